"""Damaged and changed checkpoints and responses: the run restores its data bit for bit, or refuses the file."""

from __future__ import annotations

import io
import json
import os
import pickle
import shutil
import zipfile
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from skfem_stvk.arguments import Array
from skfem_stvk.solvers.dynamics import SimulationError
from skfem_stvk.solvers.runs.archive import write_archive
from skfem_stvk.solvers.statics import SolveError

from .case import Case, Verdict, Wrong, is_readable
from .runs_on_disk import KINDS, beam, check_same, strip

Header = dict[str, Any]

#: For each kind of run, the file that the cases change.
FILES = {
    "verlet": "motion.npz",
    "energy-momentum": "motion.npz",
    "load steps": "state_00002.npz",
    "arc length": "state_00011.npz",
    "response": "table.npz",
}
WRONG_VALUES: dict[str, Any] = {
    "removed": ...,
    "None": None,
    "-1": -1,
    "0": 0,
    "1e300": 1e300,
    "NaN": float("nan"),
    "a text": "x",
    "a list": [],
    "a dict": {},
    "True": True,
    "10**400": 10**400,
}
#: Wrong values that are also tried without a new digest.
EDITS = ("removed", "-1", "1e300", "a text", "True")
#: Times at which the interrupted motions end.
HALFWAY: dict[str, dict[str, Any]] = {"verlet": {"until": 0.3}, "energy-momentum": {"until": 1.0}}
#: Number of trials with random bytes, and number of bytes in each.
FLIPS, BYTES = 60, 3


def cases() -> Iterator[Case]:
    """Yield all changes of all checkpoints."""
    for name in FILES:
        same = partial(check_same, name, folder=None)
        for percent in range(0, 100, 5):
            yield changed(name, f"cut at {percent} %", partial(cut, percent / 100), same, quick=percent == 50)
        for seed in range(FLIPS):
            yield changed(name, f"{BYTES} random bytes, seed {seed}", partial(flip_bytes, seed), same)
        for what, make in NOT_OURS.items():
            yield changed(name, f"it is {what}", make, same)
        for keys in leaves(contents_of(name)[0]):
            for what, value in WRONG_VALUES.items():
                text, change = f"{' '.join(map(str, keys))} is {what}", partial(with_value, keys, value)
                yield changed(name, f"signed again, {text}", partial(rewrite, change, True), plausible)
                if what in EDITS:
                    yield changed(name, f"edited, {text}", partial(rewrite, change, False), same)
        for array in contents_of(name)[1]:
            for what, alter in CHANGES.items():
                text, change = f"array {array} is {what}", partial(with_array, array, alter)
                yield changed(name, f"signed again, {text}", partial(rewrite, change, True), plausible)
                yield changed(name, f"edited, {text}", partial(rewrite, change, False), same)
    yield from others()


def resumed(name: str, folder: Path) -> Any:
    """Resume the run and return its result."""
    return KINDS[name].run(folder, resume=True)


def refused(error: BaseException) -> bool:
    """Return whether an error is readable. Errors of solves and motions must have no other exception as their cause."""
    known = isinstance(error, SolveError | SimulationError) and error.__cause__ is None
    return is_readable(error) or (known and len(str(error).split()) > 5)


def changed(
    name: str, what: str, change: Callable[[Path], object], judge: Callable[[Any], None], quick: bool = False, seconds: float = 60
) -> Case:
    """Return the case of a run that is resumed from a changed file."""

    def attempt(folder: Path) -> Any:
        shutil.copytree(interrupted(name), folder, dirs_exist_ok=True)
        change(folder / "saved" / FILES[name])
        return resumed(name, folder)

    return Case(f"{name}: {what}", attempt, judge, refused, seconds, quick=quick)


