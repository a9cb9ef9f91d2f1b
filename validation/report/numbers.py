"""Claims of one number each, with the reference value, the tolerance and its reason."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import skfem
from scipy.sparse import issparse

from skfem_stvk import (
    BodyForce,
    ElementMesh,
    Gravity,
    Report,
    StVK,
    System,
    embedded_mesh,
    published_vectors,
    simulate,
    solve_static,
    verify,
    verify_integrator,
    verify_law,
    verify_results,
    verify_solver,
)  # fmt: skip
from skfem_stvk.referee.against import peer_candidate
from skfem_stvk.referee.self_test import self_test
from skfem_stvk.referee.vectors import PUBLISHED
from skfem_stvk.scenes.commands.referee import EMBEDDED
from skfem_stvk.solvers.dynamics.integrators import INTEGRATORS

from .. import textbook_laws
from ..statics import manufactured, turek_hron
from ..statics.meshes import Array


@dataclass(frozen=True)
class Number:
    """Computed value. Its error is relative to `expected` if `relative`, otherwise absolute."""

    name: str
    words: str
    value: float
    expected: float
    tolerance: float
    reason: str
    reference_kind: str
    source: str
    relative: bool = False
    notes: tuple[str, ...] = ()


def agreement(quick: bool) -> Iterator[Number]:
    """Yield the largest differences from scikit-fem on the embedded bracket of two materials."""
    report = verify(embedded_mesh(), EMBEDDED, quiet=True)
    reason = "round-off of two orders of summation is 1e-15 to 1e-14; the limit is a hundred times as large"
    for quantity in "WFK":
        worst = max(r.measured or 0.0 for r in report.results if r.check == "agreement" and r.quantity == quantity)
        yield Number(
            f"{quantity} on the bracket", f"{quantity} equals scikit-fem's in eight states", worst, 0.0, 1e-12, reason,
            "another code", "skfem_stvk verify",
        )  # fmt: skip
    yield _of_checks("the bracket", report, "docs/measurements/referee.md", "the referee")


def planted_faults(quick: bool) -> Iterator[Number]:
    """Yield the numbers of faults that no check detects, of idle checks, and of faults with a wrong name."""
    found = self_test(quiet=True)
    source, many = "docs/measurements/planted-faults.md", f"of {len(found.caught)}"
    none = "no exception is allowed"
    yield Number(
        "faults not caught", f"the checks detect every planted fault, {many}", len(found.missed), 0.0, 0.0, none, "mutation", source
    )
    yield Number("idle checks", "every check detects a fault that no other check detects, or names the check that it backs up",
                 len(found.idle), 0.0, 0.0, none, "mutation", source)  # fmt: skip
    wrong = sorted({*found.unnamed, *found.wrong_names})
    yield Number("faults with a wrong name", f"every planted fault gets the name of its class or no name, {many}", len(wrong), 0.0,
                 0.0, none, "mutation", "docs/measurements/named-faults.md", notes=tuple(wrong))  # fmt: skip


def _of_checks(name: str, report: Report, source: str, kind: str, *notes: str) -> Number:
    """Return the number of checks of a report that did not pass, without checks that do not apply."""
    failed = float(sum(r.outcome.value not in ("passed", "not applicable") for r in report.results))
    words = f"every check of {name} passes"
    return Number(f"{name}: checks that did not pass", words, failed, 0.0, 0.0, "no check may fail", kind, source, notes=notes)


def _named(name: str, fits: bool, printed: str, source: str) -> Number:
    """Return the number of a planted mistake: 0 if it was detected and named, 1 if not."""
    return Number(
        f"planted: {name}", "a planted mistake is detected and named", float(not fits), 0.0, 0.0, "no exception is allowed",
        "mutation", source, notes=(printed,),
    )  # fmt: skip


def laws(quick: bool) -> Iterator[Number]:
    """Yield the numbers of failed checks of the ten laws, and of wrong factors without a name."""
    source = "docs/how-to/judge-a-law.md"
    for name, law in textbook_laws.LAWS.items():
        yield _of_checks(name, verify_law(energy=law.W, stress=law.S, elasticity=law.C), source, "analytic")
    lam, mu, right = textbook_laws.LAM, textbook_laws.MU, textbook_laws.LAWS["St. Venant-Kirchhoff"]
    claims = StVK(young=mu * (3 * lam + 2 * mu) / (lam + mu), poisson=lam / 2 / (lam + mu))

    def twice_lambda(F: Array) -> Array:
        return np.asarray(right.S(F) + lam * np.trace(F.T @ F - np.eye(3)) / 2 * np.eye(3))

    mistakes: dict[str, tuple[dict[str, Any], str]] = {
        "lambda doubled": ({"stress": twice_lambda}, "lambda x 2.000, mu x 1.000"),
        "S = dW/dC": ({"energy": right.W, "stress": lambda F: right.S(F) / 2}, "stress x 0.500"),
        "C = dS/dC": ({"stress": right.S, "elasticity": lambda F: right.C(F) / 2}, "elasticity x 0.500"),
    }
    for name, (functions, called) in mistakes.items():
        naming = verify_law(**functions, claims=claims).named
        yield _named(name, naming is not None and naming.names == [called], "" if naming is None else naming.lines()[-1], source)


def judged(quick: bool) -> Iterator[Number]:
    """Yield the verdicts on a correct solver and a correct integrator, and on each of them with a mistake."""
    source = "docs/how-to/judge-a-solver.md"

    def solve(mesh: Any, material: Any, body_force: Any, boundary: Any, factor: float = 1.0) -> Array:
        load = BodyForce(lambda x, t: factor * t * body_force(x))
        prescribed = {tuple(boundary.nodes): lambda x, t: t * boundary.values.T}
        return solve_static(System(mesh, [StVK(material), load], prescribed=prescribed), steps=2, quiet=True).u

    given: Any = {"young": 1e5, "poisson": 0.3, "dimension": 2 if quick else 3, "quiet": True}
    yield _of_checks("solve_static", verify_solver(solve, **given), source, "manufactured and closed solutions")
    named = verify_solver(partial(solve, factor=0.5), **given).named
    names = [] if named is None else named.names
    yield _named("half the load", names == ["load x 0.500"], ", ".join(names), source)

    def verlet(system: System, u: Array, v: Array, dt: float, late: bool = False) -> tuple[Array, Array]:
        M = system.mass()
        v = v - dt / 2 * M.solve(system.internal_force(u))
        moved = u + dt * v
        return moved, v - dt / 2 * M.solve(system.internal_force(u if late else moved))

    momenta = ("linear momentum", "angular momentum")
    claims: Any = {"density": 1000.0, "order": 2, "conserves": momenta, "stable": 2.0, "quiet": True}
    yield _of_checks("velocity Verlet", verify_integrator(verlet, **claims), source, "closed form")
    wrong = verify_integrator(partial(verlet, late=True), **claims)
    checks = sorted({result.check for result in wrong.failures()})
    yield _named("the force of the previous step", "order" in checks, ", ".join(checks), source)


def vectors(quick: bool) -> Iterator[Number]:
    """Yield the errors of this package's W, F and K in the published test vectors."""

    def largest(value: Any) -> float:
        return float(np.abs(value.data if issparse(value) else value).max())

    for name in PUBLISHED:
        published = published_vectors(name)
        system, exact = System(published.mesh, published.term), published.model()
        for quantity, method in (("W", "energy"), ("F", "internal_force"), ("K", "tangent")):
            off = scale = 0.0
            for u in published.states.values():
                found, true = (getattr(model, method)(u) for model in (system, exact))
                off, scale = max(off, largest(found - true)), max(scale, largest(true))
            yield Number(
                f"{quantity} of {name}", f"{quantity} equals the test vectors in {len(published.states)} states",
                off / scale, 0.0, 1e-13, "round-off of sums of about ten numbers, relative to the largest value of all states",
                "analytic",
                "50 digits, docs/how-to/test-vectors.md",
            )  # fmt: skip


