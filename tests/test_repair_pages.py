"""The how-to pages on failed solves and motions contain words of every message that statics and dynamics write."""

import ast
import re
from pathlib import Path

from skfem_stvk.solvers.newton.newton import End

ROOT = Path(__file__).parent.parent
SOURCES = [path for folder in ("statics", "dynamics") for path in sorted((ROOT / "skfem_stvk" / "solvers" / folder).rglob("*.py"))]
FILES = [ROOT / "docs" / "how-to" / f"{page}.md" for page in ("newton-failed", "motion-blows-up")]
PAGES = " ".join(word for file in FILES for word in file.read_text(encoding="utf-8").split())
#: Functions that write messages, in addition to those that warn or make a step fail.
WRITERS = {"reason", "branch_end", "_cause_and_advice", "_jumped", "_start", "first_state", "_message", "_reached", "remark"}
WRITERS |= {"halving_text", "inversion_text", "_gain_text", "start_within", "contact_findings"}
#: Beginnings of advice, and of descriptions, which are no words to find a page by. Errors with "expected" are explained in full.
OTHER = re.compile(r"\0| ?(If|Try|Free|Let|Give|To|, or|, because) |.*\b[Ee]xpected\b")


def messages(source):
    """Yield the texts of messages in a module, with a null character for each value."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef) and (node.name in WRITERS or re.search(r"\b(warn|StepFailed)\(", ast.unparse(node))):
            body = [one for statement in node.body[ast.get_docstring(node) is not None :] for one in ast.walk(statement)]
            formatted = [one for one in body if isinstance(one, ast.JoinedStr)]
            parts = {id(part) for one in formatted for part in one.values}
            for one in formatted:
                yield "".join(part.value if isinstance(part, ast.Constant) else "\0" for part in one.values)
            yield from (one.value for one in body if isinstance(getattr(one, "value", None), str) and id(one) not in parts)


def runs(text):
    """Return all runs of three words of a text, without values."""
    parts = [part.split() for part in text.split("\0")]
    return [" ".join(words[i : i + 3]) for words in parts for i in range(len(words) - 2)]


def missing(source):
    """Return the messages of a module, of five words or more, of which no three words in a row are on a page."""
    found = [text for text in messages(source) if not OTHER.match(text)]
    return [text for text in found if len(runs(text)) > 2 and not any(words in PAGES for words in runs(text))]


def test_words_of_every_message_are_on_a_page():
    assert [(str(path), text) for path in SOURCES for text in missing(path.read_text(encoding="utf-8"))] == []


def test_words_of_every_failure_of_newtons_method_are_on_the_page_of_solves():
    text = FILES[0].read_text(encoding="utf-8")
    assert [
        end.value for end in End if not end.converged and f'"{" ".join(end.value.split()[:7])}' not in " ".join(text.split())
    ] == []


def test_a_message_that_is_on_no_page_is_found():
    source = "def step(n):\n    warn(f'The oscillator lost {n} of its springs at once.')\n    warn('blew up soon after a step')\n"
    assert missing(source) == ["The oscillator lost \0 of its springs at once."]
    assert sum(len(list(messages(path.read_text(encoding="utf-8")))) for path in SOURCES) > 60
