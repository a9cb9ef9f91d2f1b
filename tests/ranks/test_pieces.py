"""Files of states on ranks: fields by element and at nodes are those of one machine, and pieces join to the whole body's file."""

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import meshio
import numpy as np
import pytest
from bodies import EVERY_MESH

from skfem_stvk import StvkError, read_state
from skfem_stvk.results.vtu import read_vtu

TYPES = {"Float64": np.float64, "Int64": np.int64, "Int32": np.int32, "UInt8": np.uint8}


@pytest.fixture(scope="module", params=[pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow), 3])
def written(request, on_ranks, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pieces")
    on_ranks(request.param, Path(__file__).with_name("pieces_on_ranks.py"), folder)
    return request.param, folder, json.loads((folder / "out.json").read_text())


def test_fields_by_element_and_at_nodes_are_those_of_one_machine(written):
    _, _, out = written
    assert len(out["bodies"]) == len(EVERY_MESH) + 4 and sum(len(of["differences"]) for of in out["bodies"].values()) > 400
    far = {
        (name, field): value for name, of in out["bodies"].items() for field, value in of["differences"].items() if value > 1e-13
    }
    assert not far


def test_pieces_join_to_the_file_of_the_whole_body(written):
    ranks, folder, out = written
    for name, of in out["bodies"].items():
        joined, whole = (read_vtu(folder / file) for file in (f"{name}.{'pvtu' if ranks > 1 else 'vtu'}", f"{name} whole.vtu"))
        assert np.array_equal(joined.points, whole.points) and joined.point_data.keys() == whole.point_data.keys()
        assert [block.type for block in joined.cells] == [block.type for block in whole.cells]
        assert np.array_equal(joined.cells[0].data, whole.cells[0].data)
        if ranks > 1:  # a file of one rank has it if nodes have other numbers
            assert joined.cell_data.keys() - whole.cell_data.keys() == {"rank"}
        for rank, elements in enumerate(of["ranks"] if ranks > 1 else []):
            assert np.array_equal(np.flatnonzero(joined.cell_data["rank"][0] == rank), elements)
        for field, values in whole.point_data.items():
            assert joined.point_data[field] == pytest.approx(values, rel=1e-12, abs=1e-13 * max(np.abs(values).max(), 1e-300))
        for field, (values, *_) in whole.cell_data.items():
            scale = max(np.abs(values).max(), 1e-300)
            assert joined.cell_data[field][0] == pytest.approx(values, rel=1e-12, abs=1e-13 * scale), (name, field)
        if name.startswith("part of"):
            assert "cauchy_stress_missing" in whole.point_data and "cauchy_stress_missing" in whole.cell_data


@pytest.mark.parametrize("name", ["covered", "tied"])
def test_membranes_and_cables_have_the_order_of_the_whole_mesh(written, name):
    """Some ranks have none of the cables of a name."""
    ranks, folder, _ = written
    joined, whole = (read_vtu(folder / f"{name}{file}") for file in ((".pvtu" if ranks > 1 else ".vtu"), " whole.vtu"))
    assert np.array_equal(joined.cells[1].data, whole.cells[1].data) and len(whole.cells[1].data) > 5
    stress = [one.cell_data["cauchy_stress"][1] for one in (joined, whole)]
    assert stress[0] == pytest.approx(stress[1], abs=1e-13 * np.abs(stress[1]).max())


def test_a_list_of_pieces_declares_their_arrays(written):
    ranks, folder, _ = written
    for file in folder.glob("*.pvtu"):
        grid = ET.parse(file).find("PUnstructuredGrid")
        pieces = [piece.attrib["Source"] for piece in grid.iter("Piece")]
        assert pieces == [f"{file.stem}_r{rank:04d}.vtu" for rank in range(ranks)]
        for piece in (meshio.vtu.read(folder / name) for name in pieces):
            of_cells = {name: np.concatenate(blocks) for name, blocks in piece.cell_data.items()}
            for kind, arrays in (("PPointData", piece.point_data), ("PCellData", of_cells), ("PPoints", {"Points": piece.points})):
                declared = {one.attrib["Name"]: one.attrib for one in grid.find(kind)}
                assert declared.keys() == arrays.keys()
                for name, values in arrays.items():
                    assert TYPES[declared[name]["type"]] == values.dtype
                    assert int(declared[name].get("NumberOfComponents", 1)) == (values.shape[1] if values.ndim > 1 else 1)


def test_states_are_read_on_one_machine(written):
    ranks, folder, _ = written
    for name, mesh in EVERY_MESH.items():
        u, v = read_state(folder / f"{name}.{'pvtu' if ranks > 1 else 'vtu'}", mesh)
        expected = read_state(folder / f"{name} whole.vtu", mesh)
        assert np.array_equal(u, expected[0]) and np.array_equal(v, expected[1])
    if ranks > 1:
        (folder / "triangles_r0001.vtu").rename(folder / "away.vtu")
        with pytest.raises(StvkError, match=r"cannot be read.*triangles_r0001\.vtu"):
            read_state(folder / "triangles.pvtu", EVERY_MESH["triangles"])
        (folder / "away.vtu").rename(folder / "triangles_r0001.vtu")


def test_what_needs_the_whole_body_is_refused(written):
    ranks, _, out = written
    expected = ["save='x.pvd'", "whole mesh", ".pvtu", "space=system.space", "whole mesh"]
    for message, text in zip(out["messages"], expected, strict=True):
        assert text in message if ranks > 1 else text not in message