def rewrite(change: Callable[[Header, dict[str, Array]], None], signed: bool, path: Path) -> None:
    """Change the contents of a file. If `signed`, write a digest that fits the new contents; otherwise retain the old digest."""
    header, arrays = read(path)
    change(header, arrays)
    if signed:
        write_archive(path, header, arrays)
        return
    with np.load(path) as file:
        digest = file["digest"]
    packed: dict[str, Any] = {"header": np.array(json.dumps(header)), "digest": digest}
    packed |= {f"array {name}": array for name, array in arrays.items()}
    np.savez(path, **packed)


def plausible(result: Any) -> None:
    """Raise `Wrong` if the result is not finite: the judge of changed files with a new digest, which may fit another run."""
    if not np.isfinite(result.u).all() or not np.isfinite(result.t):
        raise Wrong(Verdict.SILENT, "a success with numbers that are not finite")


@lru_cache
def interrupted(name: str) -> Path:
    """Return a folder with the files of a run that ended halfway. Each process creates it once."""
    folder = Path(_temporary_folder().name) / name
    folder.mkdir()
    KINDS[name].run(folder, **HALFWAY.get(name, {}))
    for later in (folder / "saved").glob("state_*.npz"):
        if later.name > FILES[name]:
            later.unlink()
    return folder


@lru_cache
def _temporary_folder() -> TemporaryDirectory[str]:
    return TemporaryDirectory(prefix="hostile-checkpoints-")


@lru_cache
def contents_of(name: str) -> tuple[Header, list[str]]:
    """Return the header of the file that the cases change, and the names of its arrays."""
    header, arrays = read(interrupted(name) / "saved" / FILES[name])
    return header, list(arrays)


def read(path: Path) -> tuple[Header, dict[str, Array]]:
    """Return header and arrays of a file without any check."""
    with np.load(path, allow_pickle=False) as file:
        arrays = {key.removeprefix("array "): file[key] for key in file.files if key.startswith("array ")}
        return json.loads(str(file["header"])), arrays


