"""Contact between surfaces: exact derivatives and works, balances, passing, and the pairs of nodes that follow the body."""

import pickle
import sys
import threading
from copy import deepcopy

import numpy as np
import pytest
import skfem
from terms.toys import in_step

from skfem_stvk import (
    BackwardEuler,
    ContactError,
    ElasticFoundation,
    EnergyMomentum,
    Friction,
    GeneralizedAlpha,
    Gravity,
    LinearBackwardEuler,
    MeshContact,
    NeoHookean,
    Newmark,
    Rayleigh,
    ReducedSystem,
    Simulation,
    SimulationError,
    StVK,
    StvkError,
    System,
    Traction,
    VelocityVerlet,
    simulate,
    solve_static,
)
from skfem_stvk.mesh import ElementMesh
from skfem_stvk.solvers.dynamics.step_problem import StepProblem
from skfem_stvk.solvers.statics.equilibrium import Equilibrium
from skfem_stvk.terms.loads import ipc
from skfem_stvk.terms.loads.load import APART, Moment, StepStart

LAW = StVK(young=3e4, poisson=0.3, density=1000.0)
#: Distance of the barrier, and gap at rest; both are small against the edges.
DISTANCE, GAP = 4e-3, 3e-3


def tensor(size, n, kind=skfem.MeshTet):
    return kind.init_tensor(*(np.linspace(0, length, parts + 1) for length, parts in zip(size, n, strict=True)))


def joined(lower, above, by):
    """Return one mesh of two bodies, "lower" and "upper", of which the second one is displaced `by` (d,)."""
    p = [np.vstack([one.p, np.zeros((len(by) - len(one.p), one.p.shape[1]))]) for one in (lower, above)]
    p, t = np.hstack([p[0], p[1] + np.reshape(by, (-1, 1))]), np.hstack([lower.t, above.t + lower.p.shape[1]])
    halves = {"lower": np.arange(lower.t.shape[1]), "upper": np.arange(lower.t.shape[1], t.shape[1])}
    mesh = ElementMesh.of(type(lower)(p, t)) if len(by) == len(lower.p) else ElementMesh(p, t)
    return ElementMesh(mesh.p, mesh.t, subdomains=halves, element=mesh.element)


#: Kinds of bodies in the plane, then all; "triangles" are sheets in space.
PLANE = ("triangles in the plane", "quadratic triangles in the plane", "quadrilaterals in the plane")
KINDS = ("tetrahedra", "quadratic tetrahedra", "hexahedra", "triangles", *PLANE)
#: A kind of solids, and one of bodies in the plane.
BOTH = KINDS[0], PLANE[0]
THICK = 0.02


def two(kind="tetrahedra", gap=GAP, n=3):
    """Return a lower and a smaller upper block, sheet or body in the plane, whose meshes do not match."""
    flat, hexahedra = kind in PLANE or kind == "triangles", kind == "hexahedra"
    shape = (
        (skfem.MeshQuad if "quadrilaterals" in kind else skfem.MeshTri) if flat else skfem.MeshHex if hexahedra else skfem.MeshTet
    )
    if kind in PLANE:
        return of_degree(
            kind, joined(tensor((0.1, 0.05), (n, 2), shape), tensor((0.08, 0.05), (n + 1, 2), shape), (0.013, 0.05 + gap))
        )
    high, layers = ((), ()) if flat else ((0.05,), (2,))
    lower, above = tensor((0.1, 0.1, *high), (n, n, *layers), shape), tensor((0.08, 0.07, *high), (n - 1, n, *layers), shape)
    return of_degree(kind, joined(lower, above, (0.013, 0.017, sum(high) + gap)))


def of_degree(kind, mesh):
    return mesh.with_degree(2) if kind.startswith("quadratic") else mesh


def pair(kind="tetrahedra", gap=GAP, friction=None, law=LAW, fixed=None, n=3, **options):
    """Return the system of two bodies with contact, and one without."""
    thickness = {"triangles": 0.01} | dict.fromkeys(PLANE, THICK)
    law = StVK(young=3e4, poisson=0.3, density=1000.0, thickness=thickness[kind]) if kind in thickness and law is LAW else law
    mesh = two(kind, gap, n)
    options = {"distance": DISTANCE, "name": "pair"} | options
    with_contact = System(mesh, [law, MeshContact("lower", "upper", friction=friction, **options)], fixed)
    apart = MeshContact("lower", "upper", distance=1e-9)
    return with_contact, System(mesh, [law, apart], fixed)


def on_floor(kind):
    """Return the supports of a lower body of this kind."""
    return {FLOOR: "xy" if kind in PLANE else "xyz"}


def upper(system):
    """Return the nodes of the upper body."""
    return np.unique(system.mesh.t[:, system.mesh.elements("upper")])


def deformed(system, size=1.0, seed=0):
    """Return displacements by which the upper body stays above the lower one, and a direction of size 1."""
    u, v = np.random.default_rng(seed).normal(size=(2, system.ndofs))
    return 2e-4 * size * u, v / np.abs(v).max()


def by_node(x):
    return x.reshape(-1, 3)


def force_of(term, u):
    x = u.reshape(-1, term._X.shape[1])
    out = np.zeros_like(x)
    term.energy_and_force(x, out)
    return out.ravel()


def slope(f, h=1e-7):
    return (f(h) - f(-h)) / (2 * h)


