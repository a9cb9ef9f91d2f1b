"""Report of a verification: its head, its results, and its output as text for a terminal and as files."""

from __future__ import annotations

import hashlib
import json
import math
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table

from ..about import PACKAGES, circumstances
from ..arguments import choice, path
from ..edges.materials import FramedMaterial, Isotropic
from ..errors import StvkError
from ..mesh import ElementMesh
from ..results.complete_files import cannot_write, replacing
from ..terminal import WIDTH, CountedProgress, as_text, grid, html_table, printable
from ..terms import StVK
from .discretisation import Shape
from .judgement import location_in_words, plain
from .results import CheckOutcome, Naming, Result, Task

#: Style of each outcome, the worst first.
STYLE = {
    CheckOutcome.FAILED: "bold red",
    CheckOutcome.COULD_NOT_RUN: "yellow",
    CheckOutcome.PASSED: "green",
    CheckOutcome.NOT_APPLICABLE: "dim",
}
WORST_FIRST = list(STYLE)


@dataclass
class Report:
    """Results of `verify` and of the other checks; `print(report)` shows them.

    Attributes
    ----------
    header
        Versions, machine, mesh, material, command line, seed.
    results
        Results of all checks of all quantities in all states.
    precision
        Rows of error against strain (`checks.precision.precision_table`).
    speed
        Rows of time and memory (`checks.precision.speed_table`).
    errors
        Errors against 50 digits, which are plotted with the speed.
    named
        Explanations of a candidate that does not agree, or None if no explanation was searched for.
    interrupted
        Whether the verification was stopped before its end.
    seconds
        Duration of the verification [s].

    Examples
    --------
    >>> from skfem_stvk import verify_integrator
    >>> def euler(system, u, v, dt):                                      # explicit Euler, which claims to conserve energy
    ...     return u + dt * v, v - dt * system.mass().solve(system.internal_force(u))
    >>> report = verify_integrator(euler, order=1, conserves=("energy",), quiet=True)
    >>> report.passed, sorted({result.check for result in report.results if result.outcome.value == "failed"})
    (False, ['drift', 'stability limit'])
    """

    header: dict[str, Any]
    results: list[Result] = field(default_factory=list)
    precision: list[dict[str, Any]] = field(default_factory=list)
    speed: list[dict[str, Any]] = field(default_factory=list)
    errors: dict[str, dict[str, float]] = field(default_factory=dict)
    named: Naming | None = None
    interrupted: bool = False
    seconds: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether all checks ran, at least one passed, and none failed. Checks that do not apply are ignored."""
        counts = self.counts
        stopped = counts[CheckOutcome.COULD_NOT_RUN] or self.interrupted
        return counts[CheckOutcome.PASSED] > 0 and not (counts[CheckOutcome.FAILED] or stopped)

    @property
    def counts(self) -> Counter[CheckOutcome]:
        """Number of checks by outcome."""
        return Counter(result.outcome for result in self.results)

    def failures(self, subject: str | None = None) -> list[Result]:
        """Return the failed results, of one subject or of all.

        Parameters
        ----------
        subject
            A subject of the report; None for all.

        Raises
        ------
        StvkError
            if this subject has no results.
        """
        if subject is not None:
            subject = choice("subject", subject, {result.subject for result in self.results})
        return [r for r in self.results if r.outcome is CheckOutcome.FAILED and subject in (None, r.subject)]

    def groups(self) -> dict[tuple[str, str, str, str], list[Result]]:
        """Return the results by check, subject, reference and quantity, which are the lines of a table."""
        groups: dict[tuple[str, str, str, str], list[Result]] = {}
        checks = list(dict.fromkeys(result.check for result in self.results))
        for result in sorted(self.results, key=lambda result: checks.index(result.check)):
            groups.setdefault((result.check, result.subject, result.against, result.quantity), []).append(result)
        return groups

    def to_dict(self) -> dict[str, Any]:
        """Return all attributes in JSON types."""
        return {
            "passed": self.passed,
            "counts": {outcome.value: self.counts[outcome] for outcome in CheckOutcome},
            "interrupted": self.interrupted,
            "seconds": self.seconds,
            "header": self.header,
            "results": [result.to_dict() for result in self.results],
            "precision": self.precision,
            "speed": self.speed,
            "errors": self.errors,
            "named": None if self.named is None else self.named.to_dict(),
        }

    def __str__(self) -> str:
        return as_text(rendered(self))

    def _repr_html_(self) -> str:
        title = f"{'PASSED' if self.passed else 'NOT PASSED'} in {self.seconds:.1f} s{', interrupted' if self.interrupted else ''}"
        named = [("fault", *self.named.lines())] if self.named is not None else []
        return html_table(title, [*named, *checks_as_rows(self)])

    def save(self, folder: str | Path) -> Path:
        """Write `report.json` and the self-contained `report.html` into a folder, and return its path.

        Each file is written under another name first and then renamed, so that no file is ever half written.

        Parameters
        ----------
        folder
            Path of the folder, which is created if it is missing.

        Raises
        ------
        StvkError
            if the folder cannot be written to, or a picture cannot be drawn.
        """
        folder = folder_for(folder)
        write(folder / "report.json", json.dumps(self.to_dict(), indent=1))
        write(folder / "report.html", self._page())
        return folder

    def _page(self) -> str:
        """Return the report as the text of a self-contained HTML file, including the pictures."""
        from jinja2 import Environment  # only when a page is made

        environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
        environment.filters |= {"in_words": location_in_words, "plain": plain, "size": size_in_words, "tally": _tally_in_words}
        environment.filters |= {"worst_failure": worst_failure, "worst_first": partial(sorted, key=_rank)}
        template = environment.from_string(files(__package__).joinpath("page.html").read_text(encoding="utf-8"))
        groups: dict[str, list[Any]] = {"failed": [], "passed": [], "others": []}
        for group in self.groups().items():
            worst = worst_outcome(group[1])
            name = {CheckOutcome.PASSED: "passed", CheckOutcome.NOT_APPLICABLE: "others"}.get(worst, "failed")
            groups[name].append(group)
        return template.render(report=self, header=self.header, pictures=self._pictures(), groups=groups)

    def _pictures(self) -> list[str]:
        """Return the pictures of precision and speed as SVG texts; a report without a mesh has none."""
        if "lines" in self.header:
            return []
        try:
            from .plots import as_svg, error_against_strain, speed_against_error  # imports matplotlib
        except (ImportError, ValueError) as error:
            raise StvkError(
                f"report.html needs matplotlib, which cannot be imported: {error}. MPLBACKEND = "
                f"{os.environ.get('MPLBACKEND', '')!r}; 'agg' always works. report.json is written."
            ) from error
        return [as_svg(error_against_strain(self.precision)), as_svg(speed_against_error(self.speed, self.errors))]


def judge(command: str, head: Mapping[str, Any], tasks: Sequence[Task], quiet: bool, explain: Callable[[Report], None]) -> Report:
    """Return the report on a candidate without a mesh: run the tasks, then call `explain` to name the fault.

    `head` holds the `lines` that describe the candidate.
    """
    started, report = time.perf_counter(), Report(circumstances(PACKAGES) | dict(head))
    carry_out(report, command, tasks, quiet, {"what it is": partial(explain, report)})
    report.seconds = time.perf_counter() - started
    return report


def carry_out(
    report: Report, command: str, tasks: Sequence[Task], quiet: bool, then: Mapping[str, Callable[[], None]] | None = None
) -> None:
    """Run the tasks and then the named steps of `then`, with a progress bar, and add the results to the report.

    After Ctrl-C the results so far are kept. Tasks that did not run are reported as interrupted, and the remaining steps are
    skipped.
    """
    steps = then or {}
    with CountedProgress(command, len(tasks) + len(steps), quiet) as progress:
        try:
            for task in tasks:
                progress.step(f"{task.check}: {task.implementation.name}, {task.quantity}, {task.state}")
                report.results.append(task.run())
            for name, step in steps.items():
                progress.step(name)
                step()
        except KeyboardInterrupt:
            report.interrupted = True
            report.results += [task.missed("interrupted") for task in tasks[len(report.results) :]]


def folder_for(name: str | Path) -> Path:
    """Return the folder with this path, and create it if it is missing. Raise StvkError if it cannot be created."""
    folder = path("folder", name, "the path of a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
    return folder


def write(path: Path, text: str) -> None:
    """Write a file under another name first and then rename it."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")


