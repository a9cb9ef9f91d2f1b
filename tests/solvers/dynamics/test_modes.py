"""Modes are the lowest eigenpairs of (K, M), and rigid modes are identified. Under follower loads, bodies can flutter."""

import numpy as np
import pytest
import skfem
from bodies import MESHES, box, random_frames, sheet, some_voigt, state
from scipy.linalg import eig, eigh
from skfem.helpers import ddot, dot, eye, sym_grad, trace
from slow import slow

from skfem_stvk import (
    Anisotropic,
    BodyForce,
    ElasticFoundation,
    ElementMesh,
    Pressure,
    StVK,
    StvkError,
    System,
    Traction,
    solve_static,
)
from skfem_stvk.linear import SOLVERS
from skfem_stvk.solvers.dynamics import Newmark, modes, simulate

RIGID = {1: 1, 2: 3, 3: 6}
MASSES = ("lumped", "consistent")
NAMES = tuple(solver.name for solver in SOLVERS)


def term(mesh, **options):
    """Return StVK with densities that vary by element."""
    return StVK(young=2.0, poisson=0.3, density=np.random.default_rng(0).uniform(0.5, 2, mesh.nt), **options)


def wall(mesh):
    """Return the vertices at one end."""
    return tuple(np.flatnonzero(mesh.p[0] < np.quantile(mesh.p[0], 0.15)).tolist())


def dense(system, u=None, mass="lumped", t=1.0):
    """Return all eigenpairs over the free degrees of freedom, by LAPACK."""
    u = np.zeros(system.ndofs) if u is None else u
    free = np.setdiff1d(np.arange(system.ndofs), system.supports.held)
    K, M = (matrix.toarray()[np.ix_(free, free)] for matrix in (system.jacobian(u, t), system.mass(mass).matrix))
    values, vectors = eigh(K, M)
    shapes = np.zeros((len(values), system.ndofs))
    shapes[:, free] = vectors.T
    return values, shapes


def assert_are_the_lowest(found, system, u=None, mass="lumped", limit=1e-9):
    values, shapes = dense(system, u, mass)
    n = len(found)
    assert np.abs(found.eigenvalues - values[:n]).max() < limit * max(abs(values[n - 1]), 1e-3 * values[-1])
    assert (np.diff(found.eigenvalues) > -limit * values[-1]).all()
    M = system.mass(mass).matrix
    assert np.abs(found.shapes @ (M @ found.shapes.T) - np.eye(n)).max() < 1e-10
    assert not found.shapes[:, system.supports.held].any()
    more = np.count_nonzero(values <= values[n - 1] + 1e-6 * values[-1])  # all pairs of a multiple eigenvalue
    inside = ((shapes[:more] @ (M @ found.shapes.T)) ** 2).sum(axis=0)
    assert inside.min() > 1 - 1e-8
    assert (found.residuals < 1e-4 * max(abs(values[n - 1]), 1e-3 * values[-1])).all()
    for value, residual in zip(found.eigenvalues, found.residuals, strict=True):
        assert np.abs(values - value).min() <= residual + limit * values[-1]


MATRIX_FREE = ("block-jacobi-cg", "ssor-cg")
#: The solvers with the masses that they accept.
SOLVED = [(solver, mass) for solver in NAMES for mass in MASSES if not (solver in MATRIX_FREE and mass == "consistent")]


@pytest.mark.few
@pytest.mark.parametrize(("solver", "mass"), SOLVED)
@pytest.mark.parametrize("name", ["tetrahedra", "triangles"])
def test_every_solver_finds_the_lowest_pairs(name, solver, mass):
    mesh = MESHES[name]
    system = System(mesh, term(mesh), fixed={wall(mesh): "xyz"[: mesh.d]})
    found = modes(system, 6, mass=mass, solver=solver)
    assert_are_the_lowest(found, system, mass=mass)
    assert not found.rigid.any() and not found.unstable.any()
    assert found.frequencies == pytest.approx(np.sqrt(found.eigenvalues) / (2 * np.pi))


