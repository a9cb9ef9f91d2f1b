"""Data of a time step of a reduced body, as named arrays for programs in other languages."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...arguments import Array, shown
from ...errors import StvkError
from ...mesh.locations import vertices_at
from ...terms.loads.load import Moment
from .quartic import PrecomputedCoordinates

FIRST_LINE = "skfem-stvk reduced body 1"
#: Largest number of bytes of a name in UTF-8, which programs in C read into a buffer.
LONGEST = 127


class StepArray(NamedTuple):
    """Array of the layout: its sizes by name, its unit and its meaning."""

    sizes: tuple[str, ...]
    unit: str
    what: str


LAYOUT = {
    "size": StepArray(("2",), "", "r unknowns q and l amounts s of the lifts; z = (q, s) has m = r + l entries"),
    "T": StepArray(("n(n+1)(n+2)(n+3)/24",), "J", "coefficients of W, n = m + 1"),
    "mass": StepArray(("m", "m"), "kg", "M over z"),
    "stiffness": StepArray(("m", "m"), "N/m", "K at rest over z, for Rayleigh damping alpha M + beta K"),
    "loads": StepArray(("m",), "N", "constant dead loads on z"),
    "amounts": StepArray(("l",), "m", "prescribed displacements at t = 0, as amounts s of the lifts"),
    "lifts": StepArray(("l",), "", "location and component that a lift moves by s, or `prescribed`"),
    "locations": StepArray(("L",), "", "names of the locations of the mesh"),
    "starts": StepArray(("L+1",), "", "where the nodes of each location begin"),
    "nodes": StepArray(("N",), "", "nodes of the locations, from 0"),
    "positions": StepArray(("N", "d"), "m", "their positions at rest"),
    "rows": StepArray(("N", "d", "m"), "", "displacements of these nodes: u = rows z"),
    "units": StepArray(("5",), "", "units of length, mass, time, force and energy in this file"),
}


def step_data(body: PrecomputedCoordinates) -> dict[str, Array]:
    """Return the arrays of `LAYOUT`.

    Raises
    ------
    StvkError
        if a term is not a quartic, or a load depends on time or displacements: such a step needs the mesh; if the name of a
        location is no line of text of at most 127 bytes.
    """
    system, mesh = body.system, body.mesh
    if not body.quartic:
        raise StvkError("A term is no quartic; expected terms whose step does not need the mesh, such as StVK. Save as .npz.")
    changing = [type(load).__name__ for load in system.bound_loads if not (load.dead and load.steady)]
    if changing:
        raise StvkError(
            f"{', '.join(changing)}: a load depends on time or displacements; expected constant dead loads, whose step does not "
            "need the mesh. Leave it out, and push on named locations instead."
        )
    mass, rest, moment = body.mass("lumped"), np.zeros(len(body.columns.T)), Moment(0.0, 1.0, "lumped")
    lifts = [f"{name} {c}" for name, moved in system.supports.moved.items() for c in moved.components]
    count = len(body.free.fixed)
    names = sorted({*mesh.boundaries, *mesh.node_sets})
    bad = [name for name in (*names, *lifts) if not _is_line(name)]
    if bad:
        raise StvkError(
            f"The name of a location is {shown(bad[0])} ({len(bad)} such); expected one line of 1 to {LONGEST} bytes in UTF-8, "
            "with the component of a lift, that does not begin with a blank. Rename it, or save as .npz."
        )
    at = [vertices_at(mesh, name, f"location {name!r}") for name in names]
    nodes = np.concatenate([np.empty(0, dtype=np.int64), *at])
    arrays: dict[str, Any] = {
        "size": [body.size, count],
        "T": body.coefficients,
        "mass": mass.matrix,
        "stiffness": body.linearize(rest)[2],
        "loads": body.external_force(rest, moment),
        "amounts": body.prescribed_values(moment),
        "lifts": np.array(["prescribed"] * (count - len(lifts)) + lifts, dtype=str),
        "locations": np.array(names, dtype=str),
        "starts": np.cumsum([0, *map(len, at)]),
        "nodes": nodes,
        "positions": mesh.p.T[nodes],
        "rows": body.columns.reshape(mesh.nv, mesh.d, -1)[nodes],
        "units": np.array([system.units.symbol(one) for one in ("length", "mass", "time", "force", "energy")]),
    }
    return {name: np.asarray(array) for name, array in arrays.items()}


def _is_line(name: str) -> bool:
    """Return whether a name is an entry of a text array, which programs in C read as one line without leading blanks."""
    if name.splitlines() != [name] or name[0].isspace() or "\0" in name:
        return False
    try:
        return len(name.encode()) <= LONGEST
    except UnicodeEncodeError:  # surrogates
        return False