# the head


def mesh_facts(shape: Shape) -> dict[str, Any]:
    """Return the hash, counts and shape of a mesh, and its integration rule. The hash covers coordinates and elements."""
    mesh, aspect = shape.mesh, shape.aspect
    a, b = np.array(mesh.element.edges).T
    lengths = np.linalg.norm(mesh.p[:, mesh.t[a]] - mesh.p[:, mesh.t[b]], axis=0)
    facts: dict[str, Any] = {
        "sha256": hashlib.sha256(mesh.p.tobytes() + mesh.t.tobytes()).hexdigest()[:16],
        "elements": f"{mesh.nt} {mesh.kind}",
        "curved elements": int(shape.curved.sum()),
        "rule": shape.discretisation.described(),
        "nodes": mesh.nv,
        "dofs": mesh.p.size,
        "size": [float(extent) for extent in np.ptp(mesh.p, axis=1)],
        "edges": {"shortest": float(lengths.min()), "median": float(np.median(lengths)), "longest": float(lengths.max())},
        "aspect ratio": f"{np.median(aspect):.3g} median, {aspect.max():.3g} in element {aspect.argmax()} "
        "(longest edge/smallest height)",
        "measure": float(shape.volume.sum()),
        "subdomains": {name: len(ids) for name, ids in mesh.subdomains.items()},
        "boundaries": {name: facets.shape[1] for name, facets in mesh.boundaries.items()},
    }
    if mesh.k == mesh.d:
        facts["negative elements"] = int((shape.orientation < 0).sum())
    return facts


