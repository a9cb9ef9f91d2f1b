"""In the matrix of planted faults and checks, every fault is caught and every check catches a fault.

A referee without one of its checks does not pass.
"""

import json
import re
from pathlib import Path

import pytest

from skfem_stvk.referee import self_test as module
from skfem_stvk.referee.faults import FAULTS, bodies
from skfem_stvk.referee.self_test import BACKS_UP, CHECKS, SelfTest, self_test
from skfem_stvk.referee.verification import failures_of
from skfem_stvk.scenes.commands.main import main
from skfem_stvk.terminal import as_text

PAGE = Path(__file__).parents[2] / "docs" / "measurements" / "planted-faults.md"


@pytest.fixture(scope="module")
def found():
    return self_test(quiet=True)


@pytest.mark.slow
def test_every_fault_is_caught_and_every_check_is_needed(found):
    assert found.passed and not found.missed and not found.idle
    assert len(found.caught) == len(FAULTS) >= 50
    assert set(BACKS_UP).isdisjoint(check for check in CHECKS if found.alone(check))
    assert found.alone("precision") == ["textbook cancellation"] and "frames transposed" in found.alone("agreement")
    assert all(FAULTS[name].description for name in FAULTS) and {fault.body for fault in FAULTS.values()} == set(bodies())


@pytest.mark.slow
def test_the_page_equals_the_output_of_the_command(found):
    printed = re.sub(r" in \d+ s$", "", str(found))
    text = PAGE.read_text(encoding="utf-8")
    assert all(line.strip() in text for line in printed.splitlines()), printed
    assert all(f"- **{name}**: {fault.description}" in " ".join(text.split()) for name, fault in FAULTS.items())


@pytest.mark.slow
def test_the_self_test_is_saved_as_json_and_html(found, tmp_path):
    found.save(tmp_path / "out")
    data = json.loads((tmp_path / "out" / "self-test.json").read_text())
    assert data["passed"] and data["faults"]["twice lambda"]["caught by"]["closed forms"] == "WP"
    assert "textbook cancellation" in (tmp_path / "out" / "self-test.html").read_text()


def test_an_uncaught_fault_does_not_pass():
    missed = SelfTest(caught={"twice lambda": {}, "half mu": {"agreement": "W"}}, false_alarms={"isotropic": {}})
    assert not missed.passed and missed.missed == ["twice lambda"] and "not caught: twice lambda" in str(missed)


@pytest.mark.slow
def test_a_wrong_name_does_not_pass(found):
    assert len(found.named) == len(FAULTS) and not found.unnamed and not found.wrong_names and "wrong names: 0" in str(found)
    for names in ([], ["mu halved", "lambda doubled"]):
        wrong = SelfTest(found.caught, found.false_alarms, found.named | {"half mu": names})
        assert not wrong.passed and ("not named: half mu" if not names else "half mu: ['lambda doubled']") in str(wrong)
    assert SelfTest(named={"skew K": ["K x 2"]}).wrong_names == {"skew K": ["K x 2"]}


def test_a_check_that_catches_nothing_does_not_pass():
    idle = SelfTest(caught={"twice lambda": {check: "F" for check in CHECKS if check != "patch test"}}, false_alarms={})
    assert "patch test" in idle.idle and not idle.passed


@pytest.mark.slow
@pytest.mark.parametrize("check", BACKS_UP)
def test_a_check_without_a_fault_of_its_own_must_back_up_others(found, check):
    others, _ = BACKS_UP[check]
    assert not found.alone(check) and found.alone(check, others)
    caught = {name: checks for name, checks in found.caught.items() if name not in found.alone(check, others)}
    assert check in SelfTest(caught=caught, false_alarms=found.false_alarms).idle


@pytest.mark.slow
def test_a_right_model_that_fails_does_not_pass(found):
    wrong = SelfTest(caught=found.caught, false_alarms={"curved": {"symmetry": "K"}})
    assert found.passed and not wrong.passed and "the correct model fails on curved" in as_text(wrong.rendered())


def test_a_referee_without_a_check_does_not_pass(monkeypatch):
    monkeypatch.setattr("skfem_stvk.referee.verification.CHECKS", ())
    body = bodies()["isotropic"]
    assert failures_of(FAULTS["twice lambda"].make, body.mesh, body.terms, body.options, 0) == []


def test_the_command_refuses_a_body_and_returns_its_outcome(monkeypatch, capsys, tmp_path):
    assert main(["verify", "part.msh", "--self-test"]) == 2
    assert "a mesh with --self-test" in " ".join(capsys.readouterr().err.split())
    few = dict(list(FAULTS.items())[:1])
    monkeypatch.setattr(module, "FAULTS", few)
    monkeypatch.setattr(module, "bodies", lambda: {"isotropic": bodies()["isotropic"]})
    assert main(["verify", "--self-test", "--out", str(tmp_path)]) == 1  # most checks catch no fault
    assert "twice lambda" in capsys.readouterr().out and (tmp_path / "self-test.json").exists()
