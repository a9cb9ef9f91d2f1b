"""Text of a scene: its data, the line of each key, and settings that replace values."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from ..arguments import shown
from ..errors import SceneError, name_known
from ..results.complete_files import content_of
from .syntax import DEEPEST, Loc, lines_of, parsed, path_of, refuse_too_much, value_text

#: Larger files are refused as scenes.
LARGEST = 10_000_000
#: A key or an index in the path of `--set`.
STEP = re.compile(r"""\.?(?:(?P<bare>[A-Za-z0-9_-]+)|"(?P<quoted>[^"]*)"|'(?P<literal>[^']*)')|\[(?P<index>-?\d+)\]""")


@dataclass(frozen=True, eq=False)
class SceneSource:
    """Data of a TOML file, with their origin.

    Attributes
    ----------
    data
        Tables and lists.
    name
        Name of the file, for messages.
    folder
        Folder to which the paths of inputs are relative.
    text
        Text of the file; empty if there is none.
    settings
        Settings by the path of their key, as the user wrote them.
    """

    data: dict[str, Any]
    name: str = "the scene"
    folder: Path = Path()
    text: str = ""
    settings: Mapping[Loc, str] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path) -> SceneSource:
        """Read the source in a file. Raise SceneError, with the location, if it cannot be read or is not TOML."""
        if path.is_dir():
            raise _not_read(f"{path} is a folder; expected a scene file such as {path / 'scene.toml'}.")
        if not path.exists():
            near = [one.name for one in path.parent.glob("*.toml")] if path.parent.is_dir() else []
            raise _not_read(f"There is no file {path}; scenes in its folder: {name_known(path.name, near)}")
        try:
            size = path.stat().st_size
            raw = content_of(path, LARGEST) if size <= LARGEST else b"\0"
        except OSError as error:
            raise _not_read(f"{path} cannot be read: {error.strerror}.") from error
        if b"\0" in raw:
            raise _not_read(
                f"{path} ({size} bytes) is not a text file; expected a scene, which names its mesh: [mesh] file = {path.name!r}."
            )
        if raw.startswith(b"$MeshFormat"):
            raise _not_read(
                f"{path} is a mesh of Gmsh; expected a scene, which names its mesh: [mesh] file = {path.name!r}. "
                "`skfem-stvk init --type static > scene.toml` writes an example."
            )
        try:
            text = raw.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            line = raw.count(b"\n", 0, error.start) + 1
            raise _not_read(
                f"{path}, line {line}: byte {raw[error.start]:#x} is not UTF-8, the encoding of TOML. Save the file as UTF-8."
            ) from error
        if not text.strip():
            raise _not_read(f"{path} is empty. `skfem-stvk init --type static > {path}` writes an example.")
        return replace(cls.parse(text, path.name), folder=path.parent)

    @classmethod
    def parse(cls, text: str, name: str = "scene.toml") -> SceneSource:
        """Return the source in a text. Raise SceneError, with the location, if it is not TOML."""
        return cls(parsed(text, name), name, text=text)

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> SceneSource:
        """Return the source of data from Python, whose inputs are relative to the folder of the process."""
        refuse_too_much(data, cls.name)
        return cls(deepcopy(dict(data)))

    @cached_property
    def _lines(self) -> dict[Loc, int]:
        return lines_of(self.text) if self.text else {}

    def line(self, loc: Sequence[str | int]) -> int | None:
        """Return the line of a key, or of the nearest table around it; None if a setting replaced it, or there is no text."""
        if self.setting(loc):
            return None
        for end in range(len(loc), 0, -1):
            if tuple(loc[:end]) in self._lines:
                return self._lines[tuple(loc[:end])]
        return None

    def setting(self, loc: Sequence[str | int]) -> str:
        """Return the setting that replaced a key, as the user wrote it; empty if its value is that of the text."""
        return next((self.settings[tuple(loc[:end])] for end in range(len(loc), 0, -1) if tuple(loc[:end]) in self.settings), "")

    def changed(self, settings: Sequence[str]) -> SceneSource:
        """Return the source with values replaced: "analysis.dt=1e-5", "terms[1].g=[0,0,-1]". SceneError if a key path does not
        exist.
        """
        data, made = deepcopy(self.data), dict(self.settings)
        for given in settings:
            loc, value = setting_of(given)
            made |= dict.fromkeys(_set_at(data, loc, value, given), given)
        return replace(self, data=data, settings=made)


