"""Conversion of TOML text into data with the line of each key, or into an error with its location; and of data into TOML text."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias

from ..arguments import shown
from ..errors import SceneError, StvkError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

#: Key path of a value: keys of tables and indices of lists, ("terms", 1, "g").
Loc: TypeAlias = tuple[str | int, ...]
#: Maximum levels of tables and lists in a scene, parts of a dotted key, and entries of a table or a list of anything but numbers.
#: No scene comes near these limits. Larger files would take time that grows with the square.
DEEPEST, MOST_ENTRIES = 50, 5_000
#: A dotted key, among other things.
DOTTED = re.compile(r"[^\s.=,\[\]{}#]+(?:[ \t]*\.[ \t]*[^\s.=,\[\]{}#]+)*")
#: Maximum length of a line in a message.
MOST_SHOWN = 100
#: Strings, comments, and the signs and words between them.
TOKEN = re.compile(
    r"""\"{3}(?:\\.|[^\\])*?\"{3}(?!\")|'{3}.*?'{3}(?!')|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|#[^\n]*|[][{}=,.\n]|[^][{}=,.\n\s#"']+""",
    re.DOTALL,
)
#: Words for truth values in other languages, and those of TOML.
TRUTH = {"yes": "true", "on": "true", "true": "true", "no": "false", "off": "false", "false": "false"}
#: Words by which Python's parser reports a key or table that exists already.
TWICE = ("Cannot overwrite", "Cannot declare", "Cannot mutate", "Cannot redefine", "Duplicate")


def path_of(loc: Loc) -> str:
    """Return a key path as a user writes it; "" for the scene as a whole.

    >>> path_of(("terms", 1, "g", 0)), path_of(("fixed", "left wall"))
    ('terms[1].g[0]', 'fixed."left wall"')
    """
    path = ""
    for one in loc:
        if isinstance(one, int):
            path += f"[{one}]"
        else:
            path += ("." if path else "") + (one if re.fullmatch(r"[A-Za-z0-9_-]+", one) else quoted(one))
    return path


def quoted(text: str) -> str:
    """Return text as TOML writes it.

    >>> print(quoted('a "b"\\n'))
    "a \\"b\\"\\n"
    """
    short = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}
    return '"' + "".join(short.get(c, c if c.isprintable() else f"\\U{ord(c):08x}") for c in text) + '"'


def parsed(text: str, name: str) -> dict[str, Any]:
    """Return the data of TOML text. Raise SceneError with line, column and likely cause if it is invalid; `name` is its file's."""
    text = text if text.endswith("\n") else text + "\n"
    if any(one[0].count(".") >= DEEPEST for one in DOTTED.finditer(text)):
        raise _too_much(name, f"a key has more than {DEEPEST} parts between dots.")
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise _too_much(name, "lists or tables are nested too deep.") from None
    except tomllib.TOMLDecodeError as error:
        raise _refusal(text, name, str(error)) from None
    except ValueError:  # from Python's `int`, without a position in the text
        raise _too_much(name, "a whole number has too many digits.") from None
    refuse_too_much(data, name)
    return data


def refuse_too_much(data: Any, name: str) -> None:
    """Raise SceneError if tables and lists are nested too deep, or have too many entries."""
    level = [data]
    for _ in range(DEEPEST):
        inner: dict[int, Any] = {}  # a table from Python may occur several times
        for one in level:
            entries = list(one.values() if isinstance(one, Mapping) else one)
            if len(entries) > MOST_ENTRIES and (isinstance(one, Mapping) or any(isinstance(e, Mapping | str) for e in entries)):
                raise _too_much(name, f"a table or list has {len(entries)} entries; expected at most {MOST_ENTRIES}.")
            inner |= {id(entry): entry for entry in entries if isinstance(entry, Mapping | list | tuple)}
        level = list(inner.values())
    if level:
        raise _too_much(name, f"lists or tables are nested too deep; expected at most {DEEPEST} levels.")


