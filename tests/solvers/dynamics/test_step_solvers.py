"""Default solvers of implicit steps: conjugate gradients with SSOR, on the edges of one term or on the matrix of several."""

from dataclasses import replace

import motions
import numpy as np
import pytest
from skfem import MeshTet, MeshTri
from slow import slow

from skfem_stvk import Gravity, Pressure, StVK, StvkError, System, VolumePenalty
from skfem_stvk.linear import BlockJacobiCg, SsorCg, SuperLU
from skfem_stvk.solvers.dynamics import (
    BackwardEuler,
    EnergyMomentum,
    GeneralizedAlpha,
    LinearBackwardEuler,
    Newmark,
    VelocityVerlet,
    simulate,
)
from skfem_stvk.solvers.dynamics.motion import Motion
from skfem_stvk.solvers.dynamics.step_matrix import StepTangent

MESHES = {2: MeshTri.init_tensor(*(np.linspace(0, x, n) for x, n in ((0.3, 13), (0.1, 5)))), 3: MeshTet().refined(3)}


def bar(dim, terms=1, young=1e5):
    """Return a bar that is three times as stiff in one half as in the other; one end is fixed, one side slides."""
    mesh = MESHES[dim]
    stiff = mesh.p[0][mesh.t].mean(axis=0) > mesh.p[0].max() / 2
    material = StVK(young=np.where(stiff, 3 * young, young), poisson=0.4, density=1000.0)
    several = [material, VolumePenalty()][:terms]
    fixed = {lambda x: x[0] == 0: "xyz"[:dim], lambda x: (x[0] > 0) & (x[1] == 0): "x"}
    return System(mesh, [*several, Gravity((0.0, 0.0, -9.81)[-dim:])], fixed=fixed)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("terms", [1, 2])
@pytest.mark.parametrize("dim", [2, 3])
def test_the_motion_is_that_of_a_direct_solver(dim, terms, mass):
    system, v0 = bar(dim, terms), 0.3 * MESHES[dim].p.T[:, ::-1].ravel()
    runs = [
        simulate(system, LinearBackwardEuler(0.01, rtol=1e-11, **more), until=0.2, v0=v0, mass=mass, quiet=True)
        for more in ({}, {"solver": "superlu"})
    ]
    assert np.abs(runs[0].u - runs[1].u).max() < 1e-9 * np.abs(runs[1].u).max()
    assert np.abs(runs[0].u).max() > 1e-3 and runs[0].iterations > 100


def test_a_matrix_is_assembled_if_sweeps_or_the_mass_need_it():
    def chosen(terms, mass, solver="ssor-cg"):
        return LinearBackwardEuler(0.01, solver=solver).linear_solver(Motion(bar(3, terms), mass, None))

    assert chosen(1, "lumped") == SsorCg()
    assert chosen(2, "lumped") == chosen(1, "consistent") == SsorCg(assembled=True)
    assert chosen(2, "lumped", "block-jacobi-cg") == BlockJacobiCg()
    assert chosen(2, "consistent", "block-jacobi-cg") == BlockJacobiCg(assembled=True)
    assert chosen(2, "consistent", "superlu") == SuperLU()


def test_default_solvers_depend_on_dimension_tangent_and_symmetry():
    def chosen(system, **more):
        return BackwardEuler(0.01, **more).linear_solver(Motion(system, "lumped", None)).name

    assert chosen(bar(3)) == chosen(bar(3, 2)) == "ssor-cg"
    assert chosen(bar(2)) == chosen(bar(3), tangent="rest") == chosen(bar(3), solver="superlu") == "superlu"
    assert chosen(bar(3), tangent="diagonal") == "block-jacobi-cg"
    pressed = System(MESHES[3], [StVK(young=1e5, poisson=0.3, density=1000.0), Pressure(lambda x: x[0] == 1, 1.0)])
    assert chosen(pressed) == "superlu"


@pytest.mark.few
@pytest.mark.parametrize("tangent", [one.value for one in StepTangent])
@pytest.mark.parametrize(
    ("integrator", "limit"),
    [
        (LinearBackwardEuler(1e-3), 1e-2),
        (BackwardEuler(5e-3), 4e-2),
        (Newmark(5e-3), 1e-3),
        (GeneralizedAlpha(5e-3), 1e-3),
        (EnergyMomentum(5e-3), 1e-3),
    ],
    ids=lambda one: getattr(one, "name", None),
)
@pytest.mark.parametrize("dim", [slow(2), 3])
def test_follower_loads_are_accurate_with_every_tangent(dim, integrator, limit, tangent):
    """The solver accepts the unsymmetric matrix; with the pressure as a dead load the error is 4 to 9 %."""
    mesh = motions.MESHES[dim]
    system = System(mesh, [motions.material(mesh), Pressure("right", 0.3)], fixed={"left": "xyz"[:dim]})
    expected = simulate(system, VelocityVerlet(1e-3), until=0.1, quiet=True).u
    run = simulate(system, replace(integrator, tangent=tangent), until=0.1, quiet=True)
    assert np.abs(run.u - expected).max() < limit * np.abs(expected).max()


def test_requested_conjugate_gradients_refuse_tangents_with_follower_loads():
    mesh = motions.MESHES[3]
    system = System(mesh, [motions.material(mesh), Pressure("right", 0.3)], fixed={"left": "xyz"})
    asked = LinearBackwardEuler(0.01, solver="ssor-cg")
    with pytest.raises(StvkError, match=r"kind = general; expected at most symmetric for solver='ssor-cg'.*Follower loads"):
        simulate(system, asked, until=0.02, quiet=True)
    assert simulate(system, replace(asked, tangent="rest"), until=0.02, quiet=True).success


@pytest.mark.parametrize("make", [BackwardEuler, slow(Newmark), slow(GeneralizedAlpha)])
def test_short_steps_are_as_accurate_as_with_a_direct_solver(make):
    """Only inertia is large compared with their residuals."""
    system, v0 = bar(3), 0.3 * MESHES[3].p.T[:, ::-1].ravel()
    runs = [simulate(system, make(1e-4, solver=solver), until=0.01, v0=v0, quiet=True) for solver in ("auto", "superlu")]
    assert 0 < np.abs(runs[0].v - runs[1].v).max() < 3e-7 * np.abs(runs[1].v).max()
    assert runs[0].iterations == runs[1].iterations


@pytest.mark.parametrize("rtol", [1e-2, 1e-4])
@pytest.mark.parametrize("young", [3e4, 1e6])
@pytest.mark.parametrize("terms", [1, 2])
def test_a_step_takes_less_than_half_of_the_iterations_with_diagonal_blocks(terms, young, rtol):
    system, iterations = bar(3, terms, young), []
    for solver in ("ssor-cg", "block-jacobi-cg"):
        integrator = LinearBackwardEuler(1 / 60, tangent="clamped", rtol=rtol, solver=solver)
        iterations.append(simulate(system, integrator, until=0.25, quiet=True).iterations)
    assert 15 < iterations[0] < iterations[1] / 2
