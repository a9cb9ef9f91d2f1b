"""`python -m validation bench`: exit codes, output files and folders that cannot be written."""

import sys

import pytest

from skfem_stvk.about import PACKAGES, circumstances
from validation import bench
from validation.__main__ import main


@pytest.fixture
def command(monkeypatch):
    """Yield a function that calls the command with options and a stand-in for the run, and the list of plans that the run got.

    The stand-in measures nothing and returns a benchmark with the given outcome.
    """
    plans = []

    def called(*options, **outcome):
        def run(plan):
            plans.append(plan)
            return bench.Benchmark(plan, circumstances(PACKAGES), **outcome)

        monkeypatch.setattr(bench, "bench", run)
        monkeypatch.setattr(sys, "argv", ["validation", "bench", *options])
        return main()

    return called, plans


@pytest.mark.parametrize(
    ("outcome", "code"),
    [({}, 0), ({"not_measured": {"NGSolve": "why"}}, 0), ({"failures": {"K": "why"}}, 1), ({"interrupted": True}, 130)],
)
def test_the_benchmark_fails_only_if_something_failed_to_run(outcome, code, command, capsys):
    called, plans = command
    assert called("--quick", **outcome) == code and called(**outcome) == code
    assert [plan.name for plan in plans] == ["quick", "full"] and isinstance(plans[0], bench.Plan)
    assert "quick run" in capsys.readouterr().out


def test_the_benchmark_writes_its_page(command, tmp_path, capsys):
    called, _ = command
    assert called("--out", str(tmp_path / "docs"), interrupted=True) == 130
    assert "**Interrupted**" in (tmp_path / "docs" / "benchmark.md").read_text()
    assert "are in" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["", "file/docs"])
def test_an_output_folder_that_cannot_be_created_is_an_error_before_the_run(name, command, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    called, plans = command
    assert called("--out", name) == 2 and not plans
    assert "expected" in capsys.readouterr().err