@pytest.mark.parametrize("kind", KINDS[:4])
def test_the_stiffness_of_bodies_that_are_tilted_about_an_axis_is_the_derivative(kind):
    """The blocks of K have zeros there, and SciPy lists the blocks of a row in another order."""
    system, without = pair(kind)
    term, u = system.bound_terms[1], np.zeros((system.mesh.nv, 3))
    u[upper(system), 2] = -1e-2 * system.mesh.p[1][upper(system)]
    v = deformed(system)[1]
    K = system.tangent(u.ravel()).toarray() - without.tangent(u.ravel()).toarray()
    change = slope(lambda s: force_of(term, u.ravel() + s * v))
    assert np.abs(K @ v - change).max() < 1e-2 * np.abs(change).max() and np.abs(K - K.T).max() < 1e-12 * np.abs(K).max()
    assert (np.diff(term._pairs.keys) > 0).all()


@pytest.mark.parametrize(
    ("kind", "area"), [*((kind, 0.0662) for kind in KINDS[:3]), ("triangles", 0.0156), *((kind, 0.56) for kind in PLANE)]
)
def test_the_triangles_of_facets_cover_the_surfaces(kind, area):
    system, _ = pair(kind)
    assert system.bound_terms[1]._barrier.areas().sum() == pytest.approx(area, rel=1e-12)


def test_nothing_touches_a_body_whose_elements_are_all_removed():
    system, _ = pair()
    u, _ = deformed(system)
    rest = system.without(system.mesh.elements("upper"))
    assert rest.bound_terms[1].energy_and_force(by_node(u)) == 0 < system.bound_terms[1].energy_and_force(by_node(u))


def test_the_round_off_of_the_force_counts_positions():
    system, _ = pair()
    term, (u, v) = system.bound_terms[1], deformed(system)
    sums = np.zeros_like(by_node(u))
    term.add_round_off(by_node(u), sums)
    eps = np.finfo(float).eps
    x = by_node(u) + system.mesh.p.T
    rounded = (x * (1 + eps * np.sign(by_node(v)))) - system.mesh.p.T
    change = np.abs(by_node(force_of(term, rounded)) - by_node(force_of(term, u)))
    assert (sums[term._nodes] > 0).any() and (change <= 4 * eps * sums + 1e-15 * np.abs(change).max()).all() and change.any()


@pytest.mark.parametrize("kind", KINDS)
def test_the_bodies_push_each_other_with_no_force_and_no_torque_in_total(kind):
    system, _ = pair(kind)
    term, d, u = system.bound_terms[1], system.mesh.d, deformed(system)[0]
    u = u.reshape(-1, d)
    F, x = force_of(term, u).reshape(-1, d), system.mesh.p.T + u
    size, on_upper = np.abs(F).sum(), F[upper(system)].sum(axis=0)
    assert np.abs(F.sum(axis=0)).max() < 1e-13 * size and np.abs(x.T @ F - F.T @ x).max() < 1e-13 * size
    assert -on_upper[-1] > 0.3 * size / 2 and np.abs(on_upper[:-1]).max() < 0.1 * -on_upper[-1]
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(d, d)))[0]
    turn[:, 0] *= np.sign(np.linalg.det(turn))
    turned = x @ turn.T + [0.3, -0.2, 0.1][:d] - system.mesh.p.T
    assert term.energy_and_force(turned) == pytest.approx(term.energy_and_force(u), rel=1e-9)
    assert np.abs(force_of(term, turned).reshape(-1, d) - F @ turn.T).max() < 1e-8 * np.abs(F).max()


def steps_of_any_size(system):
    """Return displacements at both ends of steps: to contact, away, from one contact to another, along the surface, and at rest."""
    apart, near, sheared = np.zeros((3, *system.mesh.p.T.shape))
    above, x = upper(system), system.mesh.p.T
    apart[above, -1], near[above, -1] = 2 * DISTANCE, -0.97 * GAP
    left, right = near.copy(), near.copy()
    left[above, -1] += 0.03 * x[above, 0]
    right[above, -1] += 0.03 * (0.1 - x[above, 0])
    sheared[above, :-1] = 0.5 * DISTANCE
    held = deformed(system)[0].reshape(x.shape)
    return {"touch": (apart, near), "leave": (near, apart), "rock": (left, right), "slide": (held, held + sheared)}


@pytest.mark.parametrize("kind", KINDS)
def test_the_mean_force_has_the_work_of_the_energy_and_no_resultant_over_steps_of_any_size(kind):
    system, _ = pair(kind)
    term = system.bound_terms[1]
    for name, (u0, u1) in steps_of_any_size(system).items():
        f = np.zeros_like(u0)
        term.mean_force(u0, u1, (0.5, 0.5), 0.5, f)
        W0, W1 = term.energy_and_force(u0), term.energy_and_force(u1)
        assert W0 + W1 > 1e-7 and abs((f * (u1 - u0)).sum() - (W1 - W0)) < 1e-11 * (W0 + W1), name
        assert np.abs(f.sum(axis=0)).max() < 1e-12 * np.abs(f).sum(), name
        forces = [np.abs(force_of(term, (u0 + s * (u1 - u0)).ravel())).max() for s in (0.0, 0.5, 1.0)]
        assert 0 < np.abs(f).max() <= 2 * max(forces), name


def test_round_off_of_a_body_at_rest_does_not_change_the_mean_force():
    system, _ = pair()
    term, u = system.bound_terms[1], by_node(deformed(system)[0])
    force, rng = by_node(force_of(term, u.ravel())), np.random.default_rng(2)
    for _ in range(20):
        f = np.zeros_like(u)
        term.mean_force(u, u + 1e-18 * rng.normal(size=u.shape), (0.5, 0.5), 0.5, f)
        assert np.abs(f - force).max() < 1e-9 * np.abs(force).max()


