import numpy as np
import pytest
from bodies import MESHES, state

from skfem_stvk import ElementMesh, RegionError, StVK
from skfem_stvk.results import Fields
from skfem_stvk.results.fields import NodalAverage, split_nodes


@pytest.mark.parametrize("name", MESHES)
def test_nodal_values_are_means_weighted_by_rest_volume(name):
    mesh = MESHES[name]
    section = np.random.default_rng(0).uniform(0.5, 2, mesh.nt)
    now = Fields(mesh, StVK(young=2.0, poisson=0.3, **{1: {"area": section}, 2: {"thickness": section}, 3: {}}[mesh.k])).at(
        state(mesh, 0.03)
    )
    values, volume, smooth = now["cauchy"], now.fields.volume, now.at_nodes("cauchy")
    for node in range(mesh.nv):
        around = np.flatnonzero((mesh.t == node).any(axis=0))
        mean = sum(volume[e] * values[e] for e in around) / volume[around].sum()
        assert np.allclose(smooth[node], mean, rtol=1e-12, atol=1e-15)


def test_constant_values_are_unchanged():
    average = NodalAverage(MESHES["tetrahedra"].t, np.arange(1.0, 163), MESHES["tetrahedra"].nv)
    values, missing = average(np.full((162, 3), 7.25), np.zeros(162, dtype=bool))
    assert np.allclose(values, 7.25, rtol=1e-14) and not missing.any()


def test_elements_without_a_value_do_not_count():
    mesh = MESHES["triangles"]
    region = np.flatnonzero(mesh.p[0, mesh.t].mean(axis=0) < 0.5)
    now = Fields(mesh, StVK(young=2.0, poisson=0.3, region=region)).at(state(mesh, 0.03))
    alone = Fields(ElementMesh(mesh.p, mesh.t[:, region]), StVK(young=2.0, poisson=0.3)).at(state(mesh, 0.03))
    smooth = now.at_nodes("von_mises")
    inside = np.isin(np.arange(mesh.nv), mesh.t[:, region])
    assert inside.any() and not inside.all()
    assert np.array_equal(~np.ma.getmaskarray(smooth), inside)
    assert np.allclose(smooth[inside], alone.at_nodes("von_mises")[inside], rtol=1e-13)


def test_averages_over_one_region_exclude_other_regions():
    mesh = MESHES["tetrahedra"]
    left = mesh.p[0, mesh.t].mean(axis=0) < 0.5
    named = ElementMesh(mesh.p, mesh.t, {"soft": np.flatnonzero(left)})
    terms = [StVK(young=1.0, poisson=0.3, region=left), StVK(young=1000.0, poisson=0.3, region=~left)]
    u = state(mesh, 0.05)
    soft = Fields(named, terms).at(u).at_nodes("von_mises", region="soft")
    alone = Fields(named, terms[0]).at(u).at_nodes("von_mises")
    assert np.ma.count_masked(soft) > 0
    assert np.ma.allclose(soft, alone) and np.array_equal(soft.mask, alone.mask)
    with pytest.raises(RegionError, match="no subdomain 'hard'; known: 'soft'"):
        Fields(named, terms).at(u).at_nodes("von_mises", region="hard")


def test_split_nodes_are_shared_within_a_part_only():
    mesh = MESHES["tetrahedra"]
    part = (mesh.p[0, mesh.t].mean(axis=0) < 0.5).astype(int)
    nodes, count = split_nodes(mesh.t, part)
    assert count == len(np.unique(mesh.t[:, part == 0])) + len(np.unique(mesh.t[:, part == 1]))
    assert not set(nodes[:, part == 0].ravel()) & set(nodes[:, part == 1].ravel())
    for number in range(count):
        assert len(np.unique(mesh.t[nodes == number])) == 1


def test_the_average_is_built_once():
    fields = Fields(MESHES["triangles"], StVK(young=2.0, poisson=0.3))
    assert fields.average is fields.average
