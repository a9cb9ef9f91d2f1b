"""Contents of reports, saved reports, and reports after errors."""

import errno
import json
import os
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from bodies import box

from skfem_stvk import (
    ElementMesh,
    Report,
    StVK,
    StvkError,
    System,
    verify,
)
from skfem_stvk.about import circumstances
from skfem_stvk.referee.results import CheckOutcome, Explanation, Naming, Result, judged

TERM = StVK(young=2.0, poisson=0.3)
QUIET = {"quiet": True}


@pytest.fixture(scope="module")
def report():
    return verify(box(3), TERM, **QUIET)


def test_an_interrupted_speed_check_does_not_pass(monkeypatch):
    from skfem_stvk.referee import verification

    def interrupted(case):
        raise KeyboardInterrupt

    monkeypatch.setattr(verification, "speed_table", interrupted)
    report = verify(box(2), TERM, **QUIET)
    assert report.interrupted and not report.passed and "interrupted" in str(report)


def test_a_hypothesis_explains_an_error_if_the_rest_is_below_the_limit():
    tried = [Explanation(str(error), "", error) for error in (0.0, 1e-8, 2e-8, np.inf, np.nan)]
    naming = Naming()
    assert naming.explain(tried, 1e-8) and naming.names == ["0.0", "1e-08"] and naming.tried == 5
    assert not naming.explain(tried[3:]) and naming.names == ["0.0", "1e-08"] and naming.tried == 7


def test_an_empty_report_has_not_passed():
    assert not Report(header={}).passed


def test_errors_in_the_speed_plot_are_round_off(report):
    errors = report.errors
    assert set(errors) == {"skfem-stvk", "scikit-fem", "|p|^2 - |P|^2"}
    assert 0 < errors["skfem-stvk"]["F"] < 1e-14 < errors["|p|^2 - |P|^2"]["F"] < 1e-11
    assert 0 < errors["skfem-stvk"]["K"] < 1e-14
    assert 0 < errors["scikit-fem"]["W"] < 1e-11


def test_errors_are_small_at_every_strain_and_offset_except_for_the_textbook_form(report):
    rows = report.precision
    error = {(r["form"], r["rotation_deg"], r["offset_m"], r["strain"]): r["error"] for r in rows}
    strains = sorted({r["strain"] for r in rows})
    assert len(strains) == 12 and {r["offset_m"] for r in rows} == {0.0, 1e3, 1e6}
    for offset in (0.0, 1e3, 1e6):
        for strain in strains:
            assert error["skfem-stvk", 0, offset, strain] < 1e-14
            assert error["skfem-stvk", 170, offset, strain] < 1e-14 / strain
    assert error["|p|^2 - |P|^2", 0, 0.0, 1e-8] > 1e-10
    assert error["|p|^2 - |P|^2", 0, 1e6, 1e-8] > 1e-3
    assert error["scikit-fem", 0, 0.0, 1e-8] > 1e-10


def test_speed_has_a_row_for_each_candidate_and_quantity(report):
    rows = report.speed
    assert {(r["player"], r["quantity"]) for r in rows} == {(p, q) for p in ("skfem-stvk", "scikit-fem") for q in "WFK"}
    ns = {(r["player"], r["quantity"]): r["ns_per_element"] for r in rows}
    assert all(r["ratio"] == pytest.approx(ns["scikit-fem", r["quantity"]] / r["ns_per_element"]) for r in rows)
    nnz = System(box(3), TERM).pattern.nnz
    assert all(r["peak_bytes_per_element"] * box(3).nt >= 8 * nnz for r in rows if r["quantity"] == "K")


def test_the_report_is_saved_as_json_and_as_one_html_file(report, tmp_path):
    folder = report.save(tmp_path / "new" / "report")
    saved = json.loads((folder / "report.json").read_text())
    assert saved["passed"] and len(saved["results"]) == len(report.results)
    assert {"versions", "machine", "mesh", "material", "command", "seed"} <= set(saved["header"])
    assert all(r["reason"] for r in saved["results"]), "every limit is explained"
    html = (folder / "report.html").read_text()
    assert html.count("<svg") == 2 and "http://" not in html.replace("http://www.w3.org", "").replace(
        "http://purl.org", ""
    ).replace("http://creativecommons.org", "")
    assert "src=" not in html and "passed" in html


