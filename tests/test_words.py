"""Docstrings and comments of the package, the studies and the tests are plain English, as far as a program can judge."""

import ast
import io
import re
import tokenize
from functools import cache
from pathlib import Path
from textwrap import dedent

ROOT = Path(__file__).parent.parent
LONGEST = 30
SECTION = re.compile(r"^(Parameters|Attributes|Returns|Yields|Raises|Warns|Notes|Examples|References)\n-+$", re.MULTILINE)
PRIVATE = re.compile(r"\b(spokes?|tangled|outlets?|players?|anew|beside|nobody|fairly|fouls?)\b", re.IGNORECASE)


def is_flag(node):
    """Return whether a definition is a property, whose docstring may be 'Whether ...'."""
    return any("property" in ast.unparse(one) for one in getattr(node, "decorator_list", []))


def begins_with(words):
    """Return the rule that a docstring does not begin with one of the words (a regular expression)."""
    begin = re.compile(rf"({words})\b")
    return lambda text, node: [text.split("\n")[0]] if begin.match(text) else []


def asks_whether(text, node):
    """Return the first line of a function's docstring that begins with 'Whether' in place of 'Return whether'."""
    function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    return [text.split("\n")[0]] if function and not is_flag(node) and text.startswith("Whether") else []


def long_sentences(text, node):
    """Return the sentences of more than 30 words. Text in backticks is one word.

    Sections, formulas, tables and examples do not count.
    """
    prose = re.sub(r"`[^`]*`", "X", SECTION.split(text)[0])
    blocks = re.split(r"\n\s*\n|\n(?=- )", prose)
    flowing = [" ".join(one.split()) for one in blocks if not one.startswith((" ", ">>>", "..", "=="))]
    return [one for block in flowing for one in re.split(r"(?<=[.!?])\s+", block) if len(one.split()) > LONGEST]


def private_words(text, node):
    """Return the words that only this project would understand. Names in backticks are those of the code."""
    prose = re.sub(r"^ *(>>>|\.\.\.) .*$", "", text, flags=re.MULTILINE)
    return PRIVATE.findall(re.sub(r"`[^`]*`", "X", prose))


def is_constructor(node):
    """Return whether a definition is an `__init__`."""
    return isinstance(node, ast.FunctionDef) and node.name == "__init__"


def unknown_parameters(text, node):
    """Return the names in the section Parameters that are neither arguments nor fields. Fields of base classes are not known."""
    section = re.search(r"^Parameters\n-+\n(.*?)(?=\n\n\w[\w ]*\n-+$|\Z)", text, re.MULTILINE | re.DOTALL)
    constructor = next(filter(is_constructor, node.body), None)
    if section is None or (constructor is None and getattr(node, "bases", [])):
        return []
    known = {one.arg for one in ast.walk(constructor or node) if isinstance(one, ast.arg)}
    known |= {one.target.id for one in node.body if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name)}
    names = [name.strip(" *`") for line in section.group(1).splitlines() if line[:1].strip() for name in line.split(",")]
    return [name for name in names if name not in known]


RULES = {
    "begins with a noun or a verb": begins_with("What|How|Which|That"),
    "begins with its subject": begins_with("Those|It|Of|As|One of|One that|One whose"),
    "returns whether": asks_whether,
    "has short sentences": long_sentences,
    "has the field's words": private_words,
    "names its parameters": unknown_parameters,
}


@cache
def docstrings(source):
    """Return line, text and definition of each docstring of a module."""
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
    nodes = [node for node in ast.walk(ast.parse(source)) if isinstance(node, kinds)]
    return [(node.body[0].lineno, text, node) for node in nodes if (text := ast.get_docstring(node))]


def comments(source):
    """Yield line and text of each comment of a module."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


def breaches(rule, source):
    """Return line and text of what breaks a rule in a module. Comments are judged by their words alone."""
    found = [(line, text) for line, doc, node in docstrings(source) for text in RULES[rule](doc, node)]
    if RULES[rule] is private_words:
        found += [(line, word) for line, text in comments(source) for word in private_words(text, None)]
    return found


@cache
def sources(folder):
    """Return path and text of each module of a folder."""
    return [(path.relative_to(ROOT), path.read_text(encoding="utf-8")) for path in sorted((ROOT / folder).rglob("*.py"))]


def test_every_docstring_keeps_the_rules():
    files = [one for folder in ("skfem_stvk", "validation", "tests") for one in sources(folder)]
    found = [f"{path}:{line}: {rule}: {text}" for path, source in files for rule in RULES for line, text in breaches(rule, source)]
    assert len(files) > 500 and not found, f"{len(found)} docstrings break a rule:\n" + "\n".join(found[:20])


PLANTED = {
    "begins with a noun or a verb": [
        "What is looked for, and how.",
        "How far the body moves.",
        "Which edges share a node.",
        "That K is symmetric.",
    ],
    "begins with its subject": [
        "Those with a pair.",
        "It is K.",
        "Of a mesh.",
        "As in `Problem`.",
        "One of two.",
        "One that fails.",
        "One whose K is 0.",
    ],
    "returns whether": ["Whether K is symmetric."],
    "has short sentences": [
        "Return K. " + "The edge has a `rest length` " * 6 + "and so on.",
        "Return K.\n\n- First.\n- " + "word " * 31,
    ],
    "has the field's words": [
        "Return the spokes.",
        "Return a tangled mesh.",
        "A foul is raised.",
        "Nobody asks.",
        "Solve anew.",
        "The two beside it.",
    ],
    "names its parameters": ["Return K.\n\nParameters\n----------\nv\n    Velocities (ndofs,) [m/s]."],
}


def test_a_planted_fault_breaks_its_rule_alone():
    for rule, docs in PLANTED.items():
        for doc in docs:
            function = ast.parse(f"def stiffness():\n    {doc!r}\n").body[0]
            assert [name for name, judge in RULES.items() if judge(doc, function)] == [rule], doc


def test_a_planted_word_in_a_comment_is_found():
    assert breaches("has the field's words", "x = 1  # the spokes of an element\n") == [(1, "spokes")]


def test_plain_docstrings_break_no_rule():
    """Properties may be flags, 'One step' has its noun, and formulas, sections and examples are no sentences."""
    source = dedent('''
        class Pattern:
            """One step from `u_0`, in `{0} of the words that stand in backticks are one word, which is why this is short`.

                W = {0}

            Parameters
            ----------
            u
                {0}.
            """

            def __init__(self, u):
                self.u = u

            @property
            def symmetric(self):
                """Whether K is symmetric."""

            def tangent(self):
                """Return K, besides F.

                >>> pattern.tangent({0})
                """
        ''').format("a " * 40)  # fmt: skip
    assert [breaches(rule, source) for rule in RULES] == [[]] * len(RULES)
