"""Runs on tiny meshes: measured, missing and retained results. No test asserts a time."""

import json
import re
import sys
from dataclasses import replace

import numpy as np
import pytest

from skfem_stvk import StvkError, System
from skfem_stvk.referee.peers import PEERS, Package
from skfem_stvk.terminal import as_text
from validation.bench import Plan, bench, contenders, control, costs, run
from validation.bench.contenders import our_calls
from validation.bench.control import compiler
from validation.bench.costs import best_and_median, copy_bandwidth, least_bytes, most_threads, threads
from validation.bench.meshes import Specimen
from validation.bench.page import page, rendered, save
from validation.bench.results import CONTROL, CSR, OURS, QUANTITIES, REFERENCE, TEXTBOOK
from validation.bench.tables import tables

PLAN = Plan("quick", boxes=(50, 400), parts=(), judged=(400,), referenced=(400,), seconds=0.0)


@pytest.fixture(scope="module", autouse=True)
def small_copies():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "copy_bandwidth", lambda: copy_bandwidth(2**20))
        yield


@pytest.fixture(scope="module")
def results():
    return bench(PLAN, quiet=True)


def test_everything_is_measured_on_every_mesh(results):
    assert not results.failures and not results.interrupted
    assert list(results.meshes) == ["box 50", "box 400"]
    for mesh in results.meshes:
        for dtype in ("float64", "float32"):
            for count in range(1, min(2, most_threads()) + 1):
                for quantity in QUANTITIES:
                    timing = results.timing(mesh, OURS, quantity, count, dtype)
                    assert timing.repetitions >= 5 and 0 < timing.best <= timing.median
            assert results.best(mesh, CSR, "K v", dtype=dtype)
    assert results.bandwidth > 0


def test_the_reference_and_the_textbook_form_are_timed_where_the_plan_says(results):
    assert {t.mesh for t in results.timings if t.implementation in (REFERENCE, TEXTBOOK)} == {"box 400"}
    assert results.best("box 400", REFERENCE, "W", "F", "K") and results.best("box 400", TEXTBOOK, "F", dtype="float32")


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_the_c_loop_is_timed(results):
    assert CONTROL not in results.not_measured and results.best("box 400", CONTROL, "W", "F", "K")


def test_setup_and_memory_are_measured(results):
    assert results.timing("box 400", OURS, "setup of K").repetitions == 3
    stored = {(m.quantity, m.dtype): m for m in results.memory if m.mesh == "box 400"}
    assert len(stored) == 6
    assert stored["F", "float64"].without_pattern < stored["F and K", "float64"].without_pattern
    assert stored["F", "float32"].without_pattern < stored["F", "float64"].without_pattern
    assert stored["F", "float64"].parts["pattern of K"] == 0 < stored["F and K", "float64"].parts["pattern of K"]


def test_errors_match_the_precision_and_the_textbook_form_loses_digits(results):
    errors = {(e.implementation, e.dtype, e.quantity, e.strain): e.error for e in results.errors}
    assert errors[OURS, "float64", "F", 1e-6] < 1e-14 < errors[REFERENCE, "float64", "F", 1e-6]
    assert errors[OURS, "float32", "F", 1e-6] < 1e-5 < errors[TEXTBOOK, "float32", "F", 1e-6]
    assert errors[OURS, "float64", "K", 1e-3] < 1e-14 and errors[OURS, "float32", "K", 1e-3] < 1e-5


def test_half_of_the_elements_have_negative_orientation():
    x = Specimen("box", 400).mesh
    edges = np.moveaxis(x.p[:, x.t[1:]] - x.p[:, x.t[:1]], 2, 0)
    assert abs((np.linalg.det(edges) < 0).mean() - 0.5) < 0.1


def test_the_least_bytes_are_those_of_the_arrays():
    case = Specimen("box", 400)
    body = System(case.mesh, case.term)
    with threads(1):
        _, K = our_calls(body, case.u, case.v)
    least, edges = (
        least_bytes(body, K),
        len(set(map(tuple, np.sort(case.mesh.t[[[0, 0, 0, 1, 1, 2], [1, 2, 3, 2, 3, 3]]], axis=0).reshape(2, -1).T))),
    )
    assert least["K v"] == (72 + 8) * edges + 2 * 8 * body.ndofs
    assert least["CSR product"] == 12 * K.nnz + 4 * (body.ndofs + 1) + 16 * body.ndofs
    assert 16 + 56 < least["F"] / case.mesh.nt < least["K"] / case.mesh.nt