@pytest.mark.few
@pytest.mark.parametrize(("solver", "mass"), SOLVED)
@pytest.mark.parametrize("name", ["tetrahedra", "triangles", "segments"])
def test_a_free_body_has_its_rigid_modes(name, solver, mass):
    mesh = MESHES[name]
    system = System(mesh, term(mesh))
    n = min(RIGID[mesh.d] + 4, system.ndofs)
    found = modes(system, n, mass=mass, solver=solver)
    assert_are_the_lowest(found, system, mass=mass)
    assert found.rigid.tolist() == [True] * RIGID[mesh.d] + [False] * (n - RIGID[mesh.d])
    assert not found.frequencies[found.rigid].any() and (found.frequencies[~found.rigid] > 0).all()


@pytest.mark.parametrize("name", [slow("tetrahedra"), "triangles"])
def test_the_lowest_modes_of_a_large_body_are_those_of_the_dense_problem(name):
    """Most cases above have so few unknowns that matrices are dense; here they are sparse, and eigenvalues occur in pairs."""
    if name == "tetrahedra":
        mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 5)] * 3)
    else:
        mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 11), np.linspace(0, 1, 11))
    for solver in NAMES:
        system = System(mesh, StVK(young=2.0, poisson=0.3, density=1.0))
        assert_are_the_lowest(modes(system, 12, solver=solver), system)


def test_the_frequencies_are_those_of_scikit_fems_matrices():
    mesh = skfem.MeshTet(box(4).p, box(4).t).with_boundaries({"wall": lambda x: x[0] < 0.1})
    young, poisson, density = 2.0, 0.3, 3.0
    lam, mu = young * poisson / (1 + poisson) / (1 - 2 * poisson), young / 2 / (1 + poisson)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTetP1()), intorder=2)

    @skfem.BilinearForm
    def stiffness(u, v, w):
        strain = sym_grad(u)
        return ddot(lam * eye(trace(strain), 3) + 2 * mu * strain, sym_grad(v))

    K, M = stiffness.assemble(basis), skfem.BilinearForm(lambda u, v, w: density * dot(u, v)).assemble(basis)
    K, M = (skfem.condense(matrix, D=basis.get_dofs("wall"), expand=False).toarray() for matrix in (K, M))
    wanted = np.sqrt(eigh(K, M, eigvals_only=True)[:7]) / (2 * np.pi)
    system = System(mesh, StVK(young=young, poisson=poisson, density=density), fixed={"wall": "xyz"})
    assert modes(system, 7, mass="consistent").frequencies == pytest.approx(wanted, rel=1e-9)


def test_frequencies_of_a_cantilever_are_those_of_euler_and_bernoulli():
    """Linear triangles are too stiff for plane stress, and half their size divides the error by four.

    The cantilever is 20 times as long as thick.
    """
    length, thick, young, density = 1.0, 0.05, 2e11, 7800.0
    errors = []
    for n in (4, 8):
        mesh = skfem.MeshTri.init_tensor(np.linspace(0, length, 20 * n + 1), np.linspace(0, thick, n + 1))
        mesh = mesh.with_boundaries({"wall": lambda x: x[0] == 0})
        system = System(mesh, StVK(young=young, poisson=0.0, density=density, plane="stress", thickness=0.02), fixed={"wall": "xy"})
        wanted = np.array([1.8751, 4.6941, 7.8548]) ** 2 / (2 * np.pi) * np.sqrt(young * thick**2 / 12 / density) / length**2
        errors.append(modes(system, 3).frequencies / wanted - 1)
    assert (errors[0] > errors[1]).all() and errors[1][0] == pytest.approx(errors[0][0] / 4, rel=0.02)
    limit = (4 * errors[1] - errors[0]) / 3  # shear and rotatory inertia lower the third frequency by 2.5 %
    assert abs(limit[0]) < 1e-3 and (np.diff(limit) < 0).all() and -0.03 < limit[2] < -0.02


