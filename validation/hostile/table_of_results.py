"""Calls of results: fields, files, pictures, reactions; and of the referee and its company."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from skfem_stvk import StaticResult, StVK, compare_networks, solve_static
from skfem_stvk.peers import load
from skfem_stvk.results import Fields, Reaction, Series, animate, plot, write_mesh, write_vtu
from skfem_stvk.results.state_files import read_state

from .call import Call
from .small_bodies import NUMBER, OPTIONAL, PLACE, POSITIVE, TEXT, call, displacements, drawn, mesh, state, system

BODY = mesh()
FIELD = {"field": "field|numbers"}


def _without_times(**given: Any) -> Any:
    """What the comparison of networks found, but for what differs from call to call."""
    found = compare_networks(**given)
    return found.shares, [(row.name, row.force, row.energy, row.at_rest) for row in found.rows]


def calls() -> list[Call]:
    """All of them."""
    u, fields = displacements(), Fields(mesh(), list(system().elastic_terms))
    forces = np.arange(12.0)
    reaction = Reaction.of(mesh(), u, forces, [0, 3])
    picture = {"scale": NUMBER, "label": TEXT | OPTIONAL, "length_unit": TEXT, "path": OPTIONAL, "backend": OPTIONAL}
    film = {"scale": NUMBER, "label": TEXT | OPTIONAL, "length_unit": TEXT, "fps": POSITIVE}
    values = np.arange(4.0)
    return [
        call("Fields", Fields, {}, {"terms": "terms"}, mesh=mesh(), terms=list(system().elastic_terms)),
        call("compare_networks", _without_times, {}, {"law": "law|material"}, mesh=mesh(), law=StVK(young=2.0, poisson=0.25), u=u),
        call("Fields.at", _stresses(fields), {"v": OPTIONAL}, u=u, v=u),
        call("State by name", lambda name: state()[name], {}, {"name": "field"}, name="cauchy"),
        call("State.at_points", lambda name: state().at_points(name), {}, {"name": "field"}, name="cauchy"),
        call(
            "State.at_nodes",
            state().at_nodes,
            {"region": OPTIONAL},
            {"name": "field", "region": PLACE},
            name="cauchy",
            region="half",
        ),
        call("State.raw", state().raw, {}, {"name": "field"}, name="cauchy"),
        call(
            "plot",
            drawn(plot),
            picture,
            FIELD,
            state=state(),
            field="von_mises",
            scale=2.0,
            label="text",
            length_unit="mm",
            path="picture.svg",
            backend="matplotlib",
        ),
        call(
            "plot of numbers",
            drawn(lambda field: plot(state(), field, backend="matplotlib")),
            {"field": frozenset({"NaN in it", "inf in it", "one masked"})},
            FIELD,
            field=values,
        ),
        call(
            "animate",
            drawn(animate),
            film,
            FIELD,
            series=[(0.0, state()), (1.0, state())],
            path="film.gif",
            field="displacement",
            scale=2.0,
            label="text",
            length_unit="mm",
            fps=20.0,
        ),
        call(
            "write_vtu",
            write_vtu,
            {"fields": frozenset({"empty list"})},
            {"fields": "field"},
            path="state.vtu",
            state=state(),
            fields=["cauchy"],
        ),
        call("write_mesh", write_mesh, path="mesh.vtu", mesh=mesh()),
        call(
            "read_state",
            _read_again,
            {"time": OPTIONAL | POSITIVE},
            {"mesh": r"mesh|\b[pt]\b"},
            mesh=(mesh().p, mesh().t),
            time=0.5,
        ),
        call("read_state of a path", _read_again, {}, {"path": "path|file|state"}, path="again.vtu"),
        call(
            "Series",
            Series,
            {"fields": OPTIONAL | {"empty list"}, "resume": frozenset({"True"}), "until": NUMBER | {"inf"}},
            {"fields": "field"},
            path="series.pvd",
            fields=["cauchy"],
            resume=False,
            until=1.0,
        ),
        Call("Series.add", lambda: (_series().add, {"state": state(), "t": 0.5}), {"t": NUMBER}),
        Call("Series.cut", lambda: (_series().cut, {"t": 0.5}), {"t": NUMBER | {"inf", "-inf"}}),
        call(
            "Reaction.of",
            Reaction.of,
            {"vertices": frozenset({"one longer"})},
            {"vertices": "vert"},
            mesh=mesh(),
            u=u,
            forces=forces,
            vertices=[0, 3],
        ),
        call("Reaction.moment", reaction.moment, {"about": OPTIONAL}, about=[0.0, 1.0]),
        Call("StaticResult.stress", lambda: (result().stress, {"measure": "pk2", "at": "nodes"}), {}, {"measure": "field|measure"}),
        Call("StaticResult.reaction", lambda: (result().reaction, {"where": "left"}), {"where": OPTIONAL}, {"where": PLACE}),
        Call(
            "StaticResult.save",
            lambda: (result().save, {"path": "static.vtu", "fields": ["cauchy"]}),
            {"fields": frozenset({"empty list"})},
            {"fields": "field"},
        ),
        Call(
            "StaticResult.plot",
            lambda: (drawn(result().plot), {"field": "von_mises_stress", "backend": "matplotlib"}),
            {"backend": OPTIONAL},
            FIELD,
        ),
        call("peers.load", load, {}, {"name": "peer"}, name="FElupe"),
    ]


@cache
def result() -> StaticResult:
    """A static result."""
    return solve_static(system(), steps=1, quiet=True)


def _read_again(path: Any = "again.pvd", mesh: Any = BODY, time: Any = None) -> Any:
    """What is read of files with a state at 0.5."""
    with Series("again.pvd", []) as series:
        series.add(state(), 0.5)
    write_vtu("again.vtu", state(), [])
    return read_state(path, mesh, time)


def _series() -> Series:
    return Series("series.pvd", ["cauchy"])


def _stresses(fields: Fields) -> Callable[..., Any]:
    return lambda **given: fields.at(**given)["cauchy"]