def round_trip(quick: bool) -> Iterator[Number]:
    """Yield the verdicts on the results that the C program of the docs computes from the published vectors of simplices."""
    with tempfile.TemporaryDirectory() as temporary:
        program = Path(temporary) / "vectors"
        source = Path(__file__).parents[2] / "docs" / "vectors.c"
        subprocess.run(["cc", "-O2", "-o", program, source], check=True, capture_output=True)
        for name in ("tetrahedron", "block", "membrane"):
            folder = published_vectors(name).save(Path(temporary) / name, text=True)
            subprocess.run([program, folder / "vectors.txt", folder / "results.txt"], check=True)
            yield _of_checks(f"the C program, {name}", verify_results(folder), "docs/how-to/test-vectors.md", "another code")


def mujoco(quick: bool) -> Iterator[Number]:
    """Yield the number of checks that MuJoCo's flex does not pass."""
    yield _peer("MuJoCo")


def felupe(quick: bool) -> Iterator[Number]:
    """Yield the number of checks that FElupe does not pass."""
    yield _peer("FElupe")


def ngsolve(quick: bool) -> Iterator[Number]:
    """Yield the number of checks that NGSolve does not pass."""
    yield _peer("NGSolve")


def _peer(name: str) -> Number:
    mesh = embedded_mesh()
    with peer_candidate(name, mesh, 1e5, 0.3) as (candidate, line):
        report = verify(mesh, young=1e5, poisson=0.3, candidate=candidate, quiet=True)
    return _of_checks(name, report, "docs/measurements/peers.md", "another code", line)


