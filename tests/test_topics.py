"""Pictures of topics are drawn by programs next to them; the page of file layouts is complete."""

import re
import runpy
from pathlib import Path

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
    named = re.findall(r"^ {4}(`[^ ].*?`(?:, `.*?`)*(?:, \.\.\.)?) {2,}", column_names.__doc__, re.MULTILINE)
    names = [name for names in named for name in re.findall(r"`(.+?)`", names)]
    assert len(names) > 14 and [name for name in names if f"`{name}`" not in page] == ["A y"]
