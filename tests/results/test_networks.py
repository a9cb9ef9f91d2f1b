"""Comparison of spring networks with a body of the same mesh and material, in a given state."""

import numpy as np
import pytest
from bodies import MESHES, box, state
from terms.test_spring_network import lattice

from skfem_stvk import MeshError, StateError, StVK, StvkError, compare_networks


def test_shares_are_those_of_the_energy_and_the_pairs_complete_it():
    mesh, law = box(2), StVK(young=3.0, poisson=0.3)
    u = 0.3 * state(mesh)
    found = compare_networks(mesh, law, u)
    form = law.bind(mesh).form
    zeta = form.squared_elongations(u.reshape(-1, 3))
    parts = (
        form.L.diagonal() @ zeta**2 / 4,
        *(
            (np.asarray(form.L[tuple(form.pairs)]).ravel() * zeta[form.pairs[0]] * zeta[form.pairs[1]])[of].sum() / 2
            for of in (form.adjacent, ~form.adjacent)
        ),
    )
    assert list(found.shares.values()) == pytest.approx(np.array(parts) / sum(parts), rel=1e-10)
    assert [row.name for row in found.rows if row.force < 1e-12] == ["StVK", "edges and pairs"]
    assert found["quartic springs"].energy == pytest.approx(found.shares["edges"] - 1, rel=1e-10)
    assert found["without opposite pairs"].energy == pytest.approx(-found.shares["opposite pairs"], rel=1e-9)
    assert {row.name.removesuffix(" springs") for row in found.rows[5:]} == {
        "least-squares",
        "edge-diagonal",
        "van-gelder",
        "lloyd",
    }
    assert all(row.ns > 0 and row.ratio > 0 for row in found.rows) and found["StVK"].ratio == 1
    assert str(found).count("\n") == len(found.rows) + 1


def test_on_equilateral_triangles_at_one_third_quartic_springs_are_exact_at_any_strain():
    """Quartic springs on equilateral triangles are exact in plane stress with nu = 1/3.

    Hookean springs are exact to first order. Both are inexact at another ratio, on other triangles or in plane strain.
    """
    mesh = lattice()
    for size in (0.01, 0.5):
        found = compare_networks(mesh, StVK(young=2.0, poisson=1 / 3, plane="stress"), size * state(mesh, 1.0))
        assert found.shares["adjacent pairs"] == pytest.approx(0, abs=1e-14)
        assert found["quartic springs"].force < 1e-13 > found["quartic springs"].at_rest
        for rule in ("least-squares", "edge-diagonal", "van-gelder", "lloyd", "triangular"):
            row = found[f"{rule} springs"]
            assert row.at_rest < 1e-13 and 0.1 * size < row.force < 2 * size
    for law in (StVK(young=2.0, poisson=0.3, plane="stress"), StVK(young=2.0, poisson=1 / 3)):
        assert compare_networks(mesh, law, state(mesh, 0.1))["quartic springs"].force > 0.02
    law = StVK(young=2.0, poisson=1 / 3, plane="stress")
    assert compare_networks(MESHES["triangles"], law, state(MESHES["triangles"], 0.1))["quartic springs"].force > 0.02


def test_the_table_of_segments_has_no_pairs():
    found = compare_networks(MESHES["cable"], StVK(young=1.0), state(MESHES["cable"]))
    assert found.shares == {"edges": 1.0} and found["quartic springs"].force < 1e-13


def test_the_comparison_can_be_plotted(tmp_path):
    mesh = box(2)
    found = compare_networks(mesh, StVK(young=3.0, poisson=0.3), 0.3 * state(mesh))
    assert len(found.plot(tmp_path / "networks.png").get_axes()) == 2 and (tmp_path / "networks.png").stat().st_size > 1e4
    with pytest.raises(StvkError, match=r"expected a path that ends in \.png"):
        found.plot(tmp_path / "networks.txt")


@pytest.mark.parametrize(
    ("mesh", "law", "u", "error", "message"),
    [
        (box(1), StVK(young=1.0, poisson=0.3), np.zeros(24), StvkError, "no strain energy"),
        (box(1), StVK(young=1.0, poisson=0.3), np.zeros(23), StateError, r"expected \(24,\)"),
        (box(1), "StVK", np.zeros(24), StvkError, r"law = 'StVK'; expected StVK\("),
        (
            box(1).with_degree(2),
            StVK(young=1.0, poisson=0.3),
            np.zeros(81),
            MeshError,
            "quadratic tetrahedra in 3D; expected linear simplices, .* Use degree=1",
        ),
    ],
)
def test_invalid_comparisons_are_refused(mesh, law, u, error, message):
    with pytest.raises(error, match=message):
        compare_networks(mesh, law, u)


def test_a_model_that_was_not_compared_is_named():
    with pytest.raises(StvkError, match="name = 'lloyds'; expected the name of a compared model: 'StVK', 'edges and pairs'"):
        compare_networks(box(1), StVK(young=1.0, poisson=0.3), state(box(1)))["lloyds"]
