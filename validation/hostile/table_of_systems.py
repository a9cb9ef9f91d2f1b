"""Calls of the methods of systems: energies, forces, tangents, masses, free degrees of freedom."""

from __future__ import annotations

from typing import Any

import numpy as np

from skfem_stvk import ElementMesh, ReducedSystem, StVK, System, Traction
from skfem_stvk.edges import TENSILE
from skfem_stvk.system import Supports
from skfem_stvk.terms.loads.load import Moment

from .call import Call
from .small_bodies import COMPLEX, NUMBER, OPTIONAL, call, costly, displacements, mesh, system

#: Methods with the argument `u`, and methods with the arguments `u` and `t`.
OF_U = (
    "energy",
    "foundation_force",
    "internal_force",
    "energy_and_force",
    "tangent",
    "linearize",
    "linear_operator",
    "elastic_energies",
    "round_off",
    "smallest_volume_ratio",
    "inside_out",
    "smallest_stretch",
)
OF_U_AND_T = ("external_force", "load_stiffness", "potential", "residual", "jacobian", "energies")
OF_Q_AND_T = (
    "energy",
    "internal_force",
    "tangent",
    "linearize",
    "lift_force",
    "displacements",
    "external_force",
    "load_stiffness",
    "residual",
    "jacobian",
    "potential",
)
#: Legal for flags.
YES = frozenset({"True"})
OF_U_AND_V = ("product", "energy_along", "step_limit")