@pytest.mark.parametrize("name", ["report.json", "report.html"])
def test_on_a_full_disk_a_report_is_complete_or_unchanged(name, report, tmp_path, monkeypatch):
    write = Path.write_text
    for old in ("report.json", "report.html"):
        (tmp_path / old).write_text("as it was")

    def full(self, text, **options):
        if name in self.name:
            write(self, text[: len(text) // 2], **options)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self))
        return write(self, text, **options)

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(StvkError, match=f"{name} could not be written: No space left on device.*Free disk space"):
        report.save(tmp_path)
    assert (tmp_path / name).read_text() == "as it was"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["report.html", "report.json"]


def test_a_failed_nan_value_is_valid_json(tmp_path):
    class Nothing:
        def energy(self, u):
            return float("nan")

    report = verify(box(2), TERM, candidate=Nothing(), **QUIET)
    saved = json.loads((report.save(tmp_path) / "report.json").read_text(), parse_constant=lambda name: pytest.fail(name))
    assert "nan" in {r["measured"] for r in saved["results"]}


def test_matplotlib_is_not_imported_without_a_picture():
    import subprocess
    import sys

    code = (
        "import sys, skfem\nfrom skfem_stvk import verify\n"
        "print(verify(skfem.MeshTet().refined(1), young=1.0, poisson=0.3))\nassert 'matplotlib' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


def test_an_error_of_the_energy_is_shown_with_its_speed(monkeypatch):
    right = System.energy
    monkeypatch.setattr(System, "energy", lambda self, u: right(self, u) * (1 + 1e-10))
    assert verify(box(2), TERM, **QUIET).errors["skfem-stvk"]["W"] == pytest.approx(1e-10, rel=1e-3)


def test_the_terminal_gives_the_reasons_of_limits_for_passed_checks_too():
    p, t = (
        np.array([[1, 0, 1e-3], [-1, 0, 1e-3], [0, 1, -1e-3], [0, -1, -1e-3], [0, 0, 2.0]]).T,
        np.array([[0, 1, 2, 3], [0, 1, 2, 4]]).T,
    )
    report = verify((p, t), TERM, **QUIET)
    text = " ".join(str(report).split())
    assert report.passed and "Why these limits agreement (W)" in text and "the flattest element in 50 digits" in text
    assert "1e-12 allows for round-off of another order of summation; 1e-15 is usual; up to" in text
    assert "20 eps x (longest edge + displacement)/smallest height" in text and "1e-13 allows for round-off at any strain" in text


class PageText(HTMLParser):
    """Text of a page as a browser shows it, without its style and pictures."""

    def __init__(self, page):
        super().__init__()
        self.parts, self.hidden = [], 0
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.hidden += tag in ("style", "svg")
        self.parts += [" "] if tag in ("td", "br") else []

    def handle_endtag(self, tag):
        self.hidden -= tag in ("style", "svg")

    def handle_data(self, data):
        self.parts += [] if self.hidden else [data]

    def __str__(self):
        return " ".join("".join(self.parts).split())


def test_a_page_begins_with_failed_checks_then_the_fault_and_ends_with_provenance(tmp_path):
    mesh = ElementMesh(box(2).p, box(2).t, subdomains={"left": [0, 1]})
    report = verify(mesh, TERM, candidate=System(mesh, StVK(young=2.0 * TERM.material.young, poisson=0.2)), **QUIET)
    report.results.append(Result("patch test", "a cable", "F", "rest", CheckOutcome.NOT_APPLICABLE))
    text = str(PageText((report.save(tmp_path) / "report.html").read_text()))
    order = [text.index(heading) for heading in HEADINGS]
    assert order == sorted(order)
    failed, fault, passed, others, provenance = (text[a:b] for a, b in zip(order, [*order[1:], len(text)], strict=True))
    assert "agreement" in failed and "> 1e-12 of" in failed and "where 0.3 was claimed" in fault
    assert "of 8 passed" in passed and "failed" not in passed
    assert "patch test, F of a cable: not applicable" in others and "0 of" not in others
    assert "mesh: edges shortest 0." in provenance and "mesh: subdomains left 2" in provenance
    assert "mesh: boundaries none" in provenance and "numpy " in provenance
    assert not re.search(r"[{}]|\['", text)
    assert re.search(r"\d failed, 1 not applicable in \d+\.\d s", text)


HEADINGS = (
    "Checks that failed or could not run",
    "The fault",
    "Checks that passed",
    "Checks that do not apply",
    "What was judged, where and with what",
)


def test_a_report_without_a_mesh_shows_its_lines(tmp_path):
    report = Report(header=circumstances(["numpy"]) | {"lines": ["a law of [mine]", "at three states"]})
    report.results.append(judged(1e-15, 1e-12, check="objectivity", subject="law", quantity="W", state="generic"))
    assert report.passed and str(report).startswith("a law of [mine]\nat three states\n") and "Precision" not in str(report)
    page = (report.save(tmp_path) / "report.html").read_text()
    assert "<td>a law of [mine]</td>" in page and "<svg" not in page
    assert json.loads((tmp_path / "report.json").read_text())["header"]["lines"][1] == "at three states"