def test_a_step_of_energy_momentum_evaluates_its_mean_force_at_two_states_per_iterate_from_one_search(monkeypatch):
    system, _ = pair(fixed={FLOOR: "xyz"})
    counts, touching = dict.fromkeys(("searches", "states", "forces"), 0), 0

    def counting(cls, name, counted):
        method = getattr(cls, name)

        def counted_method(self, *arguments):
            counts[counted] += 1
            return method(self, *arguments)

        monkeypatch.setattr(cls, name, counted_method)

    monkeypatch.setattr(ipc, "MARGIN", 1e-4)  # no search serves for another iterate
    counting(ipc.Barrier, "_search", "searches")
    counting(ipc.Barrier, "_among", "states")
    counting(StepProblem, "_internal_force", "forces")
    sim = Simulation(system, EnergyMomentum(dt=1e-4), v0=thrown(system))
    for _ in range(8):
        before, iterations = dict(counts), sim.iterations
        sim.step()
        now = {name: counts[name] - before[name] for name in counts}
        assert now["searches"] <= now["forces"] + 2 and now["states"] <= 2 * now["forces"] + 4
        touching += system.bound_terms[1].energy_and_force(by_node(sim.u)) > 0
        assert now["forces"] == sim.iterations - iterations + 1  # the line search takes the first state
    assert touching > 3


def test_a_contact_that_nothing_touches_costs_no_iterations():
    v, iterations = None, []
    for system in pair(gap=1.5 * DISTANCE):
        v = 0.1 * np.sin(40 * system.mesh.p.T[:, [1, 2, 0]]).ravel() if v is None else v
        sim = Simulation(system, EnergyMomentum(dt=5e-4), v0=v)
        sim.step()
        sim.step()
        iterations.append(sim.iterations)
    assert iterations[0] == iterations[1] > 4


@pytest.mark.parametrize("kind", BOTH)
def test_contact_limit_is_the_fraction_of_the_way_at_which_surfaces_meet(kind):
    system, _ = pair(kind)
    term, down = system.bound_terms[1], np.zeros(system.mesh.p.T.shape)
    down[upper(system), -1] = -2.5 * GAP
    assert term.contact_limit(0 * down, down) == pytest.approx(1 / 2.5, rel=2e-3)
    assert term.passes(0 * down, down) and not term.passes(0 * down, 0.39 * down)
    assert term.contact_limit(0 * down, -down) == 2.0 and term.name == "pair"
    through = 40 * down  # from above to below the lower body
    assert term.passes(0 * down, through) and not len(term._barrier.intersections(term._moved(through)))


@pytest.mark.parametrize("start", [0.0, 2 * DISTANCE])
def test_surfaces_that_approach_each_other_meet_and_short_ways_take_no_search(start, monkeypatch):
    system, _ = pair()
    term, (u, v) = system.bound_terms[1], np.zeros((2, system.mesh.nv, 3))
    u[upper(system), 2], v[:, 2] = start, 1.0
    v[upper(system), 2] = -1.0
    gap, searches, search = GAP + start, [], ipc.Barrier.limit
    monkeypatch.setattr(ipc.Barrier, "limit", lambda *ends: searches.append(1) or search(*ends))
    for part in (0.3, 0.4, 0.49, 1.0):
        assert term.contact_limit(u, part * gap * v) == pytest.approx(0.5 / part, rel=2e-3) and searches
    searches.clear()
    assert term.contact_limit(u, 0.24 * min(gap, DISTANCE) * v) == 2.0 and not searches


def test_collisions_of_a_body_that_is_stretched_far_are_found_without_a_grid(monkeypatch):
    """A grid with cells of the usual size would fill the memory. Where both can be used, the energies agree."""
    system, _ = pair()
    term, (u, _) = system.bound_terms[1], deformed(system)
    barrier, x = term._barrier, term._moved(by_node(u))
    wanted = barrier.energy(barrier.collisions(x))
    barrier._longest = 0.0
    assert barrier.energy(barrier.collisions(x)) == pytest.approx(wanted, rel=1e-12)
    used = []
    monkeypatch.setattr(barrier._toolkit, "HashGrid", lambda: used.append("grid"))
    barrier._longest = ipc.STRETCHED * barrier._longest_edge(term._X)
    x[0] += 1e6
    assert np.isfinite(barrier.energy(barrier.collisions(x))) and not used


def test_a_step_of_arc_length_ends_before_it_passes_a_contact():
    system, _ = pair()
    top = Traction(lambda x: x[2] > 0.102, (0, 0, -1e4))
    held = System(system.mesh, [*system.terms, top, ElasticFoundation(lambda x: x[2] > 0.102, 1.0)], {FLOOR: "xyz"})
    seen, refused = [], Equilibrium.contact_limit

    def look(self, u, v, t):
        limit = refused(self, u, v, t)
        seen.append((limit[0], held.bound_terms[1].passes(by_node(u), by_node(u + v))))
        return limit

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Equilibrium, "contact_limit", look)
        found = solve_static(held, method="arc-length", steps=2, quiet=True, raise_on_failure=False)
    assert any(limit <= 1 and passes for limit, passes in seen)
    assert found.contact("pair").gap.min() > 0 and all(limit > 1 or passes for limit, passes in seen)
    assert found.success or len(found.message) > 20


def test_pairs_of_nodes_follow_the_body_and_results_do_not_depend_on_earlier_calls():
    system, _ = pair()
    u, _ = deformed(system)
    apart = np.zeros_like(by_node(u))
    apart[upper(system), 2] = 0.02
    near = system.tangent(u)
    far = system.tangent(apart.ravel())
    assert near.nnz > far.nnz and system.pattern_version == 2 and not system.bound_terms[1].nodes_paired.size
    again, other = system.tangent(u), pair()[0].tangent(u)
    for one in (again, other):
        assert np.array_equal(one.indices, near.indices) and np.array_equal(one.data, near.data)
    with pytest.raises(StvkError, match="does not have the pattern"):
        system.tangent(u, out=far)
    held = system.free_dofs("lower" if "lower" in system.mesh.node_sets else np.arange(30))
    Kff = system.tangent(u, free=held)
    assert abs(Kff - near[held.free][:, held.free]).max() < 1e-12 * abs(near).max()
    operator = system.linear_operator(u)
    system.tangent(apart.ravel())
    assert np.array_equal(operator @ u, system.linear_operator(u) @ u)  # an operator keeps its pairs
    version = system.pattern_version
    system.look(apart.ravel(), APART)
    assert system.pattern_version == version


