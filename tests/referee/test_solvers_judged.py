"""`verify_solver` passes right solvers; each planted fault is named, and fails the check meant for it."""

import numpy as np
import pytest
import skfem

from skfem_stvk import BodyForce, StVK, StvkError, System, solve_static, verify_solver
from skfem_stvk.edges.materials import Hypothesis
from skfem_stvk.referee import solvers
from skfem_stvk.referee.results import CheckOutcome

ELEMENTS = {2: skfem.ElementTriP1, 3: skfem.ElementTetP1}


def own(mesh, material, body_force, boundary):
    prescribed = {tuple(boundary.nodes): lambda x, t: t * boundary.values.T}
    system = System(mesh, [StVK(material), BodyForce(lambda x, t: t * body_force(x))], prescribed=prescribed)
    return solve_static(system, steps=2, quiet=True).u


def stress(F, lam, mu, law):
    I = np.eye(len(F))[:, :, None, None]
    if law == "linear":
        e = (F + F.swapaxes(0, 1)) / 2 - I
        return lam * np.einsum("ii...->...", e) * I + 2 * mu * e
    E = (np.einsum("kI...,kJ...->IJ...", F, F) - I) / 2
    S = lam * np.einsum("ii...->...", E) * I + 2 * mu * E
    if law == "stiff in xy":
        S[0, 1] *= 1.3
        S[1, 0] *= 1.3
    if law == "unsymmetric":
        S[0, 1] *= 1.3
    return S if law == "S for P" else np.einsum("iM...,MJ...->iJ...", F, S)


def newton(
    *,
    law="stvk",
    lam=1.0,
    load=1.0,
    prescribed=1.0,
    at="rest",
    follows=False,
    blocked=False,
    iterations=40,
    free=True,
    signed=False,
    seed=None,
):
    """Return a solver as scikit-fem's users write it, with the given faults; K is computed by differences of P."""

    def solve(mesh, material, body_force, boundary):
        d, (lame, mu) = mesh.dim(), material.lame(Hypothesis.SOLID)
        basis = skfem.Basis(mesh, skfem.ElementVector(ELEMENTS[d]()), intorder=3)
        sign = np.sign(mesh.mapping().detA)[:, None] if signed else 1.0
        X, I = np.asarray(basis.global_coordinates()), np.eye(d)[:, :, None, None]

        def P(F):
            return sign * stress(F, lam * lame, mu, law)

        def force(u):
            field = basis.interpolate(u)
            x = X + (np.asarray(field) if at == "displaced" else 0)
            b = load * body_force(x.reshape(d, -1)).reshape(X.shape)
            if follows:
                b = b * np.linalg.det((field.grad + I).transpose(2, 3, 0, 1))
            inner = skfem.LinearForm(lambda v, w: np.einsum("iJ...,iJ...->...", w.P, v.grad)).assemble(basis, P=P(field.grad + I))
            return inner - skfem.LinearForm(lambda v, w: np.einsum("i...,i...->...", w.b, v)).assemble(basis, b=b)

        def tangent(u):
            F, h = basis.interpolate(u).grad + I, 1e-4  # central differences of a cubic: error h^2, Newton's method converges
            A = np.zeros((d, d, *F.shape))
            for k in range(d):
                for L in range(d):
                    step = np.zeros_like(F)
                    step[k, L] = h
                    A[:, :, k, L] = (P(F + step) - P(F - step)) / (2 * h)
            form = skfem.BilinearForm(lambda u, v, w: np.einsum("iJkL...,kL...,iJ...->...", w.A, u.grad, v.grad))
            return form.assemble(basis, A=A)

        nodes, values = boundary.nodes, prescribed * boundary.values
        if not free:
            nodes = mesh.boundary_nodes()
            values = np.zeros((len(nodes), d))
            values[np.isin(nodes, boundary.nodes)] = boundary.values
        dofs = (d * nodes[:, None] + np.arange(d)).ravel()
        u = basis.zeros()
        u[dofs] = values.ravel()
        u += skfem.solve(*skfem.condense(tangent(0 * u), -tangent(0 * u) @ u, D=dofs))
        if seed is not None:
            inner = np.setdiff1d(np.arange(len(u)), dofs)
            u[inner] += 0.3 * np.random.default_rng(seed).standard_normal(len(inner))
        for _ in range(iterations):
            change = skfem.solve(*skfem.condense(tangent(u), -force(u), D=dofs))
            u = u + change
            if np.abs(change).max() < 1e-9 * max(np.abs(u).max(), 1.0):
                break
        return u.reshape(-1, d).T.ravel() if blocked else u

    return solve


def judged(solve, dimension=2, **how):
    return verify_solver(solve, young=3e5, poisson=0.3, dimension=dimension, quiet=True, **how)


def checks(report):
    return {result.check for result in report.results if result.outcome is not CheckOutcome.PASSED}


def names(report):
    return report.named.names


@pytest.fixture
def small_meshes(monkeypatch):
    """Use smaller meshes, on which an order of zero still differs from an order of one."""
    monkeypatch.setattr(solvers, "LADDER", {2: (5, 7, 10), 3: (2, 3, 4)})
    monkeypatch.setattr(solvers, "SMALL", {2: 3, 3: 2})


@pytest.mark.parametrize(("solve", "dimension"), [(own, 3), (newton(), 2)], ids=["solve_static", "scikit-fem"])
def test_right_solvers_pass(solve, dimension):
    report = judged(solve, dimension)
    assert report.passed, str(report)
    assert report.named is None
    assert all("fitted" in r.scale for r in report.results if r.check == "order")


