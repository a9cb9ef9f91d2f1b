"""docs/reference/equations.md has all equations of the overview, and all files, names and tests that it cites exist."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "reference" / "equations.md").read_text(encoding="utf-8")
ENTRIES = dict(re.findall(r"^### (.+?)\n(.*?)(?=^##|\Z)", PAGE, re.MULTILINE | re.DOTALL))
VERDICTS = {"held", "held in part", "did not hold", "erratum"}
#: Claims of the overview, in its order; each is identified by a phrase that occurs in no other claim.
CLAIMS = (
    "unnaturally", "mass-spring", "explicit and implicit", "conservative", "diagonal, which", "need no K", "more stable",
    "conjugate gradients", "constant and need", "simpler", "simplest", "costly", "cubic", "in advance from", "element by element",
    "vertices, edges, faces", "5 times", "semi-implicit", "expanded quadratic", "warping", "invariant", "signed volume",
    "avoid StVK", "determined by", "nonlinear springs", "non-negative", "two kinds", "70 %", "15 - 27 %", "efficient",
)  # fmt: skip


def test_every_equation_has_one_entry():
    numbers = [int(number) for number in re.findall(r"^### Eq\. (\d+):", PAGE, re.MULTILINE)]
    assert numbers == list(range(1, 15))


def test_every_claim_has_one_entry():
    claims = [title for title in ENTRIES if title.startswith("Claim")]
    assert len(claims) == len(CLAIMS)
    assert all(word in title for word, title in zip(CLAIMS, claims, strict=True))


def entries():
    """Return the lines of each entry by title, as a dict of texts by their keys."""
    found = {title: re.findall(r"^- (\w+): (.*?)(?=^- |\Z)", text, re.M | re.S) for title, text in ENTRIES.items()}
    return {title: {key: " ".join(text.split()) for key, text in pairs} for title, pairs in found.items()}


def test_each_entry_has_its_lines_and_a_verdict():
    for title, lines in entries().items():
        assert list(lines) == ["Code", "Test", "Measured", "Verdict"], title
        assert set(re.findall(r"\*\*(.+?)\*\*", lines["Verdict"])) <= VERDICTS and "**" in lines["Verdict"], title


def test_cited_code_and_tests_exist():
    missing = []
    for title, lines in entries().items():
        code = re.findall(r"`([\w/]+\.py)` \(((?:`\w+`(?:, )?)+)\)", lines["Code"])
        tests = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", lines["Test"])
        assert code and len(tests) == lines["Test"].count("::") > 0, title
        for file, name in [(file, name) for file, names in [*code, *tests] for name in re.findall(r"\w+", names)]:
            text = (ROOT / file).read_text(encoding="utf-8")
            if not re.search(rf"(class|def) {name}\b|^\s*{name}(:.*)? = ", text, re.M):
                missing.append((title, file, name))
    assert missing == []


def test_pages_of_measurements_have_the_cited_sections():
    links = [link for lines in entries().values() for link in re.findall(r"\]\(([\w./-]+\.md)(?:#([\w-]+))?\)", lines["Measured"])]
    for page, section in links:
        text = (ROOT / "docs" / "reference" / page).read_text(encoding="utf-8")
        slugs = {re.sub(r"[^\w -]", "", head.lower()).strip().replace(" ", "-") for head in re.findall(r"^#+ (.+)$", text, re.M)}
        assert not section or section in slugs, (page, section)
    assert len(links) > 10