@pytest.mark.parametrize("solver", NAMES)
def test_tension_raises_the_frequencies(solver):
    """Modes about a loaded equilibrium are modes of its Jacobian, which includes the stress."""
    mesh = ElementMesh.of(
        skfem.MeshTri(sheet(6).p * [[3.0], [0.5]], sheet(6).t).with_boundaries(
            {"left": lambda x: x[0] < 0.2, "right": lambda x: x[0] > 2.8}
        )
    )
    terms = [term(mesh), Traction("right", (0.1, 0.02))]
    system = System(mesh, terms, fixed={"left": "xy"})
    u = solve_static(system, quiet=True).u
    found, at_rest = modes(system, 4, u=u, solver=solver), modes(system, 4, solver=solver)
    assert_are_the_lowest(found, system, u)
    assert found.frequencies[0] > 1.1 * at_rest.frequencies[0]


@pytest.mark.parametrize("d", [2, 3])
def test_a_rotated_body_has_the_same_modes(d):
    mesh = sheet() if d == 2 else box()
    system = System(mesh, term(mesh))
    Q = random_frames(1, np.random.default_rng(1))[0] if d == 3 else np.array([[0.6, -0.8], [0.8, 0.6]])
    u = (Q @ mesh.p - mesh.p + 0.7).ravel("F")
    n = RIGID[d] + 4
    found, at_rest = modes(system, n, u=u), modes(system, n)
    assert np.array_equal(found.rigid, at_rest.rigid) and found.rigid.sum() == RIGID[d]
    assert found.frequencies == pytest.approx(at_rest.frequencies, rel=1e-9)


@pytest.mark.parametrize("solver", NAMES)
def test_negative_eigenvalues_are_reported_as_unstable(solver):
    """The column is straight and compressed beyond its buckling load."""
    flat = skfem.MeshTri.init_tensor(np.linspace(0, 3, 31), np.linspace(0, 0.1, 3))
    system = System(flat, StVK(young=2.0, poisson=0.3, density=1.0), fixed={(lambda x: x[0] == 0): "xy"})
    u = (flat.p * [[-0.02], [0.0]]).ravel("F")
    found = modes(system, 8, u=u, solver=solver)
    assert_are_the_lowest(found, system, u, limit=1e-8)
    values, _ = dense(system, u)
    below = np.count_nonzero(values < 0)
    assert 2 <= below < 8 and found.unstable.tolist() == [True] * below + [False] * (8 - below)
    assert np.isnan(found.frequencies[:below]).all() and (found.frequencies[below:] > 0).all()
    assert f"{below} unstable" in repr(found) and "unstable, omega^2 = -" in repr(found)


@pytest.mark.parametrize("solver", NAMES)
def test_the_lowest_of_many_negative_eigenvalues_are_found(solver):
    """The state has other eigenvalues nearest to zero than its lowest ones."""
    flat = skfem.MeshTri.init_tensor(np.linspace(0, 3, 31), np.linspace(0, 0.1, 3))
    system = System(flat, StVK(young=2.0, poisson=0.3, density=1.0), fixed={(lambda x: x[0] == 0): "xy"})
    u = (flat.p * [[-0.1], [0.0]]).ravel("F")
    assert np.count_nonzero(dense(system, u)[0] < 0) >= 10
    found = modes(system, 2, u=u, solver=solver)
    assert_are_the_lowest(found, system, u, limit=1e-8)
    assert found.unstable.all()


def test_rigid_motions_on_springs_are_not_rigid_modes():
    """The lowest modes of a stiff block on a soft foundation are rigid motions with stiffness; along the floor there is none."""
    mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 4)] * 3).with_boundaries({"floor": lambda x: x[2] == 0})
    block = StVK(young=1e6, poisson=0.3, density=2.0)
    on_springs = modes(System(mesh, [block, ElasticFoundation("floor", stiffness=(0.0, 0.0, 8.0))]), 7)
    assert on_springs.rigid.tolist() == [True] * 3 + [False] * 4
    up_and_down = np.sqrt(8.0 / 2.0) / (2 * np.pi)
    assert np.abs(on_springs.frequencies / up_and_down - 1).min() < 1e-4
    assert on_springs.frequencies[3:6].max() < 1e-2 * on_springs.frequencies[6]


