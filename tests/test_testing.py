"""The assertions for other packages pass correct models, catch planted faults, and describe each failure."""

import numpy as np
import pytest
from bodies import MESHES, box

from skfem_stvk import MaterialError, NeoHookean, StVK, StvkError, System
from skfem_stvk.referee.results import CheckOutcome
from skfem_stvk.testing import Inconsistent, assert_consistent

MESH = box(3)
OTHER = NeoHookean(young=2.0, poisson=0.3)


class Changed:
    """Model with some of its methods changed."""

    def __init__(self, terms, **changes):
        body = System(MESH, terms)
        for name in ("energy", "internal_force", "tangent"):
            own, change = getattr(body, name), changes.get(name, lambda value, u: value)
            setattr(self, name, lambda u, own=own, change=change: change(own(u), u))


def checks_of(report):
    return {result.check for result in report.failures()}


def test_a_law_without_claims_is_checked_for_properties_of_every_law():
    report = assert_consistent(System(MESH, OTHER), MESH)
    passed = {result.check for result in report.results if result.outcome is CheckOutcome.PASSED}
    every = {"derivatives", "memory", "invariance", "balance", "symmetry", "rigid modes", "no further zero mode", "patch test"}
    assert passed == every
    assert {result.subject for result in report.results} == {"candidate"}


class Logarithmic:
    """Bars along the edges of segments, with the energy `(log l/L)^2 L/2`, without a tangent."""

    def __init__(self, mesh):
        self.mesh = mesh

    def edges(self, u):
        x = self.mesh.p + u.reshape(-1, self.mesh.d).T
        edge, rest = (p[:, self.mesh.t[1]] - p[:, self.mesh.t[0]] for p in (x, self.mesh.p))
        return edge, np.linalg.norm(edge, axis=0), np.linalg.norm(rest, axis=0)

    def energy(self, u):
        _, now, rest = self.edges(u)
        return float((np.log(now / rest) ** 2 * rest / 2).sum())

    def internal_force(self, u):
        edge, now, rest = self.edges(u)
        pull, F = edge * np.log(now / rest) * rest / now**2, np.zeros_like(self.mesh.p)
        np.add.at(F.T, self.mesh.t[1], pull.T)
        np.add.at(F.T, self.mesh.t[0], -pull.T)
        return F.T.ravel()


@pytest.mark.parametrize("name", ["triangles", "segments", "membrane", "cable"])
def test_a_law_is_judged_on_meshes_of_all_dimensions(name):
    mesh = MESHES[name]
    model = Logarithmic(mesh) if mesh.k == 1 else System(mesh, OTHER)
    report = assert_consistent(model, mesh)
    assert {"derivatives", "invariance"} <= {r.check for r in report.results if r.outcome is CheckOutcome.PASSED}


def test_the_claim_to_be_st_venant_kirchhoff_is_a_material():
    body = System(MESH, StVK(young=2.0, poisson=0.3))
    assert "agreement" in {r.check for r in assert_consistent(body, MESH, young=2.0, poisson=0.3).results if r.measured is not None}
    with pytest.raises(Inconsistent, match="failed 6 of 8: agreement, F of candidate against scikit-fem"):
        assert_consistent(body, MESH, young=2.0, poisson=0.31)
    with pytest.raises(MaterialError, match="poisson"):
        assert_consistent(body, MESH, young=2.0)


INNER = 3 * int(np.flatnonzero((np.abs(MESH.p - 0.5) < 0.3).all(axis=0))[0])


def pulled(F, u):
    """Return F with equal and opposite forces added to one inner node and a neighbour, along the line between them.

    The forces rotate with the body.
    """
    x = (MESH.p.T.ravel() + u).reshape(-1, 3)
    a, b = INNER // 3, int(MESH.t[:, (MESH.t == INNER // 3).any(axis=0)].max())
    F = F.reshape(-1, 3).copy()
    F[a] += 0.01 * (x[b] - x[a])
    F[b] -= 0.01 * (x[b] - x[a])
    return F.ravel()


def with_negative_stiffness(K, u):
    """Return K with twice the stiffness of one motion subtracted, so that its stiffness becomes negative."""
    v = np.random.default_rng(7).standard_normal(len(u))
    Kv = K @ v
    return K.toarray() - 2 * np.outer(Kv, Kv) / (v @ Kv)


@pytest.mark.parametrize(
    ("changes", "caught"),
    [
        ({"internal_force": lambda F, u: 2 * F}, {"derivatives"}),
        ({"tangent": lambda K, u: K + 0.01 * abs(K)}, {"derivatives", "rigid modes"}),
        ({"tangent": lambda K, u: K + 0.01 * np.triu(np.ones(K.shape))}, {"symmetry"}),
        ({"energy": lambda W, u: W + u[0]}, {"derivatives", "invariance"}),
        ({"internal_force": lambda F, u: F + np.eye(len(F))[1]}, {"balance"}),
        ({"internal_force": pulled}, {"patch test"}),
        ({"internal_force": lambda F, u: F * np.nan}, {"derivatives", "invariance", "balance", "patch test"}),
        ({"tangent": with_negative_stiffness}, {"derivatives", "no further zero mode"}),
    ],
)
def test_faults_planted_in_another_law_are_caught(changes, caught):
    with pytest.raises(Inconsistent) as failure:
        assert_consistent(Changed(OTHER, **changes), MESH)
    assert caught <= checks_of(failure.value.report)


def test_two_materials_are_no_homogeneous_body():
    half = MESH.nt // 2
    terms = [
        NeoHookean(young=2.0, poisson=0.3, region=np.arange(half)),
        NeoHookean(young=9.0, poisson=0.2, region=np.arange(half, MESH.nt)),
    ]
    with pytest.raises(Inconsistent) as failure:
        assert_consistent(System(MESH, terms), MESH)
    assert checks_of(failure.value.report) == {"patch test"}
    assert assert_consistent(System(MESH, terms), MESH, homogeneous=False).passed


def test_the_text_of_a_failure_has_a_line_for_each_kind_and_no_control_characters():
    def broken(F, u):
        raise RuntimeError("first line\nsecond \x1b[31mred\x1b[0m ]]> [bold]")

    with pytest.raises(Inconsistent) as failure:
        assert_consistent(Changed(OTHER, internal_force=broken, tangent=lambda K, u: 2 * K), MESH, seed=3)
    first, *lines = str(failure.value).splitlines()
    assert first == "Changed is not consistent: 0 of 48 checks failed, 30 could not run (seed 3)"
    assert all(line.startswith(("failed", "could not run: ")) for line in lines) and len(lines) == 5
    assert str(failure.value).replace("\n", "").isprintable() and "first line second \\x1b[31mred" in lines[0]


def test_invalid_models_and_arguments_are_refused():
    with pytest.raises(StvkError, match="of type int, has none of energy, internal_force, tangent"):
        assert_consistent(3, MESH)
    with pytest.raises(StvkError, match="homogeneous = 'no'; expected True or False"):
        assert_consistent(System(MESH, OTHER), MESH, homogeneous="no")
    with pytest.raises(StvkError, match="seed = -1; expected a whole number from 0"):
        assert_consistent(System(MESH, OTHER), MESH, seed=-1)