def test_in_an_analysis_the_pairs_stay_until_too_many_are_unused():
    system, _ = pair()
    term = system.bound_terms[1].for_analysis(in_time=True)
    u, _ = deformed(system)
    apart = np.zeros_like(by_node(u))
    apart[upper(system), 2] = 0.02
    term.look(by_node(u))
    pairs, version = term.nodes_paired, term.pattern_version
    term.look(apart)
    assert pairs.size and np.array_equal(term.nodes_paired, pairs) and term.pattern_version == version
    history = term.after_step(term.first_history())
    assert not term.advanced(history, apart, Moment(1.0, 1.0))[1:].any()
    assert not term.nodes_paired.size and term.pattern_version == version + 1
    term.return_to(history)
    assert np.array_equal(term.nodes_paired, pairs) and term.pattern_version == version + 2
    assert not system.bound_terms[1].nodes_paired.size
    for wrong in (np.empty(0), history[:-1], np.append(history, 1.0), np.full(5, np.nan), -history):
        with pytest.raises(ValueError, match="MeshContact 'pair'"):
            term.return_to(wrong)


@pytest.mark.parametrize("friction", [None, Friction(0.4, slip_length=1e-4)])
def test_a_system_with_contact_can_be_pickled_and_copied(friction):
    system, _ = pair(friction=friction)
    u, v = deformed(system)
    end = Moment(1.0, 1.0, step=StepStart(system.advanced(system.first_history(), u, 0.0), in_time=False))
    moved = u + 1e-5 * v
    for other in (pickle.loads(pickle.dumps(system)), deepcopy(system)):
        assert np.array_equal(other.internal_force(moved, end), system.internal_force(moved, end))
        assert np.array_equal(other.tangent(moved, t=end).data, system.tangent(moved, t=end).data)


# Whole analyses


def thrown(system, speed=0.5, along=0.1):
    """Return velocities at which the upper body falls on the lower one."""
    v = np.zeros(system.mesh.p.T.shape)
    v[upper(system), 0], v[upper(system), -1] = along, -speed
    return v.ravel()


def FLOOR(x):
    return x[-1] == 0


@pytest.mark.parametrize("kind", BOTH)
def test_energy_momentum_keeps_energy_and_linear_momentum(kind):
    system, _ = pair(kind)
    axes = "xyz"[: system.mesh.d]
    run = simulate(system, EnergyMomentum(dt=1e-3), until=0.02, v0=thrown(system), quiet=True)
    ledger, kinetic = run.ledger, run.ledger["kinetic_energy"][0]
    assert np.abs(ledger["closure_error"]).max() < 1e-11 * kinetic and ledger["strain_energy MeshContact 1"].max() > 1e-4 * kinetic
    assert np.abs(np.diff([ledger[f"linear_momentum_{axis}"] for axis in axes])).max() < 1e-12
    turned = np.array([ledger[f"angular_momentum_{axis}"] for axis in ("xyz" if len(axes) == 3 else "z")])
    assert np.abs(turned - turned[:, :1]).max() < 1e-3 * np.abs(turned).max() + 1e-6  # to O(dt^2)
    v = run.v.reshape(-1, len(axes))[:, -1]
    away = v[upper(system)].mean() - np.delete(v, upper(system)).mean()
    assert away > 0.1 and run.contact("pair").gap.min() > 0


@pytest.mark.parametrize("integrator", [BackwardEuler(dt=1e-3), Newmark(dt=1e-3), GeneralizedAlpha(dt=1e-3)])
def test_implicit_integrators_stop_a_falling_body(integrator):
    system, _ = pair(fixed={FLOOR: "xyz"})
    run = simulate(system, integrator, until=0.02, v0=thrown(system), damping=Rayleigh(beta=1e-4), quiet=True)
    assert run.contact("pair").gap.min() > 0 and by_node(run.v)[upper(system), 2].mean() > -0.1
    assert run.ledger["strain_energy MeshContact 1"].max() > 1e-5 * run.ledger["kinetic_energy"][0]


@pytest.mark.parametrize("kind", BOTH)
def test_friction_slows_a_sliding_body_and_its_work_is_in_the_ledger(kind):
    runs = []
    for friction in (None, Friction(0.4, slip_speed=0.05)):
        system, _ = pair(kind, friction=friction, fixed=on_floor(kind))
        runs.append((system, simulate(system, EnergyMomentum(dt=1e-3), until=0.015, v0=thrown(system, 0.4, 0.3), quiet=True)))
    speeds = [run.v.reshape(-1, system.mesh.d)[upper(system), 0].mean() for system, run in runs]
    ledger, kinetic = runs[1][1].ledger, runs[1][1].ledger["kinetic_energy"][0]
    assert speeds[1] < 0.9 * speeds[0]
    assert np.abs(ledger["closure_error"]).max() < 1e-11 * kinetic and ledger["friction_work"][-1] > 0.01 * kinetic
    assert "friction_work" not in runs[0][1].ledger