def test_a_soft_mode_is_not_rigid():
    """A thin strip bends with a millionth of the largest frequency, but this is no rigid motion."""
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 201), np.linspace(0, 1e-3, 2))
    found = modes(System(mesh, StVK(young=1e3, poisson=0.3, density=1.0)), 6)
    assert found.rigid.tolist() == [True] * 3 + [False] * 3


@pytest.mark.filterwarnings("ignore:The mesh is in 2 parts")
def test_each_part_has_its_own_rigid_modes():
    """The bodies are two separate sheets, with or without hinges."""
    one = sheet(3)
    p, t = np.hstack([one.p, one.p + np.array([[3.0], [1.0]])]), np.hstack([one.t, one.t + one.nv])
    mesh = ElementMesh(p, t)
    assert modes(System(mesh, term(mesh)), 8).rigid.sum() == 6
    assert modes(System(mesh, term(mesh), fixed={(2,): "xy"}), 8).rigid.sum() == 4
    assert modes(System(mesh, term(mesh), fixed={(2,): "y", (one.nv,): "x"}), 8).rigid.sum() == 4
    assert modes(System(mesh, term(mesh), fixed={(2, 3): "xy"}), 8).rigid.sum() == 3


@pytest.mark.parametrize("name", ["membrane", "cable"])
def test_modes_without_transverse_stiffness_are_not_rigid(name):
    """At rest, a flat membrane in space has motions without stiffness that are not rigid."""
    flat = ElementMesh(np.append(sheet().p, np.zeros((1, 25)), axis=0), sheet().t) if name == "membrane" else MESHES["cable"]
    system = System(flat, term(flat))
    found = modes(system, 9)
    assert np.abs(found.eigenvalues[:9]).max() < 1e-9
    assert found.rigid.sum() < 9 and not found.unstable.any()


@pytest.mark.filterwarnings("ignore:The mesh is in 2 parts")
def test_a_straight_cable_has_no_rotation_about_itself():
    """A single element in space has five rigid modes, and each of two elements has its own."""
    ends = np.array([[0.0, 1.0, 5.0, 6.0], [0.0, 0.3, 0.0, 0.0], [0.0, 0.1, 0.0, 1.0]])
    found = modes(System((ends, np.array([[0, 2], [1, 3]])), StVK(young=10.0, poisson=0.3, density=1.0, area=0.1)), 12)
    assert found.rigid.tolist() == [True] * 10 + [False] * 2 and np.isfinite(found.shapes).all()


def test_a_body_without_stiffness_has_zero_eigenvalues():
    """A flat membrane can only move transversely."""
    flat = ElementMesh(np.append(sheet(6).p, np.zeros((1, 49)), axis=0), sheet(6).t)
    found = modes(System(flat, term(flat), fixed={lambda x: x[0] > -9.0: "xy"}), 3)
    assert not found.eigenvalues.any() and not found.frequencies.any() and not found.unstable.any()


TISSUE, BELOW = StVK(young=1.0, poisson=0.3, density=1.0), {lambda x: x[2] == 0: "xyz"}


@pytest.mark.filterwarnings("ignore:The mesh is in 20 parts")
def test_all_of_many_equal_modes_are_found():
    """Lanczos' method alone found 18 of the 20 with this solver."""
    one, copies = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 3)] * 3), 20
    p = np.hstack([one.p + 3.0 * number * np.eye(3)[:, :1] for number in range(copies)])
    mesh = ElementMesh(p, np.hstack([one.t + number * one.nvertices for number in range(copies)]))
    (first,) = modes(System(one, TISSUE, fixed=BELOW), 1).eigenvalues
    found = modes(System(mesh, TISSUE, fixed=BELOW), copies + 1, solver="block-jacobi-cg")
    np.testing.assert_allclose(found.eigenvalues[:copies], first, rtol=1e-8)
    assert found.eigenvalues[copies] > 1.01 * first


def test_single_precision_is_sufficient():
    mesh = MESHES["tetrahedra"]
    single, double = (modes(System(mesh, term(mesh), dtype=dtype), 9) for dtype in (np.float32, np.float64))
    assert single.rigid.sum() == double.rigid.sum() == 6
    assert single.frequencies == pytest.approx(double.frequencies, rel=1e-4)


