"""The runner of hostile inputs catches what it is there for, and its quick version finds nothing."""

import planted
import pytest

from validation import hostile
from validation.hostile import runner, study


@pytest.fixture(scope="module")
def outcomes():
    """What comes of the planted cases, by name."""
    return {outcome.case: outcome for outcome in runner.outcomes(runner.jobs({"planted": "planted"}))}


@pytest.mark.parametrize("name", planted.EXPECTED)
def test_a_planted_fault_of_each_kind_is_caught(outcomes, name):
    assert outcomes.keys() == planted.EXPECTED.keys()
    assert outcomes[name].verdict is planted.EXPECTED[name], outcomes[name].why


def test_what_went_wrong_is_told(outcomes):
    assert "KeyError: 'connectivity'" in outcomes["an error from the depths"].why
    assert "SIGSEGV" in outcomes["a segmentation fault"].why and "SIGKILL" in outcomes["a kill"].why
    assert outcomes["a loss"].why == "state 7 is gone"
    assert "in forever" in outcomes["a hang"].why


def test_wrong_cases_are_counted_listed_with_how_to_repeat_them_and_fail_the_command(outcomes, monkeypatch, capsys):
    monkeypatch.setitem(study.FAMILIES, "planted", "planted")
    monkeypatch.setattr(study, "outcomes", lambda todo: list(outcomes.values()))
    assert hostile.main(only=["planted"]) == 1
    out = capsys.readouterr().out
    wrong = sum(verdict.wrong for verdict in planted.EXPECTED.values())
    assert f"{len(planted.EXPECTED)} cases" in out and f"{wrong} WRONG" in out
    assert out.count("python -m validation hostile --case ") == wrong


def test_a_case_is_repeated_alone_with_all_that_it_says(monkeypatch, capsys):
    monkeypatch.setitem(study.FAMILIES, "planted", "planted")
    assert hostile.main(only=["planted"], case=["planted/refused in words"]) == 0
    out = capsys.readouterr().out
    assert "1 cases" in out and "Expected a mesh, got nothing at all." in out


def test_the_quick_version_takes_the_quick_cases(monkeypatch, capsys):
    monkeypatch.setitem(study.FAMILIES, "planted", "planted")
    assert hostile.main(quick=True, only=["planted"]) == 0
    assert "none is wrong" in capsys.readouterr().out


def test_a_case_that_is_not_there_is_told():
    with pytest.raises(SystemExit, match="There is no case 'meshes/nothing'"):
        hostile.main(case=["meshes/nothing"])


@pytest.mark.slow
def test_the_quick_version_finds_nothing_in_any_family(capsys):
    assert hostile.main(quick=True) == 0, capsys.readouterr().out
    out = capsys.readouterr().out
    assert "none is wrong" in out and all(f" {family} " in out for family in hostile.NAMES)
