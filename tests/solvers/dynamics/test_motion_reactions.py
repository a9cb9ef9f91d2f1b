"""Reactions of bodies in motion agree with momentum, energy and statics."""

import pickle

import numpy as np
import pytest
from motions import BOTH, MESHES, Scene, clamped, driven, material, moved, pushed, velocities

from skfem_stvk import (
    ElasticFoundation,
    Gravity,
    NodalLoad,
    RegionError,
    StvkError,
    SupportError,
    System,
    Traction,
    simulate,
    solve_static,
)
from skfem_stvk.solvers.dynamics import (
    BackwardEuler,
    EdgeDamping,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    LinearBackwardEuler,
    Newmark,
    Rayleigh,
    VelocityVerlet,
)
from skfem_stvk.solvers.dynamics.motion import Motion, constrained_accelerations
from skfem_stvk.terms.loads.load import Moment

AXES = "xyz"


def columns(run, prefix):
    return np.stack([run.ledger[prefix + axis] for axis in AXES[: run.system.mesh.d]], axis=1)


def pushes(run):
    """Return sums (n, d) of the loads, which do not depend on the displacements, and of damping by `alpha`."""
    system, times = run.system, run.ledger["time"]
    loads = [system.external_force(np.zeros(system.ndofs), Moment(t, 1.0)) for t in times]
    return np.reshape(loads, (len(times), -1, system.mesh.d)).sum(axis=1) - run.motion.alpha * columns(run, "linear_momentum_")


def rate_and_forces(run):
    """Return the rate of linear momentum over each step, and all external forces at each time."""
    rate = np.diff(columns(run, "linear_momentum_"), axis=0) / np.diff(run.ledger["time"])[:, None]
    return rate, pushes(run) + columns(run, "reaction clamp ")


def heavy(d, pull):
    """Return a heavy body fixed at its left end, with forces on two vertices."""
    mesh = MESHES[d]
    right = np.unique(mesh.boundaries["right"])[:2]
    return System(mesh, [material(mesh), Gravity((0.3, -1.0, 0.5)[:d]), NodalLoad(right, pull)], fixed={"left": AXES[:d]})


@pytest.mark.few
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(
    ("integrator", "mass", "start", "end"),
    [
        (ForwardEuler(0.01), "lumped", 1.0, 0.0),
        (VelocityVerlet(0.01), "lumped", 0.5, 0.5),
        (BackwardEuler(0.02, rtol=1e-13), "lumped", 0.0, 1.0),
        (Newmark(0.02, rtol=1e-13), "lumped", 0.5, 0.5),
        (Newmark(0.02, rtol=1e-13), "consistent", 0.5, 0.5),
    ],
    ids=lambda one: getattr(one, "name", None),
)
def test_loads_and_reactions_are_the_rate_of_momentum_to_round_off(integrator, mass, start, end, d):
    """The forces are those at the beginning of a step, at its end, or the mean of both, as in the integrator."""
    constant = isinstance(integrator, ForwardEuler)  # it uses the loads at the end of a step
    system = heavy(d, (0.05, 0.1, -0.05)[:d] if constant else lambda t: [0.06 * f for f in pushed(t)[:d]])
    run = Scene(system, 0.2 * velocities(MESHES[d])).run(integrator, 0.2, mass=mass, reactions={"clamp": "left"})
    rate, forces = rate_and_forces(run)
    np.testing.assert_allclose(rate, start * forces[:-1] + end * forces[1:], rtol=0, atol=1e-11 * np.abs(forces).max())
    assert np.abs(np.diff(columns(run, "reaction clamp "), axis=0)).max() > 1e-3 * np.abs(forces).max()


