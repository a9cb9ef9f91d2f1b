"""Where the time goes."""

import pytest

from skfem_stvk.nonlinear import stopwatch
from skfem_stvk.nonlinear.stopwatch import Stopwatch


@pytest.fixture
def seconds(monkeypatch):
    """Every look at the clock is a second after the one before."""
    now = iter(range(100))
    monkeypatch.setattr(stopwatch, "perf_counter", lambda: float(next(now)))


def test_parts_add_up_to_the_total(seconds):
    watch = Stopwatch("write")
    for _ in range(3):
        with watch("write"), watch("assemble"):
            pass
    assert watch.parts() == {"assemble": 3.0, "factor": 0.0, "solve": 0.0, "write": 9.0, "other": 1.0}


def test_time_until_an_error_counts_and_the_error_goes_on(seconds):
    watch = Stopwatch()
    with pytest.raises(ZeroDivisionError), watch("solve"):
        1 / 0  # noqa: B018
    assert watch.parts()["solve"] == 1.0


def test_a_part_that_was_not_named_is_refused():
    with pytest.raises(KeyError):
        Stopwatch()("write")
