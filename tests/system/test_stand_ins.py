"""Whatever answers the questions of a system is one: analyses ask for methods, not for a class."""

import numpy as np
import pytest
import skfem

from skfem_stvk import StVK, StvkError, System, Traction, VelocityVerlet, critical_step, modes, simulate, solve_static
from skfem_stvk.dynamics import Newmark
from skfem_stvk.system.protocol import SystemLike


def plate():
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 5), np.linspace(0, 0.5, 3))
    pulled = Traction(lambda x: x[0] == 1, (200.0, -300.0))
    return System(mesh, [StVK(young=1e4, poisson=0.3, density=1.0), pulled], fixed={lambda x: x[0] == 0: "xy"})


def asked():
    """Names of what the protocol asks for."""
    return sorted(name for name in vars(SystemLike) if not name.startswith("_"))


def stand_in(system, without=()):
    """An object of no class of ours, with methods that a system answers and one that counts."""
    calls = []

    def internal_force(self, u):
        calls.append(u)
        return system.internal_force(u)

    members = {name: property(lambda self, name=name: getattr(system, name)) for name in asked() if name not in without}
    if "internal_force" not in without:
        members["internal_force"] = internal_force
    return type("Other", (), members | {"__repr__": lambda self: "another one"})(), calls


def test_a_stand_in_is_solved_for_moved_and_looked_at_like_a_system():
    system = plate()
    other, calls = stand_in(system)
    assert not isinstance(other, System)
    mine, theirs = (solve_static(one, steps=3, solver="superlu", quiet=True) for one in (system, other))
    np.testing.assert_array_equal(mine.u, theirs.u)
    assert calls and theirs.system is other
    np.testing.assert_array_equal(mine.reaction().resultant, theirs.reaction().resultant)
    np.testing.assert_array_equal(mine.stress(), theirs.stress())
    np.testing.assert_array_equal(modes(system, 3).eigenvalues, modes(other, 3).eigenvalues)
    assert critical_step(system).step == critical_step(other).step
    for integrator in (VelocityVerlet(1e-3), Newmark(1e-2)):
        np.testing.assert_array_equal(*(simulate(one, integrator, until=0.02, quiet=True).u for one in (system, other)))


@pytest.mark.parametrize("missing", ["jacobian", "supports", "mass", "step_limit", "ndofs"])
def test_what_lacks_a_method_is_no_system(missing):
    other, _ = stand_in(plate(), without=[missing])
    for analysis in (solve_static, modes, critical_step, lambda one: simulate(one, Newmark(1e-2), until=0.1)):
        with pytest.raises(StvkError, match=r"system = another one; expected a System"):
            analysis(other)


@pytest.mark.parametrize("given", [None, "body", System, SystemLike], ids=str)
def test_classes_and_things_are_no_systems(given):
    with pytest.raises(StvkError, match="expected a System"):
        solve_static(given)
