import numpy as np

from validation import aspect


def test_a_part_meshed_by_gmsh_agrees_to_1e_13_in_every_state(gmsh, capsys):
    from validation import part

    assert part.main() == 0
    out = capsys.readouterr().out
    assert "PASSED" in out and "in 8 states" in out
    assert int(out.split(" tetrahedra")[0].split()[-1]) >= 20_000


def test_flat_elements_cost_the_edge_form_digits():
    rows = {(round(ratio, -1), strain): (ours, theirs) for ratio, strain, ours, theirs in aspect.measure()}
    (plump, *_, flat) = sorted({ratio for ratio, _ in rows})
    assert rows[plump, 1e-6][0] < 1e-13 < rows[plump, 1e-6][1]  # small strains on plump elements: ours is better
    assert rows[flat, 1e-1][0] > 1e-10 > rows[flat, 1e-1][1]  # large strains on flat elements: scikit-fem's is


def test_all_that_was_tried_for_the_kernels_agrees(capsys):
    from validation import kernels

    assert kernels.main(quick=True) == 0
    out = capsys.readouterr().out
    assert out.count("TSEP list") == 4 and "lanes: the package" in out


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