def setting_of(given: str) -> tuple[Loc, Any]:
    """Return the key path and the value of a setting; quotation marks are optional for text that is no other value.

    >>> setting_of("terms[1].g=[0, 0, -1]"), setting_of("mesh.file=2nd.msh"), setting_of("fixed.'left wall'=xy")
    ((('terms', 1, 'g'), [0, 0, -1]), (('mesh', 'file'), '2nd.msh'), (('fixed', 'left wall'), 'xy'))
    """
    if "\0" in given or given.encode(errors="replace") != given.encode(errors="surrogatepass"):
        raise _not_set(given, "it has bytes that are no UTF-8, or a zero byte; expected text")
    path, *values = split(given, "=", 1)
    text = "".join(values)
    if not path or not text:
        raise _not_set(given, "expected KEY=VALUE, such as analysis.dt=1e-5 or 'terms[1].g=[0,0,-1]'")
    loc: list[str | int] = []
    position = 0
    while position < len(path):
        step = STEP.match(path, position)
        if step is None or (path[position] not in ".[" if loc else path[position] in ".["):
            raise _not_set(given, f"{shown(path)} is not a key; expected names and [numbers], such as terms[1].g")
        loc.append(int(step["index"]) if step["index"] is not None else step["bare"] or step["quoted"] or step["literal"] or "")
        position = step.end()
        if len(loc) > DEEPEST:
            raise _not_set(given, f"the key has more than {DEEPEST} parts")
    try:
        found = parsed(f"value = {text}", given)
    except SceneError as error:
        if text[0] in "[{\"'":
            raise _not_set(given, f"the value {shown(text)} is not valid: {error.complaints[0][2].rstrip('.')}") from None
        return tuple(loc), text
    if len(found) > 1:
        raise _not_set(
            given, f"the value {shown(text)} has several lines with keys; expected one value. Set each key by its own --set"
        )
    return tuple(loc), found["value"]


def _set_at(data: dict[str, Any], loc: Loc, value: Any, given: str) -> list[Loc]:
    """Set the value at a key path. Missing tables are made; entries of lists must exist.

    Returns the key paths of the value and of the new tables, with the entries of lists counted from 0.
    """
    table: Any = data
    key_path: Loc = ()
    new: list[Loc] = []
    for depth, key in enumerate(loc):
        parent = path_of(loc[:depth])
        if isinstance(key, int):
            if not isinstance(table, list):
                raise _not_set(given, f"{parent} is not a list, so it has no entry {key}")
            if not -len(table) <= key < len(table):
                raise _not_set(
                    given, f"{parent} has {len(table)} entries, counted from 0; expected a number below {len(table)}, not {key}"
                )
            key %= len(table)
        elif not isinstance(table, dict):
            entry = f"{parent}[{key}]" if key.isdecimal() else f"{parent}[0].{key}"
            hint = f"; entries of a list need a number, as in {entry}" if isinstance(table, list) else ""
            raise _not_set(given, f"{parent} is not a table, so it has no key {key!r}{hint}")
        key_path = (*key_path, key)
        if depth == len(loc) - 1:
            new.append(key_path)
            table[key] = value
            continue
        if isinstance(table, dict) and key not in table:
            new.append(key_path)
            table[key] = {}
        table = table[key]
    return new


def _not_set(given: str, why: str) -> SceneError:
    return SceneError(f"--set {given[:200]}: {why}.", [("", None, why)])


def _not_read(message: str) -> SceneError:
    return SceneError(message, [("", None, message)])


# values of a sweep


