"""Surfaces for contact (.off, .obj, .stl, POLYDATA), structured grids of VTK, and Medit's sections of second order."""

import numpy as np
import pytest

from skfem_stvk import MeshError, RigidMesh, read_mesh
from skfem_stvk.mesh import box

VERTICES = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
OFF = "4 4 0\n" + "".join(f"{x} {y} {z}\n" for x, y, z in VERTICES) + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES)
V = "".join(f"v {x} {y} {z}\n" for x, y, z in VERTICES)
OBJ = V + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES)
STL = "solid s\n" + "".join(
    "facet normal 0 0 0\nouter loop\n" + "".join("vertex {} {} {}\n".format(*VERTICES[i]) for i in face) + "endloop\nendfacet\n"
    for face in FACES
)
POLYDATA = (
    "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 4 double\n"
    + " ".join(f"{x} {y} {z}" for x, y, z in VERTICES)
    + "\nPOLYGONS 4 16\n"
    + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES)
)


def read(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    return read_mesh(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.off", "OFF " + OFF),
        ("b.off", "OFF\n# comment\n" + OFF.replace("3 1 2 3", "3 1 2 3 255 0 0")),
        ("c.obj", OBJ),
        ("d.obj", "mtllib x.mtl\nvn 0 0 1\n" + V + "".join(f"f {a + 1}/1/1 {b + 1}//1 {c + 1}/1\n" for a, b, c in FACES)),
        ("e.obj", V.replace("v 0 0 1", "v 0 0 \\\n1 1.0") + "".join(f"f {a - 4} {b - 4} {c - 4}\n" for a, b, c in FACES)),
        ("f.vtk", POLYDATA),
        ("g.stl", STL + "endsolid s"),
    ],
    ids=lambda value: value if len(value) < 9 else "",
)  # fmt: skip
def test_a_closed_surface_is_read_and_is_a_rigid_body(name, text, tmp_path):
    mesh = read(tmp_path, name, text)
    assert mesh.nt == 4 and mesh.d == 3
    x = mesh.p[:, mesh.t]
    assert np.isclose(np.linalg.det(x.transpose(2, 0, 1)).sum() / 6, 1 / 6)  # the volume within, so faces have their orientation
    assert len(RigidMesh(str(tmp_path / name)).simplices) == 4


def test_objects_and_groups_of_wavefront_are_subdomains_and_polygons_are_split(tmp_path):
    square = V + "v 1 1 0\no lid\nf 1 2 5 3\ng left right\nf 1 2 4\nf 1 2 5 3 4\n"
    mesh = read(tmp_path, "square.obj", square)
    assert {name: ids.tolist() for name, ids in mesh.subdomains.items()} == {
        "lid": [0, 1],
        "left": [2, 3, 4, 5],
        "right": [2, 3, 4, 5],
    }
    assert read(tmp_path, "quads.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n").kind == "quadrilaterals in 2D"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.off", "NOFF " + OFF, "expected OFF"),
        ("a.off", "OFF " + OFF.replace("4 4 0", "4 5 0"), "5 faces are declared, 4 were found"),
        ("a.off", "OFF " + OFF.replace("4 4 0", "4 3 0"), "3 faces are declared, more were found"),
        ("a.off", "OFF " + OFF.replace("3 1 2 3", "3 1 2"), "expected the 3 corners of a face"),
        ("a.off", "OFF " + OFF.replace("3 1 2 3", "3 1 2 7"), "vertex ids outside 0"),
        ("a.off", ("OFF " + OFF)[:-1], "its last line has no end"),
        ("a.obj", OBJ.replace("v 1 0 0", "v 1 0"), "expected three coordinates"),
        ("a.obj", OBJ.replace("v 1 0 0", "v 1 0 x"), "other text than numbers"),
        ("a.obj", OBJ.replace("f 2 3 4", "f 2 3 0"), "expected the 3 corners"),
        ("a.obj", OBJ.replace("f 2 3 4", "f 2 3"), "its face 3 has 2 corners"),
        ("a.obj", OBJ + "curv 0 1 1 2\n", "it has 'curv' elements, which are not read"),
        ("a.vtk", POLYDATA.replace("POLYGONS 4 16", "TRIANGLE_STRIPS 4 16"), "TRIANGLE_STRIPS"),
        ("a.vtk", POLYDATA.replace("POLYDATA", "FIELD x 1"), "expected a grid or POLYDATA"),
    ],
)
def test_damaged_surfaces_are_refused(name, text, message, tmp_path):
    with pytest.raises(MeshError, match=message):
        read(tmp_path, name, text)


