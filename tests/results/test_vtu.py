import os
from pathlib import Path

import meshio
import numpy as np
import pytest
from bodies import MESHES, state

from skfem_stvk import ElementMesh, StateError, StVK, StvkError, embedded_mesh, read_mesh
from skfem_stvk.results import Fields, names, write_vtu
from skfem_stvk.results.complete_files import output_folder, output_path, replacing


def at(mesh, **term):
    return Fields(mesh, StVK(young=2.0, poisson=0.3, **term)).at(state(mesh, 0.03))


@pytest.mark.parametrize("name", MESHES)
def test_all_fields_are_read_back_unchanged(name, tmp_path):
    mesh = MESHES[name]
    now = at(mesh)
    path = write_vtu(tmp_path / "body.vtu", now, names())
    file = meshio.read(path)
    assert np.array_equal(file.points[:, : mesh.d], mesh.p.T) and not file.points[:, mesh.d :].any()
    assert np.array_equal(file.cells[0].data, mesh.t.T)
    assert np.array_equal(file.point_data["displacement"][:, : mesh.d], now.u)
    assert file.point_data["displacement"].shape == (mesh.nv, 3)
    for field in names():
        for values, written in ((now[field], file.cell_data[field][0]), (now.at_nodes(field), file.point_data[field])):
            assert np.isfinite(written).all()
            if field in ("green_strain", "pk2_stress", "cauchy_stress"):
                xx, yy, zz, xy, yz, xz = written.T
                again = np.moveaxis(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), 2, 0)
                assert np.allclose(again, values, rtol=0, atol=1e-15 * np.abs(values).max())
            else:
                assert np.array_equal(written, values.reshape(len(values), -1) if values.ndim > 1 else values)


@pytest.mark.parametrize("name", MESHES)
def test_velocities_are_written_if_the_body_moves(name, tmp_path):
    mesh = MESHES[name]
    v = np.random.default_rng(3).normal(size=mesh.p.size)
    fields = Fields(mesh, StVK(young=2.0, poisson=0.3))
    written = meshio.read(write_vtu(tmp_path / "body.vtu", fields.at(state(mesh, 0.03), v), [])).point_data
    assert list(written) == ["displacement", "velocity"] and written["velocity"].shape == (mesh.nv, 3)
    assert np.array_equal(written["velocity"][:, : mesh.d], v.reshape(-1, mesh.d)) and not written["velocity"][:, mesh.d :].any()
    assert list(meshio.read(write_vtu(tmp_path / "still.vtu", fields.at(state(mesh, 0.03)), [])).point_data) == ["displacement"]
    with pytest.raises(StateError, match=r"v has shape \(3,\)"):
        fields.at(state(mesh), np.zeros(3))


def test_an_unsymmetric_tensor_is_written_row_by_row(tmp_path):
    now = at(MESHES["tetrahedra"])
    written = meshio.read(write_vtu(tmp_path / "body.vtu", now, ["pk1"])).cell_data["pk1_stress"][0]
    assert written.shape[1] == 9 and np.array_equal(written[:, 1], now["pk1"][:, 0, 1])
    assert np.abs(written[:, 1] - written[:, 3]).max() > 1e-3


def test_the_file_is_a_mesh_file_with_its_subdomains(tmp_path):
    mesh = embedded_mesh()
    path = write_vtu(tmp_path / "bracket.vtu", Fields(mesh, StVK(young=1.0, poisson=0.3)).at(np.zeros(mesh.p.size)))
    again = read_mesh(path)
    assert np.array_equal(again.p, mesh.p) and np.array_equal(again.t, mesh.t)
    assert set(again.subdomains) == {"bracket", "bushing"}
    for name, ids in mesh.subdomains.items():
        assert np.array_equal(again.subdomains[name], np.sort(ids))
    region = meshio.read(path).cell_data["region"][0]
    for number, name in enumerate(mesh.subdomains, start=1):
        assert (region[mesh.subdomains[name]] == number).all()


def test_missing_values_are_marked_and_not_nan(tmp_path):
    mesh = MESHES["triangles"]
    now = at(mesh, region=np.arange(9, mesh.nt))
    file = meshio.read(write_vtu(tmp_path / "body.vtu", now, ["cauchy", "volume_ratio"]))
    missing = file.cell_data["cauchy_stress_missing"][0]
    assert missing[:9].all() and not missing[9:].any()
    assert not file.cell_data["cauchy_stress"][0][:9].any() and np.isfinite(file.cell_data["cauchy_stress"][0]).all()
    assert np.array_equal(file.point_data["cauchy_stress_missing"] == 1, now.at_nodes("cauchy").mask[:, 0, 0])
    complete = meshio.read(write_vtu(tmp_path / "other.vtu", at(mesh), ["cauchy"]))
    assert not [name for name in (*complete.cell_data, *complete.point_data) if "missing" in name]