def material_facts(mesh: ElementMesh, term: StVK) -> str:
    """Return the description of a term in one line."""
    material = term.material
    if isinstance(material, Isotropic):
        words = f"isotropic, E = {_range(material.young)}, nu = {'-' if material.poisson is None else _range(material.poisson)}"
    elif isinstance(material, FramedMaterial):
        stiffness = np.einsum("...ii->...i", material.stiffness())
        frames = {0: "", 2: ", a frame", 3: ", a frame per element"}[np.ndim(material.frame) if material.frame is not None else 0]
        words = f"{type(material).__name__}, diagonal of the elasticity matrix {_range(stiffness)}{frames}"
    else:
        words = type(material).__name__
    extras, sections = [f"plane {term.plane}"] if term.plane else [], {"thickness": term.thickness, "area": term.area}
    extras += [f"{name} {_range(value)}" for name, value in sections.items() if value is not None]
    return _region(mesh, term) + ", ".join([words, *extras])


def _region(mesh: ElementMesh, term: StVK) -> str:
    if term.region is None:
        return ""
    return f"{term.region!r}: " if isinstance(term.region, str) else f"{len(mesh.elements(term.region))} elements: "


def _range(values: Any) -> str:
    array = np.asarray(values, dtype=float)
    return f"{array.min():.6g}" if array.min() == array.max() else f"{array.min():.6g} ... {array.max():.6g}"


def header(shape: Shape, terms: Sequence[StVK], source: str, seed: int) -> dict[str, Any]:
    """Return the head of a report on this body. `source` names the type or origin of the mesh."""
    facts = {
        "mesh": {"source": source} | mesh_facts(shape),
        "material": [material_facts(shape.mesh, term) for term in terms],
        "seed": seed,
    }
    return circumstances(PACKAGES) | facts


# text for a terminal


def worst_outcome(results: Iterable[Result]) -> CheckOutcome:
    """Return the worst outcome of the results of a group."""
    return min(results, key=_rank).outcome


def _rank(result: Result) -> int:
    """Return the position of the outcome of a result among `WORST_FIRST`."""
    return WORST_FIRST.index(result.outcome)


def rendered(report: Report, width: int = WIDTH) -> RenderableType:
    """Return the report for a rich console: head, checks, failures, precision, speed and verdict.

    A narrow console gets fewer columns.
    """
    tables = [table(report, width) for table, rows in ((_precision, report.precision), (_speed, report.speed)) if rows]
    lines = [*_reasons(report), *_failures(report), *_named(report)]
    return Group(_head(report), _checks(report, width), *lines, *tables, _verdict(report))


def _head(report: Report) -> RenderableType:
    """Return the head: the `lines` of a report without a mesh, or lines on mesh and material, then machine and versions."""
    machine, versions = report.header["machine"], report.header["versions"]
    first = ("python", "skfem-stvk", "scikit-fem", "numpy", "scipy")
    lines = [
        *(report.header["lines"] if "lines" in report.header else _on_the_body(report.header)),
        f"{machine['processor']}, {machine['cores']} cores; "
        + ", ".join(f"{name} {versions[name]}" for name in first if name in versions),
    ]
    return printable("\n".join(lines))