def test_all_modes_of_a_small_body_are_found():
    mesh = sheet(1)
    system = System(mesh, StVK(Anisotropic(some_voigt(np.random.default_rng(0)), density=2.0)), fixed={(0,): "xy"})
    assert_are_the_lowest(modes(system, 6), system)
    with pytest.raises(StvkError, match="n = 7; expected a number of modes, from 1 to 6"):
        modes(system, 7)


def test_modes_are_bitwise_reproducible():
    system = System(box(5), term(box(5)))
    one, other = modes(system, 8), modes(system, 8)
    assert np.array_equal(one.shapes, other.shapes) and np.array_equal(one.eigenvalues, other.eigenvalues)


def test_dead_loads_do_not_change_the_modes():
    """Dead loads of any size add nothing to K."""
    mesh = MESHES["triangles"]
    loaded, bare = (System(mesh, [term(mesh), *loads], fixed={wall(mesh): "xy"}) for loads in ([BodyForce((0.0, -1.0))], []))
    assert np.array_equal(modes(loaded, 4).eigenvalues, modes(bare, 4).eigenvalues)


def test_modes_are_written_and_drawn(tmp_path):
    mesh = sheet()
    found = modes(System(mesh, term(mesh)), 5)
    path = found.save(tmp_path / "modes.pvd")
    assert path.exists() and len(list(tmp_path.glob("modes_*.vtu"))) == 5
    shape = found.shapes[4].reshape(-1, 2)
    u = found.state(4).u
    size = np.linalg.norm(np.ptp(mesh.p, axis=1))
    assert np.linalg.norm(u, axis=1).max() == pytest.approx(0.1 * size)
    assert np.abs(u * np.linalg.norm(shape, axis=1).max() - 0.1 * size * shape).max() < 1e-12
    assert np.array_equal(found.state(4, 0.0).u, 0 * shape)
    found.plot(3, path=tmp_path / "mode.png", backend="matplotlib")
    assert (tmp_path / "mode.png").stat().st_size > 5000
    with pytest.raises(StvkError, match="number = 5; expected a mode from 0 to 4"):
        found.state(5)


def test_modes_are_summarised_in_repr():
    found = modes(System(sheet(), term(sheet())), 4)
    assert repr(found).splitlines()[:2] == ["Modes: 4, 3 of them rigid, 0 unstable", "   0  rigid"]
    assert repr(found).splitlines()[4] == f"   3  {found.frequencies[3]:.6g} Hz"
    assert len(found) == 4 and state(sheet()).size == found.shapes.shape[1]


@pytest.mark.parametrize("size", [1e-20, 1e-9, 1e20])
def test_modes_are_found_in_any_unit_of_length(size):
    """ARPACK treats eigenvalues of the inverse below 4e-11 as zero.

    Without scaling, it missed a rigid mode at 1e-9 m, and did not end at 1e-20 m.
    """
    cube = skfem.MeshTet().refined(2)
    one, other = (
        modes(System(ElementMesh(s * cube.p, cube.t), StVK(young=210e9, poisson=0.3, density=7850.0)), 8) for s in (1.0, size)
    )
    assert other.rigid.tolist() == [True] * 6 + [False] * 2
    np.testing.assert_allclose(size * other.frequencies, one.frequencies, rtol=1e-7)


YOUNG, WIDTH = 1e6, 1.0


def column(cells=40, length=20.0, copies=1):
    """Return a slender column along x, with `cells` elements along it; copies are side by side without contact."""
    one = skfem.MeshQuad.init_tensor(np.linspace(0, length, cells + 1), np.linspace(-WIDTH / 2, WIDTH / 2, 3)).to_meshtri(style="x")
    p = np.hstack([one.p + np.array([[0.0], [3.0 * number]]) for number in range(copies)])
    t = np.hstack([one.t + number * one.nvertices for number in range(copies)])
    ends = {"base": lambda x: np.isclose(x[0], 0), "head": lambda x: np.isclose(x[0], length)}
    return ElementMesh.of(skfem.MeshTri(p, t).with_boundaries(ends))


