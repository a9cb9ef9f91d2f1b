"""A system whose mesh is a part of a divided body has the energy, forces and limits of the whole body."""

import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from copy import deepcopy
from functools import cached_property
from threading import Barrier, BrokenBarrierError

import numpy as np
import pytest
from bodies import EVERY_MESH, state

from skfem_stvk import (
    BackwardEuler,
    EdgeDamping,
    ElasticFoundation,
    ElementMesh,
    EnergyMomentum,
    ForwardEuler,
    Gravity,
    LinearBackwardEuler,
    Newmark,
    NodalLoad,
    Rayleigh,
    StVK,
    System,
    Traction,
    VelocityVerlet,
    VolumePenalty,
    critical_step,
    simulate,
    solve_static,
)
from skfem_stvk.linear import BlockJacobiCg, Kind, Outcome, Unknowns
from skfem_stvk.linear.space import Space
from skfem_stvk.nonlinear.outcome import Status
from skfem_stvk.system.operator import FreeOperator


class Exchange:
    """Values that the parts exchange, each part in its own thread."""

    def __init__(self, parts):
        self.barrier, self._values = Barrier(parts, timeout=60), [None] * parts

    def values(self, part, value):
        """Return the values of all parts, in ascending order of parts."""
        self._values[part] = deepcopy(value)
        self.barrier.wait()
        found = list(self._values)
        self.barrier.wait()
        return found


