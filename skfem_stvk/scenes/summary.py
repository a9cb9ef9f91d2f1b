"""Results that matter most, with units and locations: the lines that `solve` prints, and the first table of the report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..errors import StvkError
from ..mesh import ElementMesh
from ..results.monitors import point_of
from ..solvers.dynamics import Modes, Run
from ..solvers.statics import StaticResult
from ..units import UNITS
from .build import Built
from .scene_outcome import Curve, SummaryRow

#: Field of the largest stress.
STRESS = "von_mises_stress"


class LargestValue(NamedTuple):
    """Largest value of a field, and its location in words."""

    value: float
    where: str


def largest_displacement(result: StaticResult | Run) -> LargestValue:
    """Return the largest displacement of a node, on all ranks together."""
    mesh = result.system.mesh
    lengths = np.linalg.norm(result.u.reshape(-1, mesh.d), axis=1)
    value, node = _largest(mesh, lengths, mesh.node_numbers)
    here, space = np.flatnonzero((mesh.node_numbers == node) & (mesh.space.counted(np.ones(mesh.nv)) > 0)), mesh.space
    return LargestValue(value, f"node {node} at {_point(space.comm.total(mesh.p[:, here].sum(axis=1)))}")


def largest_stress(result: StaticResult | Run) -> LargestValue | None:
    """Return the largest von Mises stress, the mean of an element, on all ranks together; None if no term has a stress."""
    try:
        states = [result.state, *result.state.beside]
    except StvkError:  # springs alone, for example
        return None
    found = []
    for state in states:
        stress, missing = state.raw(STRESS)
        mesh = state.fields.mesh
        value, element = _largest(mesh, np.where(missing, -np.inf, stress), mesh.element_numbers)
        of = f" of the {mesh.kind}" if len(states) > 1 else ""
        if np.isfinite(value):
            found.append(LargestValue(value, f"mean of element {element}{of} at {point_of(mesh, element)}"))
    return max(found, default=None)


def _largest(mesh: ElementMesh, values: Array, numbers: NDArray[np.int64]) -> tuple[float, int]:
    """Return the largest of the values of all ranks, and the number of its node or element."""
    value = mesh.space.comm.most(float(values.max(initial=-np.inf)))
    return value, int(mesh.space.comm.most(float(numbers[values == value].max(initial=-1))))


def summary(
    built: Built,
    result: StaticResult | Run | Modes,
    curves: Mapping[str, Curve],
    values: Mapping[str, float],
    stress: LargestValue | None,
) -> Iterator[SummaryRow]:
    """Yield the rows of a summary."""
    units = UNITS[built.sections.units]
    if isinstance(result, Modes):
        return  # the message lists them
    displacement = largest_displacement(result)
    yield SummaryRow("largest displacement", f"{displacement.value:.6g} {units.symbol('length')}", displacement.where)
    if stress is not None:
        yield SummaryRow("largest von Mises stress", f"{stress.value:.6g} {units.symbol('stress')}", stress.where)
    if built.system.space.comm.any(built.system.supports.held.size > 0) and not getattr(result, "projected", False):
        yield SummaryRow("reaction of all supports", f"{_vector(result.reaction().resultant)} {units.symbol('force')}")
    for name in built.reactions:
        yield SummaryRow(f"reaction of {name}", f"{_vector(curves[name].values[-1])} {units.symbol('force')}")
    for state in result.contacts:
        pressure = units.symbol("stress")
        force = f"{_vector(state.resultant)} {units.symbol('force')}, pressure up to {state.pressure.max():.6g} {pressure}"
        yield SummaryRow(f"force of contact {state.name}", force, f"{state.area:.4g} {units.symbol('area')}" if state.area else "")
    for name in ("strain", "kinetic"):
        if np.isfinite(energy := values.get(f"energy.{name}", np.nan)):
            yield SummaryRow(f"{name} energy", f"{energy:.6g} {units.symbol('energy')}")


def _vector(values: Array) -> str:
    """Return components with six digits of the largest.

    >>> _vector(np.array([1.2e-11, -3.8e-08, 601.5621]))
    '(0, 0, 601.562)'
    """
    size = float(np.abs(values).max())
    rounded = np.round(values / size, 6) * size + 0.0 if 0 < size < np.inf else values
    return f"({', '.join(f'{value:.6g}' for value in rounded)})"


def _point(x: Array) -> str:
    return f"({', '.join(f'{value:.4g}' for value in x)})"