def test_each_turn_of_a_call_has_five_timed_calls_after_one_untimed_call():
    order = []
    taken = best_and_median({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, seconds=0.0)
    assert "".join(order) == "a" * 6 + "b" * 6
    assert all(seconds.repetitions == 5 and seconds.best <= seconds.median for seconds in taken.values())


def test_the_number_of_threads_is_restored():
    import numba

    before = numba.get_num_threads()
    with threads(1):
        assert numba.get_num_threads() == 1
    assert numba.get_num_threads() == before


def test_missing_peers_are_listed_with_their_install_command(monkeypatch):
    for name, package in PEERS.items():
        monkeypatch.setitem(PEERS, name, Package(package.module, "no-such-distribution", package.install))
    found = bench(replace(PLAN, boxes=(50,), peers={"FElupe": ("box 50",)}), quiet=True)
    assert not found.failures
    assert all(re.search("not installed: (pip|conda) install", found.not_measured[name]) for name in PEERS)
    assert "pip install felupe" in as_text(rendered(found))


def test_peers_that_the_plan_leaves_out_are_left_to_the_full_run(monkeypatch):
    monkeypatch.setattr(Package, "version", lambda self: "99.0")
    assert bench(replace(PLAN, boxes=()), quiet=True).not_measured["NGSolve"] == "left to the full run"


def test_an_installed_peer_is_timed():
    pytest.importorskip("felupe")
    found = bench(replace(PLAN, boxes=(50,), peers={"FElupe": ("box 50",)}), quiet=True)
    assert found.best("box 50", "FElupe", "W", "F", "K")
    assert ("FElupe", "K") in {(e.implementation, e.quantity) for e in found.errors}


def test_a_peer_that_breaks_is_a_failure_and_the_rest_is_measured(monkeypatch):
    monkeypatch.setattr(Package, "version", lambda self: "99.0")
    monkeypatch.setattr(contenders, "load", lambda name: 1 / 0)
    found = bench(replace(PLAN, boxes=(50,), peers={"FElupe": ("box 50",)}), quiet=True)
    assert "ZeroDivisionError" in found.failures["box 50: FElupe"] and found.best("box 50", OURS, "K")
    assert "failed: ZeroDivisionError" in as_text(rendered(found))


def test_without_a_compiler_the_c_loop_is_not_measured(monkeypatch):
    monkeypatch.setattr(control, "compiler", lambda: None)
    control._library.cache_clear()
    try:
        found = bench(replace(PLAN, boxes=(50,)), quiet=True)
    finally:
        control._library.cache_clear()
    assert "No C compiler" in found.not_measured[CONTROL] and not found.failures


def test_without_gmsh_parts_are_not_measured(monkeypatch):
    monkeypatch.setitem(sys.modules, "gmsh", None)
    assert "pip install gmsh" in bench(replace(PLAN, boxes=(), parts=(5_000,)), quiet=True).not_measured["part 5 k"]


def test_a_part_of_an_unknown_size_is_an_error():
    with pytest.raises(StvkError, match="size = 7; expected one of the sizes of parts: 5000, 40000, 250000"):
        Specimen("part", 7).mesh  # noqa: B018


def test_ctrl_c_retains_the_results_of_finished_steps(monkeypatch, tmp_path):
    def interrupted(results, case):
        raise KeyboardInterrupt

    monkeypatch.setitem(run.STEPS, "memory", interrupted)
    found = bench(PLAN, quiet=True)
    assert found.interrupted and found.best("box 50", OURS, "setup of K") and not found.memory
    assert "interrupted" in as_text(rendered(found)) and "**Interrupted**" in page(found)
    save(found, tmp_path)
    assert (tmp_path / "benchmark-size.png").exists()


def test_a_step_that_fails_leaves_the_others(monkeypatch):
    monkeypatch.setitem(run.STEPS, "setup", lambda results, case: 1 / 0)
    found = bench(replace(PLAN, boxes=(50,)), quiet=True)
    assert found.failures == {"box 50: setup": "ZeroDivisionError: division by zero"} and found.memory


def test_a_failing_first_use_is_reported(monkeypatch):
    monkeypatch.setattr(costs, "FIRST_USE", "raise SystemExit('no such thing')")
    found = bench(replace(PLAN, boxes=(), first_use=True), quiet=True)
    assert "no such thing" in found.failures["first use"] and found.first_use is None
    monkeypatch.setattr(costs, "FIRST_USE", "print(1.5)")
    assert costs.first_use() == 1.5


def test_the_tables_name_all_that_was_measured(results):
    text = as_text(rendered(results))
    words = ("Targets", "This package", "Threads and precision", "Growth", "Setup", "Memory by part", "Errors", "Not measured")
    assert all(word in text for word in (*words, "W + F, in CSR products", "x memory limit", "scikit-fem", "pattern of K"))
    assert all(len(row) == len(table.columns) for table in tables(results) for row in table.rows)
    assert max(map(len, text.splitlines())) <= 132


def test_a_run_without_measurements_still_has_tables():
    assert "quick run" in as_text(rendered(bench(replace(PLAN, boxes=()), quiet=True)))


def test_the_page_its_pictures_and_the_numbers_are_written(results, tmp_path):
    save(results, tmp_path / "a" / "docs")
    names = {path.name for path in (tmp_path / "a" / "docs").iterdir()}
    assert names == {"benchmark.json", "benchmark.md", "benchmark-speed-error.png", "benchmark-size.png"}
    text = (tmp_path / "a" / "docs" / "benchmark.md").read_text()
    assert (
        set(re.findall(r"\((benchmark\S*)\)", text)) <= names
        and "python -m validation bench --quick --out docs/measurements" in text
    )
    numbers = json.loads((tmp_path / "a" / "docs" / "benchmark.json").read_text())
    assert len(numbers["timings"]) == len(results.timings) and numbers["plan"]["name"] == "quick"
