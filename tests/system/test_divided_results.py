"""Findings, reactions, ledgers, signatures and linear solves of a divided body are those of the whole body in each part."""

import numpy as np
import pytest
from divided import Division, beam, caught, combined, free_body, grounded, separate_threads

from skfem_stvk import (
    BackwardEuler,
    ElasticFoundation,
    EnergyMomentum,
    ForwardEuler,
    Gravity,
    LinearBackwardEuler,
    Newmark,
    NodalLoad,
    Plane,
    StVK,
    System,
    VelocityVerlet,
    simulate,
    solve_static,
)
from skfem_stvk.errors import LoadError, SupportError
from skfem_stvk.linear import BlockJacobiCg, Kind, Unknowns
from skfem_stvk.results.monitors import Monitors
from skfem_stvk.system.operator import FreeOperator
from skfem_stvk.system.rigid import rigid_modes
from skfem_stvk.system.signature import Fingerprint

__all__ = ["separate_threads"]  # a fixture
pytestmark = pytest.mark.filterwarnings("ignore::skfem_stvk.errors.StvkWarning")
divided = pytest.mark.parametrize("how", ["strips", "random"])


def compressed(mesh, young):
    """Return a body of a material that locks."""
    return System(mesh, [StVK(young=young, poisson=np.where(young > 3, 0.49, 0.3)), ElasticFoundation("skin", 3.0)])


@divided
def test_findings_have_the_elements_of_all_parts_and_the_place_of_the_first(how):
    body = Division("tetrahedra", how)
    x = body.mesh.p.T - body.mesh.p.mean(axis=1)
    u = (-0.5 * x - 0.6 * (x[:, :1] > 0.2) * x).ravel()

    def work(system, dofs):
        monitors = Monitors(system)
        before = getattr(system.space.comm, "ids_sent", 0)
        found = [*monitors.before(), *monitors.at(u[dofs])]
        assert getattr(system.space.comm, "ids_sent", 0) - before <= 5 * len(found)
        return [(one.name, one.elements.tolist(), one.extreme, one.text) for one in found]

    found, whole = body.run(work, compressed)
    assert [one[0] for one in whole] == ["locking", "inside out", "compressed"]
    for _, own in found:
        for (name, ids, extreme, text), (whole_name, whole_ids, whole_extreme, whole_text) in zip(own, whole, strict=True):
            assert (name, ids, text) == (whole_name, whole_ids[:5], whole_text) and len(whole_ids) > 5
            assert extreme == pytest.approx(whole_extreme, rel=1e-12)


def clamped(mesh, young):
    """Return a body whose first third is held, so that a part has no free degree of freedom."""
    left = mesh.bounds[0, 0] + 0.3 * mesh.extent[0]
    fixed = {lambda x: x[0] < left: "xyz"}
    loads = Gravity(g=(0, 0.01, 0.02)), ElasticFoundation("skin", 0.3)
    return System(mesh, [StVK(young=young, poisson=0.3, density=2.0), *loads], fixed=fixed)


INTEGRATORS = [VelocityVerlet(dt=0.02), BackwardEuler(dt=0.05, rtol=1e-11), Newmark(dt=0.05, rtol=1e-11), EnergyMomentum(dt=0.05)]


@divided
def test_reactions_are_those_of_the_whole_body_in_each_part(how, separate_threads, monkeypatch):
    monkeypatch.setattr(System, "check_held", lambda self, u=None, t=0.0: None)

    def work(system, dofs):
        reaction = solve_static(system, steps=1, solver="block-jacobi-cg", rtol=1e-12, quiet=True).reaction()
        return reaction, reaction.resultant, reaction.moment((0.1, 0.2, 0.3)), reaction.centroid

    found, (whole, *numbers) = beam(how).run(work, clamped)
    for _, (own, *of_part) in found:
        assert np.array_equal(own.vertices, whole.vertices) and np.array_equal(own.rest, whole.rest)
        for one, other in zip((own.by_node, *of_part), (whole.by_node, *numbers), strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * abs(whole.by_node).max())


PLANES = {axis: Plane((0.0, 0.0, 0.0), np.eye(3)["xyz".index(axis)]) for axis in "xyz"}


