"""Static solves and motions on ranks end where they end on one machine, and all ranks have the same states."""

import json
from pathlib import Path

import pytest


@pytest.fixture(scope="module", params=[2, pytest.param(3, marks=pytest.mark.slow)])
def differences(request, on_ranks, tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "out.json"
    some = ["moved", "Verlet", "equation 9", "energy and", "two regions", "quadratic tetrahedra"] if request.param == 2 else []
    on_ranks(request.param, Path(__file__).with_name("runs_on_ranks.py"), out, *some)
    return json.loads(out.read_text())


def test_runs_on_ranks_are_those_of_one_machine(differences):
    """All is in one test, so that the runs are made once, whatever the number of processes of the tests."""
    assert len(differences) > 10
    assert not {case: of["u"] for case, of in differences.items() if not of["u"] <= 1e-12}
    assert not {case: of for case, of in differences.items() if of["bits"] or of["columns of ranks"]}
    of_runs = {(case, name): value for case, of in differences.items() for name, value in of.items() if name != "u"}
    assert len(of_runs) > 150
    assert not {key: value for key, value in of_runs.items() if not value <= 1e-11}
