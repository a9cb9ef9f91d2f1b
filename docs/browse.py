"""Open every page of a built site in a browser, without a network: `python docs/browse.py build/site`.

It needs the extra `browser` and Debian's package `chromium`. Exit code 1 if a page, 1280 or 390 pixels wide, has an error in the
console, a failed request, a missing picture, a formula that is not set, or is wider than the window; if a query does not find its
page among the first three; or if the copy button copies prompts.
"""

import sys
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Page, sync_playwright

#: Queries, and the page that must be among the first three results.
QUERIES = {
    "arc length": "stability",
    "not converged": "newton-failed",
    "inverted elements": "inversion",
    "inside out": "inversion",
    "lambda doubled": "read-a-report",
    "friction": "contact",
    "warm-up": "command-line",
    "Abaqus": "coming-from",
    "checkpoint": "long-runs",
    "spring network": "choose-springs",
    "conjugate gradients": "choose-solver",
}
#: Pages that Sphinx makes and nobody reads from the first to the last line.
LEFT_OUT = ("_static", "_modules", "search.html", "genindex.html", "py-modindex.html")
BROWSER = {"executable_path": "/usr/bin/chromium", "args": ["--no-sandbox"]}


def main(folder: str) -> int:
    """Check a site and print its faults."""
    site = Path(folder).resolve()
    pages = [path for path in sorted(site.rglob("*.html")) if not path.relative_to(site).as_posix().startswith(LEFT_OUT)]
    with sync_playwright() as play:
        browser = play.chromium.launch(**BROWSER)
        faults = [fault for width in (1280, 390) for fault in faults_of(browser, width, site, pages)]
        page = new_page(browser, 1280, [])
        faults += [fault for query, name in QUERIES.items() for fault in searched(page, site, query, name)]
        faults += copied(page, site)
        browser.close()
    print("\n".join(faults) or f"no faults on {len(pages)} pages")
    return bool(faults)


def new_page(browser: Browser, width: int, seen: list[str]) -> Page:
    """Return a page without a network whose errors are added to `seen`."""
    context = browser.new_context(viewport={"width": width, "height": 900}, offline=True)
    context.grant_permissions(["clipboard-read", "clipboard-write"])
    page = context.new_page()
    page.on("console", lambda message: seen.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: seen.append(str(error)))
    page.on("requestfailed", lambda request: seen.append(f"failed: {request.url}"))
    return page


def faults_of(browser: Browser, width: int, site: Path, pages: list[Path]) -> list[str]:
    """Return the faults of all pages in a window of this width."""
    seen: list[str] = []
    page, faults = new_page(browser, width, seen), []
    for path in pages:
        seen.clear()
        page.goto(path.as_uri())
        if page.locator(".math").count():
            page.wait_for_timeout(300)
        found: dict[str, Any] = {
            "missing pictures": "[...document.images].filter(i => i.loading != 'lazy' && !i.naturalWidth).map(i => i.src)",
            "formulas not set": "[...document.querySelectorAll('.math')].filter(m => !m.querySelector('mjx-container')).length",
            "wrong formulas": "document.querySelectorAll('mjx-merror, [data-mjx-error]').length",
            "too wide by": "Math.max(0, document.documentElement.scrollWidth - innerWidth)",
        }
        wrong = {name: page.evaluate(script) for name, script in found.items()} | {"errors": list(seen)}
        text = ", ".join(f"{name} {value}" for name, value in wrong.items() if value)
        faults += [f"{path.relative_to(site)}, {width} pixels: {text}"] * bool(text)
    return faults


def searched(page: Page, site: Path, query: str, name: str) -> list[str]:
    """Return a fault if a page is not among the first three results of a query."""
    page.goto(f"{(site / 'search.html').as_uri()}?q={query.replace(' ', '+')}")
    page.wait_for_selector("ul.search li a", timeout=20_000)
    page.wait_for_timeout(500)
    results = [link.get_attribute("href") or "" for link in page.locator("ul.search li a").all()[:3]]
    return [] if any(f"{name}.html" in result for result in results) else [f"query {query!r}: {results}; expected {name}"]


def copied(page: Page, site: Path) -> list[str]:
    """Return a fault if the copy button of the first program copies prompts."""
    page.goto((site / "index.html").as_uri())
    page.locator("button.copybtn").first.click(force=True)
    text = page.evaluate("navigator.clipboard.readText()")
    return [] if text and ">>>" not in text else [f"the copy button copies {text[:60]!r}"]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