@pytest.mark.parametrize("damping", [None, Rayleigh(alpha=0.8, beta=4e-3), BOTH], ids=["free", "Rayleigh", "both"])
@pytest.mark.parametrize(
    ("integrator", "mass", "start"), [(VelocityVerlet(0.01), "lumped", 0.5), (BackwardEuler(0.02, rtol=1e-13), "consistent", 0.0)]
)
def test_loads_and_reactions_with_foundations_are_the_rate_of_momentum(integrator, mass, start, damping):
    """Springs of a foundation, and their share of damping by stiffness, are external forces.

    A clamp shares a vertex with the foundation.
    """
    mesh = MESHES[2]
    bed = ElasticFoundation(lambda x: x[1] < 0.1, (0.5, 0.9))
    system = System(mesh, [material(mesh), bed, Gravity((0.3, -1.0))], fixed=[([0], "xy")])
    options = {"mass": mass, "reactions": {"clamp": None, "bed": lambda x: x[1] < 0.1}}
    run = Scene(system, 0.2 * velocities(mesh), damping=damping).run(integrator, 0.2, **options)
    rate, forces = rate_and_forces(run)
    # Verlet uses damping at a predicted velocity, and backward Euler that of edges from the difference of their elongations
    limit = 2e-3 if damping is BOTH or (damping and start) else 1e-11
    np.testing.assert_allclose(rate, start * forces[:-1] + (1 - start) * forces[1:], rtol=0, atol=limit * np.abs(forces).max())
    assert np.abs(columns(run, "reaction bed ")).max() > 0.02 * np.abs(forces).max()
    np.testing.assert_array_equal(columns(run, "reaction bed ")[-1], run.reaction(lambda x: x[1] < 0.1).resultant)
    assert 0 in run.reaction(lambda x: x[1] < 0.1).vertices


def swung(d):
    """Return a body with prescribed displacements of its left end, and of one component of another vertex."""
    mesh = MESHES[d]
    corner = int(np.argmax(mesh.p.sum(axis=0)))
    ends = [
        ("left", lambda x, t: [0.3 * component for component in moved(x, t)[:d]]),
        ([corner], {"y": lambda t: 0.02 * np.sin(7 * t)}),
    ]
    pull = NodalLoad([int(np.argmin(mesh.p[1] - mesh.p[0]))], lambda t: [0.04 * f for f in pushed(t)[:d]])
    return Scene(System(mesh, [material(mesh), pull], prescribed=ends), damping=BOTH)


@pytest.mark.parametrize(
    ("make", "mass"),
    [
        (VelocityVerlet, "lumped"),  # it accepts no other mass
        *((make, mass) for make in (EnergyMomentum, Newmark, GeneralizedAlpha) for mass in ("lumped", "consistent")),
    ],
)
def test_reactions_of_moving_supports_are_accurate_to_second_order(make, mass):
    off = []
    for dt in (0.02, 0.01):
        run = swung(2).run(make(dt), 0.4, mass=mass, reactions={"clamp": None})
        (rate, forces), loads = rate_and_forces(run), pushes(run)
        missing = rate - columns(run, "reaction clamp ")[1:] - (loads[1:] + loads[:-1]) / 2  # reactions are means over a step
        late = run.ledger["time"][1:] > 0.25  # generalised alpha starts with an acceleration that is not its own
        off.append(np.abs(missing[late]).max() / np.abs(forces).max())
    assert off[0] < 0.01 and off[1] < 0.3 * off[0]


def test_reactions_of_linear_steps_are_accurate_to_first_order():
    off = []
    for dt in (0.02, 0.01):
        run = clamped(2).run(LinearBackwardEuler(dt, rtol=1e-10), 0.2, reactions={"clamp": "left"})
        impulse = np.cumsum((pushes(run) + columns(run, "reaction clamp "))[1:] * dt, axis=0)
        gained = np.diff(columns(run, "linear_momentum_")[[0, -1]], axis=0)[0]
        off.append(np.abs(impulse[-1] - gained).max() / np.abs(impulse).max())
    assert off[0] < 0.05 and off[1] < 0.6 * off[0]


def test_the_work_of_moving_supports_is_the_work_of_their_reactions():
    mesh = MESHES[3]
    system = System(
        mesh, material(mesh), prescribed={"left": lambda x, t: np.outer([0.1, -0.2, 0.1], np.sin(3 * t) ** 2 + 0 * x[0])}
    )
    run = simulate(system, EnergyMomentum(2e-3), until=0.3, reactions={"clamp": "left"}, quiet=True)
    force, path = columns(run, "reaction clamp "), np.outer(np.sin(3 * run.ledger["time"]) ** 2, [0.1, -0.2, 0.1])
    work = (force[1:] * np.diff(path, axis=0)).sum()
    assert work == pytest.approx(run.ledger["external_work"][-1], rel=1e-3)