def on_planes(mesh, young):
    """Return a body on three planes, which share edges with each other and nodes with a foundation."""
    loads = Gravity(g=(0.2, 0.01, 0.02)), ElasticFoundation("skin", (0.0, 0.3, 0.1))
    return System(mesh, [StVK(young=young, poisson=0.3, density=2.0), *loads], fixed=[(PLANES[a], a) for a in PLANES])


@divided
def test_shares_of_supports_are_those_of_the_whole_body_in_each_part(how, separate_threads, monkeypatch):
    monkeypatch.setattr(System, "check_held", lambda self, u=None, t=0.0: None)
    places = {**PLANES, "skin": "skin", "all": None}

    def work(system, dofs):
        static = solve_static(system, steps=1, solver="block-jacobi-cg", rtol=1e-12, quiet=True)
        run = simulate(system, VelocityVerlet(dt=0.02), until=0.1, reactions=places, quiet=True)
        columns = {name: np.stack([run.ledger[f"reaction {name} {axis}"] for axis in "xyz"]) for name in places}
        return {name: static.reaction(where).by_node for name, where in places.items()}, columns

    found, whole = beam(how).run(work, on_planes)
    for _, own in found:
        for values, wanted in zip(own, whole, strict=True):
            for name, one in wanted.items():
                np.testing.assert_allclose(values[name], one, rtol=0, atol=1e-8 * abs(wanted["all"]).max(), err_msg=name)
    for wanted, axis in zip(whole, (0, 1), strict=True):
        total = sum(values.sum(axis=axis) for name, values in wanted.items() if name != "all")
        np.testing.assert_allclose(total, wanted["all"].sum(axis=axis), rtol=0, atol=1e-9 * abs(wanted["all"]).max())


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda one: one.name)
@divided
def test_probes_and_reactions_of_a_ledger_are_those_of_the_whole_body(how, integrator, separate_threads, monkeypatch):
    """One part has no free degree of freedom, others have no support."""
    monkeypatch.setattr(System, "check_held", lambda self, u=None, t=0.0: None)
    body = beam(how)
    tip = np.flatnonzero(body.mesh.p[0] > 5.4)

    def work(system, dofs):
        own = {"probes": {"tip": tip}, "reactions": {"wall": lambda x: x[0] < 1.9}}
        run = simulate(system, integrator, until=0.2, quiet=True, **own)
        return run.u, {name: run.ledger[name] for name in run.ledger.names}, run.reaction(lambda x: x[0] < 1.9).resultant

    found, (_, ledger, resultant) = body.run(work, clamped)
    assert {"tip x", "reaction wall z"} <= set(ledger)
    for _, (_, own, own_resultant) in found:
        for name, column in ledger.items():
            if not name.endswith(("energy", "work", "error")):
                np.testing.assert_allclose(own[name], column, rtol=0, atol=1e-8 * max(abs(column).max(), 1e-3), err_msg=name)
        np.testing.assert_allclose(own_resultant, resultant, rtol=0, atol=1e-8 * abs(resultant).max())


def moving(mesh, young):
    """Return a body with supports that move at one end: other parts have no support that moves."""
    prescribed = {
        lambda x: x[0] > 5.9: {"x": lambda x, t: 0.02 * np.sin(t) * np.ones(x.shape[1]), "y": lambda x, t: 0.03 * t + 0 * x[0]}
    }
    terms = [StVK(young=young, poisson=0.3, density=2.0), ElasticFoundation("skin", 0.3)]
    return System(mesh, terms, fixed={lambda x: x[0] < 0.1: "xyz"}, prescribed=prescribed)


