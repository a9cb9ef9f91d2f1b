"""The validation report separates kinds of claims, gives each claim its reference, and lists missing claims and changed values."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from skfem_stvk.errors import StvkError
from validation import __main__ as command
from validation.report import catalogue, job, numbers
from validation.report import report as make_report
from validation.report.catalogue import PARTS, Kind, Part

module = sys.modules["validation.report.report"]


def claim(name="a", outcome="holds", value=1.0, part="one", **more):
    return job.Claim(
        Kind.CODE.value, "statics", part, name, outcome=outcome, value=value, expected=1.0, error=0.0, tolerance=0.1, **more
    )


@pytest.fixture
def jobs(monkeypatch):
    """Replace the jobs and return their claims by part."""
    part = Part(Kind.CODE, "closed forms", "analytic", "a book")
    monkeypatch.setitem(
        PARTS, "statics", {"one": part, "two": part._replace(kind=Kind.SOLUTION), "timed": part._replace(speed=True)}
    )
    found = {"one": [claim()], "two": [claim("b")], "timed": [claim("c")]}
    monkeypatch.setattr(module, "_run", lambda group, name, quick: found[name])
    return found


def test_every_part_of_every_study_is_in_the_report():
    """The study of mutants judges the tests, not the package."""
    for group in command.PARTS.keys() - {"protection"}:
        assert set(command.PARTS[group]) <= set(PARTS[group]), group
    assert set(command.STUDIES) - {"protection"} <= set(PARTS)
    assert {part.kind for parts in PARTS.values() for part in parts.values()} == set(Kind)
    assert all(part.reference and part.reference_kind and part.source for parts in PARTS.values() for part in parts.values())


def test_the_report_is_written_as_html_and_json_and_compared_with_an_earlier_run(jobs, tmp_path, capsys):
    assert make_report(["statics"], quick=True, out=str(tmp_path / "first")) == 0
    first = json.loads((tmp_path / "first" / "validation.json").read_text())
    assert first["holds"] and len(first["claims"]) == 2 and first["not run without --speed"]
    assert first["provenance"]["commit"] and first["provenance"]["versions"]["scikit-fem"]
    jobs["one"][0].value = 1.05
    code = make_report(["statics"], quick=True, out=str(tmp_path), compare=str(tmp_path / "first" / "validation.json"))
    out = capsys.readouterr().out
    assert code == 0 and "1 values changed since" in out
    page = (tmp_path / "validation.html").read_text()
    assert "Code verification" in page and "all claims hold" in page and "1.05" in page


#: A run whose second part never ends.
ENDLESS = """
import sys, time
from tests.validation.test_whole_report import claim, module
from validation.report import report
module._jobs = lambda *given: [("statics", "one"), ("statics", "two")]
module._run = lambda group, name, quick: [claim()] if name == "one" else time.sleep(600)
report(quick=True, out=sys.argv[1])
"""


def test_a_killed_run_retains_the_finished_parts_and_is_resumed(jobs, tmp_path, monkeypatch):
    file = tmp_path / "validation.json"
    root = Path(__file__).parents[2]
    paths = os.pathsep.join([str(root), str(root / "tests")])
    with subprocess.Popen([sys.executable, "-c", ENDLESS, tmp_path], env=os.environ | {"PYTHONPATH": paths}) as run:
        end = time.monotonic() + 300
        while not file.exists() and time.monotonic() < end:
            time.sleep(0.05)
        run.terminate()
    left = json.loads(file.read_text())
    assert not left["holds"] and left["unfinished"] == ["statics, two"] and [c["name"] for c in left["claims"]] == ["a"]
    asked = []
    monkeypatch.setattr(module, "_run", lambda group, name, quick: asked.append(name) or [claim("b", part=name)])
    assert make_report(["statics"], quick=True, out=str(tmp_path), resume=True) == 0
    last = json.loads(file.read_text())
    assert asked == ["two"] and last["holds"] and last["unfinished"] == [] and [c["name"] for c in last["claims"]] == ["a", "b"]
    assert last["seconds"] > left["seconds"]
    with pytest.raises(StvkError, match=r"has commit, quick = .*True.*expected .*False"):
        make_report(["statics"], out=str(tmp_path), resume=True)
    file.write_text(json.dumps(last | {"provenance": {"commit": "another"}}))
    with pytest.raises(StvkError, match="'another'"):
        make_report(["statics"], quick=True, out=str(tmp_path), resume=True)
    with pytest.raises(StvkError, match="Add --out FOLDER"):
        make_report(["statics"], quick=True, resume=True)


def test_a_resumed_run_repeats_missing_parts(jobs, tmp_path, capsys):
    jobs["two"] = [claim("b", "missing", part="two")]
    assert make_report(["statics"], quick=True, out=str(tmp_path)) == 1
    jobs["one"], jobs["two"] = [claim("not asked")], [claim("b", part="two")]
    assert make_report(["statics"], quick=True, out=str(tmp_path), resume=True) == 0
    assert "not asked" not in (tmp_path / "validation.html").read_text()


def test_parts_that_measure_time_run_only_on_request(jobs):
    assert module._jobs(["statics"], True, False) == [("statics", "one"), ("statics", "two")]
    assert ("statics", "timed") in module._jobs(["statics"], True, True)


def test_a_claim_that_does_not_hold_or_is_missing_fails_the_report(jobs, capsys):
    jobs["one"] = [claim(outcome="does not hold", reason="round-off")]
    assert make_report(["statics"], quick=True) == 1
    jobs["one"], jobs["two"] = [claim()], [claim("b", outcome="missing", failures=["no such package"])]
    assert make_report(["statics"], quick=True) == 1
    assert "missing statics, one: b: no such package" in " ".join(capsys.readouterr().out.split())


def test_the_reason_of_a_failed_command_is_its_last_line(jobs, capsys):
    """The claim of a command has neither failures nor an error, so that the report shows the last note."""
    jobs["one"] = [job.Claim(Kind.CODE.value, "statics", "one", "a", outcome="does not hold", notes=["a table", "3 WRONG"])]
    assert make_report(["statics"], quick=True) == 1
    assert "does not hold statics, one: a: 3 WRONG" in capsys.readouterr().out


def test_a_job_that_crashes_or_takes_too_long_is_missing(monkeypatch):
    monkeypatch.setitem(PARTS, "nowhere", {"all": Part(Kind.CODE, "a", "b", "c", "words")})
    (crashed,) = module._run("nowhere", "all", True)
    assert crashed.outcome == "missing" and "nowhere" in crashed.failures[0]
    monkeypatch.setitem(module.MOST, True, 0.05)
    (late,) = module._run("statics", "homogeneous", True)
    assert late.outcome == "missing" and "took longer than" in late.failures[0]


def test_a_number_holds_only_within_its_tolerance():
    number = numbers.Number("n", "words", 1.02, 1.0, 0.01, "reason", "analytic", "a book")
    assert job.of_number(number, Kind.CODE, "g", "p").outcome == "does not hold"
    for value in (float("nan"), float("inf")):
        wrong = numbers.Number("n", "words", value, 1.0, 10.0, "reason", "analytic", "a book")
        assert job.of_number(wrong, Kind.CODE, "g", "p").outcome == "does not hold"


def test_studies_are_recorded_with_their_tables():
    claims = list(job.claims_of("stability", "law", True))
    assert claims and all(c.outcome == "holds" and c.rows and c.columns and c.reference for c in claims)


def test_richardson_finds_order_limit_and_uncertainty():
    h = np.array([1.0, 0.5, 0.25])
    order, limit, uncertainty = numbers.richardson(3 + 2 * h**1.5, 2.0)
    assert (order, limit) == pytest.approx((1.5, 3.0)) and uncertainty == pytest.approx(1.25 * 0.25 / 3.25, rel=1e-6)


def test_coefficients_of_the_regular_tetrahedron_hold():
    assert {job.of_number(n, Kind.PUBLISHED, "g", "p").outcome for n in numbers.coefficients(True)} == {"holds"}


def test_bad_arguments_are_errors(capsys, monkeypatch, tmp_path):
    (tmp_path / "no.json").write_text("{}")
    monkeypatch.setattr(sys, "argv", ["validation", "--quick", "--compare", str(tmp_path / "no.json")])
    assert command.main() == 2 and "is not a report of this command" in capsys.readouterr().err
    with pytest.raises(Exception, match="groups = nothing; expected some of"):
        make_report(["nothing"])
    assert catalogue.PARTS is PARTS
