"""Checkpoints and responses that are cut, changed or lie: read back is what was written, to the last bit, or it is refused."""

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
from skfem_stvk.dynamics import SimulationError
from skfem_stvk.results.store import write_archive
from skfem_stvk.statics import SolveError

from .case import Case, Verdict, Wrong, in_words
from .runs_on_disk import KINDS, beam, check_same, strip

Header = dict[str, Any]

#: Kinds of runs whose checkpoints are changed, with the file that is changed.
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
#: Of these, those that are tried without a new digest too.
EDITS = ("removed", "-1", "1e300", "a text", "True")
#: Times at which motions end halfway.
HALFWAY: dict[str, dict[str, Any]] = {"verlet": {"until": 0.3}, "energy-momentum": {"until": 1.0}}
#: Trials with random bytes, and how many of them.
FLIPS, BYTES = 60, 3


def cases() -> Iterator[Case]:
    """All changes of all checkpoints."""
    for name in FILES:
        same = partial(check_same, name, folder=None)
        for percent in range(0, 100, 5):
            yield changed(name, f"cut at {percent} %", partial(cut, percent / 100), same, quick=percent == 50)
        for seed in range(FLIPS):
            yield changed(name, f"{BYTES} random bytes, seed {seed}", partial(flipped, seed), same)
        for what, make in NOT_OURS.items():
            yield changed(name, f"it is {what}", make, same)
        for place in leaves(kept(name)[0]):
            for what, value in WRONG_VALUES.items():
                said, change = f"{' '.join(map(str, place))} is {what}", partial(with_value, place, value)
                yield changed(name, f"signed again, {said}", partial(rewritten, change, True), plausible)
                if what in EDITS:
                    yield changed(name, f"edited, {said}", partial(rewritten, change, False), same)
        for array in kept(name)[1]:
            for what, alter in CHANGES.items():
                said, change = f"array {array} is {what}", partial(with_array, array, alter)
                yield changed(name, f"signed again, {said}", partial(rewritten, change, True), plausible)
                yield changed(name, f"edited, {said}", partial(rewritten, change, False), same)
    yield from others()


def resumed(name: str, folder: Path) -> Any:
    """The run, resumed."""
    return KINDS[name].run(folder, resume=True)


def refused(error: BaseException) -> bool:
    """Errors in words; those of solves and motions only if nothing unforeseen is behind them."""
    known = isinstance(error, SolveError | SimulationError) and error.__cause__ is None
    return in_words(error) or (known and len(str(error).split()) > 5)


def changed(
    name: str, what: str, change: Callable[[Path], object], judge: Callable[[Any], None], quick: bool = False, seconds: float = 20
) -> Case:
    """A checkpoint whose file is changed."""

    def attempt(folder: Path) -> Any:
        shutil.copytree(interrupted(name), folder, dirs_exist_ok=True)
        change(folder / "kept" / FILES[name])
        return resumed(name, folder)

    return Case(f"{name}: {what}", attempt, judge, refused, seconds, quick=quick)


def rewritten(change: Callable[[Header, dict[str, Array]], None], signed: bool, path: Path) -> None:
    """A file with other contents; `signed`: as if it had been written so, with a digest that fits."""
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
    """The judge of lies that are signed anew, which may be the truth of another run: numbers, at least."""
    if not np.isfinite(result.u).all() or not np.isfinite(result.t):
        raise Wrong(Verdict.SILENT, "a success with numbers that are not finite")


@lru_cache
def interrupted(name: str) -> Path:
    """A folder with what a run leaves that ends halfway, made once a process."""
    folder = Path(_holder().name) / name
    folder.mkdir()
    KINDS[name].run(folder, **HALFWAY.get(name, {}))
    for later in (folder / "kept").glob("state_*.npz"):
        if later.name > FILES[name]:
            later.unlink()
    return folder


@lru_cache
def _holder() -> TemporaryDirectory[str]:
    return TemporaryDirectory(prefix="hostile-checkpoints-")


@lru_cache
def kept(name: str) -> tuple[Header, list[str]]:
    """The header of the file that is changed, and the names of its arrays."""
    header, arrays = read(interrupted(name) / "kept" / FILES[name])
    return header, list(arrays)


def read(path: Path) -> tuple[Header, dict[str, Array]]:
    """Header and arrays of a file, whatever they are."""
    with np.load(path, allow_pickle=False) as file:
        arrays = {key.removeprefix("array "): file[key] for key in file.files if key.startswith("array ")}
        return json.loads(str(file["header"])), arrays


def leaves(node: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Places of all that stands in a header; of long lists the first two entries."""
    if place:
        yield place
    if isinstance(node, dict):
        for key, value in node.items():
            yield from leaves(value, (*place, key))
    elif isinstance(node, list):
        for number, value in enumerate(node[:2]):
            yield from leaves(value, (*place, number))


def with_value(place: tuple[Any, ...], value: Any, header: Header, arrays: dict[str, Array]) -> None:
    """Another value at this place of the header."""
    node: Any = header
    for key in place[:-1]:
        node = node[key]
    if value is ...:
        del node[place[-1]]
    else:
        node[place[-1]] = value


def with_array(name: str, change: Callable[[Array], Array | None], header: Header, arrays: dict[str, Array]) -> None:
    """Another array of this name, or none."""
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
    """The first part of the file."""
    path.write_bytes(path.read_bytes()[: int(part * path.stat().st_size)])


def flipped(seed: int, path: Path) -> None:
    """Some bytes are others."""
    rng, content = np.random.default_rng(seed), bytearray(path.read_bytes())
    for place in rng.integers(0, len(content), BYTES):
        content[place] ^= int(rng.integers(1, 256))
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
    """What a pickle would run."""

    def __reduce__(self) -> Any:
        return os.system, ("touch owned",)


def _pickled(path: Path) -> None:
    np.savez(path, header=np.array([_Shell()], dtype=object))


def _huge(path: Path) -> None:
    """An array that declares 1e12 numbers, in a member of a few bytes."""
    member = io.BytesIO()
    np.lib.format.write_array_header_2_0(member, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("array u.npy", member.getvalue())


def _bomb(path: Path) -> None:
    """A gigabyte of zeros, compressed."""
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
    """Checkpoints and series of other problems: neither resumed nor replaced, unless that is asked for."""
    makes = {"verlet": partial(strip, young=2.5), "load steps": partial(beam, young=9e3)}
    moved = {"verlet": partial(strip, moved=1e-5), "load steps": partial(beam, moved=1e-5)}
    for what, systems in {"another modulus": makes, "another mesh": moved}.items():
        for name, system in systems.items():
            for how in ("resume", "anew", "overwrite"):
                yield Case(f"{name}: {what}, {how}", partial(_other, name, system, how), lambda result: None, refused)


def _other(name: str, system: Callable[[], Any], how: str, folder: Path) -> Any:
    shutil.copytree(interrupted(name), folder, dirs_exist_ok=True)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    options: dict[str, Any] = {"resume": {"resume": True}, "anew": {}, "overwrite": {"overwrite": True}}[how]
    try:
        result = KINDS[name].run(folder, system(), **options)
    except BaseException:
        if how == "overwrite":
            raise Wrong(Verdict.TRACEBACK, "not replaced, although that was asked for") from None
        if {path: path.read_bytes() for path in before if path.is_file()} != before:
            raise Wrong(Verdict.LOSS, "the files of another problem were changed") from None
        raise
    if how != "overwrite":
        raise Wrong(Verdict.SILENT, f"{how}: the files of another problem were taken")
    return result