@pytest.mark.parametrize("kind", BOTH)
def test_friction_is_at_most_coulombs_and_acts_against_the_slip(kind):
    system, elastic = pair(kind, friction=Friction(0.4, slip_length=1e-4))
    without, u = pair(kind)[0].bound_terms[1], np.zeros(system.mesh.p.T.shape)
    term, history = in_step(system.bound_terms[1], u, 0.0, 1.0, in_time=False)
    normal = force_of(without, u).reshape(u.shape)[upper(system), -1].sum()
    assert np.abs(force_of(term, u).reshape(u.shape)[:, :-1]).max() < 0.02 * abs(normal)  # none without a slip
    for slip, share in ((0.5e-4, 0.75), (1e-3, 1.0)):
        moved = u.copy()
        moved[upper(system), 0] += slip
        rub = (force_of(term, moved) - force_of(without, moved)).reshape(u.shape)
        assert rub[upper(system), 0].sum() == pytest.approx(share * 0.4 * abs(normal), rel=1e-3)
        assert np.abs(rub.sum(axis=0)).max() < 1e-12
        assert term.work(u, moved)[1] == pytest.approx(slip * rub[upper(system), 0].sum())
    direction = np.random.default_rng(5).normal(size=moved.size) * 1e-2

    def check(t):
        at = Moment(t, t, step=StepStart((history,), in_time=False))
        K = (system.tangent(moved.ravel(), t=at) - elastic.tangent(moved.ravel())) @ direction
        change = slope(lambda s: force_of(term, moved.ravel() + s * direction), 1e-6)
        assert np.abs(K - change).max() < 1e-4 * np.abs(change).max()

    check(1.0)
    term, history = in_step(system.bound_terms[1], moved, 1.0, 2.0, in_time=False, after=history)
    moved[upper(system), -2] += 2e-5
    check(2.0)


def test_friction_has_the_width_of_its_step_and_the_start_of_its_analysis():
    system, _ = pair(friction=Friction(0.4, slip_speed=0.1))
    u, _ = deformed(system, 0.0)
    moved = by_node(u).copy()
    moved[upper(system), 0] += 1e-4
    contact, found = system.bound_terms[1], []
    for t in (1e-3, 4e-3):  # widths of .1 and .4 mm
        one, history = in_step(contact, by_node(u), 0.0, t)
        one.look(moved)
        found.append((by_node(force_of(one, moved))[upper(system), 0].sum(), one._blocks_at(moved, False)[1].copy()))
    assert found[1][0] == pytest.approx(found[0][0] * 0.4375, rel=2e-3) and not np.array_equal(found[0][1], found[1][1])
    first = in_step(contact, by_node(u), 0.0, 4e-3)[0]._blocks_at(moved, False)[1].copy()
    other, _ = in_step(contact, (by_node(u) + moved) / 2, 4e-3, 8e-3, after=history)  # the same width, from another start
    assert not np.array_equal(other._blocks_at(moved, False)[1], first)
    with_mean = []
    for states in (None, (by_node(u), moved)):
        one, _ = in_step(contact, by_node(u), 0.0, 4e-3, contact=states)
        with_mean.append(one._stiffness_at(states or (moved,), False))
    without = pair()[0].bound_terms[1]
    smooth = [without._stiffness_at(states, False) for states in ((moved,), (by_node(u), moved))]
    twice, once = with_mean[1] - smooth[1], with_mean[0] - smooth[0]
    assert abs(twice - 2 * once).max() < 1e-9 * abs(once).max() and abs(once).max() > 0  # the equation has twice the mean force
    first = contact.first_history()
    again = contact.at(Moment(1e-3, 1.0, step=StepStart((first,), in_time=True)), first)
    assert again.work(by_node(u), moved) == (0.0, 0.0) and len(first) == 2


@pytest.mark.parametrize("friction", [None, Friction(0.3, slip_speed=0.05)])
def test_a_resumed_run_and_a_restored_simulation_have_the_same_bits(tmp_path, friction):
    system, _ = pair(friction=friction, fixed={FLOOR: "xyz"})
    options = {"v0": thrown(system), "quiet": True}
    whole = simulate(system, BackwardEuler(dt=1e-3), until=0.02, **options)
    simulate(system, BackwardEuler(dt=1e-3), until=0.012, checkpoint=tmp_path, **options)
    again = simulate(system, BackwardEuler(dt=1e-3), until=0.02, checkpoint=tmp_path, resume=True, quiet=True)
    assert np.array_equal(again.u, whole.u) and np.array_equal(again.v, whole.v)
    sim = Simulation(system, BackwardEuler(dt=1e-3), v0=thrown(system))
    for _ in range(8):
        sim.step()
    saved, ends = sim.copy_state(), []
    for _ in range(2):
        for _ in range(6):
            sim.step()
        ends.append((sim.u.copy(), sim.v.copy()))
        sim.restore(saved)
    assert np.array_equal(ends[0], ends[1])


def test_simulations_of_one_system_in_threads_do_not_affect_each_other():
    system, _ = pair(friction=Friction(0.3, slip_speed=0.05), fixed={FLOOR: "xyz"})
    speeds, found = (0.5, 0.4), {}

    def run(speed, key):
        found[key] = simulate(system, BackwardEuler(dt=1e-3), until=0.01, v0=thrown(system, speed), quiet=True).u

    for speed in speeds:
        run(speed, ("alone", speed))
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        threads = [threading.Thread(target=run, args=(speed, ("beside", speed))) for speed in speeds]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(interval)
    for speed in speeds:
        assert np.array_equal(found["alone", speed], found["beside", speed])


def test_an_analysis_has_pairs_of_its_own_after_tangents_at_other_states():
    (system, _), (fresh, _) = (pair(fixed={FLOOR: "xyz"}) for _ in range(2))
    u, _ = deformed(system)
    near, options = system.tangent(u), {"until": 4e-3, "v0": thrown(system), "quiet": True}
    runs = [simulate(body, BackwardEuler(dt=1e-3, solver="superlu"), **options).u for body in (system, fresh, system)]
    assert np.array_equal(runs[0], runs[1]) and np.array_equal(runs[2], runs[1])
    again = system.tangent(u)
    assert np.array_equal(again.indices, near.indices) and np.array_equal(again.data, near.data)


