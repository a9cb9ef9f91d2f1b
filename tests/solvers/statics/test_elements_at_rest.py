"""Quadratic simplices, hexahedra and quadrilaterals in statics: scikit-fem's solution, balance of forces, all solvers."""

import numpy as np
import pytest
import skfem
from bodies import CURVED, scikit_fem_of
from skfem.helpers import ddot, sym_grad, trace

from skfem_stvk import BodyForce, ElasticFoundation, ElementMesh, Gravity, Pressure, Stop, StVK, System, Traction, solve_static
from skfem_stvk.edges.materials import Hypothesis, Isotropic
from skfem_stvk.mesh.points import rule_of

SOLID = [name for name, mesh in CURVED.items() if scikit_fem_of(mesh)]
SECTION = {2: {"thickness": 0.3}, 3: {}}
YOUNG, POISSON = 1e6, 0.3


def clamped(mesh):
    return np.unique(mesh.surface[:, mesh.p[0, mesh.surface].max(axis=0) < 0.1])


def tip(x):
    return x[0] > 0.85


def system_of(mesh, *loads, **more):
    material = StVK(young=YOUNG, poisson=POISSON, density=1e3, **SECTION[mesh.k])
    return System(mesh, [material, *loads], fixed=[(clamped(mesh), "xyz"[: mesh.d])], **more)


@pytest.mark.parametrize("quadrature", [None, "exact"])
@pytest.mark.parametrize("name", SOLID)
def test_small_displacements_are_scikit_fems(name, quadrature):
    """Small displacements are scikit-fem's, with the same elements and rule, under a body force and a traction on curved facets."""
    mesh, small = CURVED[name], 1e-6
    section = 0.3 if mesh.k == 2 else 1.0
    b, T = 1e3 * small * np.arange(1.0, mesh.d + 1), 1e4 * small * np.array([0.3, -1.0, 0.5])[: mesh.d]
    system = system_of(mesh, BodyForce(b), Traction(tip, T), quadrature=quadrature)
    u = solve_static(system, quiet=True).u

    known = scikit_fem_of(mesh)
    lam, mu = Isotropic(YOUNG, POISSON).lame(Hypothesis.SOLID)  # the same for plane strain

    @skfem.BilinearForm
    def stiffness(u, v, w):
        return section * (lam * trace(sym_grad(u)) * trace(sym_grad(v)) + 2 * mu * ddot(sym_grad(u), sym_grad(v)))

    def solved(rule):
        basis = skfem.Basis(known.mesh, known.elem, quadrature=(rule.points.T, rule.weights))
        return skfem.solve(*skfem.condense(stiffness.assemble(basis), f, D=system.supports.held))

    f, kinds = system.external_force(np.zeros(system.ndofs)), ("usual", "exact")
    exact, other = (solved(rule_of(mesh.element, kind)) for kind in (kinds if quadrature is None else kinds[::-1]))
    assert np.abs(exact).max() > 1e-9 and np.abs(u - exact).max() < 1e-6 * np.abs(exact).max()
    assert np.abs(other - exact).max() > 1e-5 * np.abs(exact).max()


@pytest.mark.few
@pytest.mark.parametrize("solver", ["superlu", "pardiso", "amg-cg", "block-jacobi-cg", "ssor-cg"])
@pytest.mark.parametrize("name", SOLID)
def test_all_solvers_find_the_same_large_displacements(name, solver):
    mesh = CURVED[name]
    T = 2e4 * np.array([0.3, -1.0, 0.5])[: mesh.d]
    system = system_of(mesh, Traction(tip, T), Gravity(-9.81 * np.arange(1.0, mesh.d + 1)))
    result = solve_static(system, solver=solver, quiet=True)
    assert np.abs(result.u).max() > 0.02
    residual = system.residual(result.u)
    residual[system.supports.held] = 0
    force = system.external_force(result.u).reshape(-1, mesh.d)
    assert np.abs(residual).max() < 1e-6 * np.abs(force).max()
    reaction = result.reaction([*clamped(mesh)])
    assert reaction.resultant == pytest.approx(-force.sum(axis=0), rel=1e-6)
    x = mesh.p.T + result.u.reshape(-1, mesh.d)
    if mesh.d == 3:
        moments = np.cross(x, force).sum(axis=0), reaction.moment(np.zeros(3))
    else:
        moments = (x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]).sum(), reaction.moment(np.zeros(2))
    assert np.abs(moments[0] + moments[1]).max() < 1e-6 * np.abs(moments[0]).max()


@pytest.mark.parametrize("name", SOLID)
def test_a_pressed_body_on_springs_is_in_equilibrium_under_follower_loads(name):
    mesh = CURVED[name]
    low = lambda x: x[1] < 0.15  # noqa: E731
    terms = StVK(young=YOUNG, poisson=POISSON, **SECTION[mesh.k]), ElasticFoundation(low, 2e5), Pressure(tip, 5e3)
    system = System(mesh, terms)
    result = solve_static(system, quiet=True)
    loads = system.external_force(result.u)
    assert np.abs(result.u).max() > 5e-3 and np.abs(system.residual(result.u)).max() < 1e-6 * np.abs(loads).max()
    ground = system.foundation_force(result.u).reshape(-1, mesh.d).sum(axis=0)
    assert ground == pytest.approx(-loads.reshape(-1, mesh.d).sum(axis=0), abs=1e-6 * np.abs(loads).max())


@pytest.mark.parametrize("name", SOLID)
def test_a_path_by_arc_length_ends_at_its_stop(name):
    mesh = CURVED[name]
    system = system_of(mesh, Traction(tip, 2e4 * np.array([0.0, -1.0, 0.0])[: mesh.d]))
    node = int(np.argmax(mesh.p[0]))
    result = solve_static(system, steps=4, method="arc-length", stop=Stop(displacement=([node], "y", -0.01)), quiet=True)
    assert result.u.reshape(-1, mesh.d)[node, 1] == pytest.approx(-0.01, rel=1e-6)


def test_quadratic_cantilevers_bend_as_beams_do_where_linear_ones_lock():
    """Quadratic elements have the deflection of a beam under an end load, P L^3 / (3 E I) with shear; linear tetrahedra lock."""
    length, height, P = 10.0, 1.0, 1e-4
    tets = skfem.MeshTet.init_tensor(np.linspace(0, length, 9), *[np.linspace(0, height, 2)] * 2)
    hexes = skfem.MeshHex.init_tensor(np.linspace(0, length, 41), *[np.linspace(0, height, 5)] * 2)
    beam = P * length**3 / (3 * 1.0 / 12) * (1 + 0.75 * height**2 / length**2)

    def deflection(mesh, **more):
        mesh = ElementMesh.of(mesh.with_boundaries({"wall": lambda x: x[0] == 0, "tip": lambda x: x[0] == length}))
        load = Traction("tip", (0, 0, -P))
        system = System(mesh, [StVK(young=1.0, poisson=0.0), load], fixed={"wall": "xyz"}, **more)
        found = solve_static(system, quiet=True)
        return -found.u.reshape(-1, 3)[system.mesh.p[0] == length, 2].mean()

    assert deflection(tets, degree=2) == pytest.approx(beam, rel=0.05)
    assert deflection(hexes) == pytest.approx(beam, rel=0.05)
    assert deflection(tets) < 0.4 * beam
