"""Print the pages of the reference that the code determines: `python docs/print_reference.py` writes them.

They are the command line, the keys of scenes, and the outcomes, errors and warnings with their remedies. A test compares the pages
with what this program prints.
"""

import argparse
import inspect
import re
from functools import partial
from pathlib import Path

import skfem_stvk
from skfem_stvk import StvkError
from skfem_stvk.cli.main import COMMANDS
from skfem_stvk.nonlinear.newton import End
from skfem_stvk.nonlinear.outcome import Status
from skfem_stvk.scene import templates
from skfem_stvk.statics.message import ADVICE

#: Pages of the keys of scenes: file, title, and the first table on it.
SCENE_KEYS = (
    ("scene-keys", "Scene keys: mesh and places", "Scene"),
    ("scene-keys-laws", "Scene keys: materials and laws", "isotropic"),
    ("scene-keys-loads", "Scene keys: loads, contact and supports", "elastic-foundation"),
    ("scene-keys-analyses", "Scene keys: analyses and results", "Initial state"),
)
FINDINGS = (
    ("locking", "Poisson's ratio above 0.45, where the element is much too stiff", "[locking](../topics/locking.md)"),
    ("inside out", "inverted or flat elements", "[prevent inversion](../how-to/inversion.md)"),
    ("compressed", "smallest principal stretch below 0.577, where StVK softens", "[what StVK is not](../topics/wrong-model.md)"),
    ("not elliptic", "strong ellipticity lost, with `ellipticity=True`", "[what StVK is not](../topics/wrong-model.md)"),
)
#: Remedy of the failures for which messages name one that depends on the body.
INVERSION = (
    "Add a term that resists inversion, refine the mesh there, take more steps, or spread the load over more of the boundary."
)
EXIT_CODES = (
    ("0", "success"),
    ("1", "a check failed, or a solve did not converge"),
    ("2", "bad input"),
    ("3", "a scene does not meet its expectations"),
    ("130", "interrupted"),
)
#: What a reader can do after a static solve or a motion with each outcome.
REMEDIES = {
    Status.CONVERGED: "",
    Status.AT_ROUND_OFF: "The residual is as small as rounding allows. A smaller `rtol` has no effect.",
    Status.UNSTABLE: "Follow the path through the critical point, or add an imperfection: [stability](../topics/stability.md).",
    Status.INVERTED: "Add a term that resists inversion: [prevent inversion](../how-to/inversion.md).",
    Status.STOPPED: "Read the message: [why did Newton fail?](../how-to/newton-failed.md).",
    Status.FINISHED: "",
    Status.ENDED_INVERTED: "Add a term that resists inversion, or take a smaller `dt`.",
    Status.BLEW_UP: "Take a smaller `dt`, or an implicit integrator.",
    Status.NOT_CONVERGED: "Take a smaller `dt`, another tangent, or an integrator that damps.",
    Status.INTERRUPTED: "Resume from the checkpoint: [long runs and restart](../how-to/long-runs.md).",
}


def command_line() -> str:
    """Return the page of the command line: each command with its arguments."""
    rows = [f"| [`{name}`](#{name}) | {sentence(command.help)} |" for name, command in COMMANDS.items()]
    parts = [
        "# Command line\n",
        "With `skfem-stvk COMMAND ...` you solve scenes and check models without a program. The option `--help` prints the\n"
        "arguments of a command. This page is printed by `python docs/print_reference.py`.\n",
        "    skfem-stvk verify                               # check W, F and K on an embedded mesh\n"
        "    skfem-stvk init --type static > scene.toml      # a commented example of a scene\n"
        "    skfem-stvk solve scene.toml\n",
        "| command | |\n|---|---|\n" + "\n".join(rows) + "\n",
        "| exit code | |\n|---|---|\n" + "\n".join(f"| {code} | {words} |" for code, words in EXIT_CODES) + "\n",
    ]
    for name, command in COMMANDS.items():
        parser = argparse.ArgumentParser(prog="skfem-stvk")
        if command.add_arguments is not None:
            command.add_arguments(parser)
        actions = [action for action in parser._actions if action.dest != "help"]
        parts.append(f"## {name}\n\n{inspect.cleandoc(command.run.__doc__ or '')}\n")
        if actions:
            rows = [f"| {argument(action)} | {cell(action.help or '')} |" for action in actions]
            parts.append("| argument | |\n|---|---|\n" + "\n".join(rows) + "\n")
    parts.append("Next: [the whole job from one file](../tutorials/scenes.md), and [all keys of a scene](scene-keys.md).")
    return "\n".join(parts) + "\n"


def argument(action: argparse.Action) -> str:
    """Return an argument as it is typed, with the name of its value."""
    value = action.metavar or action.dest.upper()
    value = " ".join(value) if isinstance(value, tuple) else value
    if action.choices is not None:
        value = "{" + ",".join(map(str, action.choices)) + "}"
    if not action.option_strings:
        return f"`{value}`" + " (optional)" * (action.nargs in ("?", "*"))
    takes = "" if action.nargs == 0 else f" {value}" + " ..." * (action.nargs in ("+", "*"))
    return f"`{', '.join(action.option_strings)}{takes}`"


