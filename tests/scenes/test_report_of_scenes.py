"""The report of a scene has plots and pictures in its units and is one self-contained page."""

import re
from collections import namedtuple
from types import SimpleNamespace

import numpy as np
import pytest
import skfem
from matplotlib.image import imread

from skfem_stvk import EnergyMomentum, Gravity, SpringNetwork, StVK, System, Traction, modes, simulate, solve_static
from skfem_stvk.scenes import scene_report as report
from skfem_stvk.scenes.scene_report import write_report

Curve = namedtuple("Curve", "t values dimension")
SummaryRow = namedtuple("SummaryRow", "name value where")
ComparedResult = namedtuple("Judged", "name got expected allowed passed")
STEEL = StVK(young=2.1e5, poisson=0.3, density=7.85e-9)  # in N, mm, t
CLAMPED = {"left": "xyz"}


def beam(d=3):
    ends = [np.linspace(0, 100, 7), *[np.linspace(0, 10, 2)] * (d - 1)]
    return (skfem.MeshTet if d == 3 else skfem.MeshTri).init_tensor(*ends).with_defaults()


@pytest.fixture(scope="module")
def bent():
    """Return the path of a steel cantilever in mm, N and MPa."""
    return solve_static(System(beam(), [STEEL, Traction("right", [0, 0, -1.0])], fixed=CLAMPED, units="mm-N-MPa"), 4, quiet=True)


def outcome_of(result, *, kind, curves=None, judged=(), summary=(), units="mm-N-MPa", title="", **output):
    """Return a stand-in for the outcome of a scene with this result of an analysis."""
    output = {"file": None, "fields": None, "picture": "", "animation": None, "plots": []} | output
    sections = SimpleNamespace(
        title=title,
        units=units,
        terms=[SimpleNamespace(type="stvk", material="steel"), SimpleNamespace(type="traction")],
        fixed=CLAMPED,
        analysis=SimpleNamespace(type=kind),
        output=SimpleNamespace(**output),
        initial=SimpleNamespace(t0=0.0),
    )
    system = result.system
    return SimpleNamespace(
        built=SimpleNamespace(sections=sections, system=system, mesh=system.mesh, u0=None),
        result=result,
        success=True,
        status="converged",
        message="the full load is carried",
        curves=curves or {},
        values={"load": 1.0, "energy.strain": 2.5, "tip.z": -0.125},
        judged=judged,
        summary=summary,
        seconds_by_stage="1.5 s (assemble 1.1 s)",
        ranks="",
        folder=None,
        warnings=(),
        exit_code=0 if all(one.passed for one in judged) else 3,
    )


def tip(result):
    return Curve(result.history.t, result.history.u[:, -3:], "length")


def text_of(figure):
    return [words.get_text() for axes in figure.axes for words in (axes.xaxis.label, axes.yaxis.label)] + [
        words.get_text() for words in figure.texts
    ]


def test_a_report_contains_its_pictures_and_needs_no_other_file(tmp_path, bent):
    outcome = outcome_of(bent, kind="static", curves={"tip": tip(bent)}, plots=["path", "tip"], picture="von_mises_stress")
    page = write_report(tmp_path, outcome).read_text(encoding="utf-8")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["picture.png", "plot-path.png", "plot-tip.png", "report.html"]
    assert page.count("data:image/png;base64,") == 3
    assert not re.search(r"""(src|href)=["'](?!data:)""", page)


def test_pictures_are_not_empty(tmp_path, bent):
    write_report(tmp_path, outcome_of(bent, kind="static", plots=["path"], picture="displacement"))
    drawn = {path.name: (imread(path)[:, :, :3].min(axis=2) < 0.95).mean() for path in tmp_path.glob("*.png")}
    assert len(drawn) == 2 and all(0.01 < part < 0.6 for part in drawn.values()), drawn


def test_labels_have_the_units_of_the_scene(bent):
    outcome = outcome_of(bent, kind="static", curves={"tip": tip(bent)}, picture="von_mises_stress")
    assert "von Mises stress [MPa]" in text_of(report._last_state(outcome))
    assert "displacement of tip [mm]" in text_of(report._curve(outcome, "tip"))
    assert "largest displacement [mm]" in text_of(report._path(outcome))
    assert report._unit_of_result(outcome, "tip.z") == "mm"
    assert report._unit_of_result(outcome, "load") == ""


def test_axes_in_a_plane_and_animations_have_the_unit_of_length(tmp_path):
    system = System(beam(2), [STEEL, Gravity([0, -9810.0])], fixed={"left": "xy"}, units="mm-N-MPa")
    run = simulate(system, EnergyMomentum(dt=1e-3), until=3e-3, save=tmp_path / "a.pvd", every=1, quiet=True)
    outcome = outcome_of(run, kind="dynamic", picture="von_mises_stress", plots=["ledger"], file="a.pvd", animation="a.gif")
    assert "x [mm]" in text_of(report._last_state(outcome))
    assert "time [s]" in text_of(report._ledger(outcome))
    page = write_report(tmp_path, outcome).read_text(encoding="utf-8")
    assert "data:image/gif;base64," in page and (tmp_path / "plot-ledger.png").exists()