def calls() -> list[Call]:
    """Return the calls of this table."""
    body, u = system(), displacements()
    time = {"t": NUMBER}
    K = body.tangent(u)
    reduced, q = ReducedSystem(body, 3, 2, quiet=True), np.array([0.25, -0.5, 0.125])
    free_dofs = body.free_dofs([0, 1])
    restricted = free_dofs.matrix(K)
    mass = body.mass()
    return [
        *(call(f"System.{name}", getattr(body, name), u=u) for name in OF_U),
        *(call(f"System.{name}", getattr(body, name), time, u=u, t=0.5) for name in OF_U_AND_T),
        *(call(f"System.{name}", getattr(body, name), u=u, v=u[::-1].copy()) for name in OF_U_AND_V),
        call(
            "System.external_force at a moment",
            lambda time, factor: body.external_force(u, Moment(time, factor)),
            {"time": NUMBER, "factor": NUMBER},
            {"time": r"\bt =|time", "factor": r"\bt =|factor"},
            time=0.5,
            factor=0.5,
        ),
        costly(
            "ReducedSystem",
            lambda **given: ReducedSystem(**given).basis,
            {
                "snapshots": OPTIONAL,
                "sampled": frozenset({"0"}),
                "times": OPTIONAL | {"one longer"},
                "size": OPTIONAL,
                "modes": OPTIONAL | {"0"},
                **dict.fromkeys(("derivatives", "quiet"), YES),
            },
            {"body": "System"},
            body=body,
            size=3,
            modes=2,
            derivatives=True,
            snapshots=u[:, None] * np.array([0.0, 0, 1, 1, 1, 1, 0, 0, 1, 1, 1, 1])[:, None],
            times=[0.0, 1.0],
            sampled=0,
            most_memory=1e9,
            quiet=True,
        ),
        *(call(f"ReducedSystem.{name}", getattr(reduced, name), time, q=q, t=0.5) for name in OF_Q_AND_T),
        call("ReducedSystem.save", lambda path: reduced.save(path), path="reduced.npz"),
        call("ReducedSystem.energy_along", reduced.energy_along, time, q=q, v=q[::-1].copy(), t=0.5),
        call("ReducedSystem.coordinates", reduced.coordinates, time, u=u, t=0.5),
        call("ReducedSystem.amounts", reduced.amounts, time, t=0.5),
        call("System.mass", body.mass, {}, {"kind": "mass|kind"}, kind="consistent"),
        call(
            "System.free_dofs",
            body.free_dofs,
            {"fixed": frozenset({"empty list", "empty dict", "empty array", "one longer"})},
            fixed=[0, 1, 4],
        ),
        _writing("energy_and_force", {"out": OPTIONAL | {"NaN in it", "inf in it"}}, u=u),
        Call("System.tangent into a matrix", lambda: (body.tangent, {"u": u, "out": K.copy()}), {"out": OPTIONAL}),
        Call(
            "System.tangent of free degrees of freedom",
            lambda: (body.tangent, {"u": u, "free": free_dofs}),
            {"free": OPTIONAL},
        ),
        Call(
            "System.jacobian of free degrees of freedom",
            lambda: (body.jacobian, {"u": u, "t": 0.5, "free": free_dofs}),
            time | {"free": OPTIONAL},
        ),
        Call(
            "System.jacobian into a matrix",
            lambda: (body.jacobian, {"u": u, "t": 0.5, "out": K.copy(), "kept": TENSILE}),
            time | {"out": OPTIONAL},
        ),
        Call("System.linearize into a matrix", lambda: (body.linearize, {"u": u, "out": K.copy()}), {"out": OPTIONAL}),
        call("System.linear_operator of tensions", lambda kept: body.linear_operator(u, kept=kept).matvec(u), kept=TENSILE),
        call("TangentOperator.prepare", lambda **given: body.linear_operator(u).prepare(**given), u=u),
        call("FreeDofs.matrix", free_dofs.matrix, {"out": OPTIONAL}, K=K, out=restricted),
        call(
            "FreeDofs.vector",
            free_dofs.vector,
            dict.fromkeys(("free", "fixed"), NUMBER | COMPLEX),
            free=np.arange(10.0),
            fixed=[0.5, 0.25],
        ),
        call("System.check_held", body.check_held, {"u": OPTIONAL}, u=u),
        call(
            "System.without",
            _left,
            {"elements": frozenset({"empty list", "empty dict", "empty array", "one longer", "text"})},
            {"elements": "region|elements|subdomain"},
            elements=[0, 3],
        ),
        call("Mass.multiply", mass.multiply, v=u),
        call("Mass.solve", mass.solve, f=u),
        call("consistent Mass.multiply", body.mass("consistent").multiply, v=u),
        call("consistent Mass.solve", body.mass("consistent").solve, f=u),
        Call("Mass.add_to", lambda: (_added, {"K": K.copy(), "factor": 0.5}), {"factor": NUMBER}),
        call(
            "Supports",
            _supports,
            {"fixed": OPTIONAL | {"empty list", "empty dict"}, "prescribed": OPTIONAL | {"empty list", "empty dict"}},
            {"fixed": "fixed|components|place|vertices", "prescribed": "prescribed|displacements"},
            mesh=body.mesh,
            fixed={"left": "xy"},
            prescribed={"right": {"x": 0.5}},
        ),
        call("Supports.values", Supports(body.mesh, {"left": "xy"}, {"right": {"x": 0.5}}).values, time, t=0.5),
    ]


def _supports(mesh: ElementMesh, fixed: Any, prescribed: Any) -> Any:
    supports = Supports(mesh, fixed, prescribed)
    return supports.held, supports.values(0.5)


def _left(elements: Any) -> Any:
    body = System(mesh(), [StVK(young=2.0, poisson=0.25), Traction("right", (0.25, 0.0))])
    body = body.without(elements)
    return body.removed, body.residual(displacements())


def _added(K: Any, factor: Any) -> Any:
    system().mass().add_to(K, factor)
    return K


def _writing(name: str, legal: Any = None, **good: Any) -> Call:
    """Return the call of a method that writes into an array; its result includes the array."""

    def written(out: Any, **given: Any) -> Any:
        found = getattr(system(), name)(**given, out=out)
        return found, out

    return Call(f"System.{name} into an array", lambda: (written, {**good, "out": np.zeros(system().ndofs)}), legal or {})
