import numpy as np
import pytest

from skfem_stvk.mesh import embedded_mesh
from skfem_stvk.mesh.diagnostics import check_mesh
from validation import aspect


@pytest.mark.slow
def test_a_fine_part_is_a_sound_mesh_on_which_all_agree_to_1e_13_in_every_state(gmsh, capsys, monkeypatch):
    """Mesh generation takes most of the time."""
    from validation import meshes, part

    fine, coarse = meshes.bracket(meshes.FINE_SIZE), embedded_mesh()
    check_mesh(fine)
    assert fine.nt >= 20_000
    assert set(fine.subdomains) == set(coarse.subdomains) and set(fine.boundaries) == set(coarse.boundaries)
    assert abs((meshes.signed_volumes(fine) < 0).sum() - fine.nt / 2) <= 1
    assert meshes.dihedral_angles(fine).min() > 5
    monkeypatch.setattr(part, "bracket", {meshes.FINE_SIZE: fine}.__getitem__)
    assert part.main() == 0
    out = capsys.readouterr().out
    assert "PASSED" in out and "in 8 states" in out
    assert f"{fine.nt} tetrahedra" in out


def test_errors_of_flat_elements_are_eps_times_their_aspect():
    """The bound holds in both precisions. At small strain scikit-fem, which forms F, loses more up to aspects of 500."""
    for box, strain, errors in aspect.measure(200):
        assert 0.1 < errors.double < 20 and 0.1 < errors.single < 20, (box, strain, errors)
        if strain == 1e-6 and box <= 500:
            assert errors.ours < errors.theirs / 5, (box, errors)


def test_eigenvalues_at_points_clamp_better_than_tensions_of_pairs():
    from validation import clamp

    name, body, held, ends = next(clamp.cases(quick=True))
    assert name == "cube, doubled" and 0.4 < clamp.negative_in_tension(body) < 0.55
    at_points, of_pairs = (int(clamp.iterations(body, held, ends, pairs)) for pairs in (False, True))
    assert at_points <= 6 and of_pairs > 2 * at_points


@pytest.mark.slow
def test_all_candidates_for_the_kernels_agree(capsys):
    from validation import kernels

    assert kernels.main(quick=True) == 0
    out = capsys.readouterr().out
    assert out.count("TSEP list") == 4 and "lanes: the package" in out


@pytest.mark.slow
def test_edge_by_edge_gives_the_blocks_of_K():
    from bodies import box

    from skfem_stvk import StVK, System
    from validation.edge_gather import EdgeGather

    mesh = box()
    u = 0.1 * np.random.default_rng(0).standard_normal((mesh.nv, 3))
    candidate = EdgeGather(mesh.p, mesh.t, 1.5, 1.0)
    K = System(mesh, StVK(young=2.6, poisson=0.3)).tangent(u.ravel()).toarray().reshape(mesh.nv, 3, mesh.nv, 3)
    blocks = K[candidate.edges[0], :, candidate.edges[1]]
    assert np.abs(candidate.tangent(u) - blocks).max() < 1e-13 * np.abs(K).max()


def test_finer_tables_have_smaller_errors_and_lose_less_work(capsys, monkeypatch):
    from validation import response

    monkeypatch.setattr(response, "SECONDS", 0.05)
    assert response.main(quick=True) == 0
    coarse, fine = (line.split() for line in capsys.readouterr().out.splitlines()[1:3])
    assert coarse[:4] == ["192", "3", "x", "3"] and fine[:4] == ["192", "5", "x", "5"]
    assert float(fine[6]) < 0.05 * float(coarse[6]) and float(fine[7]) < 0.1 * float(coarse[7]) and float(fine[8]) < 1e-3


def test_steps_in_a_loop_are_timed(capsys):
    from validation import loop

    assert loop.main(quick=True) == 0
    text = capsys.readouterr().out
    assert text.count("a reaction") == 3 and text.count("99.9 %") == 2 and "(target 9)" in text
