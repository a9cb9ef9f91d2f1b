"""The command `skfem-stvk`: exit codes, messages and output files of `verify`, `info` and `bench`."""

import io
import json
import os
import re
import shlex
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import meshio
import numpy as np
import pytest
import skfem
from bodies import box
from rich.console import Console
from slow import slow

from skfem_stvk import StVK, System, verify
from skfem_stvk.kernels.compiled import cache_folder
from skfem_stvk.referee import verification
from skfem_stvk.referee.checks import agreement, precision
from skfem_stvk.referee.report import rendered
from skfem_stvk.referee.results import CheckOutcome
from skfem_stvk.scenes.commands.main import main
from skfem_stvk.scenes.commands.scenes import OPTIONAL

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

MATERIAL = ["--young", "70e9", "--poisson", "0.33"]


def saved(path, p, t, cells="tetra", **data):
    meshio.Mesh(np.asarray(p, dtype=float).T, [(cells, np.asarray(t).T)], **data).write(path)
    return str(path)


def test_without_a_mesh_file_the_embedded_mesh_is_verified(capsys):
    assert main(["verify"]) == 0
    out = capsys.readouterr().out
    assert "embedded bracket" in out and "PASSED" in out and "NOT PASSED" not in out


def test_a_mesh_file_is_verified_and_reported(tmp_path, capsys):
    mesh = saved(tmp_path / "part.vtu", box(3).p, box(3).t)
    assert main(["verify", mesh, *MATERIAL, "--out", str(tmp_path / "a" / "report")]) == 0
    report = json.loads((tmp_path / "a" / "report" / "report.json").read_text())
    assert report["passed"] and report["header"]["mesh"]["source"] == mesh
    assert (tmp_path / "a" / "report" / "report.html").stat().st_size > 10_000


