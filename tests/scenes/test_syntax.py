"""The TOML functions return the lines of keys, readable syntax errors, and text that is read as the same data."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skfem_stvk.errors import SceneError
from skfem_stvk.scenes.syntax import lines_of, parsed, written

#: Keys of every form; values or names of keys are their line numbers.
FORMS = '''one = 1 # [no]
"two # 2" = 2
three.a . "b.c" = 3
list = [
  5, # ], not the end
  [6,
   7],
  { k = 8, "m" = { n = 8 } },
]
text = """10
[eleven]
t = 12"""
other = \'\'\'
"""
# \'\'\'
more = [ """
""", "#]", 17.5e-3, 1979-05-27 07:32:00 ]
[[terms]]
g = 19
[terms.time]
k = 21
[[terms]]
[[terms.parts]]
u = 24
[[terms.parts]]
u = 26
[ x . "y z" ]
w = 28
'''
LINES = {
    ("one",): 1,
    ("two # 2",): 2,
    ("three", "a", "b.c"): 3,
    ("list",): 4,
    ("list", 0): 5,
    ("list", 1): 6,
    ("list", 1, 1): 7,
    ("list", 2, "m", "n"): 8,
    ("text",): 10,
    ("other",): 13,
    ("more", 0): 16,
    ("more", 1): 17,
    ("more", 3): 17,
    ("terms", 0): 18,
    ("terms", 0, "g"): 19,
    ("terms", 0, "time"): 20,
    ("terms", 0, "time", "k"): 21,
    ("terms", 1): 22,
    ("terms", 1, "parts", 0): 23,
    ("terms", 1, "parts", 0, "u"): 24,
    ("terms", 1, "parts", 1, "u"): 26,
    ("x", "y z"): 27,
    ("x", "y z", "w"): 28,
}


def key_paths(data, loc=()):
    """Return the key paths of all keys and list entries in the data."""
    entries = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    return {loc}.union(*(key_paths(value, (*loc, one)) for one, value in entries))


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_keys_of_every_form_have_their_line(end):
    lines = lines_of(FORMS.replace("\n", end))
    assert lines.keys() | {()} == key_paths(parsed(FORMS, "forms.toml"))
    assert {loc: lines[loc] for loc in LINES} == LINES


@pytest.mark.parametrize("mark", ["'", '"'])
def test_a_text_may_end_with_quotation_marks(mark):
    text = "a = [QQQxQQQQ, QbQ] # Q\nb = [QQQQQQ, QQQxQQQQQ, QQ]\n[c]\nd = QeQ\n".replace("Q", mark)
    lines = lines_of(text)
    assert lines.keys() | {()} == key_paths(parsed(text, "quotes.toml"))
    assert [lines[loc] for loc in (("a", 1), ("b", 2), ("c", "d"))] == [1, 2, 4]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = 1\n[b]\na = 2\na = {x = 3}\n", "line 4, column 12: cannot overwrite a value. 'b.a' is already defined in line 3"),
        ("a.b = 1\na = [1,\n2]\n", "line 3, column 3: cannot overwrite a value. 'a' is already defined in line 1"),
        ("[[a]]\nb = [1]\n[a]\n", "line 3, column 3: cannot declare ('a',) twice. 'a' is already defined in line 1"),
        ("x = {a = 1, 'a' = 2}\n", "'x.a' is already defined in line 1: remove one of them"),
        ("x = [bar/soft.msh, 2]\n", 'line 1, column 6: invalid value. Text needs quotation marks: "bar/soft.msh".'),
        ("x = No # not\n", "line 1, column 5: invalid value. Write false."),
        ("x = 'open\n", 'line 1, column 10: expected "\'"'),
        ("x = [1,\n", "line 1, column 8: invalid value"),
        ("[a.b]\nx = 1\n[a]\nb.y = 1\n", "'a.b' is already defined in line 1"),
        ("# next\x85line\nx = 'a\u2028b'\ny = yes\n", "line 3, column 5: invalid value. Write true.\n    y = yes\n        ^"),
        ("x = 'a'\r\ny = yes\r\n", "line 2, column 5: invalid value. Write true.\n    y = yes\n        ^"),
        (f"x = {'1' * 5000}\ny = 2\n", "scene.toml: a whole number has too many digits."),
    ],
)
def test_a_syntax_error_has_line_and_column_and_the_message_of_the_parser(text, message):
    with pytest.raises(SceneError, match=re.escape(message)):
        parsed(text, "scene.toml")


TEXT = st.text(st.characters(exclude_categories=["Cs"]))
VALUES = st.recursive(
    st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | TEXT,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT, inner, max_size=4),
    max_leaves=12,
)


@given(st.dictionaries(TEXT, VALUES, max_size=5))
def test_written_data_are_read_unchanged(data):
    text = written(data)
    assert parsed(text, "scene.toml") == data
    assert lines_of(text).keys() | {()} == key_paths(data)
