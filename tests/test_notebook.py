"""Tables and progress in notebooks, without a browser or a kernel; and the log."""

import builtins
import logging
import re
import sys
from html.parser import HTMLParser
from types import SimpleNamespace

import matplotlib.figure  # noqa: F401 - results have pictures where it is loaded
import pytest
import skfem

from skfem_stvk import (
    EnergyMomentum,
    LinearBackwardEuler,
    ReducedSystem,
    Scene,
    Simulation,
    StVK,
    System,
    Traction,
    mesh_quality,
    simulate,
    solve_static,
    verify,
)
from skfem_stvk.mesh import box
from skfem_stvk.results import plotting
from skfem_stvk.terminal import CountedProgress, html_table


class Table(HTMLParser):
    """Rows of texts of the tables in HTML. All tags must be closed in order, except those of pictures."""

    def __init__(self, html):
        super().__init__()
        self.rows, self.open, self.pictures = [], [], 0
        self.feed(html)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        if tag == "img":
            self.pictures += dict(attrs)["src"].startswith("data:image/png;base64,iVBOR")
            return
        self.open.append(tag)
        if tag in ("tr", "caption"):
            self.rows.append([])
        if tag in ("th", "td"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1] in ("th", "td"):
            self.rows[-1][-1] += data
        else:
            self.rows[-1].append(data)


def shown(thing):
    """Return the title, the rows by their names, and the number of pictures."""
    table = Table(thing._repr_html_())
    return table.rows[0][0], {row[0]: row[1:] for row in table.rows[1:]}, table.pictures


@pytest.fixture(scope="module")
def bar():
    terms = [StVK(young=1e6, poisson=0.3, density=1e3), Traction("right", (0, 0, -1e3))]
    body = System(box((4.0, 1.0, 1.0), (4, 1, 1)), terms, fixed={"left": "xyz"})
    works(body, quiet=True)  # kernels that are compiled at their first use print notes
    return body


def works(bar, quiet):
    """Do all that prints progress."""
    solve_static(bar, steps=2, quiet=quiet)
    simulate(bar, EnergyMomentum(dt=1e-3), until=3e-3, quiet=quiet)
    ReducedSystem(bar, size=4, modes=2, quiet=quiet)


def test_text_is_escaped():
    hostile = "<script>alert('x')</script> & \"more\""
    html = html_table(hostile, [(hostile, hostile, 1)])
    assert "<script" not in html and "& " not in html
    assert Table(html).rows == [[hostile], [hostile, hostile, "1"]]


def test_a_system_shows_its_elements_terms_and_supports(bar):
    title, rows, _ = shown(bar)
    assert title == "System" and rows["elements"] == [f"{bar.mesh.nt} tetrahedra in 3D"]
    assert rows["degrees of freedom"] == [str(bar.ndofs)]
    assert (
        "young=array(1000000.)" in rows["StVK"][0]
        and "None" not in rows["StVK"][0]
        and "'right'" in rows["Traction"][0]
        and rows["fixed"] == ["{'left': 'xyz'}"]
    )


def test_text_of_the_user_is_escaped_in_a_system():
    mesh = box((1.0, 1.0), (1, 1))
    mesh = mesh.with_boundaries({"<b>left": lambda x: x[0] == 0})
    html = System(mesh, StVK(young=1.0, poisson=0.3), fixed={"<b>left": "xy"})._repr_html_()
    assert "&lt;b&gt;left" in html and "<b>left" not in html


def test_a_static_result_shows_its_outcome_with_a_picture(bar):
    result = solve_static(bar, steps=2, quiet=True)
    title, rows, pictures = shown(result)
    assert title == "StaticResult" and rows["status"] == [str(result.status)] and rows["message"] == [result.message]
    assert rows["load factor"] == ["1"] and rows["states"] == ["2"] and pictures == 1