class PartSpace(Space):
    """Space of a part of a body with `n` degrees of freedom.

    `numbers` are the degrees of freedom of the part, `elements` the ids of its elements in the body.
    """

    numbers = None

    def __init__(self, exchange, part, n, numbers, elements, owned):
        super().__init__(len(numbers))
        self._of_all = lambda value: exchange.values(part, value)
        self._whole, self.numbers, self._elements = n, numbers, elements
        self._owned = owned

    @property
    def divided(self):
        return True

    @property
    def owned(self):
        return self._owned

    def share(self, f):
        each = max(self.n // f.size, 1)  # d for numbers of nodes
        numbers, rows = self.numbers[::each] // each, f.reshape(self.n // each, -1)
        total = np.zeros((self._whole // each, rows.shape[1]))
        for of_part, values in self._of_all((numbers, rows)):
            total[of_part] += values
        rows[:] = total[numbers]
        return f

    def random(self, seed=0):
        return np.random.default_rng(seed).standard_normal(self._whole)[self.numbers]

    def counted(self, x):
        each, counts = self.n // x.size, np.zeros(x.size)
        for own in self.owned:
            counts[own.start // each : own.stop // each] = 1
        return counts * x

    def total(self, x):
        return sum(self._of_all(x))

    def least(self, x):
        return min(self._of_all(x))

    def most(self, x):
        return max(self._of_all(x))

    def element_ids(self, ids):
        return np.unique(np.concatenate(self._of_all(self._elements[ids])))


class Part(ElementMesh):
    """Part of a mesh, with a space that is set afterwards. Midpoints need not be in scikit-fem's order."""

    space = None

    def __post_init__(self):
        object.__setattr__(self, "t", np.ascontiguousarray(self.t))


def part_of(mesh, parts, number, exchange):
    """Return the mesh of some elements, with the facets of the body's surface that it has, and its degrees of freedom.

    A node belongs to the first part that has it. Among the vertices and among the midpoints, a part's own nodes come first.
    """
    ids, d = parts[number], mesh.d
    nodes = np.unique(mesh.t[:, ids])
    middle, foreign = (
        np.isin(nodes, mesh.t[mesh.element.corners :]),
        np.isin(nodes, mesh.t[:, np.concatenate([[], *parts[:number]]).astype(int)]),
    )
    order = np.lexsort((foreign, middle))
    starts = d * np.array([0, np.count_nonzero(~middle)])
    counts = d * np.array([np.count_nonzero(~middle & ~foreign), np.count_nonzero(middle & ~foreign)])
    owned = tuple(slice(start, start + count) for start, count in zip(starts, counts, strict=True))
    nodes = nodes[order]
    local = np.empty(mesh.p.shape[1], dtype=np.int32)
    local[nodes] = np.arange(len(nodes))
    facets = {frozenset(mesh.t[list(of), e]) for e in ids for of in mesh.element.facets}
    skin = np.array([facet for facet in mesh.boundaries["skin"].T if frozenset(facet) in facets])
    part = Part(mesh.p[:, nodes], local[mesh.t[:, ids]], boundaries={"skin": local[skin].T}, element=mesh.element)
    dofs = (d * nodes[:, None] + np.arange(d)).ravel()
    object.__setattr__(part, "space", PartSpace(exchange, number, mesh.p.size, dofs, ids, owned))
    return part, dofs


def system_of(mesh, young, factor=0.05):
    """Return a system of terms that are sums over elements and facets, with a stiffness for each element and a factor of loads."""
    d = mesh.d
    terms = [StVK(young=young, poisson=0.3, density=2.0), VolumePenalty(0.5, kind="quadratic")]
    loads = [
        Gravity(g=0.05 * np.arange(1, d + 1)),
        Traction("skin", scaled(factor, np.arange(2, d + 2))),
        ElasticFoundation("skin", 3.0),
    ]
    loads.append(NodalLoad(lambda x: x[0] > -9, 0.001 * np.arange(1, d + 1)))
    return System(mesh, [*terms, *loads])


def scaled(factor, values):
    """Return `factor` times values, as a function of time if the factor is one."""
    return (lambda t: factor(t) * values) if callable(factor) else factor * values


def results(system, u, v):
    """Return fields by name, which the parts share, and numbers of the whole body by name."""
    W, F = system.energy_and_force(u)
    other_W, other_F, _ = system.linearize(u)
    operator, prepared_F, free_Kv = system.linear_operator(u), np.zeros(system.mesh.p.T.shape), np.zeros_like(v)
    prepared_W = operator.prepare(u, force=prepared_F)
    free = system.free_dofs(np.flatnonzero(system.space.numbers % 5 == 0))
    free_space = system.space.on(free.free)
    free_Kv[free.free] = FreeOperator(operator, free) @ v[free.free]
    fields = {
        "F": F,
        "F of linearize": other_F,
        "F of prepare": prepared_F,
        "internal force": system.internal_force(u),
        "loads": system.external_force(u, 0.7),
        "residual": system.residual(u, 0.7),
        "K v": system.product(u, v),
        "operator": operator @ v,
        "free operator": free_Kv,
        "diagonal": operator.diagonal_blocks(),
        "round-off": system.round_off(u),
        "foundation": system.foundation_force(u),
    }
    for kind in ("lumped", "consistent"):
        mass = system.mass(kind)
        fields |= {f"M v, {kind}": mass.multiply(v), f"M^-1 F, {kind}": mass.solve(F)}
    numbers = {
        "W": W,
        "W of linearize": other_W,
        "W of prepare": prepared_W,
        "energy": system.energy(u),
        "potential": system.potential(u, 0.7),
        "smallest J": system.smallest_volume_ratio(u),
        "smallest stretch": system.smallest_stretch(u),
        "limit": system.step_limit(0 * u, u),
        "along": System(system.mesh, system.terms[0]).energy_along(u, v),
        "mass": system.mass().total,
        "critical step": critical_step(system, u).step,
        "safe step": critical_step(system, u).bound,
        "norm": system.space.norm(v),
        "norm of tiny numbers": system.space.norm(1e-250 * v),
        "free norm": free_space.norm(free_space.restrict(v)),
        "free product": free_space.dot(free_space.restrict(v), free_space.restrict(u)),
        "energies": list(system.energies(u, 0.7).values()),
        "inside out": system.inside_out(3 * u),
        "compressed": system.compressed(u, 0.9),
    }
    return fields, numbers


class Division:
    """A body of three parts, by strips or at random, with another stiffness in each element."""

    def __init__(self, name, how):
        bare, rng = EVERY_MESH[name], np.random.default_rng(3)
        self.mesh = ElementMesh(bare.p, bare.t, boundaries={"skin": bare.surface}, element=bare.element)
        self.young = rng.uniform(1, 5, self.mesh.nt)
        order = np.argsort(bare.p[0, bare.t].mean(axis=0)) if how == "strips" else rng.permutation(bare.nt)
        self.parts = [np.sort(ids) for ids in np.array_split(order, 3)]

    def run(self, work, **options):
        """Return for each part its degrees of freedom and `work(system, dofs)`, and the result of the whole body."""
        exchange = Exchange(len(self.parts))

        def run(number):
            try:
                part, dofs = part_of(self.mesh, self.parts, number, exchange)
                return dofs, work(system_of(part, self.young[self.parts[number]], **options), dofs)
            except BaseException:
                exchange.barrier.abort()
                raise

        with ThreadPoolExecutor(len(self.parts)) as pool:
            futures = [pool.submit(run, number) for number in range(len(self.parts))]
        failed = [future for future in futures if future.exception() and not isinstance(future.exception(), BrokenBarrierError)]
        found = [future.result() for future in failed or futures]
        return found, work(system_of(self.mesh, self.young, **options), np.arange(self.mesh.p.size))


def combined(found, shape):
    """Return a field of the whole body from those of the parts, which have the same bits at nodes that they share."""
    field = np.full(shape, np.nan)
    for dofs, values in found:
        rows, known = values.reshape(len(dofs), -1), ~np.isnan(field[dofs])
        assert np.array_equal(field[dofs][known], rows[known])
        field[dofs] = rows
    return field


@pytest.fixture
def separate_threads(monkeypatch):
    """Parts run in threads, which share the locks that cached properties have before Python 3.12; remove these."""
    modules = [module for name, module in list(sys.modules.items()) if name.partition(".")[0] == "skfem_stvk"]
    classes = {one for module in modules for one in vars(module).values() if isinstance(one, type)}
    for one in [value for cls in classes for value in vars(cls).values() if isinstance(value, cached_property)]:
        if hasattr(one, "lock"):
            monkeypatch.setattr(one, "lock", nullcontext())


divided = pytest.mark.parametrize("how", ["strips", "random"])
on_solids = pytest.mark.parametrize("name", [name for name, mesh in EVERY_MESH.items() if mesh.k == mesh.d > 1])
pytestmark = pytest.mark.filterwarnings("ignore:The mesh is in . parts:skfem_stvk.errors.StvkWarning")


@divided
@on_solids
def test_parts_have_the_results_of_the_whole_body(name, how):
    body = Division(name, how)
    u, v = state(body.mesh).ravel(), np.random.default_rng(4).standard_normal(body.mesh.p.size)
    found, (fields, numbers) = body.run(lambda system, dofs: results(system, u[dofs], v[dofs]))
    assert len(numbers["inside out"]) and len(numbers["compressed"]) and np.isfinite(numbers["limit"])
    for name, field in fields.items():
        whole = field.reshape(body.mesh.p.size, -1)
        of_parts = combined([(dofs, own[name]) for dofs, (own, _) in found], whole.shape)
        if name == "round-off":  # an estimate, which depends on the order of nodes
            assert (of_parts > whole / 5).all() and (of_parts < 5 * whole).all()
        else:
            np.testing.assert_allclose(of_parts, whole, rtol=0, atol=1e-13 * abs(whole).max(), err_msg=name)
    for _, (_, own) in found:
        for name, number in numbers.items():
            if name == "safe step":  # norms of blocks that two parts share are bounded by the sum of both
                assert 0.97 * number < own[name] <= (1 + 1e-12) * number
                continue
            tolerance = 1e-9 if name == "critical step" else 1e-13  # iterations end at another residual
            np.testing.assert_allclose(own[name], number, rtol=tolerance, err_msg=name)


@divided
@on_solids
def test_conjugate_gradients_on_parts_find_the_solution_of_the_whole_body(name, how):
    """All parts have the same number of iterations, and the solution has the same bits at nodes that they share."""
    body = Division(name, how)
    b = np.random.default_rng(5).standard_normal(body.mesh.p.size)

    def solve(system, dofs):
        free = system.free_dofs(np.flatnonzero(system.space.numbers % 7 == 0))
        K = FreeOperator(system.linear_operator(np.zeros(system.ndofs)), free)
        factors = BlockJacobiCg().analyse(Unknowns(*np.divmod(free.free, system.mesh.d))).factorise(K, Kind.POSITIVE_DEFINITE)
        solution = factors.solve(b[dofs][free.free], rtol=1e-12)
        x = np.zeros(system.ndofs)
        x[free.free] = solution.x
        return x, solution.iterations, solution.outcome

    found, (x, iterations, outcome) = body.run(solve)
    of_parts = combined([(dofs, own) for dofs, (own, _, _) in found], (len(x), 1))
    np.testing.assert_allclose(of_parts[:, 0], x, rtol=0, atol=1e-10 * abs(x).max())
    assert iterations > 5 and outcome is Outcome.SOLVED
    assert len({count for _, (_, count, _) in found}) == 1 and abs(found[0][1][1] - iterations) <= 1
    assert {end for _, (_, _, end) in found} == {outcome}


def assert_same(found, u, tolerance):
    of_parts = combined([(dofs, own) for dofs, (own, *_) in found], (len(u), 1))
    np.testing.assert_allclose(of_parts[:, 0], u, rtol=0, atol=tolerance * abs(u).max())


@divided
@pytest.mark.parametrize("name", ["tetrahedra", "quadratic triangles"])
def test_a_static_solve_on_parts_is_that_of_the_whole_body(name, how, separate_threads):
    def solve(system, dofs):
        result = solve_static(system, steps=2, solver="block-jacobi-cg", rtol=1e-12, quiet=True)
        return result.u, [len(step.iterations) for step in result.history], result.status, result.history[-1].potential

    found, (u, iterations, status, potential) = Division(name, how).run(solve)
    assert_same(found, u, 1e-12)
    assert abs(u).max() > 0.01 and status is Status.CONVERGED
    for _, (_, own_iterations, own_status, own_potential) in found:
        assert own_iterations == iterations and own_status is status
        assert own_potential == pytest.approx(potential, rel=1e-12)


INTEGRATORS = {
    "Verlet": VelocityVerlet(dt=0.01),
    "Euler": ForwardEuler(dt=0.01),
    "equation 9": LinearBackwardEuler(dt=0.05, rtol=1e-12, solver="block-jacobi-cg"),
    "backward Euler": BackwardEuler(dt=0.05, rtol=1e-12, solver="block-jacobi-cg"),
    "Newmark": Newmark(dt=0.05, rtol=1e-12, solver="block-jacobi-cg"),
    "energy and momentum": EnergyMomentum(dt=0.05, solver="block-jacobi-cg"),
}


@pytest.mark.parametrize("factor", [0.05, lambda t: 0.1 * np.sin(9 * t)], ids=["constant", "changing"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_damped_motion_on_parts_is_that_of_the_whole_body(integrator, factor, separate_threads):
    """Energies, momenta and works of the ledger are those of the whole body, too."""
    body = Division("tetrahedra", "random")
    v = 0.1 * np.random.default_rng(6).standard_normal(body.mesh.p.size)

    def move(system, dofs):
        damping = [Rayleigh(0.1, 0.002), *([] if integrator == "equation 9" else [EdgeDamping(0.003)])]
        run = simulate(system, INTEGRATORS[integrator], until=0.5, v0=v[dofs], damping=damping, quiet=True)
        return run.u, {name: run.ledger[name] for name in run.ledger.names}

    found, (u, ledger) = body.run(move, factor=factor)
    assert_same(found, u, 1e-11)
    assert abs(u).max() > 0.01 and {"kinetic_energy", "strain_energy", "dissipated_work", "angular_momentum_z"} <= set(ledger)
    energy = max(abs(ledger[name]).max() for name in ledger if name.endswith(("energy", "work")))
    for _, (_, own) in found:
        for name, column in ledger.items():
            scale = energy if name.endswith(("energy", "work", "error")) else abs(column).max()
            np.testing.assert_allclose(own[name], column, rtol=0, atol=1e-10 * scale, err_msg=name)
