"""The documentation: links lead to pages and headings that exist, and pages keep to their limits."""

import re
from pathlib import Path

import pytest

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


def prose(page):
    """Text of a page without its blocks of code."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    return "\n".join(line for line in text.split("\n") if not line.startswith("    "))


def headings(page):
    """Addresses of the headings of a page, as GitHub and MyST make them."""
    titles = re.findall(r"^#+ (.+)$", prose(page), re.M)
    plain = [re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", title).replace("`", "") for title in titles]
    return {re.sub(r"[^\w -]", "", title.lower()).strip().replace(" ", "-") for title in plain}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_of_a_page_lead_somewhere(page):
    broken = []
    for target in re.findall(r"\]\(([^()\s]+)\)", prose(page)):
        path, _, heading = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        if re.match(r"[a-z]+:", target):
            continue
        if not file.exists() or (heading and heading not in headings(file)):
            broken.append(target)
    assert broken == []


def test_pages_that_are_cited_exist():
    """README, docstrings, messages and programs cite pages as `docs/.../page.md`."""
    cited = [
        (path.relative_to(ROOT), name)
        for path in CITING
        for name in re.findall(r"(?<![\w/.-])docs/[\w/-]+\.(?:md|png|c)\b", path.read_text(encoding="utf-8"))
    ]
    assert len(cited) > 20
    assert [(str(path), name) for path, name in cited if not (ROOT / name).exists()] == []