def test_a_run_shows_its_outcome_with_a_picture(bar):
    run = simulate(bar, EnergyMomentum(dt=1e-3), until=3e-3, quiet=True)
    title, rows, pictures = shown(run)
    assert title == "Run" and rows["status"] == ["finished"] and rows["time [s]"] == ["0.003"] and rows["steps"] == ["3"]
    assert rows["integrator"][0].startswith("EnergyMomentum") and pictures == 1


@pytest.mark.parametrize("name", ["many elements", "no matplotlib"])
def test_there_is_no_picture_where_it_takes_long(bar, monkeypatch, name):
    result = solve_static(bar, steps=1, quiet=True)
    if name == "many elements":
        monkeypatch.setattr(plotting, "MOST_ELEMENTS", bar.mesh.nt - 1)
    else:
        monkeypatch.delitem(sys.modules, "matplotlib")
    assert shown(result)[2] == 0


def test_a_simulation_shows_its_state(bar):
    sim = Simulation(bar, LinearBackwardEuler(dt=1e-3), pushed=["right"])
    sim.step(right=(0, 0, -1.0))
    title, rows, _ = shown(sim)
    assert title == "Simulation" and rows["t"] == ["0.001"] and rows["steps"] == ["1"] and rows["inputs"] == ["right"]
    assert rows["body"] == [repr(bar)]


def test_a_report_shows_failed_checks_first_and_the_fault(bar):
    mesh = skfem.MeshTet().refined(1)
    body = System(mesh, StVK(young=1e5, poisson=0.3))
    wrong = SimpleNamespace(
        energy=lambda u: 2 * body.energy(u),
        internal_force=lambda u: 2 * body.internal_force(u),
        tangent=lambda u: 2 * body.tangent(u),
    )
    report = verify(mesh, young=1e5, poisson=0.3, candidate=wrong, quiet=True)
    table = Table(report._repr_html_())
    assert table.rows[0][0].startswith("NOT PASSED in")
    assert table.rows[1][0] == "fault" and table.rows[1][1:] == report.named.lines()
    head, *rows = table.rows[2:]
    assert head[:4] == ["check", "of", "against", "what"] and len(rows) == len(report.groups())
    failed = ["failed" in row[-1] for row in rows]
    assert failed[0] and failed == sorted(failed, reverse=True)
    assert {(row[0], row[3]) for row, bad in zip(rows, failed, strict=True) if bad} == {
        (r.check, r.quantity) for r in report.failures()
    }
    assert Table(verify(mesh, young=1e5, poisson=0.3, quiet=True)._repr_html_()).rows[0][0].startswith("PASSED in")


def test_the_quality_of_a_mesh_shows_its_worst_elements_and_faults():
    quality = mesh_quality(([[0, 1, 0, 1.0], [0, 0, 1, 1.0]], [[0, 0], [1, 1], [3, 1]]))
    title, rows, _ = shown(quality)
    assert title == "MeshQuality: 2 triangles in 2D" and rows["measure"] == ["worst", "median", "in"]
    worst = quality.worst("largest aspect ratio")
    assert rows["largest aspect ratio"][:2] == [f"{worst.value:.4g}", f"{worst.median:.4g}"]
    assert {text for name, row in rows.items() if name in ("refused", "doubtful") for text in row} <= {
        f.text for f in quality.faults
    }
    assert "refused" in rows


def test_a_scene_shows_its_tables():
    scene = Scene.of_data(
        {
            "title": "<i>bar</i>",
            "mesh": {"type": "box", "size": [4.0, 1.0], "cells": [4, 1]},
            "materials": {"rubber": {"model": "isotropic", "young": 1e6, "poisson": 0.45}},
            "terms": [{"type": "stvk", "material": "rubber"}],
            "fixed": {"left": "xy"},
            "analysis": {"type": "static", "steps": 4},
        }
    )
    _, rows, _ = shown(scene)
    assert rows["title"] == ["<i>bar</i>"] and "<i>" not in scene._repr_html_()
    assert rows["terms"][0].startswith("type = stvk, material = rubber") and rows["fixed"] == ["left = xy"]
    assert "steps = 4" in rows["analysis"][0]


