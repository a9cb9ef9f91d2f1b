"""The product of values: which scenes a sweep is made of, and what each of them is called."""

from __future__ import annotations

import hashlib
import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

from ..arguments import path as checked_path
from ..arguments import shown
from ..errors import SceneError, StvkError
from .folder import hash_of
from .scene import Scene
from .source import SceneSource, setting_of
from .syntax import Loc, path_of, quoted

#: A longer name of a folder is cut.
LONGEST = 120


class Axis(NamedTuple):
    """A key of a scene with the values that it takes in turn."""

    loc: Loc
    texts: tuple[str, ...]  # of the values, as TOML has them
    values: tuple[Any, ...]

    @property
    def path(self) -> str:
        """The key as a user writes it."""
        return path_of(self.loc)

    @property
    def of_numbers(self) -> bool:
        """Whether there are several values, all of them numbers."""
        return len(self.values) > 1 and all(isinstance(one, int | float) and not isinstance(one, bool) for one in self.values)


class Planned(NamedTuple):
    """One scene of a sweep: its values, what is to be set, and the name of its folder."""

    values: dict[str, Any]
    settings: tuple[str, ...]
    name: str
    scene: Scene


def axes_of(settings: Mapping[str, Iterable[Any]] | Sequence[str]) -> list[Axis]:
    """Keys with their values, of `--set` texts or of a dictionary.

    Commas part values, but for those within quotation marks, lists and tables.

    >>> [(axis.path, axis.values) for axis in axes_of(["analysis.steps=5,10", "terms[1].g=[0,-1],[0,-2]"])]
    [('analysis.steps', (5, 10)), ('terms[1].g', ([0, -1], [0, -2]))]
    >>> axes_of({"analysis.steps": [5, 10]}) == axes_of(["analysis.steps=5,10"])
    True

    Raises
    ------
    SceneError
        if there is no value, or one that is none, or a key is there twice: all of that at once.
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
    _refuse(wrong, "The sweep")
    return axes


def _given(settings: Mapping[str, Iterable[Any]] | Sequence[str], wrong: list[str]) -> Iterable[tuple[str, list[str]]]:
    """Keys and the texts of their values."""
    if isinstance(settings, Mapping):
        for key, values in settings.items():
            values = values.tolist() if hasattr(values, "tolist") else values
            if isinstance(values, str | Mapping) or not isinstance(values, Iterable) or not (listed := list(values)):
                wrong.append(f"{key}: got {shown(values)}; expected a list of values, such as [1e9, 2e9]")
            else:
                yield str(key), [_toml(one) for one in listed]
        return
    for given in [settings] if isinstance(settings, str) else settings:
        key, *rest = split(given, "=")
        texts = split("=".join(rest), ",")
        if not rest or not all(texts):
            wrong.append(f"--set {given}: expected KEY=VALUE,VALUE,..., such as analysis.steps=5,10, and no value that is empty")
        else:
            yield key, texts


def split(text: str, mark: str) -> list[str]:
    """The parts of a text between marks that stand outside of quotation marks, brackets and braces.

    >>> split("[0, 0, -1], 'a,b', {x = 1, y = 2}", ",")
    ['[0, 0, -1]', "'a,b'", '{x = 1, y = 2}']
    """
    parts, begin, depth, quote, skipped = [], 0, 0, "", False
    for place, one in enumerate(text):
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
        elif one == mark and depth == 0:
            parts.append(text[begin:place].strip())
            begin = place + 1
    return [*parts, text[begin:].strip()]


def planned(
    path: str | os.PathLike[str], settings: Mapping[str, Iterable[Any]] | Sequence[str]
) -> tuple[list[Axis], list[Planned]]:
    """The axes of a sweep, and the product of their values: the last axis changes fastest; every scene is checked.

    Raises
    ------
    SceneError
        with all that is wrong in the scene, in the settings and in any of the scenes, each once; or if two are the same.
    """
    axes = axes_of(settings)
    source = SceneSource.read(checked_path("path", path, "the path of a scene file such as 'thrown.toml'"))
    combinations = list(product(*(range(len(axis.values)) for axis in axes)))
    wrong: Counter[str] = Counter()
    scenes: list[Scene] = []
    for numbers in combinations:
        try:
            scenes.append(Scene.read(path, _settings(axes, numbers)))
        except SceneError as error:
            wrong.update(_each(error, source.name))
    count = len(combinations)
    _refuse([text + (f" (in {times} of {count} runs)" if times < count else "") for text, times in wrong.items()], source.name)
    names = _names(axes, combinations)
    first: dict[str, str] = {}
    twice = []
    for name, scene in zip(names, scenes, strict=True):
        other = first.setdefault(hash_of(scene.data), name)
        if other != name:
            twice.append(f"{other} and {name} are the same scene; give each value once")
    _refuse(twice, source.name)
    values = [{axis.path: axis.values[k] for axis, k in zip(axes, numbers, strict=True)} for numbers in combinations]
    texts = [_settings(axes, numbers) for numbers in combinations]
    return axes, [Planned(*one) for one in zip(values, texts, names, scenes, strict=True)]


def _settings(axes: Sequence[Axis], numbers: Sequence[int]) -> tuple[str, ...]:
    return tuple(f"{axis.path}={axis.texts[k]}" for axis, k in zip(axes, numbers, strict=True))


def _each(error: SceneError, name: str) -> list[str]:
    """What an error of a scene says, complaint by complaint."""
    head, *complaints = str(error).split("\n  ")
    return complaints or [head.removeprefix(f"{name}: ")]


def _refuse(wrong: Sequence[str], name: str) -> None:
    """Raise SceneError with all that is wrong, if anything is."""
    if wrong:
        head = f"{name}: " if len(wrong) == 1 else f"{name} has {len(wrong)} errors:\n  "
        raise SceneError(head + "\n  ".join(wrong), [("", None, one) for one in wrong])


# names of folders


def _names(axes: Sequence[Axis], combinations: Sequence[Sequence[int]]) -> list[str]:
    """A name for each run that a person reads and every file system takes, of the last names of its keys and its values.

    Names that would be the same, or that are cut, end with a hash of what they are the names of.
    """
    short = [_plain(_dotted(_last(axis.loc))) for axis in axes]
    keys = [one if short.count(one) == 1 else _plain(_dotted(axis.loc)) for one, axis in zip(short, axes, strict=True)]
    whole = [
        ",".join(f"{key}={_plain(in_short(axis.values[k]))}" for key, axis, k in zip(keys, axes, numbers, strict=True))
        for numbers in combinations
    ]
    times = Counter(name.lower() for name in whole)  # some file systems do not tell capitals
    names = []
    for name, numbers in zip(whole, combinations, strict=True):
        if times[name.lower()] > 1 or len(name) > LONGEST:
            hashed = hashlib.sha256(repr(_settings(axes, numbers)).encode()).hexdigest()[:8]
            name = f"{name[: LONGEST - 9]}-{hashed}"
        names.append(name)
    return names


def _last(loc: Loc) -> Loc:
    """The last name in a place, and numbers behind it."""
    return loc[max(depth for depth, one in enumerate(loc) if isinstance(one, str)) :]


def _dotted(loc: Loc) -> str:
    return ".".join(map(str, loc))


def _plain(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.+-]+", "_", text)


def in_short(value: Any) -> str:
    """A value in few characters: numbers as a person writes them, lists without brackets.

    >>> in_short(1e9), in_short(0.25), in_short([0.0, 0.0, -9.81]), in_short(True)
    ('1e9', '0.25', '0_0_-9.81', 'true')
    """
    if isinstance(value, Mapping):
        return "_".join(f"{name}_{in_short(one)}" for name, one in value.items())
    if isinstance(value, list | tuple):
        return "_".join(map(in_short, value))
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, float):
        return str(value)
    text = f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return re.sub(r"e\+?(-?)0*", r"e\1", text)


def _toml(value: Any) -> str:
    """A value of Python's as TOML has it on one line."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{quoted(str(name))} = {_toml(one)}" for name, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str | os.PathLike):
        return quoted(os.fspath(value))
    raise StvkError(f"got {shown(value)}; expected a number, a text, true or false, or a list or table of such: what TOML has.")