@pytest.mark.slow
def test_a_curved_c3d10_file_is_verified_with_quadratic_tetrahedra(tmp_path, capsys):
    mesh = box(1).with_degree(2)
    p = mesh.p.copy()
    p[:, 8:] += 0.03 * np.random.default_rng(0).standard_normal(p[:, 8:].shape)
    file = saved(tmp_path / "part.inp", p, mesh.t, "tetra10")
    assert "C3D10" in (tmp_path / "part.inp").read_text().upper()
    assert main(["verify", file, *MATERIAL]) == main(["verify", file, *MATERIAL, "--degree", "2", "--quadrature", "exact"]) == 0
    first, second = (" ".join(part.split()) for part in capsys.readouterr().out.split("PASSED")[:2])
    assert "6 quadratic tetrahedra in 3D, 6 of them curved, 27 nodes" in first and "integrated by 4 points of order 2" in first
    assert "integrated by 14 points of order 5" in second


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--degree", "3"], "degree = 3; expected 1 or 2, the degree of the shape functions of simplices"),
        (["--quadrature", "nodes"], "quadrature = 'nodes'"),
        (["--hourglass", "0.1"], "expected None without quadrature"),
    ],
)
def test_a_wrong_element_is_exit_code_two(options, words, tmp_path, capsys):
    assert main(["verify", saved(tmp_path / "part.vtu", box(1).p, box(1).t), *MATERIAL, *options]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


def test_nodes_on_no_element_are_dropped_with_a_message(tmp_path, capsys):
    mesh = box(2)
    p = np.concatenate([mesh.p, [[9.0], [9.0], [9.0]]], axis=1)
    assert main(["verify", saved(tmp_path / "part.vtu", p, mesh.t), *MATERIAL]) == 0
    assert "1 vertex (27)" in capsys.readouterr().err.replace("\n", " ")


def test_a_check_that_fails_is_exit_code_one(tmp_path, capsys, monkeypatch):
    right = System.internal_force
    monkeypatch.setattr(System, "internal_force", lambda self, u: right(self, u) * (1 + 1e-11))
    mesh = saved(tmp_path / "box.vtu", box(2).p, box(2).t)
    assert main(["verify", mesh, *MATERIAL]) == 1
    assert "NOT PASSED" in capsys.readouterr().out


BOX = box(2)
NAN = np.where(np.arange(BOX.nv) == 5, np.nan, BOX.p)
REPEATED = BOX.t.copy()
REPEATED[1, 3] = REPEATED[0, 3]
FLAT = BOX.p * np.array([[1.0], [1.0], [0.0]])
DOUBLE = np.concatenate([BOX.t, BOX.t[[2, 0, 1, 3], 4:6]], axis=1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (lambda f: [saved(f / "m.vtu", NAN, BOX.t), *MATERIAL], r"1 vertex \(5\) with coordinates that are not finite"),
        (lambda f: [saved(f / "m.vtu", BOX.p, REPEATED), *MATERIAL], r"1 element \(3\): the same vertex twice"),
        (lambda f: [saved(f / "m.vtu", FLAT, BOX.t), *MATERIAL], r"48 elements \(0, 1, 2, 3, 4, ...\): no volume"),
        (
            lambda f: [saved(f / "m.vtu", BOX.p, DOUBLE), *MATERIAL],
            r"2 elements \(48, 49\): the same vertices as an earlier element",
        ),
        (lambda f: [saved(f / "m.vtu", BOX.p, BOX.t)], "A mesh needs a material: add --young"),
        (lambda f: [saved(f / "m.vtu", BOX.p, BOX.t), "--young", "70e9"], "poisson = None; expected a number"),
        (lambda f: [saved(f / "m.vtu", BOX.p, BOX.t), "--poisson", "0.3"], "A material is missing"),
        (lambda f: [saved(f / "m.vtu", BOX.p, BOX.t), "--young", "70e9", "--poisson", "0.5"], "poisson .*; expected values in"),
        (lambda f: [saved(f / "m.vtu", BOX.p, BOX.t), "--young", "nan", "--poisson", "0.3"], "young = nan; expected finite values"),
        (lambda f: [saved(f / "m.vtu", BOX.p, BOX.t), "--young", "-1", "--poisson", "0.3"], "young = -1.; expected values in"),
        (lambda f: [str(f / "nothing.msh"), *MATERIAL], "nothing.msh does not exist"),
        (lambda f: ["", *MATERIAL], "expected the path of a mesh file"),
        (
            lambda f: [saved(f / "m.vtu", box(2).p, box(2).t[[0, 1, 2, 3, 0, 1, 2, 3]], "hexahedron"), *MATERIAL],
            "the same vertex twice",
        ),
    ],
)
def test_broken_input_is_an_error_and_nothing_is_written(arguments, message, tmp_path, capsys):
    out = tmp_path / "report"
    assert main(["verify", *arguments(tmp_path), "--out", str(out)]) == 2
    err = " ".join(capsys.readouterr().err.split())
    assert err.startswith("error ") and re.search(message, err), err
    assert not out.exists()


def test_duplicate_nodes_and_parts_are_notes(tmp_path, capsys):
    """Two blocks with coincident faces and separate nodes give notes on duplicate nodes and on two parts."""
    block = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 3)] * 3)
    p, t = np.concatenate([block.p, block.p + np.array([[1.0], [0], [0]])], axis=1), np.concatenate([block.t, block.t + 27], axis=1)
    assert main(["verify", saved(tmp_path / "m.vtu", p, t), *MATERIAL]) == 0
    err = " ".join(capsys.readouterr().err.split())
    assert "9 vertices" in err and "at the same point" in err and "2 parts that are not connected (27, 27 vertices)" in err


@pytest.mark.parametrize("make", [lambda f: f / "file" / "report", lambda f: f / "file"])
def test_a_folder_that_cannot_be_created_is_an_error_before_the_run(make, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["verify", "--out", str(make(tmp_path))]) == 2
    captured = capsys.readouterr()
    assert "is a file; expected a folder" in " ".join(captured.err.split()) and not captured.out


