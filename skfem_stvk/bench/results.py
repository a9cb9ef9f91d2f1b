"""What a run has measured so far."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

from ..errors import StvkError
from ..referee.case import OURS, REFERENCE
from .case import Case
from .plan import Plan
from .timing import Seconds

CSR, CONTROL, TEXTBOOK = "CSR product", "C loop", "textbook form"
QUANTITIES = ("W", "F", "W+F", "K", "W+F+K", "K v", "K v: prepare")
T = TypeVar("T")

__all__ = ["CONTROL", "CSR", "OURS", "QUANTITIES", "REFERENCE", "TEXTBOOK", "Benchmark", "ErrorOf", "Memory", "Timing"]


@dataclass(frozen=True)
class Timing:
    """Shortest and median time of a call [ns a tetrahedron]."""

    mesh: str
    nt: int
    player: str
    quantity: str
    threads: int
    dtype: str
    best: float
    median: float
    repetitions: int


@dataclass(frozen=True)
class Memory:
    """What a system holds after it was asked for `quantity`, by part [bytes]."""

    mesh: str
    nt: int
    quantity: str
    dtype: str
    parts: dict[str, int]

    @property
    def besides(self) -> int:
        """All but the pattern of K, which is the matrix's own."""
        return sum(self.parts.values()) - self.parts["pattern of K"]


@dataclass(frozen=True)
class ErrorOf:
    """Error of F or of `K v` against 50 digits, relative to the largest entry, at a strain."""

    player: str
    dtype: str
    quantity: str
    strain: float
    error: float


@dataclass
class Benchmark:
    """A run and its results, which may be a part of what was planned.

    Attributes
    ----------
    bandwidth : of a copy, bytes read and written a second.
    least_bytes : by mesh and quantity, what a call must read and write [bytes a tetrahedron], in double precision.
    first_use : time of W, F, K and K v with an empty cache of compiled kernels [s].
    not_measured : what, and why not.
    failures : what went wrong.
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

    def add(self, case: Case, player: str, quantity: str, taken: Seconds, threads: int = 1, dtype: str = "float64") -> None:
        """Keep the time of a call."""
        per_tet = 1e9 / case.mesh.nt
        times = per_tet * taken.best, per_tet * taken.median
        self.timings.append(Timing(case.name, case.mesh.nt, player, quantity, threads, dtype, *times, taken.repetitions))

    def timing(self, mesh: str, player: str, quantity: str, threads: int = 1, dtype: str = "float64") -> Timing | None:
        """The time of a call; None if it was not measured."""
        wanted = mesh, player, quantity, threads, dtype
        return next((t for t in self.timings if (t.mesh, t.player, t.quantity, t.threads, t.dtype) == wanted), None)

    def best(self, mesh: str, player: str, *quantities: str, threads: int = 1, dtype: str = "float64") -> float | None:
        """Sum of the shortest times of calls [ns a tetrahedron]; None if one was not measured."""
        found = [self.timing(mesh, player, quantity, threads, dtype) for quantity in quantities]
        return None if None in found else sum(t.best for t in found if t is not None)

    def optional(self, what: str, make: Callable[[], T]) -> T | None:
        """What `make` returns, or None and the reason kept if it is not to be had here."""
        try:
            return make()
        except StvkError as error:
            self.not_measured[what] = str(error)
            return None

    def attempt(self, what: str, step: Callable[[], object]) -> None:
        """Run a step; if it fails, what went wrong is kept, and the next ones run all the same."""
        try:
            step()
        except Exception as error:
            self.failures[what] = f"{type(error).__name__}: {error}"

    def as_dict(self) -> dict[str, Any]:
        """All of it, as JSON can hold it."""
        return asdict(self)
