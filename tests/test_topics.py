"""Pictures of topics are drawn by programs next to them; the page of file layouts is complete."""

import re
import runpy
from pathlib import Path

import numpy as np

from skfem_stvk import Friction, RigidContact, RigidPlane, StVK, System
from skfem_stvk.mesh import box
from skfem_stvk.solvers.dynamics.ledger_rows import column_names

TOPICS = Path(__file__).parent.parent / "docs" / "topics"


def test_the_picture_of_edge_pairs_has_their_numbers_and_can_be_drawn_again(tmp_path):
    program = runpy.run_path(str(TOPICS / "edge_pairs.py"))
    program["picture"](tmp_path / "pairs.png")
    L = program["form"].L
    assert list(program["panels"]) == ["6 edges", "12 adjacent pairs", "3 opposite pairs"]
    assert [round(value, 3) for value in (L[0, 0], L[0, 1], L[0, 5])] == [0.065, -0.003, 0.02]
    assert (tmp_path / "pairs.png").stat().st_size > 10_000 and (TOPICS / "edge_pairs.png").exists()


def test_the_page_of_file_layouts_has_all_columns_of_a_ledger():
    page = (TOPICS.parent / "reference" / "files.md").read_text(encoding="utf-8")
    mesh, law = box((1.0, 1.0, 1.0), (1, 1, 1)), {"young": 1.0, "poisson": 0.3, "density": 1.0}
    halves = [StVK(**law, region=np.arange(first, mesh.nt, 2)) for first in (0, 1)]
    contact = RigidContact(RigidPlane((0, 0, -1), (0, 0, 1)), stiffness=1.0, friction=Friction(0.3, slip_speed=0.1), name="C")
    names = column_names(System(mesh, [*halves, contact]), ["A"], ["B"], removing=True)
    first = {re.sub("(?<=[ _])[yz]$", "x", name) for name in names} - {"strain_energy StVK 1", "strain_energy RigidContact 2"}
    assert len(first) == 18 and [name for name in first if f"`{name}`" not in page] == []
