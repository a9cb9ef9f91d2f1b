"""Checkpoints with impossible contents are refused; the tests change each number and each array."""

import copy
import json

import numpy as np
import pytest
from motions import driven, kicked

from skfem_stvk import StvkError, simulate
from skfem_stvk.solvers.dynamics import EnergyMomentum, VelocityVerlet
from skfem_stvk.solvers.dynamics.motion_checkpoint import MotionCheckpoint
from skfem_stvk.solvers.runs.archive import read_archive, write_archive

pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")
#: Wrong values that replace each entry of the header.
WRONG = [None, True, -1, 10**30, 0.5, float("nan"), "x", [], {}]
#: Entries that do not change the results or the paths of a run: counters, and times of the next frames. Dates and values of the
#: critical step are computed again.
LOOKS = ("record.reviews.", "record.good.reviews.", "record.good.cuts", "record.seconds.")
#: Options that may have any value; they are compared only with options that the caller gives again.
OPTIONS = ("problem.method.damping.", "problem.method.integrator.options.")
HARMLESS = {
    "record.good",
    "record.cuts",
    "record.good.cuts",
    "record.counts.iterations",
    "record.counts.clamped",
    "record.seconds",
    "record.every",
    "record.save",
    "record.pushed",
    "record.reviews",
    "record.good.reviews",
    "problem.moments",
}
RUNS = {
    "explicit": lambda: (kicked(2), VelocityVerlet(), 0.6, {"reactions": {}}),
    "implicit": lambda: (driven(2), EnergyMomentum(0.01), 0.05, {"probes": {"A": [1]}, "reactions": {"B": "left"}}),
}


@pytest.fixture(scope="module", params=RUNS)
def motion(request, tmp_path_factory):
    """Return a run and its checkpoint: header and arrays."""
    scene, integrator, until, places = RUNS[request.param]()
    folder = tmp_path_factory.mktemp(request.param)
    scene.run(integrator, until, checkpoint=folder / "run", **places)
    header, arrays = read_archive(folder / "run" / "motion.npz", MotionCheckpoint.known, "")
    return scene.system, folder, header, arrays, until


def resume_error(system, folder, header, arrays, until):
    """Resume from this checkpoint for a few steps; return the error message, or "" on success."""
    write_archive(folder / "run" / "motion.npz", header, arrays)
    try:
        simulate(system, checkpoint=folder / "run", resume=True, until=until * 1.02, quiet=True)
    except StvkError as error:
        return str(error)
    except Exception as error:
        return f"RAW {type(error).__name__} {error}"
    return ""


def entries(header, path=()):
    """Yield the key path to each entry of the header."""
    for name, value in header.items():
        yield (*path, name)
        if isinstance(value, dict):
            yield from entries(value, (*path, name))


def changed(header, path, value):
    """Return a copy with another entry, or without the entry if the value is `...`."""
    other = copy.deepcopy(header)
    inner = other
    for name in path[:-1]:
        inner = inner[name]
    if value is ...:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return other


@pytest.mark.slow
def test_each_wrong_entry_of_the_header_is_refused(motion):
    system, folder, header, arrays, until = motion
    assert not resume_error(system, folder, header, arrays, until)
    accepted, nameless, refused = [], [], 0
    for path in entries(header):
        inner = header
        for name in path:
            inner = inner[name]
        for value in [..., *WRONG]:
            if value == inner and type(value) is type(inner):
                continue
            message = resume_error(system, folder, changed(header, path, value), arrays, until)
            refused += bool(message)
            if not message:
                accepted.append((".".join(path), value))
            elif str(folder / "run") not in message:
                nameless.append((".".join(path), value, message))
    harmful = [one for one in accepted if one[0] not in HARMLESS and not one[0].startswith((*LOOKS, *OPTIONS))]
    nameless = [one for one in nameless if not (one[0].startswith(OPTIONS) and one[1] == 1e300)]
    assert not harmful and not nameless and refused > 400


def without(rows, number):
    return np.delete(rows, number, axis=0)


#: Changes of a ledger.
LEDGERS = {
    "a row is missing": lambda rows: without(rows, 2),
    "the first row is missing": lambda rows: without(rows, 0),
    "the last row is missing": lambda rows: without(rows, -1),
    "reversed": lambda rows: rows[::-1],
    "a row twice": lambda rows: np.concatenate([rows, rows[-1:]]),
    "a column is missing": lambda rows: rows[:, :-1],
    "not finite": lambda rows: rows * np.where(np.arange(len(rows)) == 1, np.nan, 1)[:, None],
    "another kinetic energy": lambda rows: rows * np.where(np.arange(rows.shape[1]) == 1, 1.01, 1),
    "whole numbers": lambda rows: rows.astype(int),
    "text": lambda rows: rows.astype(str),
    "no table": lambda rows: rows.ravel(),
}
ARRAYS = {
    "missing": lambda array: None,
    "shorter": lambda array: array[:-1],
    "a table": lambda array: array.reshape(-1, 1),
    "text": lambda array: array.astype(str),
    "single": lambda array: array.astype(np.float32),
    "complex": lambda array: array.astype(complex),
    "not finite": lambda array: np.where(np.arange(len(array)) == 3, np.inf, array),
}


def test_impossible_ledgers_and_arrays_are_refused(motion):
    system, folder, header, arrays, until = motion
    cases = [("rows", name, change) for name, change in LEDGERS.items()]
    cases += [(one, name, change) for one in arrays if one != "rows" and arrays[one].size for name, change in ARRAYS.items()]
    cases += [(one, "another", lambda array: 1.01 * array + 0.01) for one in ("state u", "state v")]
    accepted = []
    for one, name, change in cases:
        other = arrays | {one: change(arrays[one])}
        message = resume_error(system, folder, header, {key: array for key, array in other.items() if array is not None}, until)
        if str(folder / "run") not in message:
            accepted.append((one, name, message))
    assert [
        one[:2] for one in accepted if one[:2] != ("reactions B", "shorter")
    ] == []  # other locations are valid, and are compared only if they are given again
    assert not resume_error(system, folder, header, arrays, until)


def test_plausible_later_changes_are_refused(motion):
    system, folder, header, arrays, until = motion
    write_archive(folder / "run" / "motion.npz", header, arrays)
    with np.load(folder / "run" / "motion.npz") as file:
        whole = dict(file)
    likely = changed(header, ("problem", "method", "damping", "alpha"), header["problem"]["method"]["damping"]["alpha"] + 1e-3)
    for change in (
        {"header": np.array(json.dumps(likely))},
        {"array state u": (1 + 1e-9) * whole["array state u"]},
        {"digest": np.array("0" * 32)},
    ):
        np.savez(folder / "run" / "motion.npz", **(whole | change))
        with pytest.raises(StvkError, match=r"motion\.npz was changed after it was written"):
            simulate(system, checkpoint=folder / "run", resume=True, until=until * 1.02, quiet=True)
