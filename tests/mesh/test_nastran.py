"""Bulk data of Nastran as other programs write it: fields, continuation lines, coordinate systems, included files."""

import numpy as np
import pytest

from skfem_stvk import MeshError, StvkWarning, read_mesh

POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 2), (1, 0, 2), (1, 1, 2), (0, 1, 2)]
#: A grid point, and a hexahedron, in fields of 8, of 16, and free.
GRID = "GRID    {0:<8}{4:<8}{1:<8}{2:<8}{3:<8}\n"
GRIDS = "".join(GRID.format(i, *map(float, x), "") for i, x in enumerate(POINTS, 1))
HEX = "CHEXA   1       7       1       2       3       4       5       6       +A\n+A      7       8\n"
HEAD, END = "SOL 101\nCEND\nTITLE = a box, 1\nBEGIN BULK\n", "ENDDATA\n"
WIDE = "".join(
    f"GRID*   {i:<16}{'':16}{float(x[0]):<16}{float(x[1]):<16}*\n*       {float(x[2]):<16}\n" for i, x in enumerate(POINTS, 1)
)
WIDE_HEX = f"CHEXA*  {1:<16}{7:<16}{1:<16}{2:<16}*\n*       {3:<16}{4:<16}{5:<16}{6:<16}*\n*       {7:<16}{8:<16}\n"
FREE = "".join(f"GRID,{i},,{x[0]}.,{x[1]}.,{x[2]}.\n" for i, x in enumerate(POINTS, 1))
BOX = HEAD + GRIDS + HEX + END


def read(tmp_path, text, name="deck.bdf"):
    (tmp_path / name).write_bytes(text.encode())
    return read_mesh(tmp_path / name)


@pytest.mark.parametrize(
    "text",
    [
        BOX,
        GRIDS + HEX + END,
        "$ Created by Gmsh\n" + GRIDS + HEX,
        BOX.replace("+A", "  "),
        HEAD + GRIDS + "CHEXA,1,7,1,2,3,4,5,6\n,7,8\n" + END,
        HEAD + FREE + "CHEXA,1,7,1,2,3,4,5,6,+B\n+B,7,8 $ comment\n" + END,
        HEAD + WIDE + WIDE_HEX + END,
        BOX.lower(),
        BOX.rstrip("\n"),
        BOX.replace("\n", "\r\n"),
        BOX + "anything after the end",
        BOX.replace("GRID    2               1.0     ", "GRID    2               1.0-0   "),
        BOX.replace("GRID    2       ", "GRID\t2\t").replace("BULK\n", "BULK\nCORD2C  3       0       0.      0.      0.\n"),
        BOX.replace("BULK\n", "BULK\nMAT1,1,2.1+11,,.3\nPSOLID,7,1\nSPC1,1,123456,1,2\n"),
    ],
    ids=[
        "fixed", "no head", "no end", "blank", "free", "free marks", "wide", "lower", "last line", "crlf", "after", "exponent",
        "unused", "more",
    ],
)  # fmt: skip
def test_valid_decks_are_read_as_the_same_box(text, tmp_path):
    mesh = read(tmp_path, text)
    assert (
        np.array_equal(mesh.p.T, np.array(POINTS, dtype=float))
        and mesh.nt == 1
        and mesh.t.T.tolist() == read(tmp_path, BOX).t.T.tolist()
    )
    assert mesh.subdomains.keys() == {"nastran:ref:7"}


@pytest.mark.parametrize("suffix", [".nas", ".fem"])
def test_included_files_are_read(suffix, tmp_path):
    (tmp_path / "grids.inc").write_text(GRIDS)
    mesh = read(tmp_path, HEAD + "INCLUDE 'grids.inc'\n" + HEX + END, f"deck{suffix}")
    assert mesh.nv == 8
    for name, message in (("gone.inc", "missing or not a regular file"), ("/etc/passwd", "not in its folder")):
        with pytest.raises(MeshError, match=message):
            read(tmp_path, HEAD + f"INCLUDE '{name}'\n" + HEX + END)
    with pytest.raises(MeshError, match="includes files more than 8 deep"):
        read(tmp_path, HEAD + "INCLUDE 'deck.bdf'\n" + END)


def rotated(system, points, number=5):
    """Return grid points in a coordinate system of their own."""
    return "".join(f"GRID,{i},{number},{x[0]:.12f},{x[1]:.12f},{x[2]:.12f}\n" for i, x in enumerate(points, 1))


#: A system whose z axis is the global x axis, and whose x axis is the global y axis, from an origin.
ORIGIN, AXES = np.array([1.0, 2.0, 3.0]), np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
CORD2 = "CORD2{0},5,0,1.,2.,3.,2.,2.,3.\n,1.,3.,3.\n"
CORD1 = "GRID,101,,1.,2.,3.\nGRID,102,,2.,2.,3.\nGRID,103,,1.,3.,3.\nCORD1{0},9,101,102,103,5,101,102,103\n"


