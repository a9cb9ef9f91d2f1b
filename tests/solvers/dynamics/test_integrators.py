"""One suite tests every integrator for its declared properties, and `EnergyMomentum` for round-off and large rotations."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
import skfem
from bodies import box
from motions import MESHES, SCENES, Scene, clamped, driven, loaded, material, spinning, velocities

from skfem_stvk import ElasticFoundation, Gravity, Pressure, StVK, System, VolumePenalty
from skfem_stvk.solvers.dynamics import (
    INTEGRATORS,
    BackwardEuler,
    EdgeDamping,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    LinearBackwardEuler,
    Newmark,
    Rayleigh,
    VelocityVerlet,
    simulate,
)
from skfem_stvk.solvers.dynamics.damping import damping_factors
from skfem_stvk.solvers.dynamics.integrators import ANGULAR_MOMENTUM, ENERGY, LINEAR_MOMENTUM
from skfem_stvk.solvers.dynamics.integrators.energy_momentum import _rate
from skfem_stvk.solvers.dynamics.motion import Motion

TIGHT = {"rtol": 1e-12}
MAKERS = {
    "ForwardEuler": lambda dt: ForwardEuler(dt),
    "VelocityVerlet": lambda dt: VelocityVerlet(dt),
    "LinearBackwardEuler": lambda dt: LinearBackwardEuler(dt, **TIGHT),
    **{
        f"LinearBackwardEuler, {name}": lambda dt, name=name: LinearBackwardEuler(dt, tangent=name, **TIGHT)
        for name in ("clamped", "gauss-newton", "warped")
    },
    **{
        f"LinearBackwardEuler, {name}": lambda dt, name=name: LinearBackwardEuler(dt, tangent=name, **TIGHT)
        for name in ("diagonal", "rest")
    },
    "BackwardEuler": lambda dt: BackwardEuler(dt, **TIGHT),
    "Newmark": lambda dt: Newmark(dt, **TIGHT),
    "Newmark, damped": lambda dt: Newmark(dt, beta=0.49, gamma=0.9, **TIGHT),
    **{f"GeneralizedAlpha, {rho}": lambda dt, rho=rho: GeneralizedAlpha(dt, rho=rho, **TIGHT) for rho in (0, 0.5, 1)},
    "EnergyMomentum": lambda dt: EnergyMomentum(dt, **TIGHT),
}
IMPLICIT = [name for name, make in MAKERS.items() if not make(1.0).explicit]
CONVERGED = [name for name in IMPLICIT if not name.startswith("Linear")]
#: Tangents without coupling of neighbours, or without the rotation of the body, do not contain damping by stiffness either.
CRUDE = ("LinearBackwardEuler, diagonal", "LinearBackwardEuler, rest")
#: End time and number of steps, if they differ from those of other integrators of the same order.
TIMES = {"GeneralizedAlpha, 0": (0.06, 16)}
#: Circular frequency that scales displacements for the comparison with velocities [1/s].
OMEGA = 10.0


def test_the_suite_covers_all_integrators():
    assert {type(make(1.0)).__name__ for make in MAKERS.values()} == set(INTEGRATORS)


def cases():
    for name in MAKERS:
        for scene in SCENES:
            for d in (2, 3):
                if scene != ("driven and damped" if name in CRUDE else "driven") and not (name in CRUDE and "damped" in scene):
                    yield pytest.param(name, scene, d, "lumped", id=f"{name}, {scene}, {d}D", marks=[pytest.mark.slow] * (d == 3))
    for name in ("LinearBackwardEuler", "BackwardEuler", "Newmark", "GeneralizedAlpha, 0.5", "EnergyMomentum"):
        for scene in ("driven and damped", "spinning"):
            yield pytest.param(name, scene, 3, "consistent", id=f"{name}, {scene}, consistent")


@pytest.mark.few(8)
@pytest.mark.parametrize(("name", "scene", "d", "mass"), list(cases()))
def test_errors_of_motion_and_energy_fall_with_the_declared_order(name, scene, d, mass):
    order = MAKERS[name](1.0).order
    until, steps = TIMES.get(name, {1: (0.03, 20), 2: (0.12, 16)}[order])
    runs = [SCENES[scene](d).run(MAKERS[name](until / n), until, mass=mass) for n in (steps, 2 * steps, 4 * steps)]
    assert all(run.success and not run.cuts and run.ledger.steps - 1 == n * steps for run, n in zip(runs, (1, 2, 4), strict=True))
    states = [np.concatenate([OMEGA * run.u, run.v]) for run in runs]
    coarse, fine = (np.linalg.norm(a - b) for a, b in pairwise(states))
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.1)
    closures = [np.abs(run.ledger["closure_error"]).max() for run in runs]
    if ENERGY in runs[0].integrator.conserves:
        assert max(closures) < 1e-10 * runs[0].ledger["kinetic_energy"].max()
    else:
        assert np.log2(closures[1] / closures[2]) > order - 0.2


def drifts(integrator, d, mass="lumped"):
    """Return relative changes of the conserved quantities of a free rotating body."""
    ledger = spinning(d).run(integrator, 0.6, mass=mass).ledger
    axes = {2: "z", 3: "xyz"}[d]
    momenta = {
        LINEAR_MOMENTUM: [ledger[f"linear_momentum_{axis}"] for axis in "xyz"[:d]],
        ANGULAR_MOMENTUM: [ledger[f"angular_momentum_{axis}"] for axis in axes],
        ENERGY: [ledger["total_energy"]],
    }
    return {
        name: np.abs(np.subtract(rows, [[row[0]] for row in rows])).max() / np.abs(rows).max() for name, rows in momenta.items()
    }


@pytest.mark.few(8)
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("name", MAKERS)
def test_an_integrator_conserves_what_it_declares_and_nothing_else(name, d):
    for mass in ("lumped",) if MAKERS[name](1.0).explicit or name in CRUDE else ("lumped", "consistent"):
        found = drifts(MAKERS[name](0.02), d, mass)
        assert {quantity for quantity, drift in found.items() if drift < 1e-10} == MAKERS[name](1.0).conserves, found
        assert all(drift > 1e-6 or drift < 1e-10 for drift in found.values()), found


@pytest.mark.few
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("name", MAKERS)
def test_only_declared_integrators_are_reversible(name, d):
    scene, integrator = spinning(d), MAKERS[name](0.01)
    there = scene.run(integrator, 0.2)
    back = scene.run(integrator, 0.2, u0=there.u, v0=-there.v)
    far = np.abs(there.u).max()
    missed = np.abs(back.u).max() / far, np.abs(back.v + scene.v0).max() / np.abs(scene.v0).max()
    assert max(missed) < 1e-9 if integrator.reversible else min(missed) > 1e-6


def test_damped_motions_are_not_reversible():
    scene, integrator = spinning(3, damping=EdgeDamping(3e-3)), VelocityVerlet(0.01)
    there = scene.run(integrator, 0.2)
    assert np.abs(scene.run(integrator, 0.2, u0=there.u, v0=-there.v).u).max() > 1e-3


def relative_closure_error(run):
    """Return the largest closure error relative to the largest energy."""
    ledger = run.ledger
    assert run.success and not run.cuts
    return np.abs(ledger["closure_error"]).max() / max(ledger["kinetic_energy"].max(), ledger["strain_energy"].max())


def on_foundation(d):
    """Return a body on an elastic foundation, with follower pressure and gravity."""
    mesh = MESHES[d]
    terms = [
        material(mesh),
        ElasticFoundation("left", (2.0, 0.5, 1.0)[:d]),
        Pressure("right", lambda t: 0.2 + 0.5 * np.sin(5 * t)),
        Gravity((0.3, -1.0, 0.5)[:d]),
    ]
    return Scene(System(mesh, terms), v0=0.6 * velocities(mesh))


WORKING = {"time loads": clamped, "moving supports": driven, "a free body": loaded, "a bed and pressure": on_foundation}


@pytest.mark.few
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(
    "damping", [None, Rayleigh(alpha=0.8, beta=0.05), EdgeDamping(0.05)], ids=["undamped", "Rayleigh", "edges"]
)
@pytest.mark.parametrize("scene", WORKING)
def test_the_energy_of_energy_momentum_balances_under_all_loads(scene, damping, d):
    run = WORKING[scene](d)._replace(damping=damping).run(EnergyMomentum(0.02, rtol=1e-13), 0.3)
    work, lost = run.ledger["external_work"], run.ledger["dissipated_work"]
    assert relative_closure_error(run) < 1e-11 and np.abs(work).max() > 1e-3
    assert (np.diff(lost) > 0).all() if damping else not lost.any()


def test_the_energy_of_energy_momentum_balances_to_second_order_with_a_volume_penalty():
    mesh = MESHES[3]
    system = System(mesh, [material(mesh), VolumePenalty(5.0, kind="quadratic")])
    scene = Scene(system, v0=velocities(mesh))
    errors = [relative_closure_error(scene.run(EnergyMomentum(dt, rtol=1e-13), 0.2)) for dt in (0.02, 0.01, 0.005)]
    assert errors[0] > 1e-5 and np.log2(errors[1] / errors[2]) == pytest.approx(2, abs=0.2)
    ledger = scene.run(EnergyMomentum(0.02, rtol=1e-13), 0.5).ledger
    for axis in "xyz":
        momentum = ledger[f"angular_momentum_{axis}"]
        assert np.abs(momentum - momentum[0]).max() < 1e-12


#: Integrators that conserve linear momentum, with the masses that they accept.
FLYING = [
    (name, mass)
    for name, make in MAKERS.items()
    for mass in ("lumped", "consistent")
    if LINEAR_MOMENTUM in make(1.0).conserves and not (mass == "consistent" and make(1.0).explicit)
]


@pytest.mark.few
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(("name", "mass"), FLYING)
def test_a_rigid_body_translates_exactly(name, mass, d):
    integrator, mesh = MAKERS[name](0.03), MESHES[d]
    v, g = np.array([3.0, -2.0, 1.0])[:d], np.array([0.5, -9.0, 2.0])[:d]
    flight = Scene(System(mesh, material(mesh)), v0=np.tile(v, mesh.nv)).run(integrator, 0.6, mass=mass)
    assert np.abs(flight.u - np.tile(0.6 * v, mesh.nv)).max() < 1e-11
    fall = Scene(System(mesh, [material(mesh), Gravity(g)]), v0=np.tile(v, mesh.nv)).run(integrator, 0.6, mass=mass)
    assert np.abs(fall.v - np.tile(v + 0.6 * g, mesh.nv)).max() < 1e-10
    parabola = np.tile(0.6 * v + 0.18 * g, mesh.nv)
    missed = np.abs(fall.u - parabola).max()
    assert (
        missed < 1e-10
        if integrator.order == 2 or isinstance(integrator, Newmark)
        else 0.05 < missed / np.abs(0.6 * 0.03 / 2 * g).max() < 2.1
    )


@pytest.mark.parametrize("d", [2, 3])
def test_rayleigh_damping_resists_rotation_and_edge_damping_does_not(d):
    mesh, angle = MESHES[d], 0.9
    rotation = np.eye(d)
    rotation[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    system, x = System(mesh, material(mesh)), mesh.p.T
    rotated = (x @ rotation.T - x).ravel()
    scale = system.energy(0.3 * x.ravel())
    lost = {
        kind: Motion(system, "lumped", kind).dissipated(np.zeros(system.ndofs), rotated, 1.0)
        for kind in (EdgeDamping(1.0), Rayleigh(beta=1.0))
    }
    assert abs(lost[EdgeDamping(1.0)]) < 1e-14 * scale and lost[Rayleigh(beta=1.0)] > 0.1 * scale


@pytest.mark.parametrize("make", [EnergyMomentum, BackwardEuler], ids=["EnergyMomentum", "BackwardEuler"])
def test_edge_damping_conserves_the_spin_and_rayleigh_damping_stops_it(make):
    ends = {}
    for damping in (EdgeDamping(0.2), Rayleigh(beta=0.2)):
        ledger = spinning(2, damping=damping).run(make(0.04, rtol=1e-13), 4.0).ledger
        spin = ledger["angular_momentum_z"]
        late = np.diff(ledger["dissipated_work"])[-20:].sum() / ledger["dissipated_work"][-1]
        ends[type(damping)] = spin[-1] / spin[0], late
    assert ends[EdgeDamping][1] < 1e-3 and ends[Rayleigh][0] < 0.7 * ends[EdgeDamping][0]
    assert (abs(ends[EdgeDamping][0] - 1) < 1e-11) == (make is EnergyMomentum)  # backward Euler damps rotations itself


@pytest.mark.few
@pytest.mark.parametrize("tangent", ["clamped", "gauss-newton", "warped", "diagonal", "rest"])
@pytest.mark.parametrize("make", [BackwardEuler, Newmark, GeneralizedAlpha, EnergyMomentum])
def test_converged_steps_do_not_depend_on_the_tangent(make, tangent):
    for mass in ("lumped", "consistent")[: 1 if tangent == "diagonal" else 2]:
        for scene in (SCENES["driven and damped"](2), spinning(3)):
            exact, other = (scene.run(make(0.01, tangent=which, rtol=1e-11), 0.08, mass=mass) for which in ("exact", tangent))
            assert np.abs(other.v - exact.v).max() < 1e-8 * np.abs(exact.v).max() and not other.cuts
            assert np.abs(other.v - exact.v).any()


@pytest.mark.few
@pytest.mark.parametrize("solver", ["superlu", "block-jacobi-cg", "ssor-cg", "amg-cg"])
@pytest.mark.parametrize("name", ["LinearBackwardEuler", "BackwardEuler", "EnergyMomentum"])
def test_solvers_agree(name, solver):
    make = INTEGRATORS[name]
    for mass in ("lumped", "consistent"):
        scene = SCENES["driven and damped"](3)
        runs = [scene.run(make(0.02, solver=which, rtol=1e-12), 0.2, mass=mass) for which in ("auto", solver)]
        assert np.abs(runs[0].u - runs[1].u).max() < 1e-9 * np.abs(runs[0].u).max()


@pytest.mark.parametrize("make", INTEGRATORS.values(), ids=INTEGRATORS)
def test_single_precision_arguments_are_converted_exactly(make, tmp_path):
    """Times are sums of steps, so single precision would change them by 1e-7."""
    scene, single = clamped(2), np.float32(0.003)
    damping = [Rayleigh(np.float32(0.5), np.float32(1e-3)), EdgeDamping(np.float32(1e-3))]
    same = [Rayleigh(*(float(one) for one in vars(damping[0]).values())), EdgeDamping(float(damping[1].tau))]
    run = scene.run(make(single), 0.03, damping=damping, checkpoint=tmp_path / "run")
    other = scene.run(make(float(single)), 0.03, damping=same)
    np.testing.assert_array_equal(run.ledger.rows(), other.ledger.rows())
    assert type(run.t) is type(run.dt) is float


def lost_in_the_square(rate):
    """Return the relative rounding error of the square of `rate`."""
    return float(abs(1 - Fraction(rate * rate) / Fraction(rate) ** 2))


def test_the_square_of_the_rate_is_almost_exact():
    steps = np.random.default_rng(0).uniform(1e-5, 1e-1, 200)
    assert max(abs(_rate(h) * h / 2 - 1) for h in steps) < 1e-14
    assert np.mean([lost_in_the_square(_rate(h)) for h in steps]) < 2e-18
    assert np.mean([lost_in_the_square(2 / h) for h in steps]) > 2e-17  # the error without this choice of the rate


def test_energy_does_not_drift_with_rounding():
    mesh = box()
    system = System(mesh, StVK(young=1e5, poisson=0.3, density=1000.0))
    p = mesh.p - mesh.p.mean(axis=1, keepdims=True)
    v = np.cross([1.0, 2.0, 8.0], p.T) + 0.2 * np.sin(5 * p).T
    ledger = simulate(system, EnergyMomentum(dt=1e-3, rtol=3e-16), until=0.5, v0=v.ravel(), quiet=True).ledger
    energy = ledger["total_energy"]
    assert np.ptp(energy) < 1e-13 * energy[0]
    assert np.ptp(ledger["strain_energy"]) > 1e-3 * energy[0] and ledger["closure_error"][0] == pytest.approx(0)


@pytest.mark.parametrize("solver", ["superlu", "block-jacobi-cg"])
def test_stiff_bodies_rotate_by_a_third_of_a_radian_per_step(solver):
    """No step is cut, although a body has shrunk by 1.4 % in the middle of such a step.

    Every step would be cut with the tensions of the middle in the tangent, or with the whole tangent at the end.
    """
    bar = skfem.MeshTet.init_tensor(np.linspace(-0.2, 0.2, 7), np.linspace(-0.05, 0.05, 3), np.linspace(-0.06, 0.06, 3))
    p = bar.p + 0.006 * np.random.default_rng(0).standard_normal(bar.p.shape)
    system = System((p, bar.t), StVK(young=1e9, poisson=0.3, density=1000.0))
    v = np.cross([1.0, 2.0, 10.0], p.T) + 0.3 * np.sin(40 * p).T
    run = simulate(system, EnergyMomentum(dt=1 / 30, rtol=1e-12, solver=solver), until=0.5, v0=v.ravel(), quiet=True)
    assert run.cuts == 0 and run.iterations < 60 * 15
    assert np.ptp(run.ledger["total_energy"]) < 1e-9 * run.ledger["total_energy"][0]


@pytest.mark.parametrize(
    ("damping", "factors"),
    [
        (None, (0, 0, 0)),
        ([], (0, 0, 0)),
        (Rayleigh(1.0, 2.0), (1, 2, 0)),
        (EdgeDamping(3), (0, 0, 3)),
        ((EdgeDamping(3.0), Rayleigh(alpha=1.0), Rayleigh(0.5, 2.0)), (1.5, 2, 3)),
    ],
)
def test_kinds_of_damping_add_up(damping, factors):
    assert damping_factors(damping) == factors
