"""Analyses call the methods of the given system, so that subclasses work; other objects are refused."""

from types import SimpleNamespace

import numpy as np
import pytest
import skfem

from skfem_stvk import StVK, StvkError, System, Traction, VelocityVerlet, critical_step, modes, simulate, solve_static
from skfem_stvk.solvers.dynamics import Newmark


class Counting(System):
    """System that counts evaluations of its force."""

    calls = 0

    def internal_force(self, u, t=0.0):
        self.calls += 1
        return super().internal_force(u, t)


def plate(kind=System):
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 5), np.linspace(0, 0.5, 3))
    pulled = Traction(lambda x: x[0] == 1, (200.0, -300.0))
    return kind(mesh, [StVK(young=1e4, poisson=0.3, density=1.0), pulled], fixed={lambda x: x[0] == 0: "xy"})


def test_analyses_and_results_of_a_subclass_are_those_of_a_system():
    system, other = plate(), plate(Counting)
    mine, theirs = (solve_static(one, steps=3, solver="superlu", quiet=True) for one in (system, other))
    np.testing.assert_array_equal(mine.u, theirs.u)
    assert other.calls and theirs.system is other
    np.testing.assert_array_equal(mine.reaction().resultant, theirs.reaction().resultant)
    np.testing.assert_array_equal(mine.stress(), theirs.stress())
    np.testing.assert_array_equal(modes(system, 3).eigenvalues, modes(other, 3).eigenvalues)
    assert critical_step(system).step == critical_step(other).step
    for integrator in (VelocityVerlet(1e-3), Newmark(1e-2)):
        np.testing.assert_array_equal(*(simulate(one, integrator, until=0.02, quiet=True).u for one in (system, other)))


@pytest.mark.parametrize("given", [None, "body", System, SimpleNamespace(ndofs=2, mesh=None)], ids=str)
def test_other_objects_are_refused(given):
    for analysis in (solve_static, modes, critical_step, lambda one: simulate(one, Newmark(1e-2), until=0.1)):
        with pytest.raises(StvkError, match=r"system = .*; expected a System"):
            analysis(given)