@pytest.mark.parametrize("cards", [CORD2, CORD1], ids=["CORD2", "CORD1"])
@pytest.mark.parametrize("kind", "RCS")
def test_coordinate_systems_of_nodes_are_applied(kind, cards, tmp_path):
    x, y, z = ((np.array(POINTS) - ORIGIN) @ AXES.T).T
    r, about = np.hypot(x, y), np.degrees(np.arctan2(y, x))
    whole = np.sqrt(r**2 + z**2)
    local = {"R": (x, y, z), "C": (r, about, z), "S": (whole, np.degrees(np.arccos(z / whole)), about)}[kind]
    text = HEAD + cards.format(kind) + rotated(kind, np.transpose(local)) + HEX + END
    if cards is CORD1:
        with pytest.warns(StvkWarning, match="3 vertices"):
            mesh = read(tmp_path, text)
    else:
        mesh = read(tmp_path, text)
    assert np.allclose(mesh.p.T, POINTS, atol=1e-9)


def test_systems_may_refer_to_systems_and_be_that_of_all_nodes(tmp_path):
    chain = "CORD2R,5,6,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nCORD2R,6,,1.,2.,3.,2.,2.,3.\n,1.,3.,3.\nGRDSET,,5\n"
    local = (np.array(POINTS) - ORIGIN) @ AXES.T
    mesh = read(tmp_path, HEAD + chain + rotated("R", local, number="") + HEX + END)
    assert np.allclose(mesh.p.T, POINTS, atol=1e-9)


def test_quadratic_elements_have_vtks_order(tmp_path):
    ten = [*POINTS[:2], (0, 1, 0), (0, 0, 1), (0.5, 0, 0), (0.5, 0.5, 0), (0, 0.5, 0), (0, 0, 0.5), (0.5, 0, 0.5), (0, 0.5, 0.5)]
    grids = "".join(f"GRID,{i},,{x[0]},{x[1]},{x[2]}\n" for i, x in enumerate(ten, 1))
    mesh = read(tmp_path, HEAD + grids + "CTETRA,1,1,1,2,3,4,5,6\n,7,8,9,10\n" + END)
    assert mesh.element.name == "quadratic tetrahedra" and np.array_equal(mesh.p[:, mesh.t[:, 0]].T, ten)


def test_elements_without_volume_are_left_out_with_a_note(tmp_path):
    with pytest.warns(StvkWarning, match="1 CONM2 and 2 CELAS1 elements are left out: they have no volume"):
        mesh = read(tmp_path, BOX.replace("ENDDATA", "CONM2,9,1,,1.\nCELAS1,10,1,1,1\nCELAS1,11,1,2,1\nENDDATA"))
    assert mesh.nt == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BOX.replace("ENDDATA\n", ""), "BEGIN BULK has no ENDDATA"),
        ((GRIDS + HEX).rstrip("\n"), "its last line has no end"),
        (BOX.replace("ENDDATA", "CTRIAX6,9,1,1,2,3\nENDDATA"), "it has the card CTRIAX6, which is not read"),
        (BOX.replace("ENDDATA", "7HEXA,1\nENDDATA"), "expected the name of a card"),
        (BOX.replace("+A      7       8", "+A      7"), "the card CHEXA 1: '' was found; expected an id; it needs 8 or 20 nodes"),
        (BOX.replace("+A      7       8", "+A      7       8       9"), "element 1 has 1 of 12 middle nodes; expected all or none"),
        (BOX.replace("+A      7       8", "+A      7       9"), r"its elements: 1 node \(9\) not defined"),
        (BOX.replace("GRID    2               1.0", "GRID    2       5       1.0"), "coordinate system 5 is not defined"),
        (BOX.replace("GRID    2 ", "GRID    1 "), r"1 node \(1\) more than once"),
        (BOX.replace("GRID    2               1.0", "GRID    2               one"), "'one' was found; expected a number"),
        (HEAD + "CORD2R,5,5,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\n" + rotated("R", POINTS) + HEX + END, "5 refers to itself"),
        (HEAD + "CORD2R,5,0,0.,0.,0.,0.,0.,1.\n,0.,0.,2.\n" + rotated("R", POINTS) + HEX + END, "5 has its three points on a line"),
        (HEAD + "CORD1R,5,1,2,77\n" + GRIDS.replace("GRID    8       ", "GRID    8       5") + HEX + END, "77"),
    ],
)
def test_what_is_not_read_is_refused_by_name(text, message, tmp_path):
    with pytest.raises(MeshError, match=message):
        read(tmp_path, text)