def outcomes() -> str:
    """Return the page of outcomes, errors and warnings."""
    parts = [
        "# Outcomes, errors and warnings\n",
        "Look here for the words of a message. A result has a `status`, a `message` and `success`; an error says what was given,\n"
        "what was expected and what to do. This page is printed by `python docs/print_reference.py`.\n",
        "```python\n>>> from skfem_stvk.nonlinear.outcome import Status\n>>> Status.UNSTABLE.value, Status.UNSTABLE.success\n"
        "('in equilibrium, but unstable', False)\n\n```\n",
        "## Outcomes of solves and motions\n\n`result.status` of a static solve and `run.status` of a motion:\n",
        "| status | its value | success | remedy |\n|---|---|---|---|",
        *(f"| `{s.name}` | {s.value} | {'yes' if s.success else 'no'} | {REMEDIES[s]} |" for s in Status),
        "\n## Why a step failed\n\nThese words are in messages after the load factor or the time:\n",
        "| words | remedy |\n|---|---|",
        *(f"| {end.value} | {cell(ADVICE.get(end, INVERSION))} |" for end in End if not end.converged),
        "\n## Findings about elements\n\n",
        "`result.findings`, `run.findings` and warnings name elements outside the range of the model:\n",
        "| name | meaning | read |\n|---|---|---|",
        *(f"| {name} | {meaning} | {page} |" for name, meaning, page in FINDINGS),
        "",
        "## Errors\n\nAll errors are `StvkError`s, which are `ValueError`s:\n",
        "| error | |\n|---|---|",
    ]
    for name in skfem_stvk.__all__:
        thing = getattr(skfem_stvk, name)
        if inspect.isclass(thing) and issubclass(thing, StvkError | Warning | KeyboardInterrupt):
            parts.append(f"| `{name}` | {cell(inspect.getdoc(thing).split(chr(10))[0])} |")
    parts.append("\nNext: [why did Newton fail?](../how-to/newton-failed.md), [read a report](../how-to/read-a-report.md).")
    return "\n".join(parts) + "\n"


def scene_keys(number: int) -> str:
    """Return one of the pages of the keys of scenes; links to tables on the other pages lead there."""
    tables = templates.page().split("\n## ")[1:]
    names, starts = [table.split("\n")[0] for table in tables], [first for _, _, first in SCENE_KEYS]
    ends = [*(names.index(first) for first in starts), len(names)]
    page_of = {anchor(name): max(n for n, end in enumerate(ends[:-1]) if end <= i) for i, name in enumerate(names)}

    def link(found: re.Match[str]) -> str:
        page = page_of[found[1]]
        return f"](#{found[1]})" if page == number else f"]({SCENE_KEYS[page][0]}.md#{found[1]})"

    others = ",\n".join(f"[{subject(title)}]({file}.md)" for n, (file, title, _) in enumerate(SCENE_KEYS) if n != number)
    title = SCENE_KEYS[number][1]
    head = (
        f"# {title}\n\nWith this page you can write the keys of a scene for {subject(title)}.\n"
        'Each key has a type, a default and a unit. Units are those of `units = "SI"`.\n'
        "The tables are printed from the schema that checks scenes.\n\n"
        "    skfem-stvk init --type static > scene.toml      # a commented example\n"
        "    skfem-stvk init --keys                          # all keys of a scene\n"
        "    skfem-stvk init --schema > scene.json           # JSON Schema, for editors\n"
    )
    shown = "\n".join(f"## {table}" for table in tables[ends[number] : ends[number + 1]])
    tail = f"Next: {others},\nand [the whole job from one file](../tutorials/scenes.md).\n"
    return head + "\n" + re.sub(r"\]\(#([\w-]+)\)", link, shown).rstrip() + "\n\n" + tail


def subject(title: str) -> str:
    """Return the second half of the title of a page of scene keys."""
    return title.partition(": ")[2]


def anchor(heading: str) -> str:
    """Return the address of a heading on its page."""
    return heading.lower().replace(" ", "-")


def sentence(words: str) -> str:
    """Return words that begin with a capital letter."""
    return cell(words[:1].upper() + words[1:])


def cell(words: str) -> str:
    """Return words for a cell of a table."""
    return " ".join(words.split()).replace("|", r"\|").replace("%%", "%").replace("%(default)s", "the default")


PAGES = {"command-line": command_line, "outcomes": outcomes}
PAGES |= {file: partial(scene_keys, number) for number, (file, _, _) in enumerate(SCENE_KEYS)}

if __name__ == "__main__":
    for page, text in PAGES.items():
        (Path(__file__).parent / "reference" / f"{page}.md").write_text(text(), encoding="utf-8")
