"""The rigid motions of the parts of a divided body save iterations of conjugate gradients, and are solved for exactly."""

import numpy as np
import pytest
import skfem
from divided import Division, combined, separate_threads

from skfem_stvk import ElementMesh, LinearBackwardEuler, StVK, System, simulate
from skfem_stvk.linear import BlockJacobiCg, Kind, Outcome, Unknowns, part_cg
from skfem_stvk.linear.rigid_parts import RigidParts, pseudo_inverse
from skfem_stvk.linear.space import Space
from skfem_stvk.system.operator import FreeOperator
from skfem_stvk.system.rigid import rigid_modes

__all__ = ["separate_threads"]


def block(length, width):
    axis = np.linspace(0, 1, width + 1)
    return ElementMesh.of(skfem.MeshTet.init_tensor(np.linspace(0, length / width, length + 1), axis, axis))


def stiff(mesh, young, **others):
    return System(mesh, StVK(young=young, poisson=0.3, **others))


def free_of(system, held):
    """Return the free degrees of freedom, if those of nodes with x = 0 are constrained, or none."""
    return system.free_dofs(np.flatnonzero(np.repeat(system.mesh.p[0] == 0, 3)) if held else np.empty(0, dtype=int))


def factors_of(system, held=True, coarse=True):
    """Return the factors of K at rest, and the free degrees of freedom."""
    free = free_of(system, held)
    modes = (lambda: rigid_modes(system.mesh.p.T, system.space)[free.free]) if coarse else None
    unknowns = Unknowns(*np.divmod(free.free, 3), near_null_space=modes)
    K = FreeOperator(system.linear_operator(np.zeros(system.ndofs)), free)
    return BlockJacobiCg().analyse(unknowns).factorise(K, Kind.SYMMETRIC), free


def test_four_parts_take_less_than_half_of_the_iterations(separate_threads):
    """A body of 6000 unknowns; solutions have the same bits at nodes that parts share."""
    body = Division(block(40, 6), "strips", parts=4)
    b = np.random.default_rng(5).standard_normal(body.mesh.p.size)

    def solve(system, dofs):
        found = {}
        for coarse in (False, True):
            factors, free = factors_of(system, coarse=coarse)
            solution = factors.solve(b[dofs][free.free], 1e-8)
            x = np.zeros(system.ndofs)
            x[free.free] = solution.x
            found[coarse] = x, solution.iterations, solution.outcome
        return found

    parts = body.only_parts(solve, stiff)
    without, with_it = (combined([(dofs, own[coarse][0]) for dofs, own in parts], (len(b), 1)) for coarse in (False, True))
    assert {own[coarse][2] for _, own in parts for coarse in (False, True)} == {Outcome.SOLVED}
    assert abs(with_it - without).max() < 1e-6 * abs(without).max()
    ((before, after),) = {(own[False][1], own[True][1]) for _, own in parts}
    assert part_cg.LONG < after < before / 2


@pytest.mark.parametrize("held", [True, False], ids=["held", "free"])
@pytest.mark.parametrize("how", ["strips", "random"])
def test_forces_of_rigid_motions_of_parts_are_solved_exactly(held, how, separate_threads):
    """K of a free body is singular: the solution is then a motion with the same forces."""
    amounts = np.random.default_rng(6).standard_normal((3, 6))

    def solve(system, dofs):
        factors, free = factors_of(system, held)
        search, space = factors._search, system.space
        coarse = search._rigid_parts(rigid_modes(system.mesh.p.T, space)[free.free])
        x, y = np.zeros(system.ndofs), np.zeros(system.ndofs)
        coarse._add_motions(amounts, x)
        force = space.share(search._of_part(0.0, x).copy())
        work = coarse.add(space.total(coarse.force(force)), y)
        K = system.linear_operator(np.zeros(system.ndofs))
        return np.stack([x, y, K @ x, K @ y], axis=1), space.total(coarse.force(force)) @ amounts.ravel() - work

    parts = Division(block(6, 2), how).only_parts(solve, stiff)
    x, y, Kx, Ky = combined([(dofs, own) for dofs, (own, _) in parts], (3 * 7 * 9, 4)).T
    fields = (x, y) if held else (Kx, Ky)
    assert abs(fields[0]).max() > 0.1
    np.testing.assert_allclose(*fields, rtol=0, atol=1e-9 * abs(fields[0]).max())
    assert all(abs(error) < 1e-9 * abs(Kx @ x) for _, (_, error) in parts)


def test_time_steps_that_start_near_their_solution_set_up_no_coarse_space(separate_threads, monkeypatch):
    monkeypatch.setattr(part_cg, "RigidParts", None)

    def move(system, dofs):
        step = LinearBackwardEuler(dt=0.02, solver="block-jacobi-cg")
        return simulate(system, step, until=0.1, v0=np.sin(dofs), quiet=True).iterations / 5

    found = Division(block(6, 2), "strips").only_parts(move, lambda *of: stiff(*of, density=1.0))
    assert all(0 < iterations < part_cg.LONG / 5 for _, iterations in found)


def test_the_motions_of_a_part_with_one_node_are_dependent():
    """E of one node with stiffness k that is free, far from the centre: rotations are translations of it."""
    rotations = np.array([[0.0, 3, -2], [-3, 0, 1], [2, -1, 0]])
    coarse = RigidParts(rotations, np.empty(0, dtype=np.int64), Space(3), lambda v: 5.0 * v)
    out = np.zeros(3)
    assert coarse.add(coarse.force(np.array([1.0, 2, 3])), out) == pytest.approx(14 / 5)
    np.testing.assert_allclose(out, [0.2, 0.4, 0.6], rtol=1e-12)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_matrix_that_is_not_finite_has_no_inverse(bad):
    assert not pseudo_inverse(np.array([[1.0, bad], [bad, 1.0]])).any()


def test_an_indefinite_matrix_has_no_inverse_and_eigenvalues_that_are_zero_are_left_out():
    assert not pseudo_inverse(np.array([[1.0, 2.0], [2.0, 1.0]])).any()  # eigenvalues 3 and -1
    np.testing.assert_allclose(pseudo_inverse(np.ones((2, 2))), np.full((2, 2), 1 / 4), rtol=1e-14)
