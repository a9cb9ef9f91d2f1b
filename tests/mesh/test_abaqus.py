"""Input files as Abaqus, CalculiX and PrePoMax write them: no matter and no name of a place is lost."""

import numpy as np
import pytest

from skfem_stvk import MeshError, StvkWarning, read_mesh
from skfem_stvk.mesh.formats.abaqus import HANDLED, KINDS, REFUSED, kind_of

NODES = """*NODE, NSET=ALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 1., 0.
5, 0., 0., 2.
6, 1., 0., 2.
7, 1., 1., 2.
8, 0., 1., 2.
"""
ELEMENT = "*ELEMENT, TYPE=C3D8, ELSET=E\n1, 1,2,3,4,5,6,7,8\n"
BOX = NODES + ELEMENT
PART = f"*PART, NAME=P\n{BOX}*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=P-1, PART=P\n"


def read(tmp_path, text):
    (tmp_path / "deck.inp").write_bytes(text.encode("latin-1") if "\xe9" in text else text.encode())
    return read_mesh(tmp_path / "deck.inp")


@pytest.mark.parametrize(
    "text",
    [
        NODES.replace("1, 0., 0., 0.", "1").replace("2, 1., 0., 0.", "2, 1.") + ELEMENT,
        NODES.replace("1, 0., 0., 0.", "1, 0., 0., 0., 0., 0., 1.") + ELEMENT,
        NODES.replace("5, 0., 0., 2.", "5, 0.D0, , 2.0D+00") + ELEMENT,
        BOX.replace("4,5,6", "4,\n5,6"),
        BOX.replace("4,5,6", "4\n5,6"),
        BOX.replace("*ELEMENT", "*\n** a comment\n*ELEMENT"),
        BOX.replace("C3D8,", "C3D8,\n"),
        BOX.replace("*ELEMENT, TYPE=C3D8, ELSET=E", "* ELEMENT , TYPE = c3d8r , ELSET = E"),
        BOX + "*SOLID SECTION, ELSET=E, MATERIAL=M\n*STEP\n*STATIC\n*EL FILE, ELSET=E\nS\n*END STEP",
        "*HEADING\n a box, 7\n" + BOX,
    ],
    ids=["omitted", "normal", "blank and D", "comma", "next line", "star", "keyword", "blanks", "step", "heading"],
)
def test_valid_decks_are_read_as_the_same_box(text, tmp_path):
    mesh, plain = read(tmp_path, text), read(tmp_path, BOX)
    assert np.array_equal(mesh.p, plain.p) and np.array_equal(mesh.t, plain.t)
    assert mesh.subdomains.keys() == {"E"} and mesh.node_sets["ALL"].size == 8


def test_data_of_another_file_are_read(tmp_path):
    (tmp_path / "elements.dat").write_text("1, 1,2,3,4,5,6,7,8\n")
    mesh = read(tmp_path, NODES + "*ELEMENT, TYPE=C3D8, ELSET=E, INPUT=elements.dat\n")
    assert mesh.nt == 1 and mesh.subdomains["E"].size == 1


def test_a_cylindrical_system_of_nodes_is_read(tmp_path):
    polar = (
        NODES.replace("*NODE, NSET=ALL", "*NODE, SYSTEM=C").replace("3, 1., 1.,", "3, 1., 90.,").replace("4, 0., 1.,", "4, 0., 1.,")
    )
    mesh = read(tmp_path, polar.replace("7, 1., 1.,", "7, 1., 90.,") + ELEMENT)
    at = {tuple(x) for x in mesh.p.T.round(12) + 0.0}
    assert {(0.0, 1.0, 0.0), (0.0, 1.0, 2.0), (1.0, 0.0, 0.0)} <= at and not any(x[0] > 1 for x in at)


def test_a_system_holds_until_the_next_one(tmp_path):
    moved = "*SYSTEM\n10.,0.,0., 11.,1.,0.\n9.,1.,0.\n" + BOX.replace(
        "8, 0., 1., 2.\n", "*SYSTEM\n*NODE, NSET=ALL\n8, 0., 1., 2.\n", 1
    )
    mesh = read(tmp_path, moved)
    half = np.sqrt(0.5)
    assert np.allclose(mesh.p.T[:4], [[10, 0, 0], [10 + half, half, 0], [10, 2 * half, 0], [10 - half, half, 0]])
    assert np.allclose(mesh.p.T[7], [0, 1, 2]) and mesh.node_sets["ALL"].size == 8
    only_origin = read(tmp_path, "*SYSTEM\n10., 0., 1.\n" + BOX)
    assert np.allclose(only_origin.p, read(tmp_path, BOX).p + np.array([[10], [0], [1]]))


