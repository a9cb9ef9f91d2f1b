"""The study of mutants: draws are reproducible, a planted fault is caught, and a run that was stopped goes on."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from validation.protection import FIRST, NONE, OPEN, SLOW, TABLE, Study, report
from validation.protection.copies import Copy
from validation.protection.mutants import KINDS, Finder, drawn, kernels_with, rooms

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
#: A package with one room and one mutant of each kind, and its tests.
MODULE = '''
def mean(values: list = [1, 2], weight=3):
    """Return 1 + 2 of them."""
    return sum(values) / len(values)

def tripled(x):
    return 3 * x

def last(values):
    if not values:
        raise ValueError(f"{1 + 2}")
    return values.pop()

def first(values):
    return values[0]

def less(a, b):
    return a - b

def difference(a, b):
    return less(a, b)

def never(a):
    return -a
'''
TESTS = """
import pytest
from skfem_stvk.room.module import difference, first, last, mean, tripled

def test_the_mean_is_between():
    assert mean([1, 3]) == 2

def test_tripled():
    assert tripled(2) == 6

@pytest.mark.slow
def test_an_empty_list_is_refused():
    with pytest.raises(ValueError):
        last([])

def test_the_last_one():
    assert last([1, 2, 3]) == 3 and first([1, 2]) == 1
"""
MORE_TESTS = """
from skfem_stvk.room.module import difference, tripled

def test_no_difference():
    assert difference(2, 2) == 0

def test_nothing():
    assert tripled(0) == 0

def test_six():
    assert tripled(2) == 6
"""
SETTINGS = '[tool.pytest.ini_options]\naddopts = "-m \'not slow\'"\nmarkers = ["slow: slow"]\n'
FILES = {
    "skfem_stvk/pytest_plugin.py": "",  # pytest loads the plugin of the installed package by this name
    "skfem_stvk/__init__.py": "",
    "skfem_stvk/room/__init__.py": "",
    "skfem_stvk/room/module.py": MODULE,
    "tests/room/test_module.py": TESTS,
    "tests/test_more.py": MORE_TESTS,
    "pyproject.toml": SETTINGS,
}


@pytest.fixture
def toy(tmp_path):
    """Return a function that makes the study of a small package."""
    for name, text in FILES.items():
        path = tmp_path / "toy" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return lambda: Study(tmp_path / "toy", tmp_path / "work", tmp_path / "mutants.toml", 1)


def test_candidates_are_code_that_runs(toy):
    found = Finder("room", "module.py", MODULE.encode()).found
    assert [(one.kind, one.line, one.lines(MODULE.encode())[1]) for one in found] == [
        ("operator", 4, "return sum(values) * len(values)"),
        ("operator", 7, "return 3 / x"),
        ("sign", 7, "return -3 * x"),
        ("constant", 7, "return 4 * x"),
        ("line", 11, "pass"),
        ("index", 15, "return values[1]"),
        ("operator", 18, "return a + b"),
        ("swap", 21, "return less(b, a)"),
        ("sign", 24, "return a"),
    ]


def test_a_draw_has_one_mutant_of_each_kind_for_each_room_and_a_seed_repeats_it(toy):
    one, again, other = (drawn(toy().root, seed) for seed in (1, 1, 2))
    assert one == again != other
    of_package = drawn(ROOT)
    assert len(of_package) >= 60 and len({one.name for one in of_package}) == len(of_package)
    assert {one.kind for one in of_package} == set(KINDS)


def test_a_kernel_contains_pieces_and_the_formulas_of_types():
    """The stiffness of a law is chosen by type, and the product of a matrix with base vectors is a piece of it."""
    pieces = [one for path in rooms(ROOT)["kernels"] for one in Finder("kernels", path.name, path.read_bytes()).found]
    for function in ("_isotropic_stiffness", "on_base_vectors"):
        assert "linearize" in kernels_with(next(one for one in pieces if one.function == function), ROOT)


def test_the_table_has_the_drawn_mutants():
    """`python -m validation protection` judges those whose code has changed."""
    table = {row["name"] for row in tomllib.loads(TABLE.read_text(encoding="utf-8"))["mutant"]}
    assert table == {one.name for one in drawn(ROOT)}


def test_the_tests_in_the_table_exist():
    rows = tomllib.loads(TABLE.read_text(encoding="utf-8"))["mutant"]
    tests = [row[key].partition("[")[0] for row in rows for key in ("test", "also") if row.get(key, NONE) != NONE]
    missing = [
        test
        for test in tests
        if test.startswith("tests/") and f"def {test.split('::')[-1]}(" not in (ROOT / test.split("::")[0]).read_text()
    ]
    assert len(tests) > 40 and not missing


def test_a_stopped_run_goes_on(toy, monkeypatch):
    """Judged mutants stay, the run with probes is not repeated, and faults that no test sees remain open."""
    first = toy()
    monkeypatch.setattr(first, "_all_tests", lambda copy, names: None)
    first.judge(["room/index", "room/sign"])
    assert first.verdicts["room/index"].test == "tests/room/test_module.py::test_the_last_one"
    assert {name: one.tier for name, one in first.verdicts.items() if one.tier} == {"room/index": FIRST, "room/sign": OPEN}
    second = toy()
    assert second.verdicts == first.verdicts
    monkeypatch.setattr(second, "_all_tests", lambda copy, names: None)
    monkeypatch.setattr(Copy, "run", lambda *arguments, **named: pytest.fail("nothing is left to do"))
    monkeypatch.setattr(Copy, "_share_machine_code", lambda copy, root: None)
    second.judge(["room/index", "room/sign"])


@pytest.mark.slow
def test_each_fault_is_judged_by_all_tests(toy, capsys):
    study = toy()
    study.judge(study.mutants)
    tiers = {name.partition("/")[2]: (one.tier, one.test.partition("::")[2], one.also) for name, one in study.verdicts.items()}
    assert tiers == {
        "constant": (FIRST, "test_tripled", "tests/test_more.py::test_six"),
        "index": (FIRST, "test_the_last_one", NONE),
        "line": (SLOW, "test_an_empty_list_is_refused", NONE),
        "operator": (FIRST, "test_no_difference", NONE),
        "sign": (NONE, "", ""),
        "swap": (NONE, "", ""),
    }
    assert not report(study.verdicts.values(), Console(width=132))
    out = capsys.readouterr().out
    assert "catches 75.0% of the mutants" in out and "tests/room/test_module.py (2), tests/test_more.py (1)" in out
    again = toy()
    again.verdicts = {name: replace(one, tier="") for name, one in again.verdicts.items()}
    again.judge(again.mutants)
    assert again.verdicts == study.verdicts