def _too_much(name: str, why: str) -> SceneError:
    return SceneError(f"{name}: {why}", [("", None, why)])


def lines_of(text: str) -> dict[Loc, int]:
    """Return the first line of each key, table and entry of a list, counted from 1.

    >>> lines_of("a.b = [1,\\n2]\\n[[terms]]\\n[terms.time]\\nk = 1")[("terms", 0, "time", "k")]
    5
    """
    lines: dict[Loc, int] = {}
    for loc, line in _keys_and_entries(text):
        lines.setdefault(loc, line)
    return lines


def _keys_and_entries(text: str) -> Iterator[tuple[Loc, int]]:
    """Yield all key paths with their lines in the order of the text, which is TOML or the beginning of TOML."""
    tokens, counts = _Tokens(text), dict[Loc, int]()
    table: Loc = ()
    while tokens.next:
        line = tokens.line
        if tokens.skip("\n"):
            continue
        if not tokens.skip("["):
            yield from _pair(tokens, table)
            continue
        table, repeated = (), tokens.skip("[")
        keys = tokens.dotted_key()
        for depth, one in enumerate(keys, 1):
            table = (*table, one)
            yield table, line
            if repeated and depth == len(keys):
                counts[table] = counts.get(table, 0) + 1
            if table in counts:
                table = (*table, counts[table] - 1)
                yield table, line
        while tokens.skip("]"):
            pass


def _pair(tokens: _Tokens, loc: Loc) -> Iterator[tuple[Loc, int]]:
    """Yield the key paths of a key with its value."""
    line = tokens.line
    for one in tokens.dotted_key():
        loc = (*loc, one)
        yield loc, line
    tokens.take()  # the equals sign
    yield from _value(tokens, loc)


def _value(tokens: _Tokens, loc: Loc) -> Iterator[tuple[Loc, int]]:
    """Yield the key paths within a value."""
    if tokens.skip("{"):
        while tokens.next and not tokens.skip("}"):
            if not tokens.skip(",", "\n"):
                yield from _pair(tokens, loc)
    elif tokens.skip("["):
        number = 0
        while tokens.next and not tokens.skip("]"):
            if not tokens.skip(",", "\n"):
                yield (*loc, number), tokens.line
                yield from _value(tokens, (*loc, number))
                number += 1
    else:
        tokens.take()
        while tokens.next and tokens.next not in ",]}\n":  # a number has several tokens
            tokens.take()


class _Tokens:
    """Tokens of TOML text without comments, in order; `next` is empty at the end, `line` is the line of `next`."""

    def __init__(self, text: str) -> None:
        self._found = (one[0] for one in TOKEN.finditer(text) if one[0][0] != "#")
        self.next, self.line = "", 1
        self.take()

    def take(self) -> str:
        """Return the next token and advance."""
        taken = self.next
        self.line += taken.count("\n")
        self.next = next(self._found, "")
        return taken

    def skip(self, *tokens: str) -> bool:
        """Advance if one of these is next, and return whether it was."""
        return self.next in tokens and bool(self.take())

    def dotted_key(self) -> list[str]:
        """Return the parts of a dotted key and advance."""
        keys = [_bare(self.take())]
        while self.skip("."):
            keys.append(_bare(self.take()))
        return keys


def _bare(key: str) -> str:
    """Return a key without its quotation marks."""
    return next(iter(tomllib.loads(f"{key} = 1"))) if key[:1] in ("'", '"') else key


# errors for invalid TOML