def elsewhere(mesh, material, body_force, boundary):
    """Solve from random starts on the finest mesh until the solution differs from the one from rest."""
    near, where = newton()(mesh, material, body_force, boundary), (mesh, material, body_force, boundary)
    finest = mesh.p.shape[1] > 100 and np.ptp(body_force(mesh.p), axis=1).any()
    for seed in range(40) if finest else ():
        found, more = newton(seed=seed)(*where), newton(seed=seed, iterations=41)(*where)
        if np.isfinite(found).all() and np.abs(found - more).max() < 1e-8 and 0.05 < np.abs(found - near).max() < 10:
            return found
    return near


FAULTS = {
    "load doubled": ({"load": 2.0}, {"equilibrium", "order"}, "load x 2.000"),
    "load with the wrong sign": ({"load": -1.0}, {"equilibrium", "order"}, "load x -1.000"),
    "no load": ({"load": 0.0}, {"equilibrium", "order", "reciprocity"}, "no load"),
    "a dead load that follows": ({"follows": True}, {"equilibrium", "order"}, "load per deformed volume"),
    "boundary ignored": ({"prescribed": 0.0}, {"boundary values", "rigid motion", "patch test", "order"}, "boundary ignored"),
    "boundary halved": ({"prescribed": 0.5}, {"boundary values", "rigid motion", "patch test", "order"}, "boundary x 0.500"),
    "linear strain": ({"law": "linear"}, {"rigid motion", "patch test", "equilibrium", "order"}, "linear strain"),
    "lambda doubled": ({"lam": 2.0}, {"patch test", "equilibrium", "order"}, "lambda x 2.000, mu x 1.000"),
    "components in blocks": ({"blocked": True}, {"boundary values", "rigid motion", "order"}, "components in blocks"),
    "S instead of P": ({"law": "S for P"}, {"equilibrium", "order"}, "S for P"),
    "stopped after an iteration": ({"iterations": 1}, {"equilibrium"}, None),
    "load at displaced points": ({"at": "displaced"}, {"order"}, None),
    "a free face constrained": ({"free": False}, {"patch test"}, None),
    "orientation counts": ({"signed": True, "iterations": 8}, {"patch test", "equilibrium"}, None),
    "shear in xy too stiff": ({"law": "stiff in xy"}, {"equilibrium", "order"}, None),
    "stress not symmetric": ({"law": "unsymmetric"}, {"equilibrium", "reciprocity", "symmetry"}, None),
}


@pytest.mark.few
@pytest.mark.parametrize("fault", FAULTS)
def test_planted_faults_are_caught_and_named(fault, small_meshes):
    how, caught, name = FAULTS[fault]
    report = judged(newton(**how))
    assert not report.passed and caught <= checks(report), (checks(report), report.named)
    assert names(report) == ([name] if name else []), report.named


def test_another_equilibrium_is_named(small_meshes):
    report = judged(elsewhere)
    assert checks(report) == {"order"} and names(report) == ["another equilibrium"], str(report)
    assert report.named.explanations[0].residual < 0.2 and "in balance with the load" in report.named.explanations[0].words


def test_each_check_catches_a_fault():
    """Each check catches at least one fault.

    Only the order catches loads at displaced points, and only the patch test catches a free face that is constrained.
    """
    assert set().union(*(caught for _, caught, _ in FAULTS.values())) == {
        "boundary values", "rigid motion", "patch test", "equilibrium", "symmetry", "reciprocity", "order",
    }  # fmt: skip


def raises(*_):
    raise SystemExit(3)


@pytest.mark.parametrize(
    ("solve", "words"),
    [
        (raises, "solve raised SystemExit"),
        (lambda mesh, *_: mesh.p[0], "expected the displacements of all nodes"),
        (lambda *_: None, "expected the displacements"),
        (lambda mesh, *_: np.array(["a"] * mesh.p.size), "real numbers"),
    ],
)
def test_solvers_that_return_no_solution_could_not_run(solve, words, small_meshes):
    report = judged(solve)
    assert not report.passed and all(r.outcome is CheckOutcome.COULD_NOT_RUN and words in r.reason for r in report.results)


def test_not_a_number_fails(small_meshes):
    report = judged(lambda mesh, *_: np.full(mesh.p.size, np.nan))
    assert not report.passed and not any(r.outcome is CheckOutcome.PASSED for r in report.results)
    assert "not a number" in report.named.smallest


def test_a_solver_may_change_its_arguments(small_meshes):
    def spoils(mesh, material, body_force, boundary):
        u = own(mesh, material, body_force, boundary)
        boundary.values[:] = boundary.nodes[:] = mesh.p[:] = mesh.t[:] = 0
        return u

    assert {r.check for r in judged(spoils).results if r.outcome is CheckOutcome.FAILED} <= {"order"}


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"young": -1.0}, "young"),
        ({"poisson": 0.5}, "poisson"),
        ({"dimension": 1}, "dimension"),
        ({"rtol": 0.5}, "rtol"),
        ({"solve": 3}, "solve is a int"),
    ],
)
def test_arguments_are_refused_by_name(how, words):
    with pytest.raises(StvkError, match=words):
        verify_solver(**{"solve": own, "young": 1e5, "poisson": 0.3, "quiet": True} | how)


def test_the_report_is_saved(small_meshes, tmp_path):
    report = judged(newton(load=2.0))
    report.save(tmp_path)
    assert "load x 2.000" in str(report) and "load x 2.000" in (tmp_path / "report.html").read_text()
