"""Modes under follower loads: K is not symmetric, and the body can flutter."""

import numpy as np
import pytest
import skfem
from scipy.linalg import eig, eigh

from skfem_stvk import ElementMesh, Pressure, StVK, StvkError, System, Traction, solve_static
from skfem_stvk.solvers.dynamics import Newmark, modes, simulate

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


def test_conjugate_gradients_are_refused_for_unsymmetric_k():
    system = pressed(column(10), Pressure, 8.0)
    with pytest.raises(StvkError, match="Follower loads make K unsymmetric"):
        modes(system, 3, u=straight(system), solver="amg-cg")


def test_flutter_is_reported_drawn_and_written(tmp_path):
    system = pressed(column(20), Pressure, 40.0)
    found = modes(system, 3, u=straight(system))
    assert "2 unstable" in repr(found) and "unstable, flutters at" in repr(found) and "grows by exp(" in repr(found)
    assert np.isrealobj(found.state(0).u) and found.save(tmp_path / "modes.pvd").exists()
