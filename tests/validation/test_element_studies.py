"""The quick studies of elements hold, and they detect planted faults."""

import warnings

import numpy as np
import pytest

from skfem_stvk import StvkWarning
from validation import elements
from validation.elements import costs, flag, orders, programs, trials, work_precision
from validation.elements.families import BOXES, ONE_POINT, P1, P2, onto, outwards, ring
from validation.statics.manufactured import body_force, displacement, gradient, nominal_stress


def test_in_a_plane_the_body_force_is_minus_the_divergence_of_the_nominal_stress():
    x, h = np.random.default_rng(0).random((2, 50)), 1e-5
    steps = h * np.eye(2)[:, :, None]
    by_differences = -sum((nominal_stress(x + s, 0.7) - nominal_stress(x - s, 0.7))[:, J] / (2 * h) for J, s in enumerate(steps))
    exact = body_force(x, 0.7)
    assert np.abs(by_differences - exact).max() < 1e-8 * np.abs(exact).max()
    for J, s in enumerate(steps):
        by_differences = (displacement(x + s, 0.7) - displacement(x - s, 0.7)) / (2 * h)
        np.testing.assert_allclose(by_differences, gradient(x, 0.7)[:, J], atol=1e-9)


@pytest.mark.parametrize("d", [2, 3])
def test_the_ring_has_its_sides_and_nodes_on_them(d):
    mesh = P2.mesh(d, 3, bent=True)
    inner, loaded = mesh.p[:, mesh.node_sets["inner"]], mesh.p[:, np.unique(mesh.boundaries["loaded"])]
    np.testing.assert_allclose(np.hypot(*inner[:2]), 1, rtol=1e-14)
    np.testing.assert_allclose(np.hypot(*loaded[:2]), 2, rtol=1e-14)
    np.testing.assert_allclose(onto(2.0, 0.9 * loaded)[:2], loaded[:2], rtol=1e-14)
    assert np.abs(outwards(loaded) - loaded / 2)[:2].max() < 1e-15 and mesh.nv > mesh.nvertices
    straight = P2.mesh(d, 3, bent=True, straight=True)
    assert np.hypot(*straight.p[:2, straight.node_sets["inner"]]).min() < 0.99
    assert ring(np.array([[0.0], [1.0]])).ravel() == pytest.approx([1, 0])


def test_elements_have_their_orders_on_squares_and_rings():
    (found,) = orders.orders(quick=True)
    assert found.passed, found.failures
    assert len(found.rows) == 8


def test_a_wrong_traction_is_detected(monkeypatch):
    right = orders.nominal_stress
    monkeypatch.setattr(orders, "nominal_stress", lambda x, t: 1.1 * right(x, t))
    monkeypatch.setattr(orders, "ALL", [series for series in orders.ALL if series.name == "quadratic triangles, square"])
    assert not orders.orders(quick=True)[0].passed


@pytest.mark.slow
def test_turek_and_hrons_reference_is_reproduced_on_coarse_meshes():
    study = flag.flag_of_quadratic_triangles(quick=True)
    assert study.passed, study.failures


def test_the_clamp_of_the_flag_is_curved():
    mesh = flag.mesh_of_the_flag(8, 2)
    np.testing.assert_allclose(np.hypot(*(mesh.p[:, mesh.node_sets["clamp"]] - 0.2)), 0.05, rtol=1e-14)
    assert len(mesh.node_sets["clamp"]) == 5


@pytest.mark.slow
def test_work_and_precision_is_plotted(tmp_path):
    pytest.importorskip("pypardiso")
    (found,) = work_precision.work_precision(quick=True, folder=tmp_path)
    assert found.passed, found.failures
    assert {row[0] for row in found.rows} == {*programs.OURS, *programs.THEIRS}
    assert found.pictures[0].stat().st_size > 10_000


@pytest.mark.slow
@pytest.mark.parametrize("trial", trials.TRIALS[1:], ids=lambda trial: trial.name)
def test_both_programs_agree_at_prescribed_ends(trial):
    mine = programs.ours(trial, P2, 1)
    others = programs.theirs(trial, "P2", 1, mine.factors)
    np.testing.assert_allclose(mine.result, others.result, rtol=1e-6)
    assert np.abs(mine.result).min() > 0


@pytest.mark.slow
def test_a_block_of_linear_elements_or_boxes_locks_and_one_of_one_point_boxes_does_not():
    families = (P2, 3), (P1, 4), (BOXES, 4), (ONE_POINT, 4)
    truth, linear, boxes, one_point = (programs.ours(trials.SHEARED, family, n).result[0] for family, n in families)
    assert min(linear, boxes) / truth > 1.5 and abs(one_point / truth - 1) < 0.1


@pytest.mark.slow
def test_a_fast_program_with_another_result_is_detected():
    def reached(w):
        solved = programs.Solved(10, np.array([0.0, 0.0, w]), 5, 1.0, np.array([1.0]))
        return [work_precision.Reached(2, solved, 0.1)]

    found = {"P1": reached(-1.0), "P2": reached(-1.0), "scikit-fem P1": reached(-1.0), "scikit-fem P2": reached(-1.1)}
    assert len(list(work_precision._failures(found))) == 1


@pytest.mark.slow
def test_costs_are_measured():
    (cost,) = costs.costs(quick=True)
    assert cost.passed
    assert {row[0] for row in cost.rows} == {choice.name for choice in costs.CHOICES}


def test_the_command_prints_the_requested_studies(capsys, monkeypatch):
    monkeypatch.setattr(orders, "ALL", orders.ALL[-6:-4])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        assert elements.main(quick=True, only=["orders"]) == 0
    out = capsys.readouterr().out
    assert "Orders of elements" in out and "all 1 claims hold" in out
