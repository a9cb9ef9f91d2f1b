"""Damaged files of meshes and scenes: each is read, or refused with an error of this package."""

from __future__ import annotations

import re
import warnings
from contextlib import redirect_stderr, redirect_stdout
from functools import lru_cache
from io import StringIO
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from skfem_stvk import Scene, StVK, StvkError, System, read_mesh
from skfem_stvk.scenes.templates import EXAMPLES, example

from ..hostile.mesh_formats import FORMATS, written

NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
#: Replacements of numbers.
HOSTILE = tuple(
    b'0 -1 7 1e400 nan -inf 1000000000 9223372036854775808 99999999999999999999999 1e-320 x "a" true [1] 0x10 1_0 \xff'.split(b" ")
)
#: Bytes that are inserted.
INSERTED = (
    b"\n",
    b" ",
    b"\x00",
    b"[" * 3000,
    b"{a=" * 500,
    b'"',
    b"'''",
    b"]",
    b"$End",
    b"*",
    b"<",
    b"\xef\xbb\xbf",
    b"a.b.c = 1\n",
)
KINDS = ("truncate", "number", "number", "number", "insert", "delete", "repeat", "swap", "flip")

Damage = tuple[str, float, float, int]


@st.composite
def damages(draw: st.DrawFn) -> list[Damage]:
    """Draw one to four damages, each with a kind, a relative position, a relative length, and a choice of the new content."""
    fraction = st.floats(0, 1, exclude_max=True, allow_subnormal=False)
    return draw(st.lists(st.tuples(st.sampled_from(KINDS), fraction, fraction, st.integers(0, 255)), min_size=1, max_size=4))


def damaged(content: bytes, damage: list[Damage]) -> bytes:
    """Return a file's content with all damages applied."""
    for kind, fraction, length, choice in damage:
        at = int(fraction * len(content))
        end = at + 1 + int(length**4 * len(content))
        if kind == "truncate":
            content = content[:at]
        elif kind == "number":
            numbers = list(NUMBER.finditer(content))
            if numbers:
                one = numbers[int(fraction * len(numbers))]
                content = content[: one.start()] + HOSTILE[choice % len(HOSTILE)] + content[one.end() :]
        elif kind == "insert":
            content = content[:at] + INSERTED[choice % len(INSERTED)] + content[at:]
        elif kind == "delete":
            content = content[:at] + content[end:]
        elif kind == "repeat":
            content = content[:end] + content[at:end] + content[end:]
        elif kind == "swap":
            content = content[end:] + content[at:end] + content[:at]
        elif content:
            content = content[:at] + bytes([content[at] ^ (1 << choice % 8)]) + content[at + 1 :]
    return content


mesh_files = st.tuples(st.sampled_from(sorted(FORMATS)), damages())
scene_files = st.tuples(st.sampled_from(sorted(EXAMPLES)), damages())


def read_damaged_mesh(folder: Path, name: str, damage: list[Damage]) -> bool:
    """Read the file, and compute the elastic energy of the mesh if it was read."""
    whole = written(name)
    path = folder / f"body{whole.suffix}"
    for suffix, content in whole.companions.items():
        path.with_suffix(suffix).write_bytes(content)
    path.write_bytes(damaged(whole.content, damage))
    with quietly():
        try:
            mesh = read_mesh(path)
            energy = System(mesh, StVK(young=1.0, poisson=0.3)).energy(0.01 * mesh.p.ravel("F"))
        except StvkError as error:
            return _says_something(error)
    assert energy >= 0, f"an energy of {energy}"
    return True


def read_damaged_scene(folder: Path, name: str, damage: list[Damage]) -> bool:
    """Read the scene, and build its system if it was read."""
    path = folder / "scene.toml"
    path.write_bytes(damaged(_scene(name), damage))
    with quietly():
        try:
            system = Scene.read(path).system()
        except StvkError as error:
            return _says_something(error)
    assert system.ndofs > 0
    return True


@lru_cache
def _scene(name: str) -> bytes:
    return example(name).encode()


def _says_something(error: StvkError) -> bool:
    assert len(str(error)) > 20, f"error = {error!r}; expected an explanation"
    return False


class quietly(warnings.catch_warnings):
    """Context without warnings, and without the output of other packages' readers."""

    def __enter__(self) -> Any:
        self.silent = redirect_stdout(StringIO()), redirect_stderr(StringIO())
        for one in self.silent:
            one.__enter__()
        entered = super().__enter__()
        warnings.simplefilter("ignore")
        return entered

    def __exit__(self, *details: Any) -> None:
        super().__exit__(*details)
        for one in reversed(self.silent):
            one.__exit__(*details)
