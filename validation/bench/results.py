"""Plans of runs, quick or full (for the page of the docs), and the results measured so far."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple, TypeVar

from skfem_stvk.errors import StvkError
from skfem_stvk.referee.case import OURS, REFERENCE
from skfem_stvk.referee.peers import PEERS

from .meshes import Specimen

CSR, CONTROL, TEXTBOOK = "CSR product", "C loop", "textbook form"
QUANTITIES = ("W", "F", "W+F", "K", "W+F+K", "K v", "K v: prepare")
#: Models of the same material that one run compares.
MODELS = (
    "StVK",
    "linear",
    "edges and TSEPs",
    "quartic springs",
    "Hookean springs",
    "neo-Hookean",
    "corotated",
    "invertible StVK",
)
MESHES = ("box 5 k", "part 5 k", "box 40 k", "part 40 k", "box 250 k", "part 250 k")
T = TypeVar("T")

__all__ = ["CONTROL", "CSR", "MODELS", "OURS", "QUANTITIES", "REFERENCE", "TEXTBOOK", "Benchmark", "ErrorOf", "Memory", "Timing"]


@dataclass(frozen=True)
class Plan:
    """Content of a run; sizes are approximate numbers of tetrahedra.

    Attributes
    ----------
    name
        Name of the run.
    boxes, parts
        Sizes of the structured meshes, and of the meshes of the part by Gmsh.
    judged
        Sizes for which the targets are judged.
    referenced
        Sizes for which scikit-fem's assembly and the textbook form are timed.
    peers
        For each timed peer, the names of its meshes. A quick run reports other peers as left to the full run.
    seconds
        Minimum time spent on each call, after warming up.
    first_use
        Whether compiling into an empty cache is timed.
    """

    name: str
    boxes: tuple[int, ...]
    parts: tuple[int, ...]
    judged: tuple[int, ...]
    referenced: tuple[int, ...]
    peers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    seconds: float = 1.0
    first_use: bool = False


QUICK = Plan(
    name="quick",
    boxes=(5_000, 40_000, 250_000),
    parts=(),
    judged=(40_000, 250_000),
    referenced=(40_000,),
    peers={"MuJoCo": ("box 40 k",), "FElupe": ("box 40 k",)},
    seconds=0.2,
)
FULL = Plan(
    name="full",
    boxes=(5_000, 40_000, 250_000, 2_000_000),
    parts=(5_000, 40_000, 250_000),
    judged=(40_000, 250_000),
    referenced=(5_000, 40_000, 250_000),
    peers=dict.fromkeys(PEERS, MESHES) | {"MuJoCo": MESHES[:4]},  # MuJoCo needs more than 10 minutes to set up 250 k tetrahedra
    first_use=True,
)


class Seconds(NamedTuple):
    """Shortest and median time of a call [s], and the number of timed calls."""

    best: float
    median: float
    repetitions: int


@dataclass(frozen=True)
class Timing:
    """Shortest and median time of a call [ns per tetrahedron]."""

    mesh: str
    nt: int
    implementation: str
    quantity: str
    threads: int
    dtype: str
    best: float
    median: float
    repetitions: int


@dataclass(frozen=True)
class Memory:
    """Memory of the parts of a system [bytes] after the computation of `quantity`."""

    mesh: str
    nt: int
    quantity: str
    dtype: str
    parts: dict[str, int]

    @property
    def without_pattern(self) -> int:
        """Memory without the pattern of K, which belongs to the matrix [bytes]."""
        return sum(self.parts.values()) - self.parts["pattern of K"]


@dataclass(frozen=True)
class ErrorOf:
    """Error of F or `K v` at a strain: the largest deviation from 50 digits, relative to the largest entry."""

    implementation: str
    dtype: str
    quantity: str
    strain: float
    error: float


@dataclass
class Benchmark:
    """Plan of a run and its results. An interrupted run has only a part of the planned results.

    Attributes
    ----------
    bandwidth
        Bytes read and written per second by a copy.
    least_bytes
        For each mesh and quantity, the data that a call must read and write in double precision [bytes per tetrahedron].
    first_use
        Time of W, F, K and K v with an empty cache of compiled kernels [s].
    not_measured
        Names of quantities and codes that could not be measured on this machine, with the reason.
    failures
        Names of failed steps, with the error.
    """

    plan: Plan
    header: dict[str, Any]
    meshes: dict[str, dict[str, int]] = field(default_factory=dict)
    timings: list[Timing] = field(default_factory=list)
    memory: list[Memory] = field(default_factory=list)
    errors: list[ErrorOf] = field(default_factory=list)
    bandwidth: float | None = None
    least_bytes: dict[str, dict[str, float]] = field(default_factory=dict)
    first_use: float | None = None
    not_measured: dict[str, str] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)
    interrupted: bool = False
    seconds: float = 0.0

    def add(
        self, specimen: Specimen, implementation: str, quantity: str, taken: Seconds, threads: int = 1, dtype: str = "float64"
    ) -> None:
        """Add the time of a call."""
        per_tet = 1e9 / specimen.mesh.nt
        times = per_tet * taken.best, per_tet * taken.median
        self.timings.append(
            Timing(specimen.name, specimen.mesh.nt, implementation, quantity, threads, dtype, *times, taken.repetitions)
        )

    def timing(self, mesh: str, implementation: str, quantity: str, threads: int = 1, dtype: str = "float64") -> Timing | None:
        """Return the time of a call; None if it was not measured."""
        wanted = mesh, implementation, quantity, threads, dtype
        return next((t for t in self.timings if (t.mesh, t.implementation, t.quantity, t.threads, t.dtype) == wanted), None)

    def best(self, mesh: str, implementation: str, *quantities: str, threads: int = 1, dtype: str = "float64") -> float | None:
        """Return the sum of the shortest times of calls [ns per tetrahedron]; None if one was not measured."""
        found = [self.timing(mesh, implementation, quantity, threads, dtype) for quantity in quantities]
        return None if None in found else sum(t.best for t in found if t is not None)

    def optional(self, what: str, make: Callable[[], T]) -> T | None:
        """Return the result of `make`. If it raises StvkError, store the message in `not_measured` and return None."""
        try:
            return make()
        except StvkError as error:
            self.not_measured[what] = str(error)
            return None

    def attempt(self, what: str, step: Callable[[], object]) -> None:
        """Run a step. If it fails, store the error in `failures`, so that the next steps still run."""
        try:
            step()
        except Exception as error:
            self.failures[what] = f"{type(error).__name__}: {error}"

    def as_dict(self) -> dict[str, Any]:
        """Return plan and results in types of JSON."""
        return asdict(self)