def test_ctrl_c_retains_the_results_of_finished_checks(monkeypatch):

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(agreement, "_lines", interrupted)
    report = verify(box(2), StVK(young=1.0, poisson=0.3), quiet=True)
    assert not report.passed
    assert report.counts[CheckOutcome.PASSED] == 2 * 24  # checks of simplices, and of edges and their pairs
    assert {r.reason for r in report.results if r.outcome is CheckOutcome.COULD_NOT_RUN} == {"interrupted"}


def test_info_prints_versions_threads_caches_and_every_optional_package_or_its_install_command(capsys, monkeypatch):
    monkeypatch.setattr("skfem_stvk.about.version", lambda package: without_pyvista(package))
    assert main(["info"]) == 0
    out = capsys.readouterr().out
    lines = {line[:16].strip(): line[18:] for line in out.splitlines()}
    assert {"python", "skfem-stvk", "scikit-fem", "processor", "cores", "kernels run on", *OPTIONAL} <= set(lines)
    assert lines["pyvista"] == "not installed: pip install 'skfem-stvk[plot]'" and lines["numpy"] == np.__version__
    assert f"{cache_folder()} (" in lines["kernels kept in"] or "NUMBA_CACHE_DIR" in lines["kernels kept in"]


def without_pyvista(package):
    if package == "pyvista":
        raise PackageNotFoundError(package)
    return version(package)


def project():
    """Return the table `project` of pyproject.toml."""
    return tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]


def test_every_extra_of_the_package_is_among_the_optional_packages_of_info():
    extras = project()["optional-dependencies"]
    names = {
        re.split("[><=;]", line)[0].strip()
        for extra, lines in extras.items()
        if extra not in ("test", "docs", "browser")
        for line in lines
    }
    assert names <= set(OPTIONAL)


def test_every_required_package_has_its_reason_and_there_are_at_most_13():
    required = [re.split("[><=;]", line)[0].strip() for line in project()["dependencies"]]
    table = (
        (Path(__file__).parents[2] / "CONTRIBUTING.md")
        .read_text()
        .partition("**Required dependencies**")[2]
        .partition("**Tests")[0]
    )
    reasons = re.findall(r"^\| (?!package)(\S+) \| [^|]{6,} \|$", table, re.MULTILINE)
    assert sorted(reasons) == sorted(required) and len(required) <= 13