@pytest.mark.parametrize("d", [2, 3])
def test_a_motion_at_rest_has_the_reactions_of_statics(d):
    mesh, roller = MESHES[d], int(np.argmax(MESHES[d].p[0] - MESHES[d].p[1]))
    terms = [material(mesh, young=30.0), Gravity((0.0, -1.0, 0.2)[:d]), Traction("right", (0.5, 0.2, 0.1)[:d])]
    terms.append(ElasticFoundation("right", 0.7))
    system = System(mesh, terms, fixed=[("left", AXES[:d]), ([roller], "y")])
    still = solve_static(system, quiet=True, rtol=1e-13)
    run = simulate(system, BackwardEuler(0.5, rtol=1e-13), until=60.0, damping=[Rayleigh(alpha=2.0), EdgeDamping(0.5)], quiet=True)
    size = np.abs(still.reaction().by_node).max()
    for place in (None, "left", [roller], lambda x: x[0] < 0.5):
        one, other = run.reaction(place), still.reaction(place)
        np.testing.assert_array_equal(one.vertices, other.vertices)
        np.testing.assert_allclose(one.by_node, other.by_node, rtol=0, atol=1e-9 * size)
        np.testing.assert_allclose(one.moment((0.3,) * d), other.moment((0.3,) * d), rtol=0, atol=1e-8 * size)
    below = run.reaction([roller]).by_node[0]
    assert below[0] == system.foundation_force(run.u)[d * roller] and below[1] != system.foundation_force(run.u)[d * roller + 1]


@pytest.mark.parametrize("scene", [clamped(2, damping=BOTH), driven(3)], ids=["clamped", "driven"])
@pytest.mark.parametrize("until", [0.1, 0.094])
def test_the_last_row_of_the_ledger_is_the_reaction_at_the_end(scene, until):
    run = scene.run(EnergyMomentum(0.02), until, reactions={"one": [0], "clamp": "left"}, probes={"clamp": "left"})
    assert run.ledger.names[-run.system.mesh.d] == "reaction clamp x"
    np.testing.assert_array_equal(columns(run, "reaction clamp ")[-1], run.reaction("left").resultant)
    np.testing.assert_array_equal(columns(run, "reaction one ")[-1], run.reaction([0]).resultant)


def test_a_pickled_run_retains_its_reactions():
    mesh = MESHES[2]
    system = System(mesh, [material(mesh), Gravity((0.0, -1.0))], fixed={"left": "xy"})
    run = simulate(system, EnergyMomentum(0.02), until=0.1, damping=BOTH, quiet=True)
    again = pickle.loads(pickle.dumps(run))
    np.testing.assert_array_equal(again.reaction("left").by_node, run.reaction("left").by_node)


def test_recorded_reactions_change_nothing_else_and_resume(tmp_path):
    scene, places = driven(2, damping=BOTH), {"probes": {"A": [3]}, "reactions": {"A": "left"}}
    for integrator in (VelocityVerlet(0.01), EnergyMomentum(0.01)):
        scene.run(integrator, 0.1, checkpoint=tmp_path / integrator.name, **places)
        resumed = simulate(scene.system, checkpoint=tmp_path / integrator.name, resume=True, until=0.2, quiet=True)
        whole, without = scene.run(integrator, 0.2, **places), scene.run(integrator, 0.2)
        assert resumed.ledger.names == whole.ledger.names
        np.testing.assert_array_equal(resumed.ledger.rows(), whole.ledger.rows())
        np.testing.assert_array_equal(resumed.reaction().by_node, whole.reaction().by_node)
        np.testing.assert_array_equal(without.reaction().by_node, whole.reaction().by_node)
        np.testing.assert_array_equal(without.ledger.rows(), whole.ledger.rows()[:, : len(without.ledger.names)])


