"""TOML text turned into data, with the line of each key; or an error that says where it is no TOML, and the likely cause."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias

import tree_sitter_toml
from tree_sitter import Language, Node, Parser

from ..arguments import shown
from ..errors import SceneError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

#: The place of a value: keys of tables and indices of lists, ("terms", 1, "g").
Loc: TypeAlias = tuple[str | int, ...]
#: Levels of tables and lists that a scene may have, parts of a dotted key, and entries of a table or a list of other things than
#: numbers: no scene comes near, and more takes time that grows with the square.
DEEPEST, MOST_ENTRIES = 50, 5_000
#: A dotted key, among other things.
DOTTED = re.compile(r"[^\s.=,\[\]{}#]+(?:[ \t]*\.[ \t]*[^\s.=,\[\]{}#]+)*")
#: What a line is cut to in a message.
MOST = 100
CLOSING = {"[": "]", "{": "}"}
#: What Python's parser says of a key or table that is there already.
TWICE = ("Cannot overwrite", "Cannot declare", "Cannot mutate", "Duplicate")


def path_of(loc: Loc) -> str:
    """A place as a user writes it; "" for the scene as a whole.

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
    """Text as TOML writes it.

    >>> print(quoted('a "b"\\n'))
    "a \\"b\\"\\n"
    """
    short = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}
    return '"' + "".join(short.get(c, c if c.isprintable() else f"\\U{ord(c):08x}") for c in text) + '"'


def parsed(text: str, name: str) -> dict[str, Any]:
    """The data of TOML text. SceneError with the line, the column and the likely cause if it is none; `name` is its file's."""
    text = text if text.endswith("\n") else text + "\n"
    if any(one[0].count(".") >= DEEPEST for one in DOTTED.finditer(text)):
        raise _too_much(name, f"a key has more than {DEEPEST} parts between dots.")
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise _too_much(name, "lists or tables are nested too deep.") from None
    except ValueError as error:  # TOMLDecodeError is one; so is what Python says of a number with thousands of digits
        raise _refusal(text, name, str(error)) from None
    refuse_too_much(data, name)
    return data


def refuse_too_much(data: Any, name: str) -> None:
    """Raise SceneError if tables and lists are nested too deep, or have too many entries."""
    level = [data]
    for _ in range(DEEPEST):
        inner: dict[int, Any] = {}  # a table of Python's may be in several places
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
    """The line of each key, table and entry of a list, counted from 1: where it stands first.

    >>> lines_of("a.b = [1,\\n2]\\n[[terms]]\\n[terms.time]\\nk = 1")[("terms", 0, "time", "k")]
    5
    """
    lines: dict[Loc, int] = {}
    for loc, line in _occurrences(text):
        lines.setdefault(loc, line)
    return lines


def _occurrences(text: str) -> Iterator[tuple[Loc, int]]:
    """All places with their lines, in the order of the text; text that is no TOML gives what can be made out."""
    counts: dict[Loc, int] = {}

    def inner(loc: Loc) -> Loc:
        return (*loc, counts[loc] - 1) if loc in counts else loc

    table: Loc = ()
    for node in Parser(Language(tree_sitter_toml.language())).parse(text.encode("utf-8", "surrogatepass")).root_node.children:
        if node.type == "pair":
            yield from _pair(node, table)
        elif node.type in ("table", "table_array_element"):
            keys, line = _keys(node), node.start_point[0] + 1
            table = ()
            for depth, one in enumerate(keys, 1):
                table = (*table, one)
                if depth == len(keys) and node.type == "table_array_element":
                    yield table, line
                    counts[table] = counts.get(table, 0) + 1
                table = inner(table)
                yield table, line
            for child in node.children:
                if child.type == "pair":
                    yield from _pair(child, table)


def _pair(node: Node, table: Loc) -> Iterator[tuple[Loc, int]]:
    loc, line = table, node.start_point[0] + 1
    for one in _keys(node):
        loc = (*loc, one)
        yield loc, line
    yield from _value(node.children[-1], loc)


def _value(node: Node, loc: Loc) -> Iterator[tuple[Loc, int]]:
    if len(loc) > DEEPEST:
        return
    if node.type == "inline_table":
        for child in node.children:
            if child.type == "pair":
                yield from _pair(child, loc)
    elif node.type == "array":
        entries = [child for child in node.named_children if child.type not in ("comment", "ERROR")]
        for number, child in enumerate(entries):
            yield (*loc, number), child.start_point[0] + 1
            yield from _value(child, (*loc, number))