def entry_point(*arguments, **environment):
    """Run the entry point of the installed command in a process."""
    module, function = project()["scripts"]["skfem-stvk"].split(":")
    return subprocess.run(
        [sys.executable, "-c", f"import sys; from {module} import {function}; sys.exit({function}())", *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )


def test_the_command_is_installed():
    module = subprocess.run([sys.executable, "-m", "skfem_stvk.scenes.commands", "--help"], capture_output=True, text=True)
    for done in (entry_point("--help"), module):
        assert done.returncode == 0 and "verify" in done.stdout and "info" in done.stdout


@pytest.mark.few(2)
@pytest.mark.parametrize("package", ["rich", "numpy", "scipy", "skfem", "numba", "pydantic"])
def test_ctrl_c_while_a_package_is_imported_is_one_line(package, tmp_path):
    (tmp_path / f"{package}.py").write_text("raise KeyboardInterrupt\n")
    done = entry_point("info", PYTHONPATH=str(tmp_path))
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")


def test_an_empty_folder_name_is_an_error(capsys):
    assert main(["verify", "--out", ""]) == 2
    assert "--out = ''; expected the path of a folder" in capsys.readouterr().err


def test_a_report_that_cannot_be_written_is_printed_first(tmp_path, capsys):
    (tmp_path / "report.json").mkdir()
    assert main(["verify", "--out", str(tmp_path)]) == 2
    captured = capsys.readouterr()
    assert "PASSED" in captured.out and "report.json" in captured.err


def test_file_names_that_are_not_utf_8_are_accepted(tmp_path, capsys):
    name = str(tmp_path / "b\udce9.vtu")
    saved(name, box(2).p, box(2).t)
    assert main(["verify", name, *MATERIAL, "--out", str(tmp_path / "report")]) == 0
    assert "b" in (tmp_path / "report" / "report.html").read_text()


def test_a_narrow_terminal_gets_fewer_columns_and_whole_words():
    report = verify(box(2), StVK(young=1.0, poisson=0.3), quiet=True)
    buffer = io.StringIO()
    Console(file=buffer, width=80).print(rendered(report, 80))
    text = buffer.getvalue()
    assert max(map(len, text.splitlines())) <= 80
    assert "no further zero mode" in text and "skfem-stvk" in text and "scikit-fem" in text
    head = next(line for line in text.splitlines() if line.split()[:2] == ["check", "of"])
    assert "error" in head and "against" not in head


@pytest.mark.parametrize("call", [slow(1), 3, slow(20), 70])
@pytest.mark.parametrize("kind", [KeyboardInterrupt, ValueError])
def test_an_error_in_the_check_of_precision_retains_the_other_results(call, kind, monkeypatch, tmp_path):
    calls = iter(range(1, 10**6))
    right = precision.ExactStVK.internal_force

    def stopped(*arguments):
        if next(calls) == call:
            raise kind("stop")
        return right(*arguments)

    monkeypatch.setattr(precision.ExactStVK, "internal_force", stopped)
    report = verify(box(2), StVK(young=1.0, poisson=0.3), quiet=True)
    assert not report.passed and "PASSED" in str(report)
    assert (report.save(tmp_path) / "report.html").exists()
    results = [r for r in report.results if r.check == "precision"]
    assert results[0].outcome is CheckOutcome.COULD_NOT_RUN and len(results) == 2
    assert "a line cannot rotate" not in {r.reason for r in results}


def test_a_failing_measurement_of_speed_fails_the_report_and_retains_the_other_results(monkeypatch):
    monkeypatch.setattr(verification, "speed_table", lambda case: 1 / 0)
    report = verify(box(2), StVK(young=1.0, poisson=0.3), quiet=True)
    assert not report.passed and "could not run speed" in " ".join(str(report).split()) and len(report.results) > 80


@pytest.mark.parametrize("options", [[], ["--quick"], ["--quick", "--out", "new docs"]])
def test_bench_prints_the_command_of_the_benchmark_without_measuring(options, capsys):
    assert main(["bench", *options]) == 2
    assert shlex.split(capsys.readouterr().out) == ["python", "-m", "validation", "bench", *options]


def command(*arguments, flags=(), **environment):
    return subprocess.run(
        [sys.executable, *flags, "-m", "skfem_stvk.scenes.commands", *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )


def test_an_unknown_backend_of_matplotlib_loses_the_pictures_but_not_the_table(tmp_path):
    mesh = saved(tmp_path / "m.vtu", box(1).p, box(1).t)
    done = command("verify", mesh, *MATERIAL, "--out", str(tmp_path / "report"), MPLBACKEND="nonsense")
    assert done.returncode == 2 and "PASSED" in done.stdout
    assert "Traceback" not in done.stderr and "MPLBACKEND = 'nonsense'; 'agg' always works" in " ".join(done.stderr.split())
    assert json.loads((tmp_path / "report" / "report.json").read_text())["passed"]


@pytest.mark.slow
def test_verify_runs_without_docstrings_and_asserts(tmp_path):
    mesh = saved(tmp_path / "m.vtu", box(1).p, box(1).t)
    done = command("verify", mesh, *MATERIAL, "--out", str(tmp_path / "report"), flags=["-OO"])
    assert done.returncode == 0, done.stderr
    assert "PASSED" in done.stdout and (tmp_path / "report" / "report.html").exists()


def test_names_cannot_control_the_terminal(tmp_path, capsys):
    name = str(tmp_path / "a\x1b[2J\r\u202e[bold]b.vtu")
    saved(name, box(1).p, box(1).t)
    assert main(["verify", name, *MATERIAL]) == 0
    missing = main(["verify", name + "\x07", *MATERIAL])
    captured = capsys.readouterr()
    assert missing == 2 and "\\x1b[2J\\r\\u202e[bold]b.vtu" in captured.out and "b.vtu\\x07" in captured.err
    assert not set("\x1b\r\x07\u202e") & set(captured.out + captured.err)