def test_supports_are_evaluated_only_within_the_run():
    asked = []

    def pull(t):
        asked.append(t)
        return 0.01 * t**2

    mesh = MESHES[2]
    system = System(mesh, material(mesh), fixed={"left": "y"}, prescribed={"left": {"x": pull}})
    asked.clear()
    run = simulate(
        system,
        EnergyMomentum(0.02),
        until=3.03,
        t0=3.0,
        u0=0.09 * np.tile([1.0, 0.0], mesh.nv),
        reactions={"A": "left"},
        quiet=True,
    )
    run.reaction()
    assert min(asked) >= 3.0 - 1e-12 and max(asked) <= 3.03 + 1e-12


def test_accelerations_of_supports_are_exact_for_cubics():
    mesh = MESHES[2]
    system = System(mesh, material(mesh), fixed={"left": "y"}, prescribed={"left": {"x": lambda t: t**3 - t**2}})
    a = constrained_accelerations(Motion(system, "lumped", None), 0.5, 0.4)
    np.testing.assert_allclose(a, np.tile([3.0 - 2.0, 0.0], len(a) // 2), atol=1e-10)
    forwards = constrained_accelerations(Motion(system, "lumped", None), 0.5, 0.6)
    np.testing.assert_allclose(forwards, a, atol=1e-10)


def test_a_run_without_a_step_has_reactions(tmp_path):
    mesh = MESHES[2]

    def failing(t):
        if 0.0 < t < 0.9:
            raise ValueError("no more")
        return 0.1, 0.2

    system = System(mesh, [material(mesh), Traction("right", failing), Gravity((0.0, -1.0))], fixed={"left": "xy"})
    with pytest.raises(RuntimeError, match="no more") as caught:
        simulate(system, EnergyMomentum(0.01), until=0.1, quiet=True)
    run = caught.value.run
    masses = np.repeat(system.mass().vertex, 2)[system.supports.held].reshape(-1, 2)
    np.testing.assert_allclose(run.reaction().by_node, masses * [0.0, 1.0])  # nothing is strained yet


@pytest.mark.parametrize(
    ("error", "message", "places"),
    [
        (StvkError, r"reactions = \['left'\]; expected locations by name, such as \{'clamp': 'left'\}", {"reactions": ["left"]}),
        (SupportError, "reaction 'B': no support and no foundation acts at 'right'", {"reactions": {"B": "right"}}),
        (RegionError, r"reaction 'B': the vertices name 1 vertex \(99\) outside", {"reactions": {"B": [99]}}),
        *(
            (StvkError, f"probe '{name}'; expected another name: the ledger has columns of this name", {"probes": {name: [3]}})
            for name in (
                *("time", "kinetic_energy", "strain_energy", "total_energy", "closure_error", "removed_energy", "inside_out"),
                *("linear_momentum_x", "angular_momentum_z", "reaction B", "contact floor", "strain_energy StVK 0"),
            )
        ),
    ],
)
def test_invalid_reactions_and_probes_are_refused_before_any_work(error, message, places, monkeypatch):
    monkeypatch.setattr(Motion, "__init__", None)
    with pytest.raises(error, match=message):
        clamped(2).run(EnergyMomentum(0.02), 0.04, **places)


def test_the_picture_has_separate_panels_for_reactions():
    run = clamped(2).run(EnergyMomentum(0.02), 0.1, probes={"tip": [3]}, reactions={"clamp": "left"})
    labels = [axes.get_ylabel().replace("\n", " ") for axes in run.ledger.plot().axes]
    assert labels[-2:] == ["displacement of tip [m]", "reaction clamp [N]"]


def test_reactions_after_a_tiny_last_step_are_accurate():
    """Over 2e-9 s, differences of the supports' displacements contain only round-off: it is the force at the end of the run.

    That after a whole step is the mean over the step, half of it before the end.
    """
    whole, more = (swung(2).run(EnergyMomentum(1e-3), 0.2 + extra, reactions={"clamp": "left"}) for extra in (0.0, 2e-9))
    assert more.ledger.steps == whole.ledger.steps + 1
    for found in (more.reaction("left").resultant, columns(more, "reaction clamp ")[-1]):
        np.testing.assert_allclose(found, whole.reaction("left").resultant, rtol=1e-3)
