"""Targets, their verdicts, and the growth of time and memory with the mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from .meshes import Specimen
from .results import CONTROL, CSR, OURS, REFERENCE, Benchmark

Measure = Callable[[Benchmark, str], float | None]


@dataclass(frozen=True)
class Target:
    """Target for a number: at most `limit`, or at least `limit` if `at_least`. The number `moonshot` is a stricter limit.

    `measure` returns the number for the name of a mesh; None if it was not measured. `where` selects the meshes: 'judged' for the
    plan's judged sizes, 'largest' for the largest judged size. 'run' stands for one number of the whole run; the mesh's name is
    then empty.
    """

    what: str
    limit: float
    measure: Measure
    moonshot: float | None = None
    at_least: bool = False
    where: str = "judged"

    def meets(self, value: float, limit: float) -> bool:
        return value >= limit if self.at_least else value <= limit

    def missed_by(self, value: float) -> float:
        """Return the distance from the limit as a fraction of the limit; 0 if the limit is met."""
        off = 1 - value / self.limit if self.at_least else value / self.limit - 1
        return max(off, 0.0)


@dataclass(frozen=True)
class TargetVerdict:
    """Target with its measured values by mesh. The worst value decides."""

    target: Target
    values: dict[str, float]

    @property
    def worst(self) -> float | None:
        worst = min if self.target.at_least else max
        return worst(self.values.values()) if self.values else None

    @property
    def met(self) -> bool | None:
        """Whether the worst value meets the limit; None if nothing was measured."""
        return None if self.worst is None else self.target.meets(self.worst, self.target.limit)

    @property
    def moonshot(self) -> bool | None:
        """Whether the worst value meets the moonshot; None if nothing was measured or the target has no moonshot."""
        if self.worst is None or self.target.moonshot is None:
            return None
        return self.target.meets(self.worst, self.target.moonshot)

    def in_words(self) -> str:
        """Return the verdict as text.

        >>> target = Target("time", 2.0, lambda results, mesh: None)
        >>> [TargetVerdict(target, values).in_words() for values in ({}, {"a": 2.0}, {"a": 1.0, "b": 2.5})]
        ['not measured', 'met', 'missed by 25 %']
        """
        if self.worst is None:
            return "not measured"
        return "met" if self.met else f"missed by {100 * self.target.missed_by(self.worst):.2g} %"


def verdicts(results: Benchmark) -> list[TargetVerdict]:
    """Return each target with the values measured so far."""
    found = []
    for target in TARGETS:
        measured = {mesh: target.measure(results, mesh) for mesh in _meshes(results, target)}
        found.append(TargetVerdict(target, {mesh: value for mesh, value in measured.items() if value is not None}))
    return found


def judged(results: Benchmark) -> list[str]:
    """Return the names of the measured meshes for which targets are judged."""
    sizes = results.plan.judged
    names = [Specimen(kind, size).name for size in sizes for kind in ("box", "part")]
    return [name for name in names if name in results.meshes]


def _meshes(results: Benchmark, target: Target) -> list[str]:
    if target.where == "run":
        return [""]
    largest = Specimen("", max(results.plan.judged)).name
    return [name for name in judged(results) if target.where == "judged" or name.endswith(largest)]


def over(above: tuple[str, ...], below: tuple[str, ...], threads: int = 1) -> Measure:
    """Return a measure for the ratio of two times, each a sum over quantities of one implementation.

    `threads` is the number of threads of the denominator.
    """

    def ratio(results: Benchmark, mesh: str) -> float | None:
        first, second = results.best(mesh, *above), results.best(mesh, *below, threads=threads)
        return None if first is None or second is None else first / second

    return ratio


def bytes_per_tet(results: Benchmark, mesh: str, quantity: str) -> float | None:
    """Return the memory of a system in double precision without the pattern of K [bytes per tetrahedron]."""
    wanted = mesh, quantity, "float64"
    return next((m.without_pattern / m.nt for m in results.memory if (m.mesh, m.quantity, m.dtype) == wanted), None)


def slope(sizes: Sequence[float], amounts: Sequence[float]) -> float | None:
    """Return the exponent `s` of `amount ~ size^s`, fitted to the logarithms; None for fewer than two sizes.

    >>> round(slope([10, 100, 1000], [3, 300, 30000]), 12)
    2.0
    """
    return float(np.polyfit(np.log(sizes), np.log(amounts), 1)[0]) if len(set(sizes)) > 1 else None


def of_time(results: Benchmark, quantity: str) -> float | None:
    """Return the growth exponent of the time of a call over the boxes, on one thread in double precision."""
    found = [results.timing(mesh, OURS, quantity) for mesh in results.meshes if mesh.startswith("box")]
    times = [timing for timing in found if timing is not None]
    return slope([t.nt for t in times], [t.best * t.nt for t in times])


def of_memory(results: Benchmark, quantity: str) -> float | None:
    """Return the growth exponent of the memory of a system without the pattern of K, over the boxes."""
    entries = [m for m in results.memory if m.mesh.startswith("box") and (m.quantity, m.dtype) == (quantity, "float64")]
    return slope([m.nt for m in entries], [m.without_pattern for m in entries])


PRODUCT, WF, K = (CSR, "K v"), (OURS, "W+F"), (OURS, "K")
TARGETS = (
    Target("W + F, in CSR products", 1.3, over(WF, PRODUCT), moonshot=0.8),
    Target("W + F, of the C loop's F", 0.85, over(WF, (CONTROL, "F"))),
    Target("K into CSR, in CSR products", 7, over(K, PRODUCT), moonshot=4),
    Target("K into CSR, of the C loop's K", 0.55, over(K, (CONTROL, "K"))),
    Target("K v applied without K, in CSR products", 1.5, over((OURS, "K v"), PRODUCT), moonshot=1),
    Target("W + F against scikit-fem's W and F", 25, over((REFERENCE, "W", "F"), WF), at_least=True),
    Target("F against scikit-fem's F", 25, over((REFERENCE, "F"), (OURS, "F")), at_least=True),
    Target("K against scikit-fem's", 130, over((REFERENCE, "K"), K), moonshot=250, at_least=True),
    Target("K against FElupe's", 25, over(("FElupe", "K"), K), at_least=True),
    Target("K against DOLFINx's", 15, over(("DOLFINx", "K"), K), at_least=True),
    Target("F against MuJoCo's", 3, over(("MuJoCo", "F"), (OURS, "F")), at_least=True),
    Target("F, 2 threads against 1", 1.6, over((OURS, "F"), (OURS, "F"), 2), 1.9, at_least=True, where="largest"),
    Target("K, 2 threads against 1", 1.6, over(K, K, 2), 1.9, at_least=True, where="largest"),
    Target("growth of the time of W + F, exponent", 1.08, lambda results, _: of_time(results, "W+F"), where="run"),
    Target("growth of the time of K, exponent", 1.08, lambda results, _: of_time(results, "K"), where="run"),
    Target("growth of memory for F, exponent", 1.02, lambda results, _: of_memory(results, "F"), where="run"),
    Target("growth of memory for F and K, exponent", 1.02, lambda results, _: of_memory(results, "F and K"), where="run"),
    Target("memory for F, bytes per tet", 400, partial(bytes_per_tet, quantity="F")),
    Target("memory for F and K besides K and its pattern", 700, partial(bytes_per_tet, quantity="F and K")),
    Target("setup, in assemblies of K", 60, over((OURS, "setup of K"), K), moonshot=20),
    Target("first use with an empty cache, s", 20, lambda results, _: results.first_use, where="run"),
)