def test_instances_have_their_own_nodes_sets_and_places(tmp_path):
    mesh = read(
        tmp_path,
        PART.replace("*END PART", "*NSET, NSET=low\n1, 2\n*END PART")
        + "*NSET, NSET=inner\n3\n*END INSTANCE\n*INSTANCE, NAME=P-2, PART=P\n5., 0., 0.\n5., 0., 0., 5., 0., 1., 90.\n"
        "*END INSTANCE\n"
        "*NSET, NSET=foot, INSTANCE=P-1\n1,2,3,4\n*NSET, NSET=head, INSTANCE=P-2\n5,6,7,8\n"
        "*NSET, NSET=both\nP-1.1, p-2.8\nP-2.low\n*ELSET, ELSET=all\nP-1.E, P-2.1\n*SURFACE, NAME=top\nP-2.E, S2\n*END ASSEMBLY\n",
    )
    assert mesh.nt == 2 and mesh.nv == 16
    assert mesh.p[0].min() == 0 and np.isclose(mesh.p[0].max(), 5) and np.isclose(mesh.p[0, 8:].min(), 4)  # turned by 90 degrees
    assert {name: ids.size for name, ids in mesh.node_sets.items()} == {
        "P-1.ALL": 8,
        "P-2.ALL": 8,
        "P-1.low": 2,
        "P-2.low": 2,
        "P-1.inner": 1,
        "inner": 1,
        "foot": 4,
        "head": 4,
        "both": 4,
    }
    assert (mesh.p[2, mesh.node_sets["head"]] == 2).all() and (mesh.node_sets["head"] >= 8).all()
    assert {name: ids.tolist() for name, ids in mesh.subdomains.items()} == {"P-1.E": [0], "P-2.E": [1], "all": [0, 1]}
    assert (mesh.p[2, mesh.boundaries["top"]] == 2).all() and (mesh.boundaries["top"] >= 8).all()


@pytest.mark.parametrize("where", ["deck", "assembly"])
def test_reference_nodes_are_left_out_with_a_note_that_names_their_set(where, tmp_path):
    reference = "*NODE, NSET=REF\n9, 0.5, 0.5, 3.\n"
    text = BOX + reference if where == "deck" else PART + f"*END INSTANCE\n{reference}*END ASSEMBLY\n"
    with pytest.warns(StvkWarning, match="Node set 'REF': 1 vertex"), pytest.warns(StvkWarning, match="dropped"):
        mesh = read(tmp_path, text)
    assert mesh.nv == 8 and "REF" not in mesh.node_sets


@pytest.mark.parametrize("face, axis, at", [("S1", 2, 0), ("S2", 2, 2), ("S3", 1, 0), ("S4", 0, 1), ("S5", 1, 1), ("S6", 0, 0)])
def test_faces_of_hexahedra_become_boundaries(face, axis, at, tmp_path):
    mesh = read(tmp_path, BOX + f"*ELSET, ELSET=_S_{face}, INTERNAL\n1\n*SURFACE, NAME=S, TYPE=ELEMENT\n_S_{face}, {face}\n")
    assert mesh.boundaries["S"].shape == (4, 1) and (mesh.p[axis, mesh.boundaries["S"]] == at).all()
    assert mesh.subdomains.keys() == {"E"}


@pytest.mark.parametrize("face, opposite", [("S1", 3), ("S2", 2), ("S3", 0), ("S4", 1)])
def test_faces_of_tetrahedra_become_boundaries(face, opposite, tmp_path):
    text = NODES.replace(", NSET=ALL", "") + "*ELEMENT, TYPE=C3D4, ELSET=E\n1, 1,2,4,5\n2, 2,3,4,7\n"
    with pytest.warns(StvkWarning, match="dropped"):
        mesh = read(tmp_path, text + f"*SURFACE, NAME=S\n1, {face}\n")
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 2]])
    found = {tuple(x) for x in mesh.p[:, mesh.boundaries["S"][:, 0]].T}
    assert found == {tuple(x) for x in np.delete(corners, opposite, axis=0)}


def test_surfaces_of_nodes_unions_and_the_free_faces_of_elements(tmp_path):
    two = (
        BOX + "*NODE\n9, 0., 0., 3.\n10, 1., 0., 3.\n11, 1., 1., 3.\n12, 0., 1., 3.\n"
        "*ELEMENT, TYPE=C3D8, ELSET=F\n2, 5,6,7,8,9,10,11,12\n"
    )
    mesh = read(
        tmp_path,
        two + "*SURFACE, NAME=FOOT, TYPE=NODE\nALL,\n*SURFACE, NAME=free\nF,\n*SURFACE, NAME=top\nF, S2\n"
        "*SURFACE, NAME=low\n1, S1\n*SURFACE, NAME=ends, COMBINE=UNION\ntop, low\n",
    )
    assert mesh.node_sets["FOOT"].size == 8
    assert {name: facets.shape[1] for name, facets in mesh.boundaries.items()} == {"free": 5, "top": 1, "low": 1, "ends": 2}
    assert (mesh.p[2, mesh.boundaries["free"]] >= 2).all()


def test_sides_and_edges_of_shells(tmp_path):
    mesh = read(
        tmp_path,
        NODES + "*ELEMENT, TYPE=S4R, ELSET=shell\n1, 1,2,3,4\n2, 5,6,7,8\n"
        "*SURFACE, NAME=side\nshell, SPOS\n*SURFACE, NAME=edge\n2, E2\n*SURFACE, NAME=of_calculix\n2, S4\n",
    )
    assert mesh.subdomains["side"].size == 2
    for name in ("edge", "of_calculix"):
        assert mesh.boundaries[name].shape == (2, 1) and (mesh.p[0, mesh.boundaries[name]] == 1).all()