def coefficients(quick: bool) -> Iterator[Number]:
    """Yield the coefficients L of the regular tetrahedron with edges of 1 m, E = 1 Pa and nu = 0.3."""
    p = np.array([[0, 0, 0], [1, 0, 0], [0.5, np.sqrt(3) / 2, 0], [0.5, np.sqrt(3) / 6, np.sqrt(2 / 3)]]).T
    L = StVK(young=1.0, poisson=0.3).coefficients(ElementMesh(p, np.array([[0], [1], [2], [3]], dtype=np.int32)))[0]
    values = np.sort(np.unique(L.round(9)))
    for name, value, expected in zip(("adjacent", "opposite", "edge"), values, (-0.0028, 0.0198, 0.0652), strict=True):
        reason = "the published values have four decimals"
        yield Number(f"L, {name}", f"L of the regular tetrahedron, {name}", value, expected, 5.1e-5, reason, "published value",
                     "literature: Delingette's coefficients at nu = 0.3")  # fmt: skip


def richardson(values: Array, ratio: float) -> tuple[float, float, float]:
    """Return observed order, extrapolated value, and Roache's uncertainty (GCI, factor 1.25) of values from coarse to fine.

    >>> order, limit, uncertainty = richardson(np.array([5 + 3, 5 + 3 / 4, 5 + 3 / 16]), 2.0)
    >>> round(order, 6), round(limit, 6), round(uncertainty, 4)
    (2.0, 5.0, 0.0452)
    """
    coarse, middle, fine = values
    order = float(np.log(abs((coarse - middle) / (middle - fine))) / np.log(ratio))
    limit = float(fine + (fine - middle) / (ratio**order - 1))
    return order, limit, float(1.25 * abs((fine - middle) / fine) / (ratio**order - 1))


def orders_in_space(quick: bool) -> Iterator[Number]:
    """Yield the orders of the manufactured solution in space, on unstructured meshes."""
    cells = (6, 9, 13) if quick else (8, 12, 16, 24)
    errors = np.array([manufactured._errors(manufactured.moved_box(3, n)) for n in cells])
    for i, (norm, order) in enumerate(manufactured.ORDERS.items()):
        fitted = manufactured.fitted_order(1 / np.array(cells), errors[:, i])
        yield Number(
            f"order in {norm}", f"a manufactured solution converges with order {order:g} in {norm}", fitted, order, 0.15,
            "errors on unstructured meshes scatter by some percent", "itself, on other meshes", "manufactured solution",
            notes=(f"errors {', '.join(f'{e:.3e}' for e in errors[:, i])} on {', '.join(map(str, cells))} cells per side",),
        )  # fmt: skip


def orders_in_time(quick: bool) -> Iterator[Number]:
    """Yield the observed orders of all integrators by Richardson's method, for a clamped bar released under gravity."""
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 9), np.linspace(0, 0.2, 3)).with_boundaries({"wall": lambda x: x[0] == 0})
    body = System(mesh, [StVK(young=1e4, poisson=0.3, density=1000.0), Gravity((0.0, -0.2))], fixed={"wall": "xy"})
    steps = np.array([200, 400, 800]) * (1 if quick else 2)
    for name, integrator in INTEGRATORS.items():
        exact = {"rtol": 1e-10} if "rtol" in getattr(integrator, "__dataclass_fields__", {}) else {}
        values = []
        for count in steps:
            run = simulate(body, integrator(dt=0.4 / count, **exact), until=0.4, quiet=True)
            values.append(float(run.u.reshape(-1, 2)[:, 1].min()))
        order, limit, uncertainty = richardson(np.array(values), 2.0)
        yield Number(
            f"order of {name}", f"{name} has its declared order", order, float(integrator(dt=0.01).order), 0.15,
            "the next term of the error is not zero", "itself, with other steps", "Richardson, Roache 1994",
            notes=(f"lowest point {values[-1]:.8g} m in {steps[-1]} steps, limit {limit:.8g} m, uncertainty {uncertainty:.1e}",),
        )  # fmt: skip


def flag(quick: bool) -> Iterator[Number]:
    """Yield the extrapolated displacements of the flag's end with their uncertainty, compared with the published values."""
    meshes = turek_hron.MESHES[:3]
    for case in turek_hron.CASES:
        tips = np.array([turek_hron.tip(case, nx, ny) for nx, ny in meshes])
        for i, component in enumerate("xy"):
            order, limit, uncertainty = richardson(tips[:, i], 2.0)
            yield Number(
                f"{case.name}, u_{component}", f"u_{component} of the flag's end [m], extrapolated", limit, case.reference[i], 5e-3,
                "error of the extrapolation from three meshes with the observed order", "published value",
                "Turek and Hron 2006; FeatFlow's benchmark page, 392 196 unknowns", relative=True,
                notes=(f"observed order {order:.2f}; uncertainty of the finest mesh (GCI) {uncertainty:.2%}",),
            )  # fmt: skip
