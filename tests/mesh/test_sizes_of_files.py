"""Files without an end are refused at once, and the work for many sets grows with their number, not with its square."""

import cProfile
import pstats
from collections.abc import Callable

import numpy as np
import pytest

from skfem_stvk import ElementMesh, MeshError, read_mesh, write_mesh
from skfem_stvk.mesh import box
from skfem_stvk.mesh.formats import CHECKS, READERS
from skfem_stvk.mesh.formats.stream import LONGEST

#: Bytes of a sparse file of zeros, more than any memory.
ENDLESS = 2**40
CUBE = box((1.0, 1.0, 1.0), (2, 2, 2))


def calls(work: Callable[[], object]) -> int:
    """Return the number of calls of functions that a piece of work makes; unlike its time it is the same on each machine."""
    with cProfile.Profile() as profile:
        work()
    return pstats.Stats(profile).total_calls


@pytest.mark.parametrize("suffix", sorted({*READERS, *CHECKS} - {".meshb"}))
def test_a_mesh_file_whose_first_line_has_no_end_is_refused_at_once(suffix, tmp_path):
    path = tmp_path / f"endless{suffix}"
    for file in (path, *(path.with_suffix(other) for other in (".ele", ".node") if suffix in (".ele", ".node"))):
        with file.open("wb") as zeros:
            zeros.truncate(ENDLESS)
    with pytest.raises(
        MeshError, match=r"(has a line of more than 1000000 bytes|does not begin with '<'|breaks at|last line|bytes|is not a)"
    ):
        read_mesh(path)


def abaqus(path, count, line=""):
    """Write a cube with this number of node sets, and a line after its heading."""
    text = ["*HEADING", line or "a cube", "*NODE", *(f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(CUBE.p.T, 1))]
    text += ["*ELEMENT, TYPE=C3D4", *(f"{i}, {', '.join(map(str, t + 1))}" for i, t in enumerate(CUBE.t.T, 1))]
    for number in range(count):
        text += [
            f"*NSET, NSET=Set{number}",
            f"{1 + number % CUBE.nv},",
            f"*NSET, NSET=SET{number}",
            f"{1 + (number + 3) % CUBE.nv},",
        ]
    path.write_text("\n".join(text) + "\n")
    return path


@pytest.mark.parametrize("length", [LONGEST - 1, LONGEST])
def test_lines_of_up_to_a_million_bytes_are_read(length, tmp_path):
    path = abaqus(tmp_path / "cube.inp", 1, "x" * length)
    if length < LONGEST:
        assert read_mesh(path).nt == CUBE.nt
    else:
        with pytest.raises(MeshError, match="has a line of more than 1000000 bytes"):
            read_mesh(path)


def test_the_work_for_node_sets_grows_with_their_number(tmp_path):
    few, many = (abaqus(tmp_path / f"{count}.inp", count) for count in (200, 800))
    read_mesh(few)
    small, large = (calls(lambda file=file: read_mesh(file)) for file in (few, many))
    assert large < 4.2 * small
    sets = read_mesh(many).node_sets
    assert len(sets) == 800 and sets["Set7"].tolist() == sorted([7 % CUBE.nv, 10 % CUBE.nv])
    mesh = ElementMesh(CUBE.p, CUBE.t, node_sets=dict(list(sets.items())[:5]))
    assert read_mesh(write_mesh(tmp_path / "cube.vtu", mesh)).node_sets.keys() == mesh.node_sets.keys()


def test_sets_of_sets_and_ids_in_any_order_are_found(tmp_path):
    order = np.random.default_rng(0).permutation(CUBE.nv)
    text = ["*NODE", *(f"{i + 1}, {', '.join(map(str, CUBE.p[:, i]))}" for i in order)]
    text += ["*ELEMENT, TYPE=C3D4", *(f"{i}, {', '.join(map(str, t + 1))}" for i, t in reversed(list(enumerate(CUBE.t.T, 1))))]
    text += ["*NSET, NSET=a, GENERATE", "2, 8, 3", "*NSET, NSET=b", "4, 1, A", "*ELSET, ELSET=e", "3, 1", ""]
    path = tmp_path / "cube.inp"
    path.write_text("\n".join(text))
    mesh = read_mesh(path)
    for name, ids in (("a", [2, 5, 8]), ("b", [1, 2, 4, 5, 8])):
        found = {tuple(x) for x in mesh.p[:, mesh.node_sets[name]].T}
        assert found == {tuple(CUBE.p[:, i - 1]) for i in ids}
    centres = {tuple(x) for x in mesh.p[:, mesh.t[:, mesh.subdomains["e"]]].mean(axis=1).T.round(9)}
    assert centres == {tuple(CUBE.p[:, CUBE.t[:, i - 1]].mean(axis=1).round(9)) for i in (1, 3)}
    path.write_text("\n".join(text).replace("3, 1\n", "3, 100\n"))
    with pytest.raises(MeshError, match=r"1 element \(100\) not defined"):
        read_mesh(path)