def pressed(mesh, load, by, **fixed):
    """Return a column fixed at its base, with a load on its head of `by` times Euler's and Bernoulli's `E I / L^2`."""
    p = by * YOUNG * WIDTH**3 / 12 / np.ptp(mesh.p[0]) ** 2
    acting = Pressure("head", p) if load is Pressure else Traction("head", (-p, 0.0))
    material = StVK(young=YOUNG, poisson=0.3, density=1.3, plane="stress")
    return System(mesh, [material, acting], fixed={"base": "xy", **fixed})


def straight(system, t=1.0):
    """Return the displacements of the shortened column at load factor t, the first step of a load path."""
    return solve_static(system, steps=round(1 / t), quiet=True, raise_on_failure=False).history[0].u


def lapack(system, u, t=1.0, mass="lumped"):
    """Return all eigenvalues in the order of their real parts, and K and M over the free degrees of freedom."""
    free = system.free_dofs(system.supports.held).free
    K, M = (matrix.toarray()[np.ix_(free, free)] for matrix in (system.jacobian(u, t), system.mass(mass).matrix))
    values = eig(np.linalg.solve(M, K), right=False)
    return values[np.lexsort((values.imag, values.real))], K, M


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize(("by", "growing"), [(8.0, 0), (90.0, 2)])
@pytest.mark.parametrize("n", [6, 24], ids=["sparse", "dense"])
def test_the_lowest_pairs_are_those_of_lapack(n, by, growing, mass):
    """Matrices are dense if there are few unknowns per mode. On so coarse a mesh the column withstands more than Beck's load."""
    system = pressed(column(10), Pressure, by)
    u = straight(system)
    found, (values, K, M) = modes(system, n, u=u, mass=mass), lapack(system, u, mass=mass)
    assert abs(K - K.T).max() > 1e-4 * abs(K).max()
    assert found.flutter.sum() == found.unstable.sum() == growing and found.stable == (growing == 0)
    assert np.iscomplexobj(found.eigenvalues) == np.iscomplexobj(found.shapes) == (growing > 0)
    assert np.abs(found.eigenvalues - values[:n]).max() < 1e-9 * abs(values[n - 1])
    free = system.free_dofs(system.supports.held).free
    for value, shape in zip(found.eigenvalues, found.shapes, strict=True):
        x = shape[free]
        assert np.linalg.norm(K @ x - value * (M @ x)) < 1e-6 * np.linalg.norm(K @ x) and not shape[system.supports.held].any()
        assert (x.conj() @ M @ x).real == pytest.approx(1, rel=1e-9)
    assert found.residuals.max() < 1e-5 * abs(values[n - 1])
    omega = np.sqrt(values[:n].astype(complex))
    np.testing.assert_allclose(found.growth, np.abs(omega.imag), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.frequencies, omega.real / (2 * np.pi), rtol=1e-6)


def critical(load, mesh, low, high):
    """Return the load at which a mode begins to grow, in `E I / L^2`, by bisection, and the modes there."""
    growing = None
    while high / low - 1 > 2e-4:
        middle = (low + high) / 2
        system = pressed(mesh, load, middle)
        found = modes(system, 3, u=straight(system))
        low, high, growing = (middle, high, growing) if found.stable else (low, middle, found)
    return (low + high) / 2, growing


def test_becks_column_flutters_at_eight_times_eulers_load():
    """A follower force on a cantilever: 20.05 E I/L^2 (Beck 1952), compared with pi^2/4 for a dead load.

    Both loads act on the same mesh, whose triangles lock. The thickness changes the ratio by (thickness/length)^2, which
    extrapolation removes.
    """
    ratios = []
    for length, cells in ((20.0, 40), (40.0, 80)):
        mesh = column(cells, length)
        euler, buckled = critical(Traction, mesh, 1.0, 8.0)
        beck, fluttering = critical(Pressure, mesh, 10.0, 40.0)
        assert buckled.unstable.sum() == 1 and not buckled.flutter.any() and np.isnan(buckled.frequencies[0])
        assert fluttering.flutter.tolist() == [True, True, False] and fluttering.frequencies[0] > 0
        ratios.append(beck / euler)
    assert ratios[0] < ratios[1] < 20.05 / (np.pi**2 / 4)
    assert (4 * ratios[1] - ratios[0]) / 3 == pytest.approx(20.05 / (np.pi**2 / 4), rel=2e-3)


