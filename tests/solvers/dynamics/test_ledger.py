"""A motion's ledger, its table on disk and its picture."""

import csv
import errno
import io
import os
from pathlib import Path

import matplotlib
import numpy as np
import pytest
import skfem
from hypothesis import given
from hypothesis import strategies as st

from skfem_stvk import Gravity, StVK, StvkError, System
from skfem_stvk.solvers.dynamics.ledger_rows import column_names
from skfem_stvk.solvers.runs import ledger as module
from skfem_stvk.solvers.runs.ledger import MOST_POINTS, Ledger, LedgerFile

matplotlib.use("Agg")
NAMES = ("time", "kinetic_energy", "total_energy")


def filled(steps, names=NAMES, seed=1):
    ledger, rng = Ledger(names), np.random.default_rng(seed)
    for number in range(steps):
        ledger.append([0.1 * number, *rng.normal(size=len(names) - 1)])
    return ledger


def read(path):
    with Path(path).open(newline="") as file:
        names, *rows = csv.reader(file)
    return tuple(names), np.array([[float(value) for value in row] for row in rows]).reshape(-1, len(names))


@pytest.mark.parametrize("steps", [0, 1, 1023, 1024, 1025, 5000])
def test_a_ledger_returns_its_rows_unchanged(steps):
    rows = np.random.default_rng(2).normal(size=(steps, 3))
    ledger = Ledger(NAMES)
    for row in rows:
        ledger.append(row)
    assert ledger.steps == steps and list(ledger) == list(NAMES) and len(ledger) == 3
    np.testing.assert_array_equal(ledger.rows(), rows)
    for column, name in enumerate(NAMES):
        np.testing.assert_array_equal(ledger[name], rows[:, column])


def test_columns_are_read_only_views_that_stay_valid_when_the_ledger_grows():
    ledger = filled(1000)
    before, copy = ledger["kinetic_energy"], ledger["kinetic_energy"].copy()
    with pytest.raises(ValueError, match="read-only"):
        before[0] = 1.0
    for _ in range(2000):
        ledger.append([0.3, 0.0, 0.0])
    np.testing.assert_array_equal(before, copy)
    assert ledger["time"][-1] == 0.3


def test_a_ledger_continues_from_rows_and_after_truncation():
    whole = filled(40)
    again = Ledger(NAMES, whole.rows()[:30])
    for row in whole.rows(30):
        again.append(row)
    np.testing.assert_array_equal(again.rows(), whole.rows())
    again.truncate(12)
    again.append([9.0, 8.0, 7.0])
    np.testing.assert_array_equal(again.rows(), np.vstack([whole.rows()[:12], [9.0, 8.0, 7.0]]))
    for steps in (-1, 14):
        with pytest.raises(StvkError, match=rf"steps = {steps}; expected 0 ... 13"):
            again.truncate(steps)


def test_rows_of_another_length_are_refused():
    ledger = filled(2)
    for values in ([1.0], [1.0, 2.0], [1.0] * 4):  # one value alone would be broadcast to all columns
        with pytest.raises(
            StvkError, match=rf"values has {len(values)} values; expected 3 numbers, one for each of time, kinetic_energy"
        ):
            ledger.append(values)
    assert ledger.steps == 2
    with pytest.raises(StvkError, match=r"rows have shape \(4, 2\); expected \(n, 3\)"):
        Ledger(NAMES, np.zeros((4, 2)))
    for names in ((), ("kinetic_energy", "time"), ("time", "A x", "A x")):
        with pytest.raises(StvkError, match="expected different names, 'time' first"):
            Ledger(names)


def test_an_unknown_column_is_refused_like_a_key():
    ledger = filled(2)
    with pytest.raises(StvkError, match=r"no column 'total_enrgy'; known: .*Did you mean 'total_energy'"):
        ledger["total_enrgy"]
    assert "total" not in ledger and ledger.get("total") is None and "time" in ledger


def test_columns_are_named_after_the_body():
    soft, stiff, weight = StVK(young=1.0, poisson=0.3), StVK(young=5.0, poisson=0.2), Gravity(g=(0, -1.0))
    plane = System(skfem.MeshTri().refined(1), [StVK(young=1.0, poisson=0.3, density=1.0), weight])
    assert column_names(plane, ["A"]) == (
        *("time", "kinetic_energy", "strain_energy", "potential_energy", "external_work", "dissipated_work"),
        *(
            "total_energy",
            "closure_error",
            "inside_out",
            "linear_momentum_x",
            "linear_momentum_y",
            "angular_momentum_z",
            "A x",
            "A y",
        ),
    )
    solid = System(skfem.MeshTet().refined(1), [soft, stiff])
    names = column_names(solid)
    by_term = [name for name in names if name.startswith("strain_energy ")]
    assert by_term == [f"strain_energy {name}" for name in solid.energies(np.zeros(solid.ndofs))] and len(by_term) == 2
    assert names[-6:] == tuple(f"{kind}_momentum_{axis}" for kind in ("linear", "angular") for axis in "xyz")
    line = column_names(System(skfem.MeshLine().refined(2), soft))
    assert line[-1] == "linear_momentum_x"


