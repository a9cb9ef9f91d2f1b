"""Print the pages of the reference that the code determines: `python docs/print_reference.py` writes them.

They are the command line, the keys of scenes, and the outcomes, errors and warnings with their remedies. Tests compare the pages
with what this program prints, and its tables with the errors and warnings in the code.
"""

import argparse
import inspect
import re
from functools import partial
from pathlib import Path

import skfem_stvk
from skfem_stvk import StvkError
from skfem_stvk.scenes import templates
from skfem_stvk.scenes.commands.main import COMMANDS
from skfem_stvk.solvers.newton.newton import End
from skfem_stvk.solvers.newton.outcome import Status
from skfem_stvk.solvers.statics.message import ADVICE

#: Pages of the keys of scenes: file, title, and the first table on it.
SCENE_KEYS = (
    ("scene-keys", "Scene keys: mesh and places", "Scene"),
    ("scene-keys-laws", "Scene keys: materials and laws", "isotropic"),
    ("scene-keys-loads", "Scene keys: loads, contact and supports", "elastic-foundation"),
    ("scene-keys-analyses", "Scene keys: analyses and results", "Initial state"),
)
FINDINGS = (
    (
        "locking",
        "Poisson's ratio above 0.45, where the element is much too stiff",
        "Take quadratic elements: [locking](../topics/locking.md).",
    ),
    ("inside out", "inverted or flat elements", "Add a term that resists inversion: [prevent inversion](../how-to/inversion.md)."),
    (
        "compressed",
        "smallest principal stretch below 0.577, where StVK softens",
        "Take a law that stiffens, or add a volume term: [what StVK is not](../topics/wrong-model.md).",
    ),
    (
        "deep contact",
        "points deeper in a rigid shape than 0.05 of the facets' edge",
        "Take a larger stiffness: [contact](../how-to/contact.md).",
    ),
    (
        "wrong side",
        "no node outside a rigid shape, and nodes deep in it",
        "Reverse the normal of the shape, or move the body.",
    ),
    (
        "thin shape",
        "a rigid shape thinner than the smallest facet, which may slip between its points",
        "Refine the surface there: [contact](../how-to/contact.md).",
    ),
    (
        "short contact",
        "contacts of fewer than 5 steps",
        "In motions, take a smaller `dt`, a smaller stiffness, or an onset. In statics the shape may have passed: take more steps.",
    ),
    (
        "lagging friction",
        "friction in statics whose normal force changes by more than 5 % in the step",
        "Press first and drag in later steps, or take more steps: [friction](../how-to/contact.md#friction).",
    ),
)
#: What a user does after each error.
ERRORS = {
    "StvkError": "Read what was given and what was expected, and pass that.",
    "MeshError": "Repair the elements or vertices that the message names: [meshes](../how-to/meshes.md).",
    "MaterialError": "Pass the constant in the stated range and shape: [materials](../how-to/materials.md).",
    "RegionError": "Pass one of the names that the message lists, or name the location in the mesh: [loads](loads.md).",
    "LoadError": "Pass finite values of the stated shape, at a location with these facets or nodes: [loads](../how-to/loads.md).",
    "ContactError": "Pass the parameter in the stated range, and start without overlap: [contact](../how-to/contact.md).",
    "SupportError": "Fix more components, or take a component out of one of two locations: [supports](../how-to/supports.md).",
    "StateError": "Pass `system.ndofs` finite numbers. If they come from a solve, check its units and steps.",
    "AnalysisError": "Catch it to treat failed solves and motions alike. `SolveError` and `SimulationError` lead to the remedies.",
    "SceneError": "Correct the keys in the lines that the message names: [scene keys](scene-keys.md).",
    "SolveError": "Look the message up: [why did Newton fail?](../how-to/newton-failed.md).",
    "SimulationError": "Look the message up: [my motion blows up](../how-to/motion-blows-up.md).",
    "Interrupted": "Resume from the checkpoint: [long runs](../how-to/long-runs.md). `error.result` has the states so far.",
}
#: Warnings besides the findings: words of their messages, cause and remedy.
WARNINGS = {
    "Meshes": (
        ("at the same point as another", "parts touch without being connected", "Merge the vertices."),
        (
            "parts that are not connected",
            "several bodies, or faces that are not merged",
            "Merge common faces, or support each part.",
        ),
        (
            "are left out: only",
            "a file with other elements of the body's dimension",
            "Split these cells if they belong to the body.",
        ),
        ("their corner vertices are used", "elements of higher order among linear ones", "Write the whole mesh in order 2."),
        (
            "are split into",
            "wedges, pyramids, or elements of several kinds in a file",
            "Nothing, if linear simplices are fine enough; else mesh again.",
        ),
        ("are left out: they have no volume", "masses, springs and connectors in a file", "Add them as terms of the body."),
        ("is left out: it has the type", "analytical surfaces of Abaqus", "Use a shape of `RigidContact`."),
        ("that are not defined; they are left out", "a range of ids with gaps", "Nothing, if the set is what you expect."),
        ("straightened, because they fold", "`straighten=True`", "Nothing, if few elements are meant."),
        (
            "dropped, because they are on none",
            "vertices without elements, such as centres of arcs",
            "For ends of cables: `read_mesh(path, keep=[names])`.",
        ),
        ("they have dropped vertices", "facets of a boundary that are on no element", "Correct the group in the mesh generator."),
        ("because they are on no element", "nodes of a set that are on no element", "Correct the group in the mesh generator."),
        (
            "their edges are on no element",
            "facets or segments of a group that are on no quadratic element",
            "Correct the group, or `keep` it.",
        ),
        (
            "are reduced to their corners",
            "quadratic elements read or used with `degree=1`",
            "Leave `degree` out if curved edges matter.",
        ),
        ("flatter than 1:1000", "flat elements in single precision", "Take float64, or remesh."),
    ),
    "Bodies": (
        ("so their rows of K are zero", "a region without an elastic term", "Add a term for this region."),
        (
            "fix or remove such parts as well",
            "`System.without` cuts parts off",
            "Fix or remove them for statics; in motions they fly.",
        ),
        (
            "are treated as such",
            '`rule="lloyd"` at another Poisson\'s ratio',
            "Take this Poisson's ratio, or [another rule](../how-to/choose-springs.md).",
        ),
        (
            "the surface is not closed or not oriented",
            "a `RigidMesh` with holes or flipped facets",
            "Close and orient it, if bodies may get behind it.",
        ),
    ),
    "Solves": (("From t =", "the first state of the path with a finding", "See the findings above."),),
    "Motions": (
        (
            "is above the critical one",
            "an explicit step that is too large",
            "Leave `dt` out: [step size](../how-to/motion-blows-up.md#a-step-that-is-too-large).",
        ),
        (
            "inverted. ",
            "elements invert during the motion",
            "Add a volume term, or take smaller steps: [impact](../how-to/motion-blows-up.md#impact).",
        ),
        (
            "jump by up to",
            "a support that moves at once",
            "Move it by a ramp: [jumps](../how-to/motion-blows-up.md#a-support-that-jumps).",
        ),
        ("steps in a row had to be cut", "steps that find no state at once", "Take a smaller `dt`, or another tangent."),
        (
            "does not exist, so it begins at",
            "a resumed run with a new `save`",
            "Pass the `save` of the first run to continue its series.",
        ),
        ("is missing and cannot be restored", "a resumed series without one of its states", "Start again if you need this state."),
    ),
    "Results and files": (
        ("leaves no thickness", "membranes stretched so far that no thickness is left", "Check the units of loads and moduli."),
        (
            "shrunk to zero volume",
            "elements without volume in the state",
            "Check that the solve converged, and the prescribed displacements.",
        ),
        (
            "The new body has all of them",
            "a state of a body with removed elements",
            "Pass `system.without(elements)`, if it is meant.",
        ),
        ("missing files, the first of them", "a series without some of its files", "Restore the files, or go on without them."),
        ("has no locks", "a disk that cannot lock files", "Let one run at a time write there."),
    ),
    "Scenes, reduced bodies, start": (
        (
            "[expect] can limit energy_gained",
            "a scene's motion that blew up on the way, or gained energy",
            "Take a smaller `dt` or an implicit integrator.",
        ),
        ("No stable equilibrium at", "holes in a `PrecomputedResponse`", "Take a smaller range, or a term that resists inversion."),
        ("solves warned, the first of them", "solves of a `PrecomputedResponse` with findings", "See the findings above."),
        ("NUMBA_NUM_THREADS", "an invalid number of threads in the environment", "Set a whole number from 1, or unset it."),
    ),
}
#: Remedy of the failures for which messages name one that depends on the body.
INVERSION = (
    "Add a term that resists inversion, refine the mesh there, take more steps, or spread the load over more of the boundary."
)
FAILURES = ADVICE | {
    End.OUT_OF_ITERATIONS: f"Look at the last state: `result.plot()`. {INVERSION}",
    End.INSIDE_OUT: f"At t = 0: check the units of material, mesh and load first. {INVERSION}",
}
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
    Status.STOPPED: "Read the message: [why did Newton fail?](../how-to/newton-failed.md), "
    "[my motion blows up](../how-to/motion-blows-up.md).",
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
        "```python\n>>> from skfem_stvk.solvers.newton.outcome import Status\n>>> Status.UNSTABLE.value, Status.UNSTABLE.success\n"
        "('in equilibrium, but unstable', False)\n\n```\n",
        "## Outcomes of solves and motions\n\n`result.status` of a static solve and `run.status` of a motion:\n",
        "| status | its value | success | remedy |\n|---|---|---|---|",
        *(f"| `{s.name}` | {s.value} | {'yes' if s.success else 'no'} | {REMEDIES[s]} |" for s in Status),
        "\n## Why a step failed\n\nThese words are in messages after the load factor or the time:\n",
        "| words | remedy |\n|---|---|",
        *(f"| {end.value} | {cell(FAILURES[end])} |" for end in End if not end.converged),
        "\n## Findings\n",
        "`step.findings`, `run.findings` and warnings name elements and contacts outside the range of the model:\n",
        "| name | meaning | remedy |\n|---|---|---|",
        *(f"| {name} | {meaning} | {remedy} |" for name, meaning, remedy in FINDINGS),
        "\n## Errors\n\nAll errors are `StvkError`s, which are `ValueError`s. An interruption is a `KeyboardInterrupt`.\n",
        "| error | a kind of | meaning | remedy |\n|---|---|---|---|",
        *(f"| `{name}` | {kinds(error)} | {summary(error)} | {ERRORS[name]} |" for name, error in errors().items()),
        "\n## Warnings\n\n`StvkWarning` is a `UserWarning`: the input can be used, but is probably a mistake. Make it an error by\n"
        '`warnings.simplefilter("error", StvkWarning)`.\n',
        "| words | cause | remedy |\n|---|---|---|",
    ]
    for occasion, rows in WARNINGS.items():
        parts.append(f"| **{occasion}** | | |")
        parts.extend(f"| {words.strip()} | {cell(cause)} | {remedy} |" for words, cause, remedy in rows)
    parts.append("\nNext: [why did Newton fail?](../how-to/newton-failed.md), [read a report](../how-to/read-a-report.md).")
    return "\n".join(parts) + "\n"


def errors() -> dict[str, type[BaseException]]:
    """Return the errors that users catch, by name: those of `skfem_stvk.errors` and the public ones."""
    found = vars(skfem_stvk.errors) | {name: getattr(skfem_stvk, name) for name in skfem_stvk.__all__}
    kinds = StvkError | KeyboardInterrupt
    return {name: thing for name, thing in sorted(found.items()) if inspect.isclass(thing) and issubclass(thing, kinds)}


def kinds(error: type[BaseException]) -> str:
    """Return the names of the base classes of an error."""
    return ", ".join(f"`{base.__name__}`" for base in error.__bases__)


def summary(thing: type) -> str:
    """Return the first line of a docstring."""
    return cell((inspect.getdoc(thing) or "").split("\n")[0])


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