def leaves(node: Any, keys: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the key paths of all entries of a header; for a list, only the first two entries."""
    if keys:
        yield keys
    if isinstance(node, dict):
        for key, value in node.items():
            yield from leaves(value, (*keys, key))
    elif isinstance(node, list):
        for number, value in enumerate(node[:2]):
            yield from leaves(value, (*keys, number))


def with_value(keys: tuple[Any, ...], value: Any, header: Header, arrays: dict[str, Array]) -> None:
    """Set the entry of the header with this key path to another value, or delete it if the value is `...`."""
    node: Any = header
    for key in keys[:-1]:
        node = node[key]
    if value is ...:
        del node[keys[-1]]
    else:
        node[keys[-1]] = value


def with_array(name: str, change: Callable[[Array], Array | None], header: Header, arrays: dict[str, Array]) -> None:
    """Replace the array of this name by `change(array)`, or delete it if that is None."""
    array = change(arrays.pop(name))
    if array is not None:
        arrays[name] = array


def _one(value: float) -> Callable[[Array], Array]:
    def change(array: Array) -> Array:
        array = array.astype(float)
        if array.size:
            array.reshape(-1)[array.size // 2] = value
        return array

    return change


CHANGES: dict[str, Callable[[Array], Array | None]] = {
    "removed": lambda array: None,
    "empty": lambda array: array[:0],
    "one shorter": lambda array: array[:-1],
    "one longer": lambda array: np.concatenate([array, array[-1:]]),
    "reversed": lambda array: array[::-1].copy() if len(array) > 1 and not np.array_equal(array, array[::-1]) else None,
    "with NaN": _one(np.nan),
    "with infinity": _one(np.inf),
    "with 1e300": _one(1e300),
    "with another number": _one(0.123),
    "twice as large": lambda array: 2 * array + 1e-3,
    "whole numbers": lambda array: array.astype(np.int64),
    "complex": lambda array: array.astype(complex),
    "text": lambda array: array.astype(str),
    "in single precision": lambda array: array.astype(np.float32) if array.dtype.kind == "f" else None,
    "a scalar": lambda array: np.array(1.0),
    "of more axes": lambda array: array[None],
}


def cut(part: float, path: Path) -> None:
    """Truncate the file to its first part."""
    path.write_bytes(path.read_bytes()[: int(part * path.stat().st_size)])


def flip_bytes(seed: int, path: Path) -> None:
    """Change some random bytes of the file."""
    rng, content = np.random.default_rng(seed), bytearray(path.read_bytes())
    for index in rng.integers(0, len(content), BYTES):
        content[index] ^= int(rng.integers(1, 256))
    path.write_bytes(content)


def _content(content: bytes, path: Path) -> None:
    path.write_bytes(content)


def _link(target: str, path: Path) -> None:
    path.unlink()
    path.symlink_to(target)


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _fifo(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


class _Shell:
    """Object whose unpickling runs a shell command."""

    def __reduce__(self) -> Any:
        return os.system, ("touch owned",)


def _pickled(path: Path) -> None:
    np.savez(path, header=np.array([_Shell()], dtype=object))


def _huge(path: Path) -> None:
    """Add an array to the archive that declares 1e12 numbers in a member of a few bytes."""
    member = io.BytesIO()
    np.lib.format.write_array_header_2_0(member, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("array u.npy", member.getvalue())


def _bomb(path: Path) -> None:
    """Write a compressed gigabyte of zeros."""
    header = io.BytesIO()
    np.lib.format.write_array_header_2_0(header, {"descr": "<f8", "fortran_order": False, "shape": (2**27,)})
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("header.npy", "w") as member:
        member.write(header.getvalue())
        for _ in range(64):
            member.write(bytes(2**24))


NOT_OURS: dict[str, Callable[[Path], object]] = {
    "empty": partial(_content, b""),
    "text": partial(_content, b"hello"),
    "a pickle": partial(_content, pickle.dumps(_Shell())),
    "an .npz file of pickles": _pickled,
    "an .npz file of others": lambda path: np.savez(path, a=np.ones(3)),
    "an .npy file": lambda path: _content(_npy(), path),
    "an archive with an array of 1e12 numbers": _huge,
    "a bomb of zeros": _bomb,
    "a folder": _folder,
    "a fifo": _fifo,
    "/dev/zero": partial(_link, "/dev/zero"),
    "a link to itself": lambda path: _link(path.name, path),
    "a link to nowhere": partial(_link, "nowhere"),
}


def _npy() -> bytes:
    stream = io.BytesIO()
    np.save(stream, np.ones(3))
    return stream.getvalue()


def others() -> Iterator[Case]:
    """Yield cases with the files of another problem: a run must neither resume nor replace them, unless `overwrite` is given."""
    makes = {"verlet": partial(strip, young=2.5), "load steps": partial(beam, young=9e3)}
    moved = {"verlet": partial(strip, moved=1e-5), "load steps": partial(beam, moved=1e-5)}
    for what, systems in {"another modulus": makes, "another mesh": moved}.items():
        for name, system in systems.items():
            for how in ("resume", "start", "overwrite"):
                yield Case(f"{name}: {what}, {how}", partial(_other, name, system, how), lambda result: None, refused)


def _other(name: str, system: Callable[[], Any], how: str, folder: Path) -> Any:
    shutil.copytree(interrupted(name), folder, dirs_exist_ok=True)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    options: dict[str, Any] = {"resume": {"resume": True}, "start": {}, "overwrite": {"overwrite": True}}[how]
    try:
        result = KINDS[name].run(folder, system(), **options)
    except BaseException:
        if how == "overwrite":
            raise Wrong(Verdict.TRACEBACK, "the files were not replaced, although overwrite = True") from None
        if {path: path.read_bytes() for path in before if path.is_file()} != before:
            raise Wrong(Verdict.LOSS, "the files of another problem were changed") from None
        raise
    if how != "overwrite":
        raise Wrong(Verdict.SILENT, f"{how}: the files of another problem were accepted")
    return result
