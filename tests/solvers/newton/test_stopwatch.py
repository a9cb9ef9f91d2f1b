"""The stopwatch attributes time to parts."""

import pytest

from skfem_stvk.solvers.newton import stopwatch
from skfem_stvk.solvers.newton.stopwatch import Stopwatch


@pytest.fixture
def seconds(monkeypatch):
    """Make the clock advance by one second at each call."""
    now = iter(range(100))
    monkeypatch.setattr(stopwatch, "perf_counter", lambda: float(next(now)))


def test_parts_add_up_to_the_total(seconds):
    watch = Stopwatch("write")
    for _ in range(3):
        with watch("write"), watch("assemble"):
            pass
    assert watch.parts() == {"assemble": 3.0, "factor": 0.0, "solve": 0.0, "write": 9.0, "other": 1.0}


def test_time_until_an_error_counts_and_the_error_is_raised(seconds):
    watch = Stopwatch()
    with pytest.raises(ZeroDivisionError), watch("solve"):
        1 / 0  # noqa: B018
    assert watch.parts()["solve"] == 1.0


def test_an_unknown_part_is_refused():
    with pytest.raises(KeyError):
        Stopwatch()("write")
