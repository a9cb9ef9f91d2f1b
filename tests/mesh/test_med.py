"""MED files of Salome and code_aster: groups that share families, groups of nodes, accents, and mirrored solids."""

import h5py
import numpy as np
import pytest

from skfem_stvk import MeshError, StVK, System, Traction, read_mesh
from skfem_stvk.mesh import box
from skfem_stvk.mesh.formats.med import KINDS

BOX = box((2.0, 1.0, 1.0), (3, 2, 2))


def write(path, points, cells, node_families=None, families=(), meshes=("mesh",)):
    """Write a file: `cells` (type, nodes, families), and `families` (NOEUD or ELEME, number, groups)."""
    with h5py.File(path, "w") as file:
        for name in meshes:
            mesh = file.create_group(f"ENS_MAA/{name}")
            mesh.attrs["ESP"] = points.shape[1]
            step = mesh.create_group("-0000000000000000001-0000000000000000001")

            def column(group, name, values):
                data = group.create_dataset(name, data=np.asarray(values).ravel(order="F"))
                data.attrs["NBR"] = len(values)

            nodes = step.create_group("NOE")
            column(nodes, "COO", points)
            if node_families is not None:
                column(nodes, "FAM", node_families)
            for kind, table, numbers in cells:
                group = step.create_group(f"MAI/{kind}")
                column(group, "NOD", np.asarray(table) + 1)
                if numbers is not None:
                    column(group, "FAM", numbers)
            file.require_group(f"FAS/{name}/FAMILLE_ZERO").attrs["NUM"] = 0
            for of, number, groups in families:
                family = file.create_group(f"FAS/{name}/{of}/FAM_{number}")
                family.attrs["NUM"] = number
                if groups:
                    texts = [text if isinstance(text, bytes) else text.encode() for text in groups]
                    family.create_group("GRO").attrs["NBR"] = len(groups)
                    rows = np.zeros(len(groups), dtype="(80,)i1")
                    for row, text in zip(rows, texts, strict=True):
                        row[: len(text)] = np.frombuffer(text, np.int8)
                    family["GRO"].create_dataset("NOM", data=rows)
    return path


def bar(path, **options):
    """Write a bar: its tetrahedra in the families -1 and -2, its end facets in -3, and nodes of its start in 5."""
    end = np.array([f for f in BOX.surface.T if (BOX.p[0, f] == 2).all()])
    halves = np.where(np.arange(BOX.nt) < 20, -1, -2)
    families = [
        ("ELEME", -1, ["all", "steel"]), ("ELEME", -2, ["all", "gummi é"]),
        ("ELEME", -3, ["end".ljust(80, "\0")]), ("ELEME", -4, []),
        ("NOEUD", 5, ["start", b"\xe9tag\xe8re"]),
    ]  # fmt: skip
    cells = [("TE4", BOX.t.T[:, [0, 2, 1, 3]], halves), ("TR3", end, np.full(len(end), -3)), ("SE2", [[0, 1]], None)]
    return write(path, BOX.p.T, cells, np.where(BOX.p[0] == 0, 5, 0), families, **options)


@pytest.mark.parametrize("suffix", [".med", ".mmed"])
def test_groups_are_the_unions_of_their_families(suffix, tmp_path):
    mesh = read_mesh(bar(tmp_path / f"bar{suffix}"))
    assert {name: ids.size for name, ids in mesh.subdomains.items()} == {"all": BOX.nt, "steel": 20, "gummi é": BOX.nt - 20}
    assert mesh.subdomains["steel"].tolist() == list(range(20)) and np.array_equal(mesh.t, BOX.t)
    assert {name: ids.size for name, ids in mesh.node_sets.items()} == {"start": 9, "étagère": 9}
    assert (mesh.p[0, mesh.node_sets["start"]] == 0).all() and (mesh.p[0, mesh.boundaries["end"]] == 2).all()
    body = System(mesh, [StVK(young=1.0, poisson=0.3), Traction("end", (0, 2.0, 0))], fixed={"étagère": "xyz"})
    assert body.external_force(np.zeros(body.ndofs)).reshape(-1, 3).sum(axis=0) == pytest.approx([0, 2.0, 0])


@pytest.mark.parametrize("kind, family", [("TE4", "tetra"), ("T10", "tetra10"), ("HE8", "hexahedron"), ("H20", "hexahedron20")])
def test_the_order_of_nodes_mirrors_each_solid_and_its_middle_nodes(kind, family):
    """The order is its own inverse, and middle nodes stay in the middle of the same corners."""
    edges = {
        "tetra": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
        "hexahedron": [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)],
    }
    name, order = KINDS[kind]
    assert name == family and [order[i] for i in order] == list(range(len(order)))
    corners = len(edges[family.rstrip("0123456789")]) * 2 // 3
    for i, (a, b) in enumerate(edges[family.rstrip("0123456789")][: len(order) - corners]):
        assert {order[a], order[b]} == set(edges[family.rstrip("0123456789")][order[corners + i] - corners])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"meshes": ("a", "b")}, r"it has 2 meshes \(a, b\); expected one"),
        ({"kind": "POG"}, "its elements POG are not read"),
    ],
)
def test_what_is_not_read_is_refused_by_name(change, message, tmp_path):
    if "kind" in change:
        path = write(tmp_path / "bar.med", BOX.p.T, [(change["kind"], BOX.t.T, None)])
    else:
        path = bar(tmp_path / "bar.med", **change)
    with pytest.raises(MeshError, match=message):
        read_mesh(path)


def test_gmsh_writes_groups_and_positive_elements(gmsh, tmp_path):
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addBox(0, 0, 0, 2, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [1], name="corps")
    gmsh.model.addPhysicalGroup(2, [1], name="left side")
    gmsh.model.mesh.generate(3)
    for suffix in ("med", "msh"):
        gmsh.write(str(tmp_path / f"box.{suffix}"))
    gmsh.finalize()
    med, msh = (read_mesh(tmp_path / f"box.{suffix}") for suffix in ("med", "msh"))
    assert med.subdomains.keys() == {"corps"} and med.boundaries["left side"].shape == msh.boundaries["left side"].shape
    sizes = np.linalg.det((med.p[:, med.t[1:]] - med.p[:, None, med.t[0]]).transpose(2, 0, 1)) / 6
    assert (sizes > 0).all() and np.isclose(sizes.sum(), 2)
