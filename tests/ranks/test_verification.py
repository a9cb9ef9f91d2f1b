"""A body on ranks passes the checks of `verify`, which see a wrong one."""

import json
from pathlib import Path

import pytest


@pytest.mark.slow
def test_a_body_on_ranks_is_verified_on_the_first(on_ranks, tmp_path):
    on_ranks(2, Path(__file__).with_name("verified_on_ranks.py"), tmp_path / "out.json")
    found = json.loads((tmp_path / "out.json").read_text())
    refused, wrong = found.pop("refused"), found.pop("wrong")
    assert len(found) == 2 and all(of["passed"] and not of["failed"] and of["results"] > 20 for of in found.values()), found
    assert not wrong["passed"] and wrong["failed"]
    assert "elements; expected at most 10: rank 0 gathers K" in refused