def _refusal(text: str, name: str, reason: str) -> SceneError:
    """Return the error for invalid TOML: file, line, column, the parser's words, a likely cause, and the marked line."""
    rows = text.replace("\r\n", "\n").split("\n")[:-1]  # `splitlines` also splits at other characters
    position = re.search(r"\(at line (\d+), column (\d+)\)", reason)
    line, column = (int(position[1]), int(position[2])) if position else (len(rows) + 1, 1)
    if line > len(rows):
        line, column = len(rows), len(rows[-1]) + 1
    row = rows[line - 1].replace("\t", " ")
    words = re.sub(r" \(at .*\)$", "", reason)
    message = f"{words[:1].lower()}{words[1:]}.{_cause(rows, line, column, words)}"
    begin = max(0, min(column - MOST_SHOWN // 2, len(row) - MOST_SHOWN))
    marked = f"    {row[begin : begin + MOST_SHOWN]}\n    {' ' * (column - 1 - begin)}^"
    return SceneError(f"{name}, line {line}, column {column}: {message}\n{marked}", [("", line, message)])


def _cause(rows: list[str], line: int, column: int, reason: str) -> str:
    """Return the likely cause of a frequent fault, preceded by a blank; "" for others. `reason` are the words of the parser."""
    rest = rows[line - 1][column - 1 :].partition("#")[0].strip()
    if reason.startswith(TWICE):
        return _twice("\n".join([*rows[: line - 1], rows[line - 1][: column - 1]]))
    if "Invalid value" in reason:
        word = re.split(r"[,\]}]", rest, maxsplit=1)[0].strip()
        if word.lower() in TRUTH:
            return f" Write {TRUTH[word.lower()]}."
        return f" Text needs quotation marks: {quoted(word)}." if re.match(r"[^\W\d]|[./~]", word) else ""
    if "after a statement" in reason:
        return " Numbers have a decimal point, no comma and no unit; text needs quotation marks; lists need [brackets]."
    return " A comma or a bracket is missing before this." if reason.startswith("Unclosed") else ""


def _twice(text: str) -> str:
    """Name the last key in the text that occurs earlier, and its line."""
    first: dict[Loc, int] = {}
    again: Loc = ()
    for loc, line in _keys_and_entries(text):
        if loc in first and isinstance(loc[-1], str):
            again = loc
        first.setdefault(loc, line)
    where = f" '{path_of(again)}' is already defined in line {first[again]}: remove one of them." if again else ""
    return f"{where} Each entry of a list of tables needs [[two brackets]]."


# data as text


def written(data: Mapping[str, Any]) -> str:
    """Return data as TOML text: tables under headers, lists of tables with a header each, values on one line.

    >>> print(written({"units": "SI", "terms": [{"type": "gravity", "g": [0.0, -9.81]}], "fixed": {"left wall": "xyz"}}))
    units = "SI"
    <BLANKLINE>
    [[terms]]
    type = "gravity"
    g = [0.0, -9.81]
    <BLANKLINE>
    [fixed]
    "left wall" = "xyz"
    <BLANKLINE>
    """
    return "\n".join(_rows(data, ())).strip() + "\n"


def _rows(table: Mapping[str, Any], loc: Loc) -> Iterator[str]:
    """Yield the lines of a table: values first, then tables and lists of tables; a table with only tables needs no header."""
    inner = {name: one for name, one in table.items() if isinstance(one, Mapping) or _is_list_of_tables(one)}
    for name, value in table.items():
        if name not in inner:
            yield f"{path_of((name,))} = {value_text(value)}"
    for name, one in inner.items():
        header = path_of((*loc, name))
        for each in one if isinstance(one, list) else [one]:
            if isinstance(one, list):
                yield from ("", f"[[{header}]]")
            elif not one or not all(isinstance(value, Mapping) for value in one.values()):
                yield from ("", f"[{header}]")
            yield from _rows(each, (*loc, name))


def _is_list_of_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(one, Mapping) for one in value)


def value_text(value: Any) -> str:
    """Return a value of Python's as TOML text on one line. StvkError for one that TOML does not have.

    >>> value_text([1e-5, True, "a", {"b c": 1}])
    '[1e-05, true, "a", {"b c" = 1}]'
    """
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{path_of((str(name),))} = {value_text(one)}" for name, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(value_text, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str | os.PathLike):
        return quoted(os.fspath(value))
    raise StvkError(f"got {shown(value)}; expected a number, a text, true or false, or a list or table of these, as in TOML.")
