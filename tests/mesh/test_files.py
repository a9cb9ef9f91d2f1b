"""Unreadable files are refused with cause and remedy, and nothing is printed."""

import shlex
import sys

import meshio
import numpy as np
import pytest
from meshfiles import CUBE, FIVE_TETS, TETS, write

from skfem_stvk import MeshError
from skfem_stvk.mesh import read_mesh


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(MeshError, match=r"gone\.msh does not exist; expected the path of a mesh file"):
        read_mesh(tmp_path / "gone.msh")


def test_an_unknown_extension_is_refused_with_the_known_ones(tmp_path):
    file = tmp_path / "mesh.xyz"
    file.touch()
    with pytest.raises(MeshError, match=r"unknown extension '\.xyz'; known: .*\.inp.*\.msh.*\.vtu.*convert it"):
        read_mesh(file)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("part.unv", "has the format I-DEAS universal, which is not read; .* This makes one: gmsh .*part.unv -save -o part.msh"),
        ("my part.STEP", "has the format CAD geometry, .* This makes one: gmsh -3 '.*my part.STEP' -o 'my part'.msh"),
        ("part.feb", "has the format FEBio, .* FEBio Studio, as an Abaqus file part.inp"),
        ("part.vtp", "has the format VTK XML, .* ParaView's Save Data, as part.vtk"),
    ],
)
def test_a_format_that_is_not_read_is_named_with_what_converts_it(name, message, tmp_path):
    (tmp_path / name).write_text("data")
    with pytest.raises(MeshError, match=message):
        read_mesh(tmp_path / name)


def test_tetrahedra_of_tetgen_with_ten_nodes_are_refused_by_name(tmp_path):
    (tmp_path / "ten.ele").write_text("1 10 0\n1 1 2 3 4 5 6 7 8 9 10\n")
    (tmp_path / "ten.node").write_text("10 3 0 0\n")
    with pytest.raises(MeshError, match=r"its elements have 10 nodes, which are not read\. Write it with 4: tetgen without -o2"):
        read_mesh(tmp_path / "ten.ele")


@pytest.mark.parametrize(
    ("name", "format_"),
    [
        ("a b.avs", "AVS-UCD"), ("m.dat", "Tecplot"), ("m.dato.gz", "Permas"), ("m.f3grid", "FLAC3D"), ("m.mdpa", "Kratos"),
        ("m.lb8.ugrid", "UGRID"), ("m.vol.gz", "Netgen"), ("m.wkt", "WKT"), ("m.xml", "DOLFIN XML"),
    ],
)  # fmt: skip
def test_a_format_without_damage_checks_is_refused_with_the_command_that_converts_it(name, format_, tmp_path):
    file = tmp_path / name
    file.write_text("data")
    with pytest.raises(MeshError) as caught:
        read_mesh(file)
    words = shlex.split(str(caught.value).partition("convert it: ")[2])
    assert f"{name} is a {format_} file; expected" in str(caught.value)
    assert words == ["meshio", "convert", str(file), f"{file.stem}.vtu"]


def test_a_fluent_mesh_is_recognised_and_converted_by_the_named_command(tmp_path, monkeypatch):
    file = tmp_path / "mesh.msh"
    meshio.Mesh(TETS.p.T, [("tetra", TETS.t.T)]).write(file)  # meshio's own choice for .msh
    with pytest.raises(MeshError, match=r"mesh\.msh is a Fluent file .*file_format='gmsh'") as caught:
        read_mesh(file)
    monkeypatch.chdir(tmp_path)
    meshio._cli.main(shlex.split(str(caught.value).partition("convert it: ")[2])[1:])
    assert np.array_equal(read_mesh("mesh.vtu").t, TETS.t)


@pytest.mark.parametrize("ending", ["msh", "vtu", "vtk", "inp"])
def test_an_empty_file_is_refused(ending, tmp_path):
    (tmp_path / f"mesh.{ending}").touch()
    with pytest.raises(MeshError, match=r"is empty\. Did the program that writes it fail"):
        read_mesh(tmp_path / f"mesh.{ending}")


@pytest.mark.parametrize(
    ("ending", "package", "line"),
    [("med", "h5py", "h5py"), ("h5m", "h5py", "h5py"), ("exo", "netCDF4", r"'skfem-stvk\[exodus\]'")],
)
def test_a_format_that_needs_another_package_names_it(ending, package, line, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / f"mesh.{ending}").write_text("data")
    with pytest.raises(MeshError, match=rf"Reading \.{ending} files needs the package {package}.*: pip install {line}"):
        read_mesh(tmp_path / f"mesh.{ending}")


@pytest.mark.parametrize("part", [0.02, 0.3, 0.6, 0.9])
@pytest.mark.parametrize(
    ("ending", "options"),
    [
        ("msh", {"file_format": "gmsh"}),
        ("msh", {"file_format": "gmsh", "binary": False}),
        ("msh", {"file_format": "gmsh22"}),
        ("msh", {"file_format": "gmsh22", "binary": False}),
        ("vtu", {}),
        ("vtk", {}),
        ("inp", {}),
    ],
)
def test_a_file_that_is_cut_off_is_refused_and_nothing_is_printed(ending, options, part, tmp_path, capfd):
    file = tmp_path / f"mesh.{ending}"
    meshio.write(file, meshio.Mesh(TETS.p.T, [("tetra", TETS.t.T)]), **options)
    file.write_bytes(file.read_bytes()[: int(part * file.stat().st_size)])
    capfd.readouterr()
    with pytest.raises(MeshError, match=rf"mesh\.{ending}.*could not be read"):
        read_mesh(file)
    assert capfd.readouterr() == ("", "")


def test_gmsh_files_that_end_between_their_sections_are_refused(tmp_path):
    file = tmp_path / "mesh.msh"
    meshio.write(file, meshio.Mesh(TETS.p.T, [("tetra", TETS.t.T)]), file_format="gmsh22", binary=False)
    file.write_text(file.read_text().replace("$EndElements\n", ""))
    with pytest.raises(MeshError, match=r"nothing follows the entries that \$Elements declares; expected \$EndElements"):
        read_mesh(file)


def test_indices_beyond_the_vertices_are_refused_by_the_name_of_the_file(tmp_path):
    file = write(tmp_path / "mesh.vtu", CUBE, [("tetra", [*FIVE_TETS, [0, 1, 2, 8]])])
    with pytest.raises(MeshError, match=r"mesh\.vtu could not be read: it has 1 cell \(5\) with vertex ids outside 0 \.\.\. 7"):
        read_mesh(file)
