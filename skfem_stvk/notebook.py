"""Tables that notebooks show for objects."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any


def html_table(title: str, rows: Iterable[Sequence[Any]], picture: str = "") -> str:
    """Return a table as HTML: the title, rows whose first cell is their name, and the HTML of a picture below.

    >>> html_table("Bar", [("E < 1", 2.5)])
    '<table><caption><b>Bar</b></caption><tr><th>E &lt; 1</th><td>2.5</td></tr></table>'
    """
    cells = ([f"<th>{escape(str(name))}</th>", *(f"<td>{escape(str(value))}</td>" for value in values)] for name, *values in rows)
    body = "".join(f"<tr>{''.join(row)}</tr>" for row in cells)
    return f"<table><caption><b>{escape(title)}</b></caption>{body}</table>{picture}"