@pytest.mark.few
@pytest.mark.parametrize(
    "integrator",
    [
        None,
        VelocityVerlet(dt=0.02),
        ForwardEuler(dt=0.02),
        LinearBackwardEuler(dt=0.05, rtol=1e-12),
        Newmark(dt=0.05, rtol=1e-11),
        EnergyMomentum(dt=0.05),
    ],
    ids=lambda one: "statics" if one is None else one.name,
)
@divided
def test_supports_that_move_in_one_part_move_the_whole_body(how, integrator, separate_threads, monkeypatch):
    monkeypatch.setattr(System, "check_held", lambda self, u=None, t=0.0: None)

    def work(system, dofs):
        if integrator is None:
            result = solve_static(system, steps=3, solver="block-jacobi-cg", rtol=1e-12, quiet=True)
            return result.u, np.array([step.t for step in result.history]), [len(step.iterations) for step in result.history]
        run = simulate(system, integrator, until=0.3, quiet=True)
        return run.u, run.ledger["external_work"], run.ledger.steps

    found, (u, work_done, steps) = beam(how).run(work, moving)
    of_parts = combined([(dofs, own) for dofs, (own, *_) in found], (len(u), 1))[:, 0]
    np.testing.assert_allclose(of_parts, u, rtol=0, atol=1e-9 * abs(u).max())
    for _, (_, own, own_steps) in found:
        assert own_steps == steps
        np.testing.assert_allclose(own, work_done, rtol=0, atol=1e-9 * abs(work_done).max())


@divided
@pytest.mark.parametrize("name", ["tetrahedra", "quadratic triangles"])
@pytest.mark.parametrize("kind", ["path of equilibria", "motion"])
def test_a_problem_has_the_same_signature_in_all_divisions(name, how, kind, separate_threads):
    def make(mesh, young):
        ends = {lambda x: x[0] < mesh.bounds[0, 0] + 0.4 * mesh.extent[0]: "x"}
        moved = {lambda x: x[1] > mesh.bounds[1, 1] - 0.2 * mesh.extent[1]: {"y": lambda x, t: t * (1 + x[0])}}
        return System(mesh, grounded(mesh, young).terms, fixed=ends, prescribed=moved)

    def work(system, dofs):
        return Fingerprint(kind, system, {}, (0.5, 1.0), {}).signature.numbers

    found, whole = Division(name, how).run(work, make)
    for _, own in found:
        assert own.keys() == whole.keys()
        for key in whole:
            np.testing.assert_allclose(own[key], whole[key], rtol=1e-11, err_msg=key)
    found, other = Division(name, how).run(work, lambda mesh, young: make(mesh, young[::-1].copy()))
    assert other["the elastic terms"] != pytest.approx(whole["the elastic terms"], rel=1e-9)


@divided
def test_a_name_means_all_of_its_nodes_in_parts_that_have_none_of_its_facets(how, separate_threads):
    """Supports, loads on nodes and foundations by name reach nodes of parts that touch them at a node or an edge only."""

    def make(mesh, young):
        low = mesh.bounds[1, 0] + 1e-9
        side = mesh.boundaries["skin"][:, (mesh.p[1][mesh.boundaries["skin"]] < low).all(axis=0)]
        object.__setattr__(mesh, "boundaries", {**mesh.boundaries, "side": side})
        return System(mesh, [StVK(young=young, poisson=0.3), NodalLoad("side", (1.0, 2.0, 3.0))], fixed={"side": "y"})

    def work(system, dofs):
        foundation = System(system.mesh, [*system.elastic_terms, ElasticFoundation("side", 2.0)])
        return (
            np.sort(system.space.numbers[system.supports.held]),
            system.external_force(0 * dofs.astype(float)),
            foundation.grounded,
        )

    body = beam(how)
    found, (held, loads, tied) = body.run(work, make)
    assert len(held) and loads.any() and len(tied)
    for dofs, (own_held, own_loads, own_tied) in found:
        assert np.array_equal(own_held, np.intersect1d(held, dofs)) and np.array_equal(own_loads, loads[dofs])
        assert np.array_equal(np.sort(dofs[own_tied]), np.intersect1d(tied, dofs))


@divided
def test_rigid_modes_turn_about_the_centre_of_the_whole_body(how):
    found, whole = Division("tetrahedra", how).run(lambda s, dofs: rigid_modes(s.mesh.p.T, s.space), grounded)
    of_parts = combined([(np.arange(len(dofs)), own) for dofs, own in found[:1]], found[0][1].shape)
    for dofs, own in found:
        np.testing.assert_allclose(own, whole[dofs], rtol=0, atol=1e-14)
    assert of_parts.shape[1] == 6