def test_a_fluttering_mode_grows_at_its_reported_rate():
    system = pressed(column(20), Pressure, 40.0)
    u = straight(system)
    found = modes(system, 3, u=u)
    assert found.flutter[0]
    period, rate = 1 / found.frequencies[0], found.growth[0]
    tip = {"tip": [int(np.argmax(system.mesh.p[0] + system.mesh.p[1]))]}
    v0 = 1e-8 * found.shapes[0].real / np.abs(found.shapes[0].real).max()
    run = simulate(system, Newmark(period / 100, rtol=1e-12), until=4 * period, u0=u, v0=v0, probes=tip, quiet=True)
    y = run.ledger["tip y"] - run.ledger["tip y"][0]
    first, second = (np.abs(y[(run.ledger["time"] > n * period) & (run.ledger["time"] <= (n + 1) * period)]).max() for n in (2, 3))
    assert np.log(second / first) / period == pytest.approx(rate, rel=0.02)


@pytest.mark.filterwarnings("ignore:The mesh is in 2 parts")
def test_equal_pairs_are_found_and_equal_modes_do_not_flutter():
    twins = column(20, copies=2)
    for by, growing in ((8.0, 0), (35.0, 4)):
        system = pressed(twins, Pressure, by)
        u = straight(system)
        found, (values, _, _) = modes(system, 8, u=u), lapack(system, u)
        assert found.flutter.sum() == growing
        np.testing.assert_allclose(found.eigenvalues, values[:8], rtol=1e-6)
        np.testing.assert_allclose(found.eigenvalues.real[::2], found.eigenvalues.real[1::2], rtol=1e-6)


def test_a_jacobian_symmetric_up_to_rounding_is_treated_as_symmetric():
    """The head slides only along x, so that pressure on it has a potential, and the column buckles.

    Without the load's contribution, K is off by 9 %.
    """
    by = 2.4 * 20.19
    system = pressed(column(), Pressure, by, head="y")
    u = straight(system)
    _, K, M = lapack(system, u)
    assert 0 < abs(K - K.T).max() < 1e-12 * abs(K).max()
    found = modes(system, 4, u=u)
    assert found.unstable.tolist() == [True, False, False, False] and not found.flutter.any() and found.shapes.dtype == np.float64
    np.testing.assert_allclose(found.eigenvalues, eigh(K, M, eigvals_only=True)[:4], rtol=1e-6)
    without = System(system.mesh, system.elastic_terms, fixed={"base": "xy", "head": "y"})
    assert abs(modes(without, 4, u=u).eigenvalues[3] / found.eigenvalues[3] - 1) < 1
    iterated = modes(system, 4, u=u, solver="block-jacobi-cg")  # this solver takes a matrix
    np.testing.assert_allclose(iterated.eigenvalues, found.eigenvalues, rtol=1e-6)


def test_modes_use_loads_at_their_load_factor():
    system = pressed(column(20), Pressure, 40.0)
    u = straight(system, 0.25)
    values, _, _ = lapack(system, u, 0.25)
    found = modes(system, 4, u=u, t=0.25)
    assert found.stable
    np.testing.assert_allclose(found.eigenvalues, values[:4], rtol=1e-8)
    assert not np.allclose(modes(system, 4, u=u).eigenvalues, values[:4], rtol=1e-2)
    with pytest.raises(StvkError, match="t = 'a'; expected the load factor"):
        modes(system, 4, u=u, t="a")


def test_flutter_is_reported_drawn_and_written(tmp_path):
    system = pressed(column(20), Pressure, 40.0)
    found = modes(system, 3, u=straight(system))
    assert "2 unstable" in repr(found) and "unstable, flutters at" in repr(found) and "grows by exp(" in repr(found)
    assert np.isrealobj(found.state(0).u) and found.save(tmp_path / "modes.pvd").exists()
