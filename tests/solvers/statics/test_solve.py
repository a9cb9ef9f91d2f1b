import numpy as np
import pytest
import skfem
from beams import CRITICAL, beam, bent, block, column, free_of

from skfem_stvk import Pressure, StVK, System, Traction, solve_static
from skfem_stvk.solvers.statics import SolveError, Status
from skfem_stvk.space import Space

SOLVERS = ("superlu", "pardiso", "amg-cg", "block-jacobi-cg", "ssor-cg")


@pytest.fixture(scope="module")
def reference():
    return solve_static(bent(), steps=3, rtol=1e-11, solver="superlu", quiet=True)


def test_the_free_residual_is_small_relative_to_loads_and_reactions(reference):
    system = reference.system
    residual = system.residual(reference.u)
    free = free_of(system)
    assert reference.status in (Status.CONVERGED, Status.AT_ROUND_OFF)
    assert np.linalg.norm(residual[free]) <= 1e-10 * np.linalg.norm(residual)
    assert np.abs(reference.u).max() > 1  # the state is not small


@pytest.mark.parametrize("steps", [1, 7, 20])
def test_the_state_does_not_depend_on_the_steps(reference, steps):
    result = solve_static(bent(), steps=steps, rtol=1e-11, solver="superlu", quiet=True)
    np.testing.assert_allclose(result.u, reference.u, atol=1e-8)


@pytest.mark.parametrize("solver", SOLVERS)
def test_all_linear_solvers_find_the_same_state(reference, solver):
    result = solve_static(bent(), steps=3, rtol=1e-11, solver=solver, quiet=True)
    assert result.success and result.solver == solver
    np.testing.assert_allclose(result.u, reference.u, atol=1e-8)


def test_newton_converges_quadratically(reference):
    """Near the solution each residual is of the order of the square of the previous one."""
    residuals = np.array(reference.history[-1].iterations.residuals)
    tail = residuals[(residuals < 1e-2) & (residuals > 1e-11)]
    assert len(tail) >= 2 and (tail[1:] < 30 * tail[:-1] ** 1.7).all()


def test_first_steps_have_the_requested_size_and_grow():
    t = solve_static(bent(), steps=10, quiet=True).history.t
    assert t[0] == pytest.approx(0.1) and t[1] - t[0] > 0.1 and t[-1] == 1


@pytest.mark.parametrize("steps", [1, 10])
def test_a_compressed_block_is_neither_mirrored_nor_inverted(steps):
    """The known state of this cube is found, without inverted elements.

    Without the guard against inversion, a single step of the boundary would end at W = 1108.6 with 216 inverted elements.
    """
    result = solve_static(block(0.2), steps=steps, rtol=1e-10, quiet=True)
    assert result.system.energy(result.u) == pytest.approx(1726.8, abs=0.1)
    assert result.history[-1].smallest_volume_ratio == pytest.approx(0.78, abs=0.005)
    assert not len(result.system.inside_out(result.u))


@pytest.mark.filterwarnings("ignore:From t")
def test_at_the_end_of_the_branch_without_inversion_the_last_good_state_is_returned():
    system = block(0.4)
    with pytest.raises(SolveError, match=r"stable branch ends here.*elements? \(.*compression.*try.*VolumePenalty") as failure:
        solve_static(system, steps=20, quiet=True)
    assert "raise_on_failure=False" in str(failure.value) and "raise_on_failure" not in failure.value.result.message
    result = failure.value.result
    assert result.status is Status.STOPPED and not result.success
    assert 0.29 < 0.4 * result.t < 0.33
    assert not len(system.inside_out(result.u)) and len(result.history.attempts) >= 10
    free = free_of(system)
    residual = system.residual(result.u, result.t)
    assert np.linalg.norm(residual[free]) <= 1e-8 * np.linalg.norm(residual)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_perfect_column_beyond_its_critical_load_is_reported_as_unstable(solver):
    below = solve_static(column(0.8 * CRITICAL), steps=2, solver=solver, quiet=True)
    assert below.success
    above = solve_static(column(1.3 * CRITICAL), steps=2, solver=solver, quiet=True, raise_on_failure=False)
    assert above.status is Status.UNSTABLE and above.t == 1
    assert "K has 1 negative eigenvalue" in above.message and "imperfection" in above.message
    buckled = solve_static(column(1.3 * CRITICAL, imperfection=1e-3), steps=10, solver=solver, quiet=True)
    assert buckled.success and np.abs(buckled.u).max() > 5


def test_a_mirrored_state_is_reported_as_inverted():
    """The body reflected at its wall is reported as inverted.

    The reflected body has no energy. Under a small load it is in equilibrium, but the state is not physical.
    """
    system = bent(load=(1e-3, 0, 0))
    u0 = np.zeros((system.mesh.nv, 3))
    u0[:, 0] = -2 * system.mesh.p[0]
    result = solve_static(system, steps=2, u0=u0.ravel(), quiet=True, raise_on_failure=False)
    assert result.status is Status.INVERTED
    assert f"{system.mesh.nt} elements (0, 1, 2, 3, 4, ...)" in result.message


def test_a_residual_at_round_off_has_its_own_status():
    result = solve_static(bent(), steps=2, rtol=1e-18, quiet=True)
    assert result.status is Status.AT_ROUND_OFF and result.success
    assert result.history[-1].iterations.residuals[-1] < 1e-11