def test_small_displacements_are_scaled_and_the_title_has_the_factor(bent):
    outcome = outcome_of(bent, kind="static", picture="von_mises_stress")
    (title,) = (text for text in text_of(report._last_state(outcome)) if "load factor" in text)
    factor = float(title.rpartition("× ")[2])
    largest = np.linalg.norm(bent.u.reshape(-1, 3), axis=1).max()
    assert 0.03 < factor * largest / np.linalg.norm([100, 10, 10]) < 0.09
    assert factor / 10 ** np.floor(np.log10(factor)) in (1.0, 2.0, 5.0)


@pytest.mark.parametrize(("largest", "factor"), [(0.0, 1.0), (0.2, 1.0), (0.03, 2.0), (0.08e-3, 1000.0), (1e-300, 5e298)])
def test_the_factor_is_round_and_large_displacements_are_not_scaled(largest, factor):
    assert report._scale(np.array([[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]]), largest) == pytest.approx(factor)


def test_a_body_without_the_field_is_coloured_by_its_displacements():
    system = System(
        beam(2),
        [SpringNetwork(rule="van-gelder", young=2.1e5, poisson=0.3, density=7.85e-9)],
        fixed={"left": "xy"},
        units="mm-N-MPa",
    )
    run = simulate(system, EnergyMomentum(dt=1e-3), until=2e-3, quiet=True, v0=np.where(system.mesh.p.T.ravel() > 50, 1.0, 0.0))
    texts = text_of(report._last_state(outcome_of(run, kind="dynamic", picture="von_mises_stress")))
    assert "displacement [mm]" in texts and not any("stress" in text for text in texts)


def test_curves_of_a_path_from_rest_begin_at_zero(bent):
    (axes,) = report._curve(outcome_of(bent, kind="static", curves={"tip": tip(bent)}), "tip").axes
    assert [line.get_xydata()[0].tolist() for line in axes.lines[1:]] == [[0.0, 0.0]] * 3
    assert len(axes.lines[1].get_xdata()) == len(bent.history) + 1


def test_results_are_listed_with_their_expected_values(tmp_path, bent):
    judged = (ComparedResult("tip.z", -0.125, -0.12, 1e-3, False), ComparedResult("load", 1.0, 1.0, 0.0, True))
    page = write_report(tmp_path, outcome_of(bent, kind="static", judged=judged)).read_text(encoding="utf-8")
    assert "1 of 2 not as expected" in page
    assert page.count(">not as expected<") == 1 and page.count(">as expected<") == 1


def test_results_precede_pictures_and_provenance_is_last(tmp_path, bent):
    judged = (ComparedResult("load", 1.0, 1.0, 0.0, True),)
    rows = (SummaryRow("largest displacement", "0.12 mm", "node 3 at (100, 0, 0)"),)
    outcome = outcome_of(bent, kind="static", judged=judged, summary=rows, picture="displacement")
    page = write_report(tmp_path, outcome).read_text(encoding="utf-8")
    parts = (
        "largest displacement",
        "node 3 at",
        "Expectations",
        "Results at the end",
        "<img",
        "What was built",
        "Versions and machine",
    )
    order = [page.index(part) for part in parts]
    assert order == sorted(order)
    assert "assemble" in page


def test_a_failing_plot_is_reported_and_the_rest_is_written(tmp_path, bent, monkeypatch):
    monkeypatch.setattr(report, "_path", lambda outcome: 1 / 0)
    outcome = outcome_of(bent, kind="static", plots=["path"], picture="pressure_of_light", file="last.vtu")
    page = write_report(tmp_path, outcome).read_text(encoding="utf-8")
    assert "Load and displacement is not drawn: division by zero" in page
    assert "The last state is not drawn: There is no field" in page
    assert (tmp_path / "last.vtu").exists() and not list(tmp_path.glob("*.png"))


def test_a_last_state_that_cannot_be_written_is_an_error_after_the_report(tmp_path, bent):
    (tmp_path / "last.vtu").mkdir()
    with pytest.raises(Exception, match=r"last\.vtu is a folder"):
        write_report(tmp_path, outcome_of(bent, kind="static", file="last.vtu"))
    assert "last.vtu is not written" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_the_first_elastic_modes_are_drawn_and_all_modes_are_saved(tmp_path):
    found = modes(System(beam(), STEEL), 9)
    write_report(tmp_path, outcome_of(found, kind="modes", picture="von_mises_stress", file="m.pvd"))
    assert sorted(path.name for path in tmp_path.glob("*.png")) == ["picture-6.png", "picture-7.png", "picture-8.png"]
    assert len(list(tmp_path.glob("m_*.vtu"))) == 9


def test_names_of_plots_cannot_leave_the_folder():
    assert list(report.plot_files(["../a/b", "a b", "a/b", "A_B"]).values()) == [
        "plot-.._a_b",
        "plot-a_b",
        "plot-a_b-2",
        "plot-A_B-3",
    ]


def test_texts_of_a_scene_are_escaped_in_the_page(tmp_path, bent):
    page = write_report(tmp_path, outcome_of(bent, kind="static", title="<script>alert(1)</script>")).read_text(encoding="utf-8")
    assert "<script>" not in page and "&lt;script&gt;" in page