@divided
@pytest.mark.parametrize("with_shift", [False, True])
@pytest.mark.parametrize("make", [grounded, free_body])
def test_an_iteration_of_conjugate_gradients_has_two_reductions(make, with_shift, how):
    """The loop finds the solution of the whole body, with a mass on the diagonal, too."""
    body = Division("tetrahedra", how)
    b, x0 = np.random.default_rng(5).standard_normal((2, body.mesh.p.size))

    def solve(system, dofs):
        free = system.free_dofs(np.flatnonzero(system.space.numbers % 7 == 0))
        shift = np.repeat(system.mass().vertex, 3)[free.free] if with_shift else None
        K = FreeOperator(system.linear_operator(np.zeros(system.ndofs)), free, shift)
        factors = BlockJacobiCg().analyse(Unknowns(*np.divmod(free.free, 3))).factorise(K, Kind.POSITIVE_DEFINITE)
        before = system.space.comm.reductions if system.space.comm.divided else 0
        first = factors.solve(b[dofs][free.free], rtol=1e-11)
        count = system.space.comm.reductions - before if system.space.comm.divided else 0
        again = factors.solve(b[dofs][free.free], 1e-11, x0[dofs][free.free])
        x, y, z = np.zeros((3, system.ndofs))
        x[free.free], y[free.free], z[free.free] = first.x, again.x, factors.precondition(b[dofs][free.free])
        return np.stack([x, y, z], axis=1), first.iterations, count

    found, (x, iterations, *_) = body.run(solve, make)
    of_parts = combined([(dofs, own) for dofs, (own, *_) in found], x.shape)
    np.testing.assert_allclose(of_parts, x, rtol=0, atol=1e-8 * abs(x).max())
    for _, (_, own, reductions) in found:
        assert abs(own - iterations) <= 2 and 2 * own <= reductions <= 2 * own + 6


def test_nothing_acts_on_the_body_is_decided_by_all_parts(separate_threads, monkeypatch):
    """A part without a load, a support or a velocity is no error; a body without any is one in all parts."""
    monkeypatch.setattr(System, "check_held", lambda self, u=None, t=0.0: None)
    body = beam("strips")

    def make(mesh, young):
        return System(mesh, [StVK(young=young, poisson=0.3, density=2.0), ElasticFoundation("skin", 0.3)])

    def work(system, dofs):
        v = np.where(system.space.numbers == 0, 0.01, 0.0)
        run = simulate(system, VelocityVerlet(dt=0.02), until=0.1, v0=v, quiet=True)
        nothing = caught(lambda: simulate(system, VelocityVerlet(dt=0.02), until=0.1, quiet=True))
        static, reaction = caught(lambda: solve_static(system, quiet=True)), run.reaction()
        return run.u, nothing, static, len(reaction.vertices)

    found, (u, nothing, static, count) = body.run(work, make)
    of_parts = combined([(dofs, own) for dofs, (own, *_) in found], (len(u), 1))[:, 0]
    np.testing.assert_allclose(of_parts, u, rtol=0, atol=1e-12 * abs(u).max())
    for _, (_, *own) in found:
        assert own[0] == nothing and own[1] == static and own[2] == count
    assert nothing[0] is static[0] is LoadError
    free = Division.only_parts(body, lambda s, dofs: caught(lambda: run_reaction(s)), free_body)
    assert {own[0] for _, own in free} == {SupportError}


def run_reaction(system):
    simulate(system, VelocityVerlet(dt=0.02), until=0.02, v0=np.ones(system.ndofs), quiet=True).reaction()


@divided
def test_numbers_of_parts_are_gathered_in_ascending_order(how):
    def work(system, dofs):
        space = system.space
        own = space.counted(np.ones(space.n)) > 0
        numbers = space.numbers[own]
        return space.comm.gather(numbers[::-1], np.stack([np.cos(numbers), numbers], axis=1)[::-1])

    found, _ = Division("tetrahedra", how).run(work, grounded)
    n = len(np.unique(np.concatenate([dofs for dofs, _ in found])))
    for _, (numbers, values) in found:
        assert np.array_equal(numbers, np.arange(n)) and np.array_equal(values, np.stack([np.cos(numbers), numbers], axis=1))