def test_a_simulation_halves_a_step_with_contact_between_meshes_as_simulate_does():
    system, _ = pair(fixed={FLOOR: "xyz"})
    fast, dt = thrown(system, speed=1.0), 2e-3
    run = simulate(system, EnergyMomentum(dt=dt), until=2 * dt, v0=fast, quiet=True)
    sim = Simulation(system, EnergyMomentum(dt=dt), v0=fast)
    for _ in range(2):
        sim.step()
    assert run.cuts > 0 and np.array_equal(sim.u, run.u) and np.array_equal(sim.v, run.v)
    whole = Simulation(system, EnergyMomentum(dt=dt), v0=fast, halvings=0)
    with pytest.raises(SimulationError, match=r"Try a smaller dt, smaller changes of the inputs, or halvings=6; on_failure"):
        whole.step()
    one = Simulation(System(skfem.MeshTet(), [LAW, Gravity((0, 0, -9.81))], {FLOOR: "xyz"}), EnergyMomentum(dt=dt))
    assert (sim._steps.halvings, one._steps.halvings) == (6, 0)


def test_a_fast_body_does_not_pass_through_another_one():
    system, _ = pair(gap=0.02, fixed={FLOOR: "xyz"})
    run = simulate(system, BackwardEuler(dt=1e-3), until=3e-3, v0=thrown(system, 100.0, 0.0), quiet=True, raise_on_failure=False)
    z = (system.mesh.p.T + by_node(run.u))[:, 2]
    assert z[upper(system)].min() > 0 and run.contact("pair").gap.min() > 0
    assert run.status.value == "finished" or "'pair'" in run.message or "invert" in run.message
    with pytest.raises(SimulationError, match="would carry the body through the contact 'pair' within the step"):
        Simulation(system, EnergyMomentum(dt=1e-2), v0=thrown(system, 100.0, 0.0)).step()


@pytest.mark.parametrize("d", [2, 3])
def test_two_blocks_pressed_carry_the_load(d):
    """The blocks have the same cross-section, so that the state is homogeneous, for nu = 0."""
    size, shape = (*(0.1,) * (d - 1), 0.05), skfem.MeshTet if d == 3 else skfem.MeshTri
    lower, above = (tensor(size, (*(n,) * (d - 1), 2), shape) for n in (4, 3))
    mesh = joined(lower, above, (*(0.0,) * (d - 1), 0.05 + 2e-3))
    law, lid = StVK(young=3e4, poisson=0.0, **({"thickness": THICK} if d == 2 else {})), mesh.p[-1].max()
    terms, held = [law, MeshContact("lower", "upper", distance=2e-3, name="pair")], {FLOOR: "xyz"[:d]}
    moved = {lambda x: x[-1] == lid: dict.fromkeys("xyz"[: d - 1], 0.0) | {"xyz"[d - 1]: -5e-3}}
    found = solve_static(System(mesh, terms, held, moved), steps=4, quiet=True)
    assert found.success
    state, section = found.contact("pair"), 0.01 if d == 3 else 0.1 * THICK
    assert state.resultant[-1] == pytest.approx(found.reaction(lambda x: x[-1] == lid).resultant[-1], rel=1e-6)
    inner = np.flatnonzero((np.abs(mesh.p[-1] - 0.05) < 1e-9) & (np.abs(mesh.p[:-1] - 0.05).max(axis=0) < 0.03))
    assert state.pressure[inner].mean() == pytest.approx(-state.resultant[-1] / section, rel=0.1)


def test_the_force_is_proportional_to_the_thickness_and_the_pressure_is_not():
    found = []
    for thickness in (THICK, 3 * THICK):
        system, _ = pair(PLANE[0], law=StVK(young=3e4, poisson=0.3, thickness=thickness))
        term, x = system.bound_terms[1], np.zeros(system.mesh.p.T.shape)
        found.append((term.energy_and_force(x), *term.evaluated(x)))
    (W, p, _, A), (V, q, _, B) = found
    assert pytest.approx(3 * W) == V and pytest.approx(3 * A) == B and np.allclose(p, q, rtol=1e-12) and p.max() > 0


@pytest.mark.parametrize("d", [2, 3])
def test_a_body_touches_itself(d):
    """A block with a slit, open at one side: its two arms touch when they are pressed."""
    size, n = ((0.12, 0.04, 0.10), (6, 2, 5)) if d == 3 else ((0.12, 0.10), (6, 5))
    mesh = tensor(size, n, skfem.MeshTet if d == 3 else skfem.MeshTri)
    centre = mesh.p[:, mesh.t].mean(axis=1)
    mesh = ElementMesh.of(mesh.remove_elements(np.flatnonzero((centre[0] > 0.04) & (np.abs(centre[-1] - 0.05) < 0.01))))

    def tip(x):
        return (x[-1] == x[-1].max()) & (x[0] > 0.09)

    contact, held = MeshContact(None, distance=3e-3, name="skin"), {FLOOR: "xyz"[:d]}
    terms = [NeoHookean(young=3e4, poisson=0.3, density=1e3), contact, Traction(tip, (*(0,) * (d - 1), -3e3))]
    found = solve_static(System(mesh, terms, held), steps=5, quiet=True)
    assert found.success and 0 < found.contact("skin").gap.min() < 3e-3 and found.contact("skin").area > 0
    assert np.abs(found.contact("skin").resultant).max() < 1e-9
    without = solve_static(System(mesh, [terms[0], terms[2]], held), steps=5, quiet=True, raise_on_failure=False)
    upper_arm = d * np.flatnonzero((np.abs(mesh.p[-1] - 0.06) < 1e-9) & (mesh.p[0] > 0.1)) + d - 1
    assert without.u[upper_arm].min() < found.u[upper_arm].min()


