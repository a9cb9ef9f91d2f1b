import pytest

from skfem_stvk.mesh import embedded_mesh
from skfem_stvk.mesh.diagnostics import check_mesh


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