def _on_the_body(header: dict[str, Any]) -> list[str]:
    mesh = header["mesh"]
    curved = f", {mesh['curved elements']} of them curved" if mesh["curved elements"] else ""
    return [
        f"{mesh['source']}: {mesh['elements']}{curved}, {mesh['nodes']} nodes, {mesh['dofs']} dofs, edges "
        f"{mesh['edges']['shortest']:.3g} ... {mesh['edges']['longest']:.3g}, sha256 {mesh['sha256']}",
        f"integrated by {mesh['rule']}",
        *header["material"],
        *(f"candidate: {line}" for line in header.get("candidate", [])),
        f"compared with {header['reference']}",
    ]


def _checks(report: Report, width: int) -> Table:
    columns = {"check": 0, "of": 0, "against": 108, "what": 0, "error": 0, "limit": 118, "worst in": 96, "passed": 0}
    shown = [column for column, needed in columns.items() if width >= needed]  # the rest is in report.json
    table = grid("Checks, the worst state of each", *shown, right=("error", "limit"))
    for outcome, row in _rows(report):
        styled = row | {"passed": f"[{STYLE[outcome]}]{row['passed']}[/]"}
        table.add_row(*(styled[column] for column in shown))
    return table


def checks_as_rows(report: Report) -> list[list[str]]:
    """Return the names of the columns, and the worst state of each check as a row, failures first."""
    rows = sorted(_rows(report), key=lambda entry: WORST_FIRST.index(entry[0]))
    return [list(row) for _, row in rows[:1]] + [list(row.values()) for _, row in rows]


def _rows(report: Report) -> Iterator[tuple[CheckOutcome, dict[str, str]]]:
    """Yield the outcome and the columns of each check, in its worst state."""
    for (check, subject, against, quantity), results in report.groups().items():
        outcome = worst_outcome(results)
        worst = max((r for r in results if r.outcome is outcome), key=error_over_limit)
        row = {
            "check": check,
            "of": subject,
            "against": against,
            "what": quantity,
            "error": _number(worst.measured),
            "limit": _number(worst.limit),
            "worst in": "" if outcome is CheckOutcome.NOT_APPLICABLE else worst.state,
            "passed": _tally(results, outcome),
        }
        yield outcome, row


def _reasons(report: Report) -> list[RenderableType]:
    """Return lines with the reasons for the limits, of the worst result of each row that has a limit, one line per reason."""
    reasons: dict[str, dict[str, None]] = {}
    for (check, _, _, quantity), results in report.groups().items():
        judged = [r for r in results if r.limit is not None]
        if judged:
            reasons.setdefault(max(judged, key=error_over_limit).reason, {})[f"{check} ({quantity})"] = None
    lines = [f"[dim]{printable(', '.join(names))}: {printable(reason)}[/]" for reason, names in reasons.items()]
    return ["[bold]Why these limits[/]", *lines, ""] if lines else []


def error_over_limit(result: Result) -> float:
    """Return the error of a result over its limit, infinity if the error is not finite, or -1 if nothing was measured."""
    if result.measured is None:
        return -1.0
    return result.measured / (result.limit or 1.0) if math.isfinite(result.measured) else math.inf


def _tally(results: list[Result], outcome: CheckOutcome) -> str:
    passed = sum(r.outcome is CheckOutcome.PASSED for r in results)
    run = sum(r.outcome is not CheckOutcome.NOT_APPLICABLE for r in results)
    if not passed:
        return outcome.value
    return f"{passed}/{run}" if outcome is CheckOutcome.PASSED else f"{passed}/{run} {outcome.value}"


def _number(value: float | None) -> str:
    if value is not None and not math.isfinite(value):
        return str(value)
    return "" if value is None else f"{value:.0f}" if value == int(value) and abs(value) < 1e6 else f"{value:.1e}"


def _failures(report: Report) -> list[RenderableType]:
    """Return lines on the worst failure of each group, and on checks that did not run or do not apply, one line per reason.

    Checks that did not run are listed with their states.
    """
    parts: list[RenderableType] = []
    for results in report.groups().values():
        if worst := worst_failure(results):
            parts.append(f"[{STYLE[CheckOutcome.FAILED]}]failed[/] {printable(failure_in_words(worst))}")
    for outcome in (CheckOutcome.COULD_NOT_RUN, CheckOutcome.NOT_APPLICABLE):
        reasons: dict[str, dict[str, dict[str, None]]] = {}
        for result in report.results:
            if result.outcome is outcome:
                name = f"{result.check} ({result.quantity}) of {result.subject}"
                reasons.setdefault(result.reason, {}).setdefault(name, {})[result.state] = None
        for reason, names in reasons.items():
            states_of = _states if outcome is CheckOutcome.COULD_NOT_RUN else lambda states: ""
            words = ", ".join(name + states_of(list(states)) for name, states in names.items())
            parts.append(f"[{STYLE[outcome]}]{outcome.value}[/] {printable(words)}: {printable(reason)}")
    return [*parts, ""] if parts else []


