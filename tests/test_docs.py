"""The documentation: links lead to pages and headings that exist, and pages keep to their limits."""

import ast
import importlib.util
import re
from collections import Counter
from pathlib import Path

import skfem_stvk

ROOT = Path(__file__).parent.parent
GENERATED = ("docs/api", "docs/gallery", "build", ".venv")
PAGES = [
    path for path in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")] if not str(path.relative_to(ROOT)).startswith(GENERATED)
]
CITING = [
    path
    for folder in ("skfem_stvk", "validation", "tests", "docs", ".github")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in (".py", ".md", ".toml", ".c", ".h", ".yml", ".rst") and not str(path.relative_to(ROOT)).startswith(GENERATED)
] + [*ROOT.glob("*.md"), ROOT / "pyproject.toml"]


def named(page):
    """Path of a page in the checkout."""
    return str(page.relative_to(ROOT))


def prose(page):
    """Text of a page without its blocks of code."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    return "\n".join(line for line in text.split("\n") if not line.startswith("    "))


def headings(page):
    """Addresses of the headings of a page, as GitHub and MyST make them."""
    titles = re.findall(r"^#+ (.+)$", prose(page), re.M)
    plain = [re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", title).replace("`", "") for title in titles]
    return {re.sub(r"[^\w -]", "", title.lower()).strip().replace(" ", "-") for title in plain}


def leads_somewhere(page, target):
    """Return whether a link of a page leads to an address, or to a file, and to a heading of it, that exist."""
    path, _, heading = target.partition("#")
    file = (page.parent / path).resolve() if path else page
    return bool(re.match(r"[a-z]+:", target)) or (file.exists() and (not heading or heading in headings(file)))


def test_links_of_pages_lead_somewhere():
    links = [(page, target) for page in PAGES for target in re.findall(r"\]\(([^()\s]+)\)", prose(page))]
    assert len(links) > 500 and [(named(page), target) for page, target in links if not leads_somewhere(page, target)] == []
    assert not leads_somewhere(ROOT / "README.md", "nowhere.md") and not leads_somewhere(ROOT / "README.md", "#nowhere")


def test_pages_that_are_cited_exist():
    """README, docstrings, messages and programs cite pages as `docs/.../page.md`."""
    cited = [
        (path.relative_to(ROOT), name)
        for path in CITING
        for name in re.findall(r"(?<![\w/.-])docs/[\w/-]+\.(?:md|png|c)\b", path.read_text(encoding="utf-8"))
    ]
    assert len(cited) > 20
    assert [(str(path), name) for path, name in cited if not (ROOT / name).exists()] == []


def test_no_two_pages_have_one_title():
    pages = [page.read_text(encoding="utf-8") for page in PAGES if page.is_relative_to(ROOT / "docs")]
    titles = Counter(title.lower() for page in pages for title in re.findall(r"\A(?s:---\n.*?\n---\n+)?# (.+)$", page, re.M))
    assert sum(titles.values()) == len(pages) > 40 and [title for title, count in titles.items() if count > 1] == []


SHELVES = {"tutorials": 1200, "topics": 1200, "how-to": 600}
LONGEST = 25
#: What is no prose, and its replacement. A formula, code and a picture are one word; a link is its text.
NO_PROSE = {
    r"\A---\n.*?\n---$|<!--.*?-->|^(`{3,}|~{3,}|:{3,}).*?^\1$": "",  # front matter, comments, blocks of code, directives
    r"\$\$.*?\$\$": "X",  # before its lines that are indented
    r"^(?: {4}| *[|#]|\([\w-]+\)=)[^\n]*$": "",  # indented blocks, tables, headings, labels
    r"\$[^$]+\$|(`+)[^`]+\1|!\[[^]]*\]\([^)]*\)": "X",
    r"\[([^][]*)\](?:\([^()]*\)|\[[^]]*\])": r"\1",
}
ITEM = r"(?:[-*+]|\d+\.) "


def paragraphs(text):
    """Yield line and text of each paragraph or item of a list."""
    for pattern, words in NO_PROSE.items():
        text = re.sub(pattern, lambda one, words=words: one.expand(words) + "\n" * one[0].count("\n"), text, flags=re.M | re.S)
    for block in re.finditer(rf"\S(?:.|\n(?!\s*\n| *{ITEM}))*", text):
        yield text.count("\n", 0, block.start()) + 1, re.sub(rf"\A{ITEM}", "", block[0])


def long_sentences(text, longest=LONGEST):
    """Return 'line: sentence' for each sentence that has more words."""
    sentences = [(line, one) for line, words in paragraphs(text) for one in re.split(r"(?<=[.!?])[)\"*_]*\s+", words)]
    return [f"{line}: {' '.join(one.split())}" for line, one in sentences if len(one.split()) > longest]


def test_sentences_are_short():
    pages = [page for page in PAGES if page.parent != ROOT or page.stem == "README"]
    assert [f"{named(page)}:{one}" for page in pages for one in long_sentences(page.read_text(encoding="utf-8"))] == []


def test_sentences_are_found_in_prose_alone():
    words = "one " * 16
    long = [f"{words}[{words}](a.md)", f"- {words}\n- {words}{words}", f"`a` $x\ny$ {words}\n{words}"]
    free = [
        f"```\n{words * 2}\n```",
        f"    {words * 2}",
        f"| {words * 2} |",
        f"{words}`{words}` ${words}$",
        f"{words}one. One {words}",
    ]
    assert [long_sentences(text)[0].split()[0] for text in long] == ["1:", "2:", "1:"]
    assert [long_sentences(text) for text in free] == [[]] * len(free)


def test_no_indented_block_follows_a_list():
    """Markdown takes such a block for a paragraph of the list, and its lines flow."""
    texts = {named(page): re.sub(r"^(```+).*?^\1", "", page.read_text(encoding="utf-8"), flags=re.M | re.S) for page in PAGES}
    blocks = re.compile(rf"^{ITEM}(?:.+\n)+\n {{4,5}}(?![ \-*]).*", re.M)
    assert [(name, block) for name, text in texts.items() for block in blocks.findall(text)] == []


def test_pages_end_with_where_to_go_next():
    """The last paragraph begins with 'Next:', or the last section is 'Next'.

    Front pages of shelves, the changelog and printed tables of keys need none.
    """
    end = re.compile(r"\n## Next\n(?s:(?!\n#).)*\Z|\n\**Next:(?:.|\n(?!\n))*\Z")
    pages = [page for page in PAGES if page.parent.name in (*SHELVES, "reference", "measurements")]
    without = [page for page in pages if not end.search(page.read_text(encoding="utf-8").rstrip())]
    assert [named(page) for page in without if not re.match("index|changelog|scene-keys", page.stem)] == []


def test_pages_keep_to_their_number_of_words():
    """Tables count, blocks of code do not. All tutorials, guides and topics have at most 35 000 words."""
    words = {page: len(prose(page).split()) for page in PAGES if page.parent.name in SHELVES}
    assert {named(page): count for page, count in words.items() if count > SHELVES[page.parent.name]} == {}
    assert 10_000 < sum(words.values()) <= 35_000


def reference():
    """The program that prints pages of the reference."""
    spec = importlib.util.spec_from_file_location("print_reference", ROOT / "docs" / "print_reference.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_printed_pages_are_up_to_date():
    pages = reference().PAGES
    printed = {page: (ROOT / "docs" / "reference" / f"{page}.md").read_text(encoding="utf-8") for page in pages}
    old = [page for page, printer in pages.items() if printed[page] != printer()]
    assert len(pages) > 3 and old == [], "print the pages again: python docs/print_reference.py"


def test_findings_are_those_of_the_monitors():
    from skfem_stvk.results.monitors import Finding

    listed = re.search(r"Name of the finding, (.*?)\.\n", Finding.__doc__, re.S)
    assert [name for name, _, _ in reference().FINDINGS] == re.findall(r'"([^"]+)"', listed[1])


def test_every_error_has_a_remedy():
    named = {name for name in skfem_stvk.__all__ if name.endswith("Error")}
    assert set(reference().ERRORS) == set(reference().errors()) > named


def texts_of(node):
    """Return the texts in a piece of a program, separated by null characters; values in them are left out."""
    return "\0".join(one.value for one in ast.walk(node) if isinstance(one, ast.Constant) and isinstance(one.value, str))


def warnings_of(source):
    """Return the texts of each warning in a module: those of the call of `warn`, or else of its function and its helpers.

    Findings have a table of their own.
    """
    found, functions = [], [one for one in ast.walk(ast.parse(source)) if isinstance(one, ast.FunctionDef)]
    named = {one.name: one for one in functions}
    for function in functions:
        called = [(getattr(one.func, "id", ""), one) for one in ast.walk(function) if isinstance(one, ast.Call)]
        around = "\0".join(texts_of(one) for one in (function, *(named[name] for name, _ in called if name in named)))
        calls = [call for name, call in called if name == "warn" and ast.unparse(call.args[0]) != "finding.text"]
        found += [texts_of(call) or around for call in calls]
    return found


def test_the_warnings_are_those_of_the_code():
    rows = [words for table in reference().WARNINGS.values() for words, _, _ in table]
    sources = [text for path in (ROOT / "skfem_stvk").rglob("*.py") if "warn(" in (text := path.read_text(encoding="utf-8"))]
    warnings = [texts for source in sources for texts in warnings_of(source)]
    assert len(warnings) > 20 and [texts for texts in warnings if not any(words in texts for words in rows)] == []
    code = [texts_of(ast.parse(source)) for source in sources]
    assert [words for words in rows if not any(words in texts for texts in code)] == []


def test_a_warning_that_is_in_no_table_is_found():
    helper = "def told(n):\n    return f'{n} springs broke'\n"
    source = f"{helper}def step(n):\n    warn(told(n))\n    warn(f'{{n}} nodes left')\n    warn(finding.text)\n"
    assert warnings_of(source) == [" nodes left\0 springs broke", " nodes left"]


def test_the_api_page_lists_every_public_name_once():
    blocks = re.findall(r":toctree: ../api\n\n(.*?)```", (ROOT / "docs" / "reference" / "api.md").read_text(encoding="utf-8"), re.S)
    assert sorted(" ".join(blocks).split()) == skfem_stvk.__all__, (
        "docs/reference/api.md lists the names of skfem_stvk/__init__.pyi"
    )
