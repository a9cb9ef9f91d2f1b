"""Checkpoints of paths with invalid contents: each number and each array in turn."""

import copy

import numpy as np
import pytest
from beams import bent
from test_arc_length import bar

from skfem_stvk import Stop, StvkError, solve_static
from skfem_stvk.solvers.runs.archive import read_archive, write_archive
from skfem_stvk.solvers.statics.path_checkpoint import PathCheckpoint

WRONG = [None, True, -1, 10**30, 0.5, float("nan"), "x", [], {}]
#: Entries that do not affect the path: effort, findings and iterations of a state, and the load factors of evaluated loads.
RECORDS = (
    "record.state.seconds",
    "record.state.iterations.",
    "record.state.jump",
    "record.state.lowest",
    "record.state.potential",
    "record.state.smallest_volume_ratio",
    "record.state.findings",
    "record.state.critical",
    "record.state.status",
    "record.state.end",
    "problem.moments",
)
#: Data of the next step, from which Newton's method may or may not find an equilibrium.
NEXT_STEP = ("record.next.",)


def load_steps():
    return {"system": bent(n=3), "steps": 3}


def arc_length():
    return {"system": bar(), "steps": 20, "method": "arc-length", "stop": Stop(states=4)}


@pytest.fixture(scope="module", params=[load_steps, arc_length])
def path(request, tmp_path_factory):
    call = request.param() | {"checkpoint": tmp_path_factory.mktemp("path") / "path", "quiet": True, "raise_on_failure": False}
    solve_static(**call)
    file = sorted(call["checkpoint"].iterdir())[-1]
    return call, file, *read_archive(file, PathCheckpoint.known, "")


def resume_from(call, file, header, arrays):
    """Resume from a file with the given contents; return the message of the error, or ""."""
    write_archive(file, header, arrays)
    try:
        solve_static(**call, resume=True)
    except StvkError as error:
        return str(error)
    return ""


def entries(header, prefix=()):
    for name, value in header.items():
        yield (*prefix, name), value
        if isinstance(value, dict):
            yield from entries(value, (*prefix, name))


@pytest.mark.slow
def test_each_entry_of_the_header_that_is_wrong_is_refused(path):
    call, file, header, arrays = path
    accepted, refused = [], 0
    for prefix, value in list(entries(header)):
        for wrong in [..., *WRONG]:
            if wrong == value and type(wrong) is type(value):
                continue
            other = copy.deepcopy(header)
            inner = other
            for name in prefix[:-1]:
                inner = inner[name]
            if wrong is ...:
                del inner[prefix[-1]]
            else:
                inner[prefix[-1]] = wrong
            message = resume_from(call, file, other, arrays)
            refused += str(file) in message
            if str(file) not in message:
                accepted.append((".".join(prefix), wrong, message))
    assert [one for one in accepted if not one[0].startswith((*RECORDS, *NEXT_STEP))] == [] and refused > 250
    assert resume_from(call, file, header, arrays) == ""


CHANGES = {
    "missing": lambda u: None,
    "shorter": lambda u: u[:-1],
    "text": lambda u: u.astype(str),
    "single": lambda u: u.astype(np.float32),
    "not finite": lambda u: np.where(np.arange(len(u)) == 3, np.nan, u),
    "of another state": lambda u: 1.01 * u,
}


@pytest.mark.parametrize("change", CHANGES)
def test_displacements_that_are_not_a_state_of_the_path_are_refused(path, change):
    call, file, header, arrays = path
    u = CHANGES[change](arrays["state u"])
    assert f"{file} is damaged" in resume_from(
        call, file, header, {name: array for name, array in (arrays | {"state u": u}).items() if array is not None}
    )
    assert resume_from(call, file, header, arrays) == ""


def test_states_in_another_order_or_of_another_path_are_refused(path, tmp_path):
    call, file, *_ = path
    first = file.with_name("state_00000.npz")
    content = file.read_bytes()
    file.write_bytes(first.read_bytes())
    with pytest.raises(StvkError, match=r"damaged: its number is 0; expected"):
        solve_static(**call, resume=True)
    solve_static(**call | {"checkpoint": tmp_path / "other", "rtol": 1e-6})
    file.write_bytes((tmp_path / "other" / file.name).read_bytes())
    with pytest.raises(StvkError, match=rf"{file.name} is of another problem: rtol was 1e-06 and is 1e-08"):
        solve_static(**call, resume=True)
    file.write_bytes(content)