def test_unknown_fields_are_refused_before_anything_is_written(tmp_path):
    with pytest.raises(StvkError, match="no field 'sigma'"):
        write_vtu(tmp_path / "body.vtu", at(MESHES["triangles"]), ["cauchy", "sigma"])
    assert not list(tmp_path.iterdir())


def test_paths_that_cannot_be_written_are_refused(tmp_path):
    for path, message in (
        (tmp_path / "body.vtk", "expected a path that ends in .vtu, such as body.vtu"),
        ("", "path = ''; expected the path of a file that ends in .vtu"),
        (None, "path = None; expected the path of a file that ends in .vtu"),
        ("body\0.vtu", r"path = 'body\\x00\.vtu'; expected the path of a file"),
        (tmp_path / "missing" / "body.vtu", "The folder .*missing of body.vtu does not exist"),
    ):
        with pytest.raises(StvkError, match=message):
            output_path(path, ".vtu")
    (tmp_path / "folder.vtu").mkdir()
    with pytest.raises(StvkError, match="is a folder"):
        output_path(tmp_path / "folder.vtu", ".vtu")
    with pytest.raises(StvkError, match=r"cannot be written: .* Choose another folder"):
        output_path(tmp_path / f"{'y' * 250}.vtu", ".vtu")


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="no folder that not even root may write to")
def test_a_folder_that_cannot_hold_files_is_refused():
    with pytest.raises(StvkError, match=r"/proc/self/body.vtu cannot be written: .* Choose another folder"):
        output_path("/proc/self/body.vtu", ".vtu")


@pytest.mark.skipif(not hasattr(os, "O_TMPFILE"), reason="files without names are Linux's")
def test_a_kill_during_the_trial_of_a_folder_leaves_no_file(tmp_path, monkeypatch):
    """A kill between creation and removal of the trial file leaves no file.

    The test lets all removals fail; such a kill was observed to leave the file.
    """

    def killed(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(os, "unlink", killed)
        patch.setattr(Path, "unlink", killed)
        output_path(tmp_path / "body.vtu", ".vtu")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(StvkError, match="cannot be written: Permission denied"):
        output_path(tmp_path / "body.vtu", ".vtu")


def test_the_check_of_a_path_does_not_remove_partial_files(tmp_path):
    path, folder = tmp_path / "body.vtu", tmp_path / "steps"
    with replacing(path) as part:
        part.write_text("new")
        output_path(path, ".vtu")
    with replacing(output_folder(folder) / "a") as part:
        part.write_text("new")
        output_folder(folder)
    assert path.read_text() == "new" == (folder / "a").read_text()
    assert sorted(file.name for file in tmp_path.rglob("*")) == ["a", "body.vtu", "steps"]


def test_a_file_is_replaced_completely_or_not_at_all(tmp_path):
    path = tmp_path / "body.vtu"
    path.write_text("old")
    with pytest.raises(RuntimeError, match="halfway"), replacing(path) as part:
        part.write_text("new, but")
        raise RuntimeError("halfway")
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]
    with replacing(path) as part:
        part.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new" and list(tmp_path.iterdir()) == [path]


def test_overlapping_subdomains_are_all_written(tmp_path):
    mesh = MESHES["triangles"]
    named = ElementMesh(mesh.p, mesh.t, {"all": np.arange(mesh.nt), "first": np.arange(4)})
    again = read_mesh(write_vtu(tmp_path / "body.vtu", at(named), []))
    assert len(again.subdomains["all"]) == mesh.nt and len(again.subdomains["first"]) == 4


def test_names_of_subdomains_with_any_letters_are_read_back(tmp_path):
    plain = ['left "half"', "a<b>&c;", "glühend 橡胶", "it's"]
    ids = [np.array([number]) for number in range(6)]
    mesh = ElementMesh(
        MESHES["tetrahedra"].p, MESHES["tetrahedra"].t, dict(zip([*plain, "\x1b[31mred\x1b[0m", "two\nlines\0"], ids, strict=True))
    )
    back = read_mesh(write_vtu(tmp_path / "body.vtu", at(mesh), []))
    assert {name: found.tolist() for name, found in back.subdomains.items()} == dict(
        zip([*plain, "\\x1b[31mred\\x1b[0m", "two\\nlines\\x00"], [[number] for number in range(6)], strict=True)
    )
    assert not any(ord(letter) < 32 and letter != "\n" for letter in (tmp_path / "body.vtu").read_text())