def _keys(node: Node) -> list[str]:
    """The keys in a header or before an equals sign."""
    for child in node.children:
        if child.type in ("bare_key", "quoted_key"):
            return [_key(child)]
        if child.type == "dotted_key":
            return list(_dotted(child))
    return []


def _dotted(node: Node) -> Iterator[str]:
    for child in node.children:
        if child.type == "dotted_key":
            yield from _dotted(child)
        elif child.type in ("bare_key", "quoted_key"):
            yield _key(child)


def _key(node: Node) -> str:
    text = (node.text or b"").decode("utf-8", "replace")
    if node.type == "bare_key":
        return text
    try:
        return next(iter(tomllib.loads(f"{text} = 1")))
    except ValueError:
        return text


# what is wrong with text that is no TOML


def _refusal(text: str, name: str, said: str) -> SceneError:
    rows = text.splitlines()
    place = re.search(r"\(at line (\d+), column (\d+)\)", said)
    line, column = (int(place[1]), int(place[2])) if place else (max(len(rows), 1), len(rows[-1]) + 1 if rows else 1)
    said = re.sub(r" \(at .*\)$", "", said)
    if line > len(rows):
        line, column = len(rows), len(rows[-1]) + 1
    row = rows[line - 1].replace("\t", " ")
    cause = _cause(text, line, column, said)
    begin = max(0, min(column - MOST // 2, len(row) - MOST))
    cut = row[begin : begin + MOST]
    message = f"{name}, line {line}, column {column}: {cause}\n    {cut}\n    {' ' * (column - 1 - begin)}^"
    return SceneError(message, [("", line, cause)])


def _cause(text: str, line: int, column: int, said: str) -> str:
    """What is probably wrong at a place, in words; `said` is what Python's parser says."""
    row = text.splitlines()[line - 1]
    rest, before = row[column - 1 :].strip(), row[: column - 1].strip()
    if said.startswith(TWICE):
        return _twice(text, line)
    if "digits" in said and "limit" in said:
        return "a whole number has more digits than any value needs."
    if said.startswith("Unclosed"):
        return _unclosed(text, line, column)
    if "string" in said and "\\" in said:
        return "a backslash in quotation marks begins a special character. Write paths with /, or the text in 'single quotes'."
    if "\\n" in said or "Unterminated" in said or re.search(r"Expected ['\"]+'?\"?$", said):
        return "the text that begins here has no quotation mark at its end." if not before else _open_text(row)
    if not rest.isprintable() or "Illegal character" in said or "Found invalid character" in said:
        return "a control character. Was the file damaged, or is it no text?"
    if "Invalid value" in said:
        return _no_value(rest, before)
    if "after a statement" in said:
        return _more_than_a_value(row, rest, before)
    if "Expected '='" in said:
        return _no_equals(rest, before)
    if "declaration" in said:
        bracket = "]]" if "]]" in said else "]"
        return f"the header of a table is not closed with '{bracket}' behind its name; names with blanks need quotation marks."
    if "key part" in said and (not rest or rest.startswith("}")) and "{" in row:
        return "a table in braces stands on one line, without a comma behind its last entry. Longer ones get a [header]."
    if "key part" in said or "Invalid statement" in said:
        return _no_statement(rest)
    return f"{said[:1].lower()}{said[1:]}."


def _twice(text: str, line: int) -> str:
    """Which key or table is there a second time in a line, and where it is first."""
    first: dict[Loc, int] = {}
    again: list[tuple[Loc, int]] = []
    for loc, where in _occurrences(text):
        if where == line and loc in first:
            again.append((loc, first[loc]))
        elif where < line:
            first.setdefault(loc, where)
    if not again:
        return "a key or table is there twice."
    loc, where = again[-1]
    return (
        f"'{path_of(loc)}' is there already, in line {where}. One of the two goes; lists of tables have [[two brackets]] each time."
    )


def _unclosed(text: str, line: int, column: int) -> str:
    """Which bracket is open at a place."""
    opened: list[tuple[str, int, int]] = []
    pattern = re.compile(r'"""(?:\\.|[^\\])*?"""|\'\'\'.*?\'\'\'|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|#[^\n]*|[][{}\n]', re.DOTALL)
    number, start = 1, 0
    for token in pattern.finditer(text):
        one = token[0]
        if (number, token.start() - start + 1) >= (line, column):
            break
        if one in CLOSING:
            opened.append((one, number, token.start() - start + 1))
        elif one in CLOSING.values() and opened:
            opened.pop()
        if "\n" in one:
            number, start = number + one.count("\n"), token.start() + one.rindex("\n") + 1
    if not opened:
        return "a bracket is not closed."
    bracket, number, where = opened[-1]
    what = "the list" if bracket == "[" else "the table in braces"
    return (
        f"expected ',' or '{CLOSING[bracket]}': {what} that begins in line {number}, column {where} is not closed, "
        "or a comma is missing in it."
    )


def _open_text(row: str) -> str:
    mark = "'" if row.count('"') % 2 == 0 else '"'
    return f"the text that begins in column {row.find(mark) + 1} has no {mark} at its end."


def _no_value(rest: str, before: str) -> str:
    word = re.split(r"[\s,\]}#]", rest, maxsplit=1)[0]
    if not rest or rest.startswith("#"):
        return "the value is missing behind '='."
    if rest[0] in ",]}":
        return "a value is missing before this: is there one comma too many?"
    if rest.startswith("="):
        return "one '=' is enough."
    if rest[0] in "“”„‘’«»`´":
        return "text stands in plain quotation marks, \"so\" or 'so'; these are others."
    if word.lower() in ("true", "false", "yes", "no", "on", "off"):
        return f"{word} is no value; write {'true' if word.lower() in ('true', 'yes', 'on') else 'false'}."
    if word.lower() in ("none", "null"):
        return f"{word} is no value in TOML: leave the key out to have its default."
    if re.match(r"[+-]?\.\d", word):
        return f"{shown(word)} is no number in TOML; write a digit before the point, as in 0.5."
    if re.match(r"[^\W\d]|[./~]", word):
        return f"text needs quotation marks: {quoted(rest.split('#')[0].strip().rstrip(',]}'))}."
    return f"{shown(word)} is no value: neither a number, nor text in quotation marks, true or false, a [list] or a {{table}}."


def _more_than_a_value(row: str, rest: str, before: str) -> str:
    """The value ended, as the parser sees it, and more follows on the line."""
    whole = row.partition("=")[2].split("#")[0].strip()
    if row.lstrip().startswith("["):
        return "more follows the header of a table; is there one bracket too many?"
    if re.fullmatch(r"[+-]?\d+,\d+([eE][+-]?\d+)?", whole):
        return f"a comma within a number; TOML writes {whole.replace(',', '.')}, and lists in [brackets]."
    if "," in whole and re.fullmatch(r"[-+\d.,eE\s]+", whole):
        return f"a list stands in brackets: [{whole}]."
    if re.match(r"[+-]?0\d", whole):
        return f"{shown(whole)} begins with 0, which TOML does not take for a number; leave the 0 out, or write text in quotes."
    if re.fullmatch(r"[+-]?\d+\.([eE][+-]?\d+)?", whole):
        return f"{shown(whole)} is no number in TOML; write a digit behind the point, as in 1.0."
    if re.match(r"[+-]?\d[\d_.]*([eE][+-]?\d+)?\s*[^\W\d]+", whole) and '"' not in whole:
        return (
            f"{shown(whole)} is no number. Values are in the units that `units` names, and written without them; text needs quotes."
        )
    return "more follows the value: each key has a line of its own, and text needs quotation marks."


def _no_equals(rest: str, before: str) -> str:
    if rest.startswith(":"):
        return "TOML writes '=' between a key and its value."
    if not rest:
        return f"a key without a value: `key = value`, or [{before}] if it is meant as a table."
    return "expected '=' behind a key; keys with blanks or other signs than letters, digits, _ and - need quotation marks."


def _no_statement(rest: str) -> str:
    if rest.startswith("="):
        return "the key is missing before '='."
    if rest.startswith(("//", ";", "%", "/*")):
        return "comments begin with #."
    if rest[:1] in ("]", "}", ","):
        return f"'{rest[0]}' closes or parts nothing: is the bracket before it missing, or is it one too many?"
    return "expected `key = value`, a [table] or a # comment; keys with other signs than letters, digits, _ and - need quotes."