def test_sets_of_elements_give_sets_of_nodes_and_ranges_may_have_gaps(tmp_path):
    with pytest.warns(StvkWarning, match="Node set 'G': GENERATE has 92 ids from 1 to 100 that are not defined; they are left out"):
        mesh = read(tmp_path, BOX + "*NSET, NSET=NE, ELSET=E\n*NSET, NSET=G, GENERATE\n1, 100, 1\n")
    assert mesh.node_sets["NE"].size == mesh.node_sets["G"].size == 8


@pytest.mark.parametrize("accent", ["\xe9", "\u00df\u4e2d"])
def test_quoted_names_keep_commas_and_accents(accent, tmp_path):
    mesh = read(tmp_path, BOX + f'*NSET, NSET="Fixed face, left {accent}"\n1,2,3,4\n')
    assert mesh.node_sets[f"Fixed face, left {accent}"].size == 4


def test_elements_without_volume_are_left_out_with_a_note(tmp_path):
    extra = "*ELEMENT, TYPE=MASS, ELSET=M\n2, 5\n*MASS, ELSET=M\n0.1\n"
    extra += "*ELEMENT, TYPE=SPRINGA, ELSET=M\n3, 5, 1\n*ELSET, ELSET=X\n1, 2, 3\n"
    with pytest.warns(StvkWarning, match="1 MASS and 1 SPRINGA elements are left out: they have no volume"):
        mesh = read(tmp_path, BOX + extra)
    assert mesh.nt == 1 and mesh.subdomains.keys() == {"E", "X"}


@pytest.mark.parametrize(
    "type, kind",
    [
        ("C3D8T", "hexahedron"),
        ("C3D20T", "hexahedron20"),
        ("C3D10R", "tetra10"),
        ("C3D10MHT", "tetra10"),
        ("CPE4RT", "quad"),
        ("S8", "quad8"),
        ("S8R5", "quad8"),
        ("R3D4", "quad"),
        ("R3D3", "triangle"),
        ("S3RS", "triangle"),
        ("SC8R", "hexahedron"),
        ("B33", "line"),
        ("T3D3", "line3"),
    ],
)
def test_mechanical_twins_have_the_cells_of_their_element(type, kind):
    assert kind_of(type) == kind and sum(bool(pattern.fullmatch(type)) for pattern in KINDS.values()) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BOX + "*ELGEN, ELSET=E\n1, 2, 1, 1\n", r"the keyword \*ELGEN, which is not read: it makes nodes or elements from others"),
        (BOX + "*NODE, SYSTEM=S\n9, 1., 0., 0.\n", r"SYSTEM=S; expected R or C"),
        ("*SYSTEM\n0.,0.,0.,1.,0.,0.,2.,0.,0.\n" + BOX, "on a line"),
        (PART.replace("PART=P\n", "PART=Q\n") + "*END INSTANCE\n", r"PART=Q: no such \*PART"),
        (PART + "1., 2.\n*END INSTANCE\n", r"\*INSTANCE has 2 numbers"),
        (PART.split("*ASSEMBLY")[0], r"it has a \*PART but no \*INSTANCE"),
        (BOX.replace("C3D8", "CAX8"), "axisymmetric, which are not read. Revolve the section"),
        (BOX + "*SURFACE, NAME=S\nE, S7\n", r"Surface 'S' has the face 'S7' of C3D8; expected one of S1, S2"),
        (BOX + "*SURFACE, NAME=S\nX, S1\n", r"Surface 'S' names the set 'X', which is not defined"),
        (BOX + "*SURFACE, NAME=S, COMBINE=DIFFERENCE\nA, B\n", "COMBINE or CROP, which is not read"),
        (BOX + "*NSET, NSET=N, INSTANCE=P-7\n1\n", "of the instance 'P-7', which is not defined"),
        (BOX + "*NSET, NSET=N\n1, x y\n", "names the set 'x y'"),
        (BOX.replace("8, 0., 1.", "8, 0., one"), "'one' was found; expected a number"),
        (BOX[:-1], "its last line has no end, so it may be cut within a number"),
    ],
)
def test_what_is_not_read_is_refused_by_name(text, message, tmp_path):
    with pytest.raises(MeshError, match=message):
        read(tmp_path, text)


#: Keywords of Abaqus and CalculiX that say where matter is, or what a place is called.
GEOMETRY = (
    "NODE, ELEMENT, NSET, ELSET, SURFACE, PART, END PART, INSTANCE, END INSTANCE, SYSTEM, INCLUDE, NGEN, NFILL, NCOPY, NMAP, "
    "ELGEN, "
    "ELCOPY, IMPORT, IMPORT NSET, IMPORT ELSET, SYMMETRIC MODEL GENERATION, SUBSTRUCTURE GENERATE"
)


def test_each_keyword_with_geometry_is_read_or_refused():
    assert {*HANDLED, *REFUSED} == set(GEOMETRY.split(", "))