class Display:
    """Output of a cell, with everything that it has shown."""

    def __init__(self):
        self.shown = []

    def __call__(self, thing, display_id):
        assert display_id is True
        self.update(thing)
        return self

    def update(self, thing, raw=False):
        self.shown.append(thing["text/plain"] if raw else thing._repr_mimebundle_([], [])["text/html"])


@pytest.fixture
def cell(monkeypatch):
    """The output of a cell of a notebook, in a process that looks like a kernel."""
    shell = type("ZMQInteractiveShell", (), {})()
    display = Display()
    monkeypatch.setattr(builtins, "get_ipython", lambda: shell, raising=False)
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(display=SimpleNamespace(display=display)))
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=display))
    monkeypatch.setattr("skfem_stvk.terminal.NOTEBOOK_INTERVAL", 0.0)
    return display


def test_a_notebook_shows_a_bar_that_counts_and_is_empty_at_the_end(cell):
    with CountedProgress("verify", 3, quiet=False) as progress:
        for name in ("first", "<second>", "third"):
            progress.step(name)
    assert len(cell.shown) == 5 and cell.shown[-1] == ""
    texts = [re.sub("<[^>]*>", "", html) for html in cell.shown]
    for number, (name, text) in enumerate(zip(("first", "&lt;second&gt;", "third"), texts[1:-1], strict=True), 1):
        assert "verify" in text and f"{number}/3" in text and name in text


def test_a_notebook_shows_analyses_and_their_last_lines(cell, capsys, bar):
    solve_static(bar, steps=2)
    assert any("iteration 0" in html for html in cell.shown) and cell.shown[-1] == ""
    assert len(re.findall("^t .*iterations", capsys.readouterr().out, re.MULTILINE)) == 2
    cell.shown.clear()
    simulate(bar, EnergyMomentum(dt=1e-3), until=3e-3)
    assert len(cell.shown) >= 2 and cell.shown[-1] == "" and "step 3/3" in capsys.readouterr().out


def test_a_quiet_analysis_shows_nothing_in_a_notebook(cell, capsys, bar):
    solve_static(bar, steps=1, quiet=True)
    assert not cell.shown and not capsys.readouterr().out


def test_a_bar_is_emptied_after_an_error(cell):
    with pytest.raises(ZeroDivisionError), CountedProgress("verify", 3, quiet=False):
        raise ZeroDivisionError
    assert cell.shown[-1] == ""


def test_logging_is_silent_by_default(bar, capsys):
    assert not logging.getLogger("skfem_stvk").handlers
    works(bar, quiet=True)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("quiet", [False, True])
def test_the_log_has_all_lines_that_are_printed_also_if_they_are_not(bar, capsys, caplog, quiet):
    with caplog.at_level(logging.INFO, logger="skfem_stvk"):
        works(bar, quiet)
    printed = capsys.readouterr().out.splitlines()
    assert {(record.name, record.levelname) for record in caplog.records} == {("skfem_stvk", "INFO")}
    lines = [line for record in caplog.records for line in record.getMessage().splitlines()]
    expected = ["System", "t ", "t ", "System", "step 3/3", "reduced", "reduced"]
    assert [re.match("System|t |step 3/3|reduced", line)[0] for line in lines] == expected
    assert printed == ([] if quiet else lines)


def test_a_line_with_a_percent_sign_is_logged_as_it_is(caplog, capsys):
    from skfem_stvk.terminal import say

    with caplog.at_level(logging.INFO, logger="skfem_stvk"):
        say("50 %s done %d", quiet=False)
    assert caplog.messages == ["50 %s done %d"] and capsys.readouterr().out == "50 %s done %d\n"