@given(st.lists(st.tuples(*[st.floats(allow_nan=False)] * 3), max_size=5))
def test_a_table_contains_all_digits(tmp_path_factory, rows):
    ledger = Ledger(("time", 'probe "A", left x', "total_energy"), np.array(rows).reshape(-1, 3))
    names, values = read(ledger.save(tmp_path_factory.mktemp("table") / "motion.csv"))
    assert names == ("time [s]", 'probe "A", left x [m]', "total_energy [J]")
    np.testing.assert_array_equal(values, ledger.rows())


def test_a_long_table_has_every_row_once(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "ROWS_AT_ONCE", 7)
    for steps in (6, 7, 8, 29):
        ledger = filled(steps)
        np.testing.assert_array_equal(read(ledger.save(tmp_path / "motion.csv"))[1], ledger.rows())


def test_a_growing_table_equals_a_table_written_at_once(tmp_path):
    whole, ledger = filled(60), Ledger(NAMES)
    file = LedgerFile(tmp_path / "flag.csv", ledger)
    assert not file.path.exists()  # no file is touched before the first rows
    for number, row in enumerate(whole.rows()):
        ledger.append(row)
        if number % 7 == 3:
            file.write()
            assert file.path.read_bytes() == ledger.save(tmp_path / "at_once.csv").read_bytes()
    file.write()
    file.write()
    assert file.path.read_bytes() == ledger.save(tmp_path / "at_once.csv").read_bytes()


@pytest.mark.parametrize("left", [0, 5, 40, 100])
def test_a_resumed_run_drops_the_rows_after_its_checkpoint_and_half_a_line(tmp_path, left):
    path = tmp_path / "flag.csv"
    filled(left).save(path)
    path.write_bytes(path.read_bytes() + b"4.0,0.1")  # a possible remainder after a kill
    ledger = filled(40)
    LedgerFile(path, ledger).write()
    np.testing.assert_array_equal(read(path)[1], ledger.rows())


@pytest.mark.parametrize("harm", ["removed", "edited", "cut"])
def test_a_table_changed_from_outside_is_written_again(tmp_path, harm):
    ledger = filled(20)
    file = LedgerFile(tmp_path / "flag.csv", ledger)
    file.write()
    if harm == "removed":
        file.path.unlink()
    elif harm == "edited":
        file.path.write_text("mine")
    else:
        ledger.truncate(11)
    ledger.append([7.0, 8.0, 9.0])
    file.write()
    np.testing.assert_array_equal(read(file.path)[1], ledger.rows())


class Full(io.FileIO):
    """File on a disk with space for ten more bytes."""

    def write(self, lines):
        super().write(bytes(lines)[:10])
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_leaves_whole_lines_and_the_next_write_completes_them(tmp_path, monkeypatch):
    ledger = filled(20)
    file = LedgerFile(tmp_path / "flag.csv", ledger)
    file.write()
    before = file.path.read_bytes()
    for _ in range(5):
        ledger.append([1.0, 2.0, 3.0])
    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", lambda path, mode: Full(path, mode))
        with pytest.raises(OSError, match="No space left"):
            file.write()
    assert file.path.read_bytes() == before
    file.write()
    np.testing.assert_array_equal(read(file.path)[1], ledger.rows())


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is full")
def test_a_real_full_device_raises(tmp_path):
    file = LedgerFile(tmp_path / "flag.csv", filled(3))
    file.write()
    file.path = Path("/dev/full")
    with pytest.raises(OSError, match="No space left"):
        file._append(b"1,2,3\n", 0)


def test_unwritable_paths_are_refused_before_any_work(tmp_path):
    for path, message in (
        (tmp_path / "flag.txt", "expected a path that ends in .csv"),
        (tmp_path / "no" / "flag.csv", "does not exist"),
    ):
        with pytest.raises(StvkError, match=message):
            LedgerFile(path, filled(1))
        with pytest.raises(StvkError, match=message):
            filled(1).save(path)
    with pytest.raises(StvkError, match=r"expected a path that ends in .png"):
        filled(2).plot(tmp_path / "flag.csv")
    with pytest.raises(StvkError, match="The ledger has 1 steps"):
        filled(1).plot()


def motion(steps):
    mesh = skfem.MeshTri().refined(1)
    names = column_names(System(mesh, [StVK(young=1.0, poisson=0.3, density=1.0), Gravity(g=(0, -1.0))]), ["tip", "A"])
    ledger = filled(steps, names)
    rows = ledger.rows().copy()
    rows[:, names.index("external_work")] = 0
    return Ledger(names, rows)


def test_the_picture_has_energies_closure_error_momenta_and_probes(tmp_path):
    figure = motion(50).plot()
    labels = [axes.get_ylabel().replace("\n", " ") for axes in figure.axes]
    assert labels == [
        *("energy [J]", "closure error [J]", "linear momentum [kg m/s]", "angular momentum [kg m²/s]"),
        *("displacement of tip [m]", "displacement of A [m]"),
    ]
    legend = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert "total energy" in legend and "external work" not in legend, "columns of zeros are left out"
    path = tmp_path / "ledger.png"
    motion(50).plot(path)
    assert path.stat().st_size > 10_000


def test_a_long_line_is_thinned_to_its_extremes():
    ledger = motion(20 * MOST_POINTS)
    drawn = next(iter(ledger.plot().axes[1].lines)).get_ydata()
    assert len(drawn) == MOST_POINTS
    assert (drawn.min(), drawn.max()) == (ledger["closure_error"].min(), ledger["closure_error"].max())
