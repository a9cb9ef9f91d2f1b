"""The runner of hostile inputs catches planted faults of each kind, and its quick version finds no fault in the package."""

import planted
import pytest

from validation import hostile
from validation.hostile import runner


@pytest.fixture(autouse=True)
def family(monkeypatch):
    monkeypatch.setitem(runner.FAMILIES, "planted", "planted")


@pytest.fixture(scope="module")
def outcomes():
    """Return the outcomes of the planted cases by name."""
    return {case.name: runner.outcome("planted", case) for case in planted.cases()}


def test_a_planted_fault_of_each_kind_is_caught_with_its_reason(outcomes):
    assert {name: outcome.verdict for name, outcome in outcomes.items()} == planted.EXPECTED
    assert "KeyError: 'connectivity'" in outcomes["an error from the depths"].why
    assert outcomes["a loss"].why == "state 7 is missing"
    assert "in forever" in outcomes["a hang"].why


def test_wrong_cases_are_counted_listed_with_the_command_that_repeats_them_and_fail_the_study(outcomes, monkeypatch, capsys):
    monkeypatch.setattr(runner, "outcome", lambda family, case: outcomes[case.name])
    assert hostile.main(only=["planted"]) == 1
    out = capsys.readouterr().out
    wrong = sum(verdict.wrong for verdict in planted.EXPECTED.values())
    assert f"{len(planted.EXPECTED)} cases" in out and f"{wrong} WRONG" in out
    assert out.count("python -m validation hostile --case ") == wrong


def test_a_single_case_is_repeated_with_its_whole_output(capsys):
    assert hostile.main(only=["planted"], case=["planted/refused in words"]) == 0
    out = capsys.readouterr().out
    assert "1 cases" in out and "Expected a mesh, got nothing at all." in out


def test_the_quick_version_runs_the_quick_cases(capsys):
    assert hostile.main(quick=True, only=["planted"]) == 0
    out = capsys.readouterr().out
    assert "1 cases" in out and "none is wrong" in out


def test_an_unknown_case_is_an_error():
    with pytest.raises(SystemExit, match="There is no case 'planted/nothing'"):
        hostile.main(only=["planted"], case=["planted/nothing"])


@pytest.mark.slow
def test_the_quick_version_finds_no_fault_in_any_family(capsys):
    assert hostile.main(quick=True) == 0, capsys.readouterr().out
    out = capsys.readouterr().out
    assert "none is wrong" in out and all(f" {family} " in out for family in hostile.NAMES)
