"""Calls of linear solvers, static solves, motions and the referee."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix

from skfem_stvk import (
    EnergyMomentum,
    Isotropic,
    NodalLoad,
    PrecomputedResponse,
    Report,
    StaticResult,
    Stop,
    StVK,
    System,
    simulate,
    solve_static,
    verify,
)
from skfem_stvk.linear import SOLVERS, BlockJacobiCg, Kind, Petsc, SsorCg, Unknowns, choose
from skfem_stvk.linear.solver import Analysis, Factors

from .call import Call
from .small_bodies import FLAG, NOT_NEGATIVE, NUMBER, OPTIONAL, PLACE, POSITIVE, call, costly, drawn, square, system, tetrahedra

RIGHT = np.arange(1.0, 5.0)


class Springs:
    """Matrix-free operator of a chain of springs."""

    def matvec(self, v: Any) -> Any:
        """Return the forces of the springs."""
        return matrix() @ v

    def diagonal_blocks(self) -> Any:
        """Return the diagonal blocks of the vertices."""
        return matrix().diagonal()[:, None, None]


@cache
def matrix() -> csr_matrix:
    """Return the stiffness of a chain of springs."""
    return csr_matrix(2.5 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1))


@cache
def unknowns() -> Unknowns:
    """Return the unknowns of the chain."""
    K = matrix()
    return Unknowns(np.arange(4), np.zeros(4, dtype=int), K.indptr, K.indices, near_null_space=lambda: np.ones((4, 1)))


def analysis(solver: Any) -> Analysis:
    """Return the analysis of the chain."""
    found: Analysis = solver.analyse(unknowns())
    return found


@cache
def factors(solver: Any) -> Factors:
    """Return the factors of the chain."""
    return analysis(solver).factorise(Springs() if solver.matrix_free else matrix(), Kind.POSITIVE_DEFINITE)


@cache
def truss() -> System:
    """Return two bars under a force."""
    p, t = np.array([[-1.0, 0.0, 1.0], [0.0, 0.5, 0.0]]), np.array([[0, 1], [1, 2]])
    return System(
        (p, t), [StVK(young=1e3, poisson=0.25, area=0.125, density=1.0), NodalLoad([1], (0.0, -1.0))], fixed=[([0, 2], "xy")]
    )


@cache
def checked() -> Report:
    """Return the report of a verification on two tetrahedra."""
    return verify(tetrahedra(), young=2.0, poisson=0.25, quiet=True)


def calls() -> list[Call]:
    """Return the calls of this table."""
    stop = {"load": NUMBER | OPTIONAL, "turns": OPTIONAL, "states": OPTIONAL, "displacement": OPTIONAL}
    return [
        *(call(f"{kind.__name__}", kind, {"assembled": FLAG}, assembled=False) for kind in (BlockJacobiCg, SsorCg)),
        call("Petsc", Petsc, {"options": frozenset({"empty text"})}, options="-ksp_type cg"),
        call(
            "choose",
            choose,
            {"indefinite": FLAG, "n": frozenset({"0"}), "entries": frozenset({"0"})},
            {"kind": "kind"},
            solver="superlu",
            n=10,
            kind=Kind.SYMMETRIC,
            indefinite=False,
            entries=0,
        ),
        *(call(f"{solver.name}: analyse", solver.analyse, {}, {"unknowns": "unknowns"}, unknowns=unknowns()) for solver in SOLVERS),
        *(
            call(
                f"{solver.name}: factorise",
                analysis(solver).factorise,
                {},
                {"kind": "kind"},
                K=Springs() if solver.matrix_free else matrix(),
                kind=Kind.POSITIVE_DEFINITE,
            )
            for solver in SOLVERS
        ),
        *(_solve(solver) for solver in SOLVERS),
        call(
            "Unknowns",
            Unknowns,
            dict.fromkeys(
                ("indptr", "indices", "near_null_space"),
                OPTIONAL | {"empty list", "empty array", "one longer", "class", "function"},
            )
            | dict.fromkeys(("vertex", "component"), frozenset()),
            vertex=[0, 1],
            component=[0, 0],
            indptr=[0, 2, 4],
            indices=[0, 1, 0, 1],
            near_null_space=list,
        ),
        call(
            "Stop",
            lambda **given: _path(Stop(**given)),
            stop,
            {"displacement": "displacement|where|vertices|place|boundary"},
            load=0.25,
            displacement=([1], "y", -0.125),
            turns=2,
            states=2,
        ),
        costly(
            "PrecomputedResponse",
            _response,
            {
                "rtol": POSITIVE,
                "tolerance": POSITIVE,
                "checks": OPTIONAL | {"0"},
                "quiet": FLAG,
            },
            {"handle": rf"handle|{PLACE}"},
            body=system(),
            handle="tip",
            displacements=([0.0], [-0.125, 0.0, 0.125]),
            tolerance=0.0009765625,
            checks=1,
            steps=2,
            rtol=0.0009765625,
            solver="superlu",
            jobs=1,
            quiet=True,
        ),
        costly(
            "solve_static",
            _static,
            {
                "t0": NUMBER,
                "stop": OPTIONAL,
                "u0": OPTIONAL,
                "save": OPTIONAL,
                "fields": OPTIONAL | {"empty list"},
                "stability": FLAG,
                "quiet": FLAG,
                "raise_on_failure": FLAG,
                "rtol": POSITIVE,
            },
            {"fields": "field"},
            system=truss(),
            steps=2,
            method="arc-length",
            stop=Stop(states=1),
            solver="superlu",
            rtol=0.0009765625,
            u0=np.zeros(6),
            t0=0.0,
            stability=False,
            save="static.pvd",
            fields=["cauchy"],
            quiet=True,
            raise_on_failure=False,
        ),
        costly(
            "simulate",
            _motion,
            {
                "until": POSITIVE,
                "t0": NUMBER,
                "u0": OPTIONAL,
                "v0": OPTIONAL,
                "mass": OPTIONAL,
                "damping": OPTIONAL | {"empty list"},
                "every": OPTIONAL,
                "save": OPTIONAL,
                "fields": OPTIONAL | {"empty list"},
                "quiet": FLAG,
                "raise_on_failure": FLAG,
                "probes": OPTIONAL | {"empty dict"},
                "reactions": OPTIONAL | {"empty dict"},
            },
            {"probes": "probe", "reactions": "reaction", "t0": r"\bt0\b|after t =", "fields": "field"},
            system=truss(),
            integrator=EnergyMomentum(0.125),
            until=0.25,
            u0=np.zeros(6),
            v0=np.zeros(6),
            t0=0.0,
            mass="lumped",
            damping=[],
            probes={"middle": [1]},
            reactions={"left": [0]},
            save="motion.pvd",
            fields=["cauchy"],
            every=1,
            quiet=True,
            raise_on_failure=False,
        ),
        costly(
            "verify",
            _verified,
            {"quiet": FLAG, "seed": frozenset({"0"}), "candidate": OPTIONAL, "candidate_is_stvk": FLAG},
            {},
            mesh=tetrahedra(),
            material=Isotropic(2.0, 0.25),
            candidate=System(tetrahedra(), StVK(young=2.0, poisson=0.25)),
            candidate_is_stvk=True,
            seed=1,
            quiet=True,
        ),
        costly(
            "verify of constants",
            _verified,
            {"young": POSITIVE, "poisson": NOT_NEGATIVE},
            mesh=tetrahedra(),
            young=2.0,
            poisson=0.25,
        ),
        costly(
            "verify of a degree",
            _verified,
            {"young": POSITIVE, "poisson": NOT_NEGATIVE, "degree": OPTIONAL},
            mesh=tetrahedra(),
            young=2.0,
            poisson=0.25,
            degree=2,
        ),
        costly(
            "verify of boxes",
            _verified,
            {"young": POSITIVE, "poisson": NOT_NEGATIVE, "hourglass": OPTIONAL | NOT_NEGATIVE},
            mesh=square(),
            young=2.0,
            poisson=0.25,
            quadrature="one-point",
            hourglass=0.125,
        ),
        call("Report.failures", checked().failures, {"subject": OPTIONAL}, subject="skfem-stvk"),
        call(
            "Report.save",
            drawn(checked().save),
            {"folder": frozenset({"text", "number as text", "control characters", "lone surrogate"})},
            folder="report",
        ),
    ]


def _response(**given: Any) -> Any:
    answers = PrecomputedResponse(**given)
    return answers.forces, answers((0.0, 0.0625))


def _path(stop: Stop) -> Any:
    """Return load factor and displacements at the end of a path."""
    result = solve_static(truss(), steps=4, method="arc-length", stop=stop, quiet=True, raise_on_failure=False)
    return result.t, result.u


def _static(**given: Any) -> Any:
    result: StaticResult = solve_static(overwrite=True, **given)
    return result.status.value, result.t, result.u


def _motion(**given: Any) -> Any:
    run = simulate(overwrite=True, **given)
    return run.status.value, run.t, run.u


def _verified(**given: Any) -> Any:
    report = verify(**{"quiet": True} | given)
    return report.passed, len(report.results)


def _solve(solver: Any) -> Call:
    not_finite = frozenset({"NaN in it", "inf in it"})  # the outcome of the solve reports it
    legal = {"b": not_finite, "rtol": POSITIVE, "x0": OPTIONAL | not_finite, "out": OPTIONAL | not_finite}
    return Call(
        f"{solver.name}: solve",
        lambda: (factors(solver).solve, {"b": RIGHT, "rtol": 0.5**30, "x0": 0.25 * RIGHT, "out": np.zeros(4)}),
        legal,
    )
