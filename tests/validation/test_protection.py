"""The study of mutants: draws are reproducible, a planted fault is caught, and a run that was stopped goes on."""

from pathlib import Path

import pytest

from validation.protection import FIRST, NONE, SLOW, Study, report
from validation.protection.mutants import KINDS, Finder, drawn, kernels_with

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


def test_a_draw_has_one_mutant_of_each_kind_for_each_room_and_a_seed_repeats_it():
    first, again, other = (drawn(ROOT, seed) for seed in (1, 1, 2))
    assert first == again != other
    assert len(first) >= 60 and len({one.name for one in first}) == len(first)
    assert {one.kind for one in first} == set(KINDS)


def test_kernels_are_found_that_contain_a_piece():
    (one,) = (one for one in drawn(ROOT) if one.name == "kernels/operator")
    kernels = kernels_with(one, ROOT)
    assert one.function in kernels
    

def test_faults_are_caught_by_the_tests_that_run_them_and_a_stopped_run_goes_on(toy, capsys, monkeypatch):
    study = toy()
    study.judge(["room/line"])
    print(study.verdicts)
    study = toy()
    study.judge(study.mutants)
    for v in study.verdicts.values(): print(v)
    from rich.console import Console
    report(study.verdicts.values(), Console())
    assert 0
