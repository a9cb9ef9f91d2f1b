"""Functions of two states and of velocities are sums over the terms of the system."""

import tracemalloc

import numpy as np
import pytest
from bodies import MESHES, box, state

from skfem_stvk import ElasticFoundation, StateError, StVK, StvkError, System, VolumePenalty
from skfem_stvk.edges import NONE
from skfem_stvk.solvers.dynamics.forces import add_damping_force, add_mean_force, add_secant_damping

MESH = MESHES["tetrahedra"]
HALF = MESH.nt // 2
TERMS = [
    StVK(young=2.0, poisson=0.45, region=np.arange(HALF)),
    StVK(young=5.0, poisson=-0.3, region=np.arange(HALF, MESH.nt)),
    ElasticFoundation(lambda x: x[0] > 0.7, 30.0),
]
BODY = System(MESH, TERMS)
U0, U1, V = state(MESH), state(MESH, seed=5), state(MESH, seed=6)


def filled(add, *arguments, **options):
    out = np.full(MESH.p.size, 2.0)
    R = add(*arguments, out, **options)
    return R, out - 2


def test_the_work_between_two_states_is_the_difference_of_the_energies_of_all_terms():
    R, force = filled(add_mean_force, BODY, U0, U1)
    gained, size = BODY.energy(U1) - BODY.energy(U0), np.abs(force) @ np.abs(U1 - U0)
    assert force @ (U1 - U0) == pytest.approx(gained, abs=1e-13 * size) and abs(gained) > 1e-3 * size and R > 1e-3
    of_edges = (
        term.bind(MESH).mean_force(*(u.reshape(-1, 3) for u in (U0, U1)), (0.5, 0.5), 0.5, np.zeros((MESH.nv, 3)))
        for term in TERMS[:2]
    )
    assert pytest.approx(sum(of_edges), rel=1e-13) == R


@pytest.mark.filterwarnings("ignore::skfem_stvk.StvkWarning")
@pytest.mark.parametrize("theta", [0.5, 0.8])
def test_the_mean_force_of_a_volume_penalty_is_that_of_the_state_in_between(theta):
    penalty = VolumePenalty(3.0, "compression")
    both, alone = System(MESH, [*TERMS, penalty]), System(MESH, penalty)
    (R, force), (wanted_R, wanted) = (
        filled(add_mean_force, body, U0, U1, weights=(0.2, 0.6), theta=theta) for body in (both, BODY)
    )
    push = 0.8 * alone.internal_force((1 - theta) * U0 + theta * U1)
    assert np.abs(push).max() > 1e-2 * np.abs(force).max()
    assert wanted_R == R and np.abs(force - wanted - push).max() < 1e-13 * np.abs(force).max()


def test_damping_includes_edges_only():
    R, force = filled(add_damping_force, BODY, U0, V)
    solid = System(MESH, TERMS[:2])
    wanted = solid.linear_operator(U0, kept=NONE) @ V
    assert np.abs(force - wanted).max() < 1e-13 * np.abs(wanted).max() and force @ V == pytest.approx(2 * R, rel=1e-12)
    assert np.abs(BODY.linear_operator(U0, kept=NONE) @ V - wanted).max() > 1e-2 * np.abs(wanted).max()


@pytest.mark.parametrize("theta", [0.5, 1.0])
def test_secant_damping_is_the_contribution_of_unequal_weights_to_the_edges(theta):
    R, force = filled(add_secant_damping, BODY, U0, U1, theta)
    solid = System(MESH, TERMS[:2])
    (_, more), (_, less) = (filled(add_mean_force, solid, U0, U1, weights=w, theta=theta) for w in ((0.0, 1.0), (1.0, 0.0)))
    assert R > 1e-3 and np.abs(force - (more - less)).max() < 1e-12 * np.abs(force).max()
    assert abs(force @ (U1 - U0) / (2 * R) - 1) < 1e-12 if theta == 0.5 else True
    h = 1e-6
    rate, resistance = filled(add_damping_force, BODY, U0, V)
    R, force = filled(add_secant_damping, BODY, U0, U0 + h * V, theta)
    assert pytest.approx(rate, rel=1e-4) == R / h**2 and np.abs(force / h - resistance).max() < 1e-4 * np.abs(resistance).max()


def test_energy_and_force_are_written_to_out():
    W, F = BODY.energy_and_force(U0)
    for dtype in (np.float64, np.float32):
        out = np.full(BODY.ndofs, 7.0, dtype=dtype)
        again, same = BODY.energy_and_force(U0, out)
        assert same is out and again == W and np.abs(out - F).max() <= np.finfo(dtype).eps * np.abs(F).max()


READ_ONLY = np.zeros(MESH.p.size)
READ_ONLY.flags.writeable = False


@pytest.mark.parametrize(
    "out",
    [
        READ_ONLY,
        np.ma.zeros(MESH.p.size),
        np.zeros(MESH.p.size, dtype=np.longdouble),
        np.zeros(5),
        np.zeros(2 * MESH.p.size)[::2],
        np.zeros(MESH.p.size, dtype=int),
        [0.0] * MESH.p.size,
        np.zeros((MESH.nv, 3)),
    ],
)
def test_an_array_that_cannot_be_written_is_refused(out):
    with pytest.raises(StvkError, match=rf"out = .*expected a contiguous, writable array of floats \({BODY.ndofs},\)"):
        BODY.energy_and_force(U0, out)
    with pytest.raises(StvkError, match="out = "):
        add_mean_force(BODY, U0, U1, out)


@pytest.mark.parametrize("add", [add_mean_force, add_damping_force])
def test_invalid_states_and_overflowing_results_are_refused(add):
    out, hole = np.zeros(BODY.ndofs), U0.copy()
    hole[7] = np.nan
    for states in ((hole, U1), (U0, hole)):
        with pytest.raises(StateError, match=r"not finite in 1 entry \(7\)"):
            add(BODY, *states, out)
    with pytest.raises(StateError, match="overflows"), np.errstate(over="ignore", invalid="ignore"):
        add(BODY, 1e200 * U0, 1e200 * U1, out)


def test_repeated_calls_allocate_no_arrays_of_the_size_of_the_mesh():
    """Repeated calls of an explicit step allocate no arrays of the size of the mesh.

    Foundations and penalties would allocate small arrays.
    """
    body = System(box(16), StVK(young=2.0, poisson=0.3))
    u, v, out = state(body.mesh), state(body.mesh, seed=9), np.zeros(body.ndofs)
    calls = (
        lambda: body.energy_and_force(u, out),
        lambda: add_mean_force(body, u, v, out),
        lambda: add_damping_force(body, u, v, out),
        lambda: add_secant_damping(body, u, v, 0.5, out),
    )
    for call in calls:
        call()
        tracemalloc.start()
        try:
            call()
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak < u.nbytes / 4
