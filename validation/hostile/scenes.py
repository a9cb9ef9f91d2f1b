"""Scenes, summaries and tables with arbitrary contents: the command must refuse them quickly with a readable message."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from skfem_stvk.scenes import templates

from .case import Case
from .checkpoints import NOT_OURS
from .commands import COMMAND, REFUSED, Finished, checked, ran

SOLVE = ("solve", "scene.toml", "--out", "out", "--quiet")
SWEEP = ("sweep", "scene.toml", "--out", "out", "--set", "analysis.steps=5,6")
#: Files that commands read, and the arguments of the command.
READ = {"scene.toml": SOLVE, "out/summary.json": SOLVE, "out/table.csv": SWEEP}
CONTENTS = ("empty", "text", "a pickle", "a bomb of zeros", "a folder", "a fifo", "/dev/zero", "a link to itself")
#: Text that is appended to a good scene.
TOO_MUCH = {
    "900 lists in lists": f"x = {900 * '['}{900 * ']'}\n",
    "900 tables in tables": f"x = {900 * '{a = '}1{900 * '}'}\n",
    "a key of 3 000 parts": f"{3_000 * 'a.'}a = 1\n",
    "10 000 terms": 10_000 * "[[terms]]\n",
    "20 000 materials": "".join(f"[materials.m{n}]\n" for n in range(20_000)),
}
THOUSAND = ",".join(map(str, range(1, 1001)))


def cases() -> Iterator[Case]:
    """Yield all files and texts, and a sweep of 1e9 runs."""
    for file, arguments in READ.items():
        for what in CONTENTS:
            yield _case(f"{file} is {what}", partial(_replace, file, NOT_OURS[what]), arguments, quick=what == "a fifo")
    for name, text in TOO_MUCH.items():
        yield _case(name, partial(_append, text), SOLVE)
    product = [word for key in ("analysis.steps", "threads", "seed") for word in ("--set", f"{key}={THOUSAND}")]
    yield _case("a sweep of 1e9 runs", partial(_append, ""), (*SWEEP[:4], *product))


def _case(name: str, change: Callable[[Path], object], arguments: tuple[str, ...], quick: bool = False) -> Case:
    """Return the case of a command in a folder with a good scene, changed by `change`."""

    def attempt(folder: Path) -> Finished:
        (folder / "scene.toml").write_text(templates.example("static"))
        change(folder)
        return checked(ran([*COMMAND, *arguments], {}), REFUSED)

    return Case(name, attempt, seconds=60, gigabytes=4, quick=quick)


def _replace(file: str, make: Callable[[Path], object], folder: Path) -> None:
    (folder / file).parent.mkdir(exist_ok=True)
    (folder / file).touch()
    make(folder / file)


def _append(text: str, folder: Path) -> None:
    with (folder / "scene.toml").open("a") as scene:
        scene.write(text)