def test_follower_pressure_stays_normal_to_the_surface():
    system = System(
        beam(),
        [StVK(young=1e4, poisson=0.3), Pressure(lambda x: x[2] == 1, 30.0)],
        fixed={"wall": "xyz"},
    )
    result = solve_static(system, steps=4, solver="superlu", rtol=1e-10, quiet=True)
    assert result.success and np.abs(result.u).max() > 1
    top = np.flatnonzero(system.mesh.p[2] == 1)
    facets = system.mesh.surface[:, np.isin(system.mesh.surface, top).all(axis=0)]
    a, b, c = (system.mesh.p.T + result.u.reshape(-1, 3))[facets]
    pushed = -30.0 * (np.cross(b - a, c - a) / 2).sum(axis=0)
    np.testing.assert_allclose(result.reaction().resultant, -pushed, rtol=1e-8)


def test_a_path_from_a_deformed_start_finds_the_same_state(reference):
    result = solve_static(bent(), steps=3, rtol=1e-11, u0=0.5 * reference.u, quiet=True)
    assert result.history.t[0] == 0  # the first state is the equilibrium without load
    np.testing.assert_allclose(result.u, reference.u, atol=1e-8)


def test_materials_of_very_different_stiffness_far_from_the_origin():
    mesh = beam()
    young = np.where(mesh.p[0, mesh.t].mean(axis=0) < 2.5, 1e10, 1e4)
    terms = [StVK(young=young, poisson=0.3), Traction("tip", (0, 0, -60.0))]
    near = solve_static(System(mesh, terms, fixed={"wall": "xyz"}), rtol=1e-9, quiet=True)
    away = type(mesh)(mesh.p + 1e6, mesh.t, boundaries=mesh.boundaries)
    far = solve_static(System(away, terms, fixed={"wall": "xyz"}), rtol=1e-9, quiet=True)
    np.testing.assert_allclose(far.u, near.u, atol=1e-5)


def test_a_flat_membrane_is_inflated_although_it_starts_without_stiffness():
    """A flat membrane can be inflated, although its exact and clamped tangents are singular: nothing resists transverse motion."""
    flat = skfem.MeshTri.init_tensor(np.linspace(0, 1, 7), np.linspace(0, 1, 7))
    p, t = np.vstack([flat.p, 0 * flat.p[0]]), flat.t.copy()
    (a, b, c) = flat.p[:, t].transpose(1, 0, 2)
    reversed_ = (b - a)[0] * (c - a)[1] < (b - a)[1] * (c - a)[0]
    t[:2, reversed_] = t[1::-1, reversed_]
    terms = [StVK(young=1e4, poisson=0.3, thickness=0.01), Pressure(None, -10.0)]
    result = solve_static(System((p, t), terms, fixed=[(flat.boundary_nodes(), "xyz")]), steps=4, solver="superlu", quiet=True)
    assert result.history[0].iterations.tangents[0] == "shifted" and result.history[-1].iterations.tangents[-1] == "exact"
    assert result.u.reshape(-1, 3)[:, 2].max() > 0.1
    lifted = result.reaction().resultant[2]  # the pressure on the projection of the membrane
    assert lifted == pytest.approx(-10.0, rel=1e-7)


@pytest.mark.parametrize("size", [1e-300, 1e-200, 1e-170])
def test_loads_whose_squares_overflow_or_underflow_are_not_ignored(size):
    system = System(
        bent().mesh, [StVK(young=1e4, poisson=0.3), Traction("tip", size * np.array([1, -0.5, 2]))], fixed={"wall": "xyz"}
    )
    result = solve_static(system, steps=2, quiet=True, raise_on_failure=False)
    residual = system.residual(result.u)[free_of(system)]
    assert result.success == (np.abs(residual).max() < 1e-6 * size)


@pytest.mark.parametrize("size", [1e-300, 1.0, 1e300])
def test_the_norm_does_not_overflow_or_underflow(size):
    assert Space(3).norm(size * np.array([3.0, 0.0, -4.0])) == pytest.approx(5 * size)
    assert Space(3).norm(np.zeros(3)) == Space(0).norm(np.empty(0)) == 0
    assert Space(2).norm(np.array([1.0, np.inf])) == np.inf and np.isnan(Space(2).norm(np.array([1.0, np.nan])))


def test_the_forces_of_a_remote_start_are_not_in_the_scale_of_the_residual(tmp_path):
    """The forces of a remote start are not in the scale of the residual, also after a resume.

    These forces are 1e9 times as large as the loads and would make the tolerance useless.
    """
    system = bent()
    far = (system.mesh.p.T * [400.0, 300.0, 200.0]).ravel()
    result = solve_static(system, steps=3, u0=far, checkpoint=tmp_path / "path", quiet=True)
    forces, held = system.residual(result.u), system.supports.held
    free = np.setdiff1d(np.arange(system.ndofs), held)
    scale = np.linalg.norm(system.external_force(result.u)) + np.linalg.norm(forces[held])
    assert result.history[0].t == 0 and np.linalg.norm(system.internal_force(far)) > 1e8 * scale
    assert np.linalg.norm(forces[free]) < 1e-8 * scale
    for file in sorted((tmp_path / "path").glob("*.npz"))[1:]:
        file.unlink()
    resumed = solve_static(system, steps=3, u0=far, checkpoint=tmp_path / "path", resume=True, quiet=True)
    np.testing.assert_array_equal(resumed.u, result.u)
