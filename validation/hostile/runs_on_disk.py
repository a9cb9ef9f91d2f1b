"""Small runs that write a checkpoint and a series, the objects of hostile changes and interruptions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from types import SimpleNamespace
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray

from skfem_stvk import (
    EnergyMomentum,
    Gravity,
    NodalLoad,
    PrecomputedResponse,
    Stop,
    StVK,
    System,
    VelocityVerlet,
    simulate,
    solve_static,
)
from skfem_stvk.results.series import read_list
from skfem_stvk.solvers.dynamics import EdgeDamping
from skfem_stvk.solvers.dynamics import motion_checkpoint as checkpoint

from .case import Verdict, Wrong

#: Seconds between checkpoints of a motion, and their largest share of the run time: the defaults, and values for every step.
SELDOM, OFTEN = (checkpoint.EVERY, checkpoint.SHARE), (0.0, np.inf)


@dataclass(frozen=True)
class Kind:
    """Kind of a run.

    Attributes
    ----------
    system
        Function that returns the system of the run.
    make
        Function `(system, **files and options)` that runs it.
    bits
        Function that returns all numbers of the result, which must be bitwise reproducible.
    """

    system: Callable[..., System]
    make: Callable[..., Any]
    bits: Callable[[Any], list[NDArray[Any]]]

    def run(self, folder: Path, system: System | None = None, often: bool = False, **options: Any) -> Any:
        """Run and return the result. All files are written into `folder`; `often` writes a checkpoint in each step."""
        checkpoint.EVERY, checkpoint.SHARE = OFTEN if often else SELDOM
        files = {"checkpoint": folder / "saved", "save": folder / "run.pvd"}
        return self.make(self.system() if system is None else system, **files, **{"quiet": True, **options})


@dataclass(frozen=True)
class Whole:
    """Numbers, files and time [s] of an uninterrupted run."""

    bits: list[NDArray[Any]]
    files: dict[str, bytes | None]
    times: list[float]
    seconds: float


def strip(young: float = 3.0, moved: float = 0.0) -> System:
    """Return a strip in the plane, clamped at its left end."""
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 9), np.linspace(0, 0.3, 4))
    p = mesh.p + moved * (mesh.p[0] > 0.5)
    load = NodalLoad(lambda x: x[0] >= 1, lambda t: (0.0, -2e-4 * (1 + np.sin(9 * t))))
    terms: list[Any] = [StVK(young=young, poisson=0.3, density=1.0), Gravity((0.0, -0.02)), load]
    return System((p, mesh.t), terms, fixed={lambda x: x[0] == 0: "xy"})


def beam(young: float = 1e4, moved: float = 0.0) -> System:
    """Return a cantilever in the plane with a large deflection under its load."""
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 5, 21), np.linspace(0, 0.5, 3))
    p = mesh.p + moved * (mesh.p[0] > 2)
    terms: list[Any] = [StVK(young=young, poisson=0.3), NodalLoad(lambda x: x[0] >= 5, (0.0, -1.0))]
    return System((p, mesh.t), terms, fixed={lambda x: x[0] == 0: "xy"})


def bar(young: float = 1e5, moved: float = 0.0) -> System:
    """Return an inclined bar that snaps through."""
    mesh = np.array([[-1.0 - moved, 0.0], [0.0, 0.1]]), np.array([[0], [1]])
    terms: list[Any] = [StVK(young=young, poisson=0.3, area=1e-2), NodalLoad([1], (0.0, -0.4))]
    return System(mesh, terms, fixed=[([0], "xy"), ([1], "x")])


def _motion(integrator: Any, until: float, **more: Any) -> Callable[..., Any]:
    def make(system: System, until: float = until, **options: Any) -> Any:
        v0 = 0.02 * np.cos(np.arange(system.ndofs))
        v0[system.supports.held] = 0
        return simulate(system, integrator, until=until, v0=v0, probes={"tip": [5]}, every=7, **more, **options)

    return make


def _bits_of_motion(run: Any) -> list[NDArray[Any]]:
    return [run.u, run.v, np.array([run.t, run.dt]), run.ledger.rows()]


def _bits_of_path(result: Any) -> list[NDArray[Any]]:
    numbers = [[step.t, step.strain_energy, step.potential, step.smallest_volume_ratio] for step in result.history]
    words = [[result.status.value, step.status.value, step.end.value, str(step.negative)] for step in result.history]
    return [result.u, np.array([result.t]), np.array(numbers), np.array(words), *[step.u for step in result.history]]


def _response(system: System, checkpoint: Path, save: Path, quiet: bool, resume: bool = False) -> Any:
    """Compute the response of a body and save it, or load it if `resume`. Return all its numbers as `u`."""
    path, axes = checkpoint / "table.npz", [[-0.2, -0.1, 0.0, 0.1], [-0.1, 0.0, 0.2]]
    if not resume:
        checkpoint.mkdir(exist_ok=True)
        PrecomputedResponse(system, lambda x: x[0] >= 5, axes, checks=2, quiet=quiet).save(path)
    response = PrecomputedResponse.load(path, system)
    force, u = response((-0.05, 0.05))
    error = response.error
    numbers = [*response.axes, response.nodes, response.forces, force, u, error.points, error.force, error.u]
    return SimpleNamespace(u=np.concatenate([np.ravel(array) for array in numbers]), t=0.0)


#: Runs that can be interrupted and resumed.
RUNS = {
    "verlet": Kind(strip, _motion(VelocityVerlet(0.01), 0.605), _bits_of_motion),
    "energy-momentum": Kind(
        strip, _motion(EnergyMomentum(0.05, solver="superlu"), 2.025, damping=EdgeDamping(1e-3)), _bits_of_motion
    ),
    "load steps": Kind(beam, lambda system, **options: solve_static(system, steps=12, solver="superlu", **options), _bits_of_path),
    "arc length": Kind(
        bar,
        lambda system, **options: solve_static(system, steps=20, method="arc-length", stop=Stop(turns=2, states=60), **options),
        _bits_of_path,
    ),
}
#: All kinds that read files: runs that read their checkpoints, and a response.
KINDS = RUNS | {"response": Kind(beam, _response, lambda result: [result.u])}


@lru_cache
def whole(name: str) -> Whole:
    """Return the data of the uninterrupted run of this kind. Each process runs it once."""
    kind = KINDS[name]
    with TemporaryDirectory() as folder:
        kind.run(Path(folder))  # compiles the kernels, or loads them from disk
        begin = perf_counter()
        bits = kind.bits(kind.run(Path(folder), often=True))
        seconds = perf_counter() - begin
        return Whole(bits, *files_of(Path(folder)), seconds)


def files_of(folder: Path) -> tuple[dict[str, bytes | None], list[float]]:
    """Return the files by name and the times of the series.

    Reproducible files (.vtu and .csv) have their contents, other files have None.
    """
    found = {str(path.relative_to(folder)): path for path in sorted(folder.rglob("*")) if path.is_file()}
    contents = {name: path.read_bytes() if path.suffix in (".vtu", ".csv") else None for name, path in found.items()}
    return contents, [t for t, _ in read_list(folder / "run.pvd")] if "run.pvd" in found else []


def check_same(name: str, result: Any, folder: Path | None) -> None:
    """Raise `Wrong` unless the result and the files are bitwise equal to those of an uninterrupted run."""
    expected, bits = whole(name), KINDS[name].bits(result)
    if len(bits) != len(expected.bits) or not all(map(np.array_equal, bits, expected.bits)):
        raise Wrong(Verdict.SILENT, "the result differs from the result of an uninterrupted run; expected equal bits")
    if folder is None:
        return
    files, times = files_of(folder)
    if times != expected.times:
        raise Wrong(Verdict.LOSS, f"number of states in the series = {len(times)}; expected {len(expected.times)}: {times}")
    if files.keys() != expected.files.keys():
        raise Wrong(Verdict.LOSS, f"missing or additional files: {sorted(files.keys() ^ expected.files.keys())}")
    changed = [name for name in files if files[name] != expected.files[name]]
    if changed:
        raise Wrong(Verdict.LOSS, f"files with other contents: {changed}")
