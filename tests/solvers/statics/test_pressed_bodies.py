"""Stability of bodies that press each other: surfaces that slip from vertex to vertex are stable, tipping bodies are not."""

import numpy as np
import pytest
import skfem
from slow import slow

from skfem_stvk import (
    ElasticFoundation,
    Gravity,
    LinearElastic,
    MeshContact,
    NeoHookean,
    SolveError,
    StVK,
    System,
    solve_static,
)
from skfem_stvk.solvers.newton.outcome import Status
from skfem_stvk.solvers.statics.load_steps import LoadSteps

pytest.importorskip("ipctk")


def blocks(law, distance=0.0267, divisions=(4, 4), down=0.1):
    """Return two blocks of tetrahedra that are pressed together by prescribed displacements of the upper one."""
    g, h = np.linspace(0, 1, divisions[0]), np.linspace(0.1, 0.9, divisions[1])
    mesh = skfem.MeshTet.init_tensor(g, g, g) + skfem.MeshTet.init_tensor(h, h, g).translated((0, 0, 1 + distance))
    mesh = mesh.with_subdomains({"lower": lambda x: x[2] < 1 + distance / 2, "upper": lambda x: x[2] > 1 + distance / 2})
    lid = {lambda x: np.isclose(x[2], 2 + distance): {"x": 0.0, "y": 0.0, "z": -down}}
    contact = MeshContact("lower", "upper", distance=distance)
    return System(mesh, [law, contact], fixed={lambda x: x[2] == 0: "xyz"}, prescribed=lid)


def force(result):
    return result.contact("contact").resultant[2]


def without_pushes(monkeypatch):
    monkeypatch.setattr(LoadSteps, "_settled", lambda *state: None)


@pytest.mark.parametrize(
    "law", [LinearElastic(young=1e3, poisson=0.0), slow(NeoHookean(young=1e3, poisson=0.0))], ids=lambda law: type(law).__name__
)
def test_two_blocks_that_slip_from_vertex_to_vertex_are_stable_nearby(law, monkeypatch):
    """The state found first is unstable, and the result a state of less energy next to it, with a remark."""
    system = blocks(law)
    result = solve_static(system, steps=5, quiet=True)
    assert result.status is Status.CONVERGED and result.history[-1].negative == 0 and result.history[-1].status is Status.CONVERGED
    assert "less than half of the contact's distance" in result.message and result.history[-1].iterations.residuals[-1] < 1e-8
    without_pushes(monkeypatch)
    first = solve_static(system, steps=5, quiet=True, raise_on_failure=False)
    assert first.status is Status.UNSTABLE and "less than half" not in first.message
    moved = np.linalg.norm((result.u - first.u).reshape(-1, 3), axis=1).max()
    assert 0 < moved < 0.5 * 0.0267 and 0 < first.history[-1].potential - result.history[-1].potential < 1e-4
    assert force(result) == pytest.approx(force(first), rel=1e-3)


def rectangle(x, y, kind=skfem.MeshQuad):
    return kind.init_tensor(np.asarray(x), np.asarray(y))


def column(down, distance=5e-3):
    """Return a column between a plate that holds its foot and one that presses its head, without friction."""
    standing = rectangle(np.linspace(-0.05, 0.05, 3), np.linspace(0, 1, 21))
    plate = rectangle((-0.2, 0.2), (1 + distance, 1.2 + distance))
    mesh = standing + plate
    mesh = mesh.with_subdomains({"column": lambda x: x[1] < 1 + distance / 2, "plate": lambda x: x[1] > 1 + distance / 2})
    pressed = {lambda x: x[1] > 1.1: {"x": 0.0, "y": -down}}
    contact = MeshContact("column", "plate", distance=distance)
    terms = [StVK(young=1e5, poisson=0.3), contact]
    return System(mesh, terms, fixed={lambda x: x[1] == 0: "xy"}, prescribed=pressed)


def test_a_resumed_path_and_an_iterative_solver_have_the_state_nearby_and_the_remark(tmp_path):
    system = blocks(LinearElastic(young=1e3, poisson=0.0))
    whole = solve_static(system, steps=5, checkpoint=tmp_path, quiet=True)
    again = solve_static(system, steps=5, checkpoint=tmp_path, resume=True, quiet=True)
    assert again.message == whole.message and np.array_equal(again.u, whole.u) and "half of the contact's" in whole.message
    iterative = solve_static(system, steps=5, solver="block-jacobi-cg", quiet=True)
    assert iterative.status is Status.CONVERGED and "half of the contact's" in iterative.message
    assert iterative.history[-1].potential == pytest.approx(whole.history[-1].potential, rel=1e-9)


STRAIN = np.pi**2 * 0.1**2 / 12


def test_a_column_that_is_stable_is_not_pushed(monkeypatch):
    result = solve_static(column(0.7 * STRAIN), steps=3, quiet=True)
    without_pushes(monkeypatch)
    assert result.success and "half of the contact's distance" not in result.message
    assert np.array_equal(solve_static(column(0.7 * STRAIN), steps=3, quiet=True).u, result.u)


def test_a_column_between_plates_is_unstable_beyond_its_buckling_load():
    """Its foot is clamped and its head flat on the plate, which lets it slide: it buckles at a strain of pi^2 (h/L)^2/12."""
    with pytest.raises(SolveError, match="in equilibrium, but unstable: K has 1 negative") as caught:
        solve_static(column(2 * STRAIN), steps=3, quiet=True)
    result = caught.value.result
    assert result.history[-1].status is Status.UNSTABLE and np.abs(result.u.reshape(-1, 2)[:, 0]).max() < 2e-3, "straight"


def balanced(bedding, distance=0.02):
    """Return a block on top of a disc without friction, on a bedding that holds it softly; the mesh is symmetric."""
    disc = skfem.MeshTri.init_circle(3)
    half = rectangle(np.linspace(0, 0.6, 5), np.linspace(0, 0.4, 3), skfem.MeshTri)
    block = half + skfem.MeshTri(half.p * [[-1], [1]], half.t)
    mesh = disc + block.translated((0, 1 + distance))
    mesh = mesh.with_subdomains({"ball": lambda x: x[1] < 1 + distance / 2, "block": lambda x: x[1] > 1 + distance / 2})
    soft = ElasticFoundation(lambda x: np.isclose(x[1], 1.4 + distance), bedding)
    terms = [StVK(young=1e7, poisson=0.3, density=1e3), Gravity((0, -9.81)), soft]
    below = {lambda x: (np.hypot(*x) > 0.99) & (x[1] < -0.3): "xy"}
    return System(mesh, [*terms, MeshContact("ball", "block", distance=distance)], fixed=below)


@pytest.mark.parametrize("steps", [1, 4])
def test_a_block_that_balances_on_a_ball_is_unstable(steps):
    """Pushes lead away from the top by more than the distance. A bedding that holds the block has a stable state there."""
    result = solve_static(balanced(3e3), steps=steps, quiet=True, raise_on_failure=False)
    assert result.status is Status.UNSTABLE and result.history[-1].negative == 1
    block = result.system.mesh.p[1] > 1.01
    assert abs(result.u.reshape(-1, 2)[block, 0].mean()) < 1e-6, "it balances"
    held = solve_static(balanced(1e4), steps=steps, quiet=True)
    assert held.status is Status.CONVERGED and "half of the contact's distance" not in held.message
    assert -force_on_ball(held) == pytest.approx(0.48 * 9810, rel=0.01)


def force_on_ball(result):
    return result.contact("contact").resultant[1]