def _states(states: list[str]) -> str:
    """Return the states in words, the first three of many."""
    more = f" and {len(states) - 3} more states" if len(states) > 4 else ""
    return f" in {', '.join(states[:3] if more else states)}{more}"


def worst_failure(results: Iterable[Result]) -> Result | None:
    """Return the worst failure of a group; None if none failed."""
    failed = [result for result in results if result.outcome is CheckOutcome.FAILED]
    return max(failed, key=error_over_limit, default=None)


def failure_in_words(result: Result) -> str:
    """Return a sentence on a failure with its check, state, size and worst location, or the reason why the check did not run."""
    what = f"{result.check}, {result.quantity} of {result.subject}" + (f" against {result.against}" if result.against else "")
    return f"{what}, {size_in_words(result)}"


def size_in_words(result: Result) -> str:
    """Return the state of a failure, its size and its worst location, or the reason why the check did not run."""
    if result.measured is None:
        return f"{result.state}: {result.reason}"
    return f"{result.state}: {result.measured:.2e} > {result.limit:.0e} of {result.scale}. {location_in_words(result.worst)}"


def _named(report: Report) -> list[RenderableType]:
    """Return lines on the explanations of a candidate that failed."""
    if report.named is None:
        return []
    first, *others = report.named.lines()
    return [f"[bold]Fault[/] {printable(first)}", *(f"  [bold]{printable(line)}[/]" for line in others), ""]


def _precision(report: Report, width: int) -> Table:
    strains = sorted({row["strain"] for row in report.precision}, reverse=True)
    shown = strains[:: 2 if width >= 90 else 4]
    title = "Precision: error of F against 50 digits, by strain, on a homogeneous patch of the mesh"
    numbers = tuple(f"{s:.0e}" for s in shown)
    table = grid(title, "form", "rotation", "offset [m]", *numbers, right=numbers)
    errors = {(r["rotation_deg"], r["offset_m"], r["form"], r["strain"]): r["error"] for r in report.precision}
    for degrees, offset, form in dict.fromkeys(key[:3] for key in errors):
        table.add_row(form, f"{degrees} deg", f"{offset:g}", *(f"{errors[degrees, offset, form, s]:.0e}" for s in shown))
    return table


def _speed(report: Report, width: int) -> Table:
    columns = {"": 0, "of": 0, "ns per element": 0, "median": 90, "x reference": 0, "peak bytes per element": 90, "error": 0}
    shown = [column for column, needed in columns.items() if width >= needed]
    table = grid("Speed against error, one run", *shown, right=tuple(shown[2:]))
    for row in report.speed:
        error = report.errors.get(row["player"], {}).get(row["quantity"])
        cells = {
            "": row["quantity"],
            "of": row["player"],
            "ns per element": f"{row['ns_per_element']:.0f}",
            "median": f"{row['median_ns_per_element']:.0f}",
            "x reference": f"{row['ratio']:.1f}",
            "peak bytes per element": f"{row['peak_bytes_per_element']:.0f}",
            "error": "" if error is None else f"{error:.0e}",
        }
        table.add_row(*(cells[column] for column in shown))
    return table


def _verdict(report: Report) -> str:
    counts = ", ".join(f"{report.counts[outcome]} {outcome.value}" for outcome in CheckOutcome)
    word, style = ("PASSED", "bold green") if report.passed else ("NOT PASSED", "bold red")
    return f"[{style}]{word}[/]: {counts} in {report.seconds:.1f} s{', interrupted' if report.interrupted else ''}"


def _tally_in_words(results: Sequence[Result]) -> str:
    """Return how many of the results passed, of those that apply.

    >>> made = [Result("a", "b", "F", "rest", outcome) for outcome in (CheckOutcome.PASSED, CheckOutcome.NOT_APPLICABLE)]
    >>> _tally_in_words(made), _tally_in_words(made[1:])
    ('1 of 1 passed', 'not applicable')
    """
    run = [result for result in results if result.outcome is not CheckOutcome.NOT_APPLICABLE]
    passed = sum(result.outcome is CheckOutcome.PASSED for result in run)
    return f"{passed} of {len(run)} passed" if run else CheckOutcome.NOT_APPLICABLE.value