def test_removed_elements_take_their_facets_with_them():
    system, _ = pair()
    u, _ = deformed(system)
    torn = system.without(system.mesh.elements("upper")[: len(system.mesh.elements("upper")) // 2])
    whole, rest = (one.bound_terms[1].energy_and_force(by_node(u)) for one in (system, torn))
    assert 0 < rest < whole and np.isfinite(torn.tangent(u).data).all()


def test_a_contact_with_friction_has_the_displacements_of_the_remaining_nodes():
    system, _ = pair(friction=Friction(0.4, slip_length=1e-4))
    contact, (u, v) = system.bound_terms[1], deformed(system)
    removed = np.zeros(system.mesh.nt, dtype=bool)
    removed[system.mesh.elements("upper")[:40]] = True
    before = contact.without(removed)
    term, history = in_step(contact, by_node(u), 0.0, 1.0, in_time=False)
    force_of(term, u + 1e-5 * v)
    end = Moment(1.0, 1.0, step=StepStart((history,), in_time=False))
    rest, fresh = (one.at(end, history) for one in (contact.without(removed), before))
    assert np.array_equal(force_of(rest, u + 1e-5 * v), force_of(fresh, u + 1e-5 * v))
    assert len(rest._nodes) != len(term._nodes) and np.array_equal(rest._start, by_node(u))
    assert np.isfinite(force_of(rest, u + 1e-5 * v)).all()
    rest.return_to(history)


def column(where=None, friction=None, **others):
    """Return two cubes with a layer between them, and the elements of the layer."""
    mesh = skfem.MeshTet.init_tensor(*2 * [np.linspace(0, 0.1, 3)], np.array([0, 0.05, 0.1, 0.12, 0.17, 0.22]))
    z = mesh.p[2, mesh.t].mean(axis=0)
    mesh = ElementMesh(mesh.p, mesh.t, subdomains={"all": np.arange(mesh.nelements)})
    mesh = mesh.with_boundaries({"ends": lambda x: (x[2] == 0) | (x[2] > 0.219)})
    contact = MeshContact(where, distance=DISTANCE, friction=friction, name="skin")
    return System(mesh, [LAW, contact], {FLOOR: "xyz"}, **others), np.flatnonzero(np.abs(z - 0.11) < 0.01)


def dropped(system, gap):
    """Return displacements (nv, 3) with which the upper cube is above the lower one by a gap."""
    u = np.zeros((system.mesh.nv, 3))
    u[system.mesh.p[2] > 0.119] = 1e-3, 2e-3, gap - 0.02
    return u


@pytest.mark.filterwarnings("ignore:1 part becomes loose")
@pytest.mark.parametrize(("where", "touches"), [(None, True), ("all", True), ("ends", False)])
def test_faces_that_removed_elements_leave_touch_unless_the_surface_is_a_boundary(where, touches):
    whole, middle = column(where)
    torn = whole.without(middle)
    term, u = torn.bound_terms[1], dropped(torn, GAP)
    rng, up = np.random.default_rng(2), torn.mesh.p[2] > 0.119
    u += 1e-4 * rng.normal(size=u.shape)
    force = by_node(force_of(term, u.ravel()))
    assert (term.energy_and_force(u) > 0) == touches and (force[up, 2].sum() < -1) == touches
    assert term.passes(u, dropped(torn, -0.01)) == touches
    on_axis = np.abs(torn.mesh.p - [[0.05], [0.05], [0.12]]).max(axis=0) < 1e-9  # on exposed faces alone
    assert (term.evaluated(u)[1][on_axis] < DISTANCE) == touches
    if touches:
        v = rng.normal(size=u.size)
        torn_elastic = System(torn.mesh, [LAW], {FLOOR: "xyz"}).without(middle)
        K = torn.tangent(u.ravel()) - torn_elastic.tangent(u.ravel())
        change = slope(lambda s: force_of(term, u.ravel() + s * v), 1e-8)
        assert np.abs(K @ v - change).max() < 1e-4 * np.abs(change).max()
        assert np.abs(force.sum(axis=0)).max() < 1e-11 * np.abs(force).sum()
        centre = whole.without(middle[whole.mesh.p[0, whole.mesh.t[:, middle]].mean(axis=0) < 0.05])
        assert centre.bound_terms[1].energy_and_force(np.zeros_like(u)) == 0  # faces with common nodes do not touch


@pytest.mark.filterwarnings("ignore:1 part becomes loose")
@pytest.mark.parametrize("friction", [None, Friction(0.4, slip_speed=0.05)])
def test_a_part_that_is_cut_off_falls_on_the_face_below_it(tmp_path, friction):
    system, middle = column(friction=friction)
    v0 = np.zeros((system.mesh.nv, 3))
    v0[system.mesh.p[2] > 0.119] = 0.1, 0, -2
    options = {"v0": v0.ravel(), "quiet": True, "remove": lambda t, u: middle if t > 0 else None}
    whole = simulate(system, EnergyMomentum(dt=2e-3), until=0.02, **options)
    ledger, z = whole.ledger, (system.mesh.p.T + by_node(whole.u))[:, 2]
    kinetic = ledger["kinetic_energy"][0]
    assert z[system.mesh.p[2] > 0.119].min() > 0.05 and ledger["strain_energy MeshContact 1"].max() > 1e-3 * kinetic
    assert np.abs(ledger["closure_error"]).max() < 1e-10 * kinetic
    assert friction is None or ledger["friction_work"][-1] > 1e-3 * kinetic
    simulate(system, EnergyMomentum(dt=2e-3), until=0.012, checkpoint=tmp_path, **options)
    again = simulate(
        system, EnergyMomentum(dt=2e-3), until=0.02, checkpoint=tmp_path, resume=True, quiet=True, remove=options["remove"]
    )
    assert np.array_equal(again.u, whole.u) and np.array_equal(again.v, whole.v)


# Bad input


BAD = {
    "names no location": ({"first": "lowr"}, "no boundary, node set or subdomain 'lowr'; .* Did you mean 'lower'"),
    "common nodes": ({"second": None, "first": "lower", "distance": 1.0}, "distance = 1 m; expected at most"),
    "distance 0": ({"distance": 0.0}, "distance = 0"),
    "stiffness < 0": ({"stiffness": -1.0}, "stiffness = -1"),
    "friction": ({"friction": 0.3}, "friction = 0.3; expected Friction"),
    "longer than an edge": ({"distance": 0.03}, "distance = 0.03 m; expected at most the shortest edge"),
    "the same surface": ({"second": "lower"}, "in both surfaces"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused(name):
    given, message = BAD[name]
    options = {"first": "lower", "second": "upper", "distance": DISTANCE} | given
    with pytest.raises(StvkError, match=message):
        System(two(), [LAW, MeshContact(**options)])


@pytest.mark.parametrize(("kind", "crossing"), [(BOTH[0], "edges and triangles"), (BOTH[1], "pairs of edges")])
def test_surfaces_that_intersect_or_lie_inside_another_body_are_refused_with_ids(kind, crossing):
    with pytest.raises(ContactError, match=rf"{crossing} intersect at the start, first the edge of nodes \(\d+, \d+\) and"):
        pair(kind, gap=-0.01)
    d, shape = (2, skfem.MeshTri) if kind in PLANE else (3, skfem.MeshTet)
    mesh = joined(tensor((0.1,) * d, (2,) * d, shape), tensor((0.02,) * d, (1,) * d, shape), (0.031, 0.03, 0.031)[:d])
    for contact in (MeshContact("lower", "upper", distance=1e-3), MeshContact(None, distance=1e-3)):
        with pytest.raises(ContactError, match="inside another part of the body at the start"):
            System(mesh, [LAW, contact])


def test_a_start_with_intersections_is_refused():
    system, _ = pair(fixed={FLOOR: "xyz"})
    u0 = np.zeros((system.mesh.nv, 3))
    u0[upper(system), 2] = -2 * GAP
    u0 = u0.ravel()
    for start in (
        lambda: solve_static(system, u0=u0, quiet=True),
        lambda: simulate(system, BackwardEuler(dt=1e-3), until=1e-3, u0=u0, quiet=True),
        lambda: Simulation(system, BackwardEuler(dt=1e-3), u0=u0),
    ):
        with pytest.raises(ContactError, match="edges and triangles intersect at the start"):
            start()


def test_what_pairs_do_not_support_is_refused():
    system, _ = pair(fixed={FLOOR: "xyz"})
    for integrator in (LinearBackwardEuler(dt=1e-3), VelocityVerlet(), VelocityVerlet(dt=1e-6)):
        with pytest.raises(StvkError, match="with the MeshContact 'pair'; expected an implicit integrator"):
            simulate(system, integrator, until=0.01, v0=thrown(system), quiet=True)
        with pytest.raises(StvkError, match="with the MeshContact 'pair'; expected an implicit integrator"):
            Simulation(system, integrator)
    with pytest.raises(StvkError, match="'pair'"):
        ReducedSystem(system, size=3)
    line = skfem.MeshLine()
    with pytest.raises(ContactError, match="1 dimension; expected 2 or 3"):
        System(line, [LAW, MeshContact(None, distance=1e-3)])
    for friction, solve in (
        (Friction(0.3, slip_speed=1.0), lambda body: solve_static(body, quiet=True)),
        (Friction(0.3, slip_length=1.0), lambda body: simulate(body, BackwardEuler(dt=1e-3), until=1e-3, quiet=True)),
    ):
        body, _ = pair(friction=friction, fixed={FLOOR: "xyz"})
        with pytest.raises(ContactError, match=r"slip_(speed|length)=None"):
            solve(body)


def test_a_missing_or_other_toolkit_is_named_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setattr(ipc, "version", lambda name: "1.7.2")
    with pytest.raises(ContactError, match=r"ipctk 1.7.2 is installed; expected 1.6.1 or later, before 1.7. Run pip install"):
        pair()

    def absent(name):
        raise ipc.PackageNotFoundError(name)

    monkeypatch.setattr(ipc, "version", absent)
    with pytest.raises(ContactError, match=r"not installed; expected the package ipctk. Run pip install 'skfem-stvk\[contact\]'"):
        pair()


@pytest.mark.parametrize("kind", KINDS)
def test_collisions_do_not_depend_on_where_pairs_were_searched(kind):
    """Collisions among the pairs of an earlier search have the bits of a new search, on a way of small and of large steps."""
    system, _ = pair(kind)
    term, rng = system.bound_terms[1], np.random.default_rng(5)
    u, searches, touching = np.zeros(system.mesh.p.T.shape), 0, set()
    for i, apart in enumerate((2.2, 0.2, 0.0, 2.2, 1.8, 1.4, 1.0, 0.6, 0.2, *rng.uniform(0, 0.5, 10))):
        u[:, -1] = -0.5 * apart * DISTANCE
        u[upper(system), -1] *= -1
        u[upper(system), 0] += 0.2 * DISTANCE * (i > 8)
        before, x = term._barrier._near, term._moved(u)
        near, new = term._barrier.collisions(x), deepcopy(term)._barrier.collisions(x)
        searches += term._barrier._near is not before
        touching.add(len(new.found))
        assert np.array_equal(term._barrier.force(near), term._barrier.force(new)) and len(near.found) == len(new.found)
        K = term._barrier.stiffness(near, False) - term._barrier.stiffness(new, False)
        assert not K.nnz or not abs(K).max()
    assert 5 < searches < 15 and len(touching) > 2
