"""Progress output of simulations."""

import io

import pytest
from rich.console import Console

from skfem_stvk import terminal
from skfem_stvk.solvers.dynamics import motion_outputs as module
from skfem_stvk.solvers.dynamics.motion_outputs import MotionProgress
from skfem_stvk.solvers.runs.ledger import Ledger


class Clock:
    """Clock whose time is set by the test."""

    def __init__(self):
        self.now = 50.0

    def perf_counter(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    return clock


def simulate(clock, seconds, steps, done=0, quiet=False):
    """Show progress for steps that take `seconds` each."""
    ledger = Ledger(["time", "kinetic_energy", "strain_energy", "total_energy", "closure_error"])
    with MotionProgress("a body of 8 elements", ledger, done, quiet) as progress:
        for number in range(done + 1, steps + 1):
            ledger.append([0.01 * number, 2.0, 0.5, 2.5, -1.5e-13])
            clock.now += seconds
            progress.step(number, steps)


def test_without_a_terminal_a_line_is_printed_every_few_seconds_and_at_the_end(clock, capsys):
    simulate(clock, 1 / 128, 1536)
    lines = capsys.readouterr().out.splitlines()
    assert lines == [
        "a body of 8 elements",
        *(
            f"step {number}/1536   128 steps/s   {left} left   t {0.01 * number:.4g} s   "
            "kinetic 2 J   strain 0.5 J   total 2.5 J   "
            "closure error -1.5e-13 J"
            for number, left in ((640, "7 s"), (1280, "2 s"))
        ),
        "step 1536/1536   128 steps/s   took 12 s   t 15.36 s   "
        "kinetic 2 J   strain 0.5 J   total 2.5 J   closure error -1.5e-13 J",
    ]


def test_each_slow_step_prints_a_line(clock, capsys):
    simulate(clock, 60.0, 100)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 102 and "0.0167 steps/s   1 h 38 min left" in lines[2]


def test_the_speed_of_a_resumed_run_counts_only_its_own_steps(clock, capsys):
    simulate(clock, 0.1, 1100, done=1000)
    lines = capsys.readouterr().out.splitlines()
    assert "step 1050/1100   10 steps/s   5 s left" in lines[1] and "step 1100/1100   10 steps/s   took 10 s" in lines[-1]


def test_the_remaining_time_follows_the_recent_speed(clock, capsys):
    ledger = Ledger(["time"])
    with MotionProgress("header", ledger, 0, False) as progress:
        for number in range(1, 301):
            clock.now += 1.0 if number <= 100 else 4.0
            progress.step(number, 1000)
    before_last = capsys.readouterr().out.splitlines()[-2]
    assert "0.25 steps/s   46 min" in before_last


def test_quiet_prints_nothing(clock, capsys):
    simulate(clock, 1.0, 100, quiet=True)
    assert capsys.readouterr() == ("", "")


def test_a_run_without_a_step_prints_no_line(clock, capsys):
    with pytest.raises(KeyError), MotionProgress("header", Ledger(["time"]), 7, False):
        raise KeyError
    assert capsys.readouterr().out == "header\n"


@pytest.mark.parametrize("width", [80, 160])
def test_a_terminal_shows_a_bar_four_times_per_second(clock, capsys, monkeypatch, width):
    screen = io.StringIO()
    monkeypatch.setattr(terminal, "Console", lambda stderr: Console(file=screen, force_terminal=True, width=width, _environ={}))
    simulate(clock, 1 / 128, 1536)
    drawn = screen.getvalue()
    assert capsys.readouterr().out.splitlines()[1:] == [
        "step 1536/1536   128 steps/s   took 12 s   t 15.36 s   kinetic 2 J   strain 0.5 J   total 2.5 J   closure error -1.5e-13 J"
    ]
    for number in range(32, 1536, 32):
        assert f"step {number}/1536   128 steps/s   " in drawn
    assert "step 33/1536" not in drawn and drawn.count("steps/s") < 60
    assert ("total 2.5 J" in drawn) == (width == 160)
