"""Calls for results (fields, files, pictures, reactions), test vectors, peers, and the referee of results and laws."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from skfem_stvk import (
    Isotropic,
    StaticResult,
    StVK,
    compare_networks,
    export_vectors,
    published_vectors,
    solve_static,
    verify_law,
    verify_results,
)
from skfem_stvk.referee.peers import load
from skfem_stvk.results import Fields, Reaction, Series, animate, plot, write_mesh, write_vtu
from skfem_stvk.results.array_files import write_text
from skfem_stvk.solvers.state_files import read_state

from .call import Call
from .small_bodies import (
    NOT_NEGATIVE,
    NUMBER,
    OPTIONAL,
    PLACE,
    POSITIVE,
    TEXT,
    call,
    costly,
    displacements,
    drawn,
    mesh,
    state,
    system,
)

BODY = mesh()
FIELD = {"field": "field|numbers"}


def _without_times(**given: Any) -> Any:
    """Return the reproducible results of the comparison of networks, that is, all but the times."""
    found = compare_networks(**given)
    return found.shares, [(row.name, row.force, row.energy, row.at_rest) for row in found.rows]


def calls() -> list[Call]:
    """Return the calls of this table."""
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
        costly(
            "export_vectors",
            _exported,
            {
                "quadrature": OPTIONAL,
                "title": frozenset({"text", "number as text", "empty text"}),
                "seed": frozenset({"0"}),
                "quiet": frozenset({"True", "False"}),
            },
            mesh=mesh(),
            material=Isotropic(2.0, 0.25),
            quadrature="exact",
            title="two",
            seed=1,
            quiet=True,
        ),
        costly(
            "export_vectors of constants",
            _exported,
            {"young": POSITIVE, "poisson": NOT_NEGATIVE},
            mesh=mesh(),
            young=2.0,
            poisson=0.25,
        ),
        call("published_vectors", lambda name: published_vectors(name).title, name="tetrahedron"),
        call(
            "verify_results",
            _judged,
            {"vectors": OPTIONAL},
            {"folder": "folder|results", "vectors": "vectors|read"},
            folder="results",
            vectors=published_vectors("tetrahedron"),
        ),
        costly(
            "verify_law",
            _judged_law,
            {"seed": frozenset({"0"}), "at": OPTIONAL, "claims": OPTIONAL, "dimension": OPTIONAL, "measure": OPTIONAL},
            at=np.diag([1.2, 1.0, 0.9]),
            claims=StVK(young=2.0, poisson=0.25),
            dimension=3,
            measure="S",
            seed=0,
        ),
    ]


@cache
def result() -> StaticResult:
    """Return a static result."""
    return solve_static(system(), steps=1, quiet=True)


def _exported(**given: Any) -> Any:
    vectors = export_vectors(**{"quiet": True} | given)
    return [vectors.arrays[name] for name in ("W", "F", "K_values")]


def _judged(folder: Any, vectors: Any) -> Any:
    """Write results into the folder `results` and return the verdict of the report on them."""
    Path("results").mkdir(exist_ok=True)
    right = published_vectors("tetrahedron").arrays
    write_text(Path("results") / "results.txt", {name: right[name] for name in ("digest", "W")})
    report = verify_results(folder, vectors)
    return report.passed, len(report.results)


def _judged_law(**given: Any) -> Any:
    """Return the verdict of the report on a stress at one deformation gradient."""

    def stress(F: Any) -> Any:
        E = (F.T @ F - np.eye(3)) / 2
        return 0.8 * np.trace(E) * np.eye(3) + 1.6 * E

    report = verify_law(**given, stress=stress)
    return report.passed, len(report.results)


def _read_again(path: Any = "again.pvd", mesh: Any = BODY, time: Any = None) -> Any:
    """Write files with a state at the time 0.5, and return the state that `read_state` returns."""
    with Series("again.pvd", []) as series:
        series.add(state(), 0.5)
    write_vtu("again.vtu", state(), [])
    return read_state(path, mesh, time)


def _series() -> Series:
    return Series("series.pvd", ["cauchy"])


def _stresses(fields: Fields) -> Callable[..., Any]:
    return lambda **given: fields.at(**given)["cauchy"]
