"""Pictures of the topics are drawn by programs next to them."""

import runpy
from pathlib import Path

TOPICS = Path(__file__).parent.parent / "docs" / "topics"


def test_the_picture_of_edge_pairs_has_their_numbers_and_can_be_drawn_again(tmp_path):
    program = runpy.run_path(str(TOPICS / "edge_pairs.py"))
    program["picture"](tmp_path / "pairs.png")
    L = program["form"].L
    assert list(program["panels"]) == ["6 edges", "12 adjacent pairs", "3 opposite pairs"]
    assert [round(value, 3) for value in (L[0, 0], L[0, 1], L[0, 5])] == [0.065, -0.003, 0.02]
    assert (tmp_path / "pairs.png").stat().st_size > 10_000 and (TOPICS / "edge_pairs.png").exists()
