"""A system whose mesh is a part of a divided body has the energy, forces and limits of the whole body."""

from functools import partial

import numpy as np
import pytest
from bodies import EVERY_MESH, state
from divided import Division, combined, separate_threads

from skfem_stvk import (
    BackwardEuler,
    EdgeDamping,
    ElasticFoundation,
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
from skfem_stvk.solvers.newton.outcome import Status
from skfem_stvk.system.bound import compressed_in_part
from skfem_stvk.system.operator import FreeOperator


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
        "compressed": system.mesh.ids_of_all(compressed_in_part(system, u, 0.9)),
    }
    return fields, numbers


__all__ = ["separate_threads"]  # a fixture
divided = pytest.mark.parametrize("how", ["strips", "random"])
on_solids = pytest.mark.parametrize("name", [name for name, mesh in EVERY_MESH.items() if mesh.k == mesh.d > 1])
pytestmark = pytest.mark.filterwarnings("ignore:The mesh is in . parts:skfem_stvk.errors.StvkWarning")


@pytest.mark.few
@divided
@on_solids
def test_parts_have_the_results_of_the_whole_body(name, how):
    body = Division(name, how)
    u, v = state(body.mesh).ravel(), np.random.default_rng(4).standard_normal(body.mesh.p.size)
    found, (fields, numbers) = body.run(lambda system, dofs: results(system, u[dofs], v[dofs]), system_of)
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


def assert_same(found, u, tolerance):
    of_parts = combined([(dofs, own) for dofs, (own, *_) in found], (len(u), 1))
    np.testing.assert_allclose(of_parts[:, 0], u, rtol=0, atol=tolerance * abs(u).max())


@divided
@pytest.mark.parametrize("name", ["tetrahedra", "quadratic triangles"])
def test_a_static_solve_on_parts_is_that_of_the_whole_body(name, how, separate_threads):
    def solve(system, dofs):
        result = solve_static(system, steps=2, solver="block-jacobi-cg", rtol=1e-12, quiet=True)
        return result.u, [len(step.iterations) for step in result.history], result.status, result.history[-1].potential

    found, (u, iterations, status, potential) = Division(name, how).run(solve, system_of)
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


@pytest.mark.few
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

    found, (u, ledger) = body.run(move, partial(system_of, factor=factor))
    assert_same(found, u, 1e-11)
    assert abs(u).max() > 0.01 and {"kinetic_energy", "strain_energy", "dissipated_work", "angular_momentum_z"} <= set(ledger)
    energy = max(abs(ledger[name]).max() for name in ledger if name.endswith(("energy", "work")))
    for _, (_, own) in found:
        for name, column in ledger.items():
            scale = energy if name.endswith(("energy", "work", "error")) else abs(column).max()
            np.testing.assert_allclose(own[name], column, rtol=0, atol=1e-10 * scale, err_msg=name)