class Axis(NamedTuple):
    """Key of a scene with the values that it takes in turn."""

    loc: Loc
    texts: tuple[str, ...]  # texts of the values, as TOML has them
    values: tuple[Any, ...]

    @property
    def path(self) -> str:
        """Key as a user writes it."""
        return path_of(self.loc)

    @property
    def of_numbers(self) -> bool:
        """Whether there are several values, all of them numbers."""
        return len(self.values) > 1 and all(isinstance(one, int | float) and not isinstance(one, bool) for one in self.values)


def axes_of(settings: Mapping[str, Iterable[Any]] | Sequence[str]) -> list[Axis]:
    """Return keys with their values, from `--set` texts or from a dictionary.

    Commas separate values, except within quotation marks, lists and tables.

    >>> [(axis.path, axis.values) for axis in axes_of(["analysis.steps=5,10", "terms[1].g=[0,-1],[0,-2]"])]
    [('analysis.steps', (5, 10)), ('terms[1].g', ([0, -1], [0, -2]))]
    >>> axes_of({"analysis.steps": [5, 10]}) == axes_of(["analysis.steps=5,10"])
    True

    Raises
    ------
    SceneError
        with all faults at once: a key without a value, an invalid value, a key that is repeated.
    """
    axes: list[Axis] = []
    wrong: list[str] = []
    for key, texts in _given(settings, wrong):
        try:
            found = [setting_of(f"{key}={text}") for text in texts]
            if found[0][0] in [axis.loc for axis in axes]:
                wrong.append(f"--set {key}: it is set twice; give all of its values at once, as {key}=1,2")
            axes.append(Axis(found[0][0], tuple(texts), tuple(value for _, value in found)))
        except SceneError as error:
            wrong.append(str(error))
    if not axes and not wrong:
        wrong.append("A sweep needs values: --set materials.steel.young=1e9,2e9,4e9")
    refuse_all(wrong, "The sweep")
    return axes


def _given(settings: Mapping[str, Iterable[Any]] | Sequence[str], wrong: list[str]) -> Iterable[tuple[str, list[str]]]:
    """Yield keys and the texts of their values."""
    if isinstance(settings, Mapping):
        for key, values in settings.items():
            values = values.tolist() if hasattr(values, "tolist") else values
            if isinstance(values, str | Mapping) or not isinstance(values, Iterable) or not (listed := list(values)):
                wrong.append(f"{key}: got {shown(values)}; expected a list of values, such as [1e9, 2e9]")
            else:
                yield str(key), [value_text(one) for one in listed]
        return
    for given in [settings] if isinstance(settings, str) else settings:
        key, *rest = split(given, "=", 1)
        texts = split("".join(rest), ",")
        if not all(texts):
            wrong.append(f"--set {given}: expected KEY=VALUE,VALUE,..., such as analysis.steps=5,10, without empty values")
        else:
            yield key, texts


def split(text: str, mark: str, most: int | None = None) -> list[str]:
    """Return the parts of a text between marks, at most `most`. Marks within quotation marks, brackets and braces do not count.

    >>> split("[0, 0, -1], 'a,b', {x = 1, y = 2}", ",")
    ['[0, 0, -1]', "'a,b'", '{x = 1, y = 2}']
    """
    parts: list[str] = []
    begin, depth, quote, skipped = 0, 0, "", False
    for position, one in enumerate(text):
        if skipped:
            skipped = False
        elif quote:
            skipped = one == "\\" and quote == '"'
            quote = "" if one == quote else quote
        elif one in "\"'":
            quote = one
        elif one in "[{":
            depth += 1
        elif one in "]}":
            depth -= 1
        elif one == mark and depth == 0 and len(parts) != most:
            parts.append(text[begin:position].strip())
            begin = position + 1
    return [*parts, text[begin:].strip()]


def refuse_all(wrong: Sequence[str], name: str, complaints: Sequence[tuple[str, int | None, str]] | None = None) -> None:
    """Raise SceneError with all faults, if there are any; `complaints` are the same with keys and lines."""
    if wrong:
        head = f"{name}: " if len(wrong) == 1 else f"{name} has {len(wrong)} errors:\n  "
        raise SceneError(head + "\n  ".join(wrong), [("", None, one) for one in wrong] if complaints is None else complaints)