def grids():
    """Return structured grids of VTK with 4 x 3 x 2 cells, and their volume."""
    pyvista = pytest.importorskip("pyvista")
    x, y, z = np.linspace(0, 2, 5), np.array([0, 0.1, 0.5, 1.0]), np.array([0, 1.0, 3.0])
    image = pyvista.ImageData(dimensions=(5, 4, 3), spacing=(0.5, 0.25, 1.0), origin=(1.0, 2.0, 3.0))
    rectilinear = pyvista.RectilinearGrid(x, y, z)
    structured = pyvista.StructuredGrid(*np.meshgrid(x, y, z, indexing="ij"))
    structured.points[:, 0] += 0.3 * structured.points[:, 2]
    return {"image": (image, 2 * 0.75 * 2), "rectilinear": (rectilinear, 6.0), "structured": (structured, 6.0)}


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("name", ["image", "rectilinear", "structured"])
def test_structured_grids_are_hexahedra_with_their_cell_data(name, binary, tmp_path):
    grid, volume = grids()[name]
    grid.cell_data["half"] = (np.arange(24) >= 12).astype(np.int32)
    grid.save(tmp_path / "grid.vtk", binary=binary)
    mesh = read_mesh(tmp_path / "grid.vtk")
    assert mesh.kind == "hexahedra in 3D" and mesh.nt == 24 and {name: ids.tolist() for name, ids in mesh.subdomains.items()} == {
        "half:0": list(range(12)), "half:1": list(range(12, 24))
    }  # fmt: skip
    centres = mesh.p[:, mesh.t].mean(axis=1).T
    assert np.allclose(centres, grid.cell_centers().points, atol=1e-6)
    corners = mesh.p[:, mesh.t]
    edges = np.stack([corners[:, mesh.t.shape[0] // 8 * i] - corners[:, 0] for i in (1, 2, 3)])
    assert np.isclose(np.abs(np.linalg.det(edges.transpose(2, 0, 1))).sum(), volume, rtol=1e-6)


def test_a_flat_image_is_quadrilaterals(tmp_path):
    text = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 3 2 1\nORIGIN 0 0 0\nSPACING 1 1 1\n"
    mesh = read(tmp_path, "flat.vtk", text)
    assert mesh.kind == "quadrilaterals in 2D" and mesh.nt == 2
    with pytest.raises(MeshError, match=r"its DIMENSIONS are \[3, 0, 1\], for 0 points"):
        read(tmp_path, "flat.vtk", text.replace("3 2 1", "3 0 1"))


MEDIT = "MeshVersionFormatted 2\nDimension 3\nVertices\n4\n0 0 0 1\n1 0 0 1\n0 1 0 1\n0 0 1 1\nTetrahedra\n1\n1 2 3 4 7\n"


@pytest.mark.parametrize(
    "text",
    [MEDIT, MEDIT + "End", MEDIT + "\nEnd\n", MEDIT.replace("Vertices\n4", "Vertices 4").replace("Dimension 3", "Dimension\n3"),
     MEDIT + "RequiredTriangles\n1\n1\nCorners\n2\n1 2\nEnd\n"],
)  # fmt: skip
def test_layouts_of_medit_are_read(text, tmp_path):
    mesh = read(tmp_path, "one.mesh", text)
    assert mesh.t.T.tolist() == [[0, 1, 2, 3]] and mesh.subdomains.keys() == {"medit:ref:7"}


def test_elements_of_second_order_of_medit_have_vtks_order(tmp_path):
    whole = box((1.0, 1.0, 1.0), (1, 1, 1)).with_degree(2)
    text = "MeshVersionFormatted 2\nDimension 3\n" + f"Vertices\n{whole.nv}\n"
    text += "".join("{} {} {} 1\n".format(*x) for x in whole.p.T) + f"TetrahedraP2\n{whole.nt}\n"
    mesh = read(tmp_path, "two.mesh", text + "".join(" ".join(str(i + 1) for i in t) + " 1\n" for t in whole.t.T) + "End\n")
    assert mesh.element.name == "quadratic tetrahedra" and np.array_equal(mesh.p[:, mesh.t], whole.p[:, whole.t])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("MFEM mesh v1.0\n", "It is a mesh of MFEM: convert it in MFEM"),
        (MEDIT.replace("Tetrahedra\n1", "Tetrahedra\n2"), "2 Tetrahedra are declared"),
        (MEDIT.replace("1 2 3 4 7", "1 2 3 5 7"), r"its elements: 1 vertex \(5\) not defined"),
        (MEDIT + "Tetrahedrons\n1\n", "'Tetrahedrons' was found; expected the beginning of a section"),
        (MEDIT + MEDIT[MEDIT.index("Tetra") :], "the section Tetrahedra occurs twice"),
        (MEDIT.replace("Dimension 3", "Dimension 4"), "its dimension is 4; expected 2 or 3"),
        ("MeshVersionFormatted 2\nDimension 3\nEnd\n", "it has no Vertices"),
    ],
)
def test_damaged_files_of_medit_are_refused(text, message, tmp_path):
    with pytest.raises(MeshError, match=message):
        read(tmp_path, "bad.mesh", text)
