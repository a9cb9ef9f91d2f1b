"""Cases with planted faults that the runner of hostile inputs must catch."""

import subprocess
import sys
import time

import numpy as np

from skfem_stvk import StvkError
from validation.hostile.case import Case, Verdict, Wrong


def refused(folder):
    raise StvkError("Expected a mesh, got nothing at all.")


def too_short(folder):
    raise StvkError("No.")


def from_the_depths(folder):
    return {}["connectivity"]


def leaves(folder):
    sys.exit(0)


def forever(folder):
    time.sleep(60)


def forever_and_hides_it(folder):
    try:
        time.sleep(60)
    except Exception as error:
        raise StvkError("The file could not be read: is it cut off?") from error


def forever_in_a_child(folder):
    subprocess.run([sys.executable, "-c", "import time; time.sleep(60)"])


def takes_everything(folder):
    return np.ones(10**9)


def takes_everything_and_hides_it(folder):
    try:
        np.ones(10**9)
    except MemoryError as error:
        raise StvkError("The file could not be read: is it cut off?") from error


def loses(folder):
    raise Wrong(Verdict.LOSS, "state 7 is missing")


def judge_that_fails(result):
    raise StvkError("An error of the judge is no refusal.")


#: Expected verdict of each case.
EXPECTED = {
    "refused in words": Verdict.REFUSED,
    "a right result": Verdict.RIGHT,
    "an error without words": Verdict.TRACEBACK,
    "an error from the depths": Verdict.TRACEBACK,
    "sys.exit": Verdict.TRACEBACK,
    "a judge that fails": Verdict.TRACEBACK,
    "accepted": Verdict.SILENT,
    "a hang": Verdict.HANG,
    "a hang that hides it": Verdict.HANG,
    "a hang in a process of its own": Verdict.HANG,
    "a memory hog": Verdict.MEMORY,
    "a memory hog that hides it": Verdict.MEMORY,
    "a loss": Verdict.LOSS,
    "after all others": Verdict.RIGHT,
}


def cases():
    yield Case("refused in words", refused, quick=True)
    yield Case("a right result", lambda folder: 1.0, judge=lambda result: None)
    yield Case("an error without words", too_short)
    yield Case("an error from the depths", from_the_depths)
    yield Case("sys.exit", leaves)
    yield Case("a judge that fails", lambda folder: 1.0, judge=judge_that_fails)
    yield Case("accepted", lambda folder: 1.0)
    yield Case("a hang", forever, seconds=1)
    yield Case("a hang that hides it", forever_and_hides_it, seconds=1)
    yield Case("a hang in a process of its own", forever_in_a_child, seconds=1)
    yield Case("a memory hog", takes_everything)
    yield Case("a memory hog that hides it", takes_everything_and_hides_it)
    yield Case("a loss", loses)
    yield Case("after all others", lambda folder: list(folder.iterdir()), judge=lambda left: None if left == [] else 1 / 0)
