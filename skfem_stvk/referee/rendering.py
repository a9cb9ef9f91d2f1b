"""Text of a report for a terminal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table

from ..terminal import WIDTH, grid, printable
from .judgement import location_in_words
from .results import CheckOutcome, Findings, Result

STYLE = {
    CheckOutcome.PASSED: "green",
    CheckOutcome.FAILED: "bold red",
    CheckOutcome.COULD_NOT_RUN: "yellow",
    CheckOutcome.NOT_APPLICABLE: "dim",
}
WORST_FIRST = (CheckOutcome.FAILED, CheckOutcome.COULD_NOT_RUN, CheckOutcome.PASSED, CheckOutcome.NOT_APPLICABLE)


def worst_outcome(results: Iterable[Result]) -> CheckOutcome:
    """Return the worst outcome of the results of a group."""
    return min((result.outcome for result in results), key=WORST_FIRST.index)


def rendered(report: Findings, width: int = WIDTH) -> RenderableType:
    """Return the report for a rich console: head, checks, failures, precision, speed and verdict.

    A narrow console gets fewer columns.
    """
    tables = [table(report, width) for table, rows in ((_precision, report.precision), (_speed, report.speed)) if rows]
    lines = [*_reasons(report), *_failures(report), *_named(report)]
    return Group(_head(report), _checks(report, width), *lines, *tables, _verdict(report))


def _head(report: Findings) -> RenderableType:
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


def _checks(report: Findings, width: int) -> Table:
    columns = {"check": 0, "of": 0, "against": 108, "what": 0, "error": 0, "limit": 118, "worst in": 96, "passed": 0}
    shown = [column for column, needed in columns.items() if width >= needed]  # the rest is in report.json
    table = grid("Checks, the worst state of each", *shown, right=("error", "limit"))
    for outcome, row in _rows(report):
        styled = row | {"passed": f"[{STYLE[outcome]}]{row['passed']}[/]"}
        table.add_row(*(styled[column] for column in shown))
    return table


def checks_as_rows(report: Findings) -> list[list[str]]:
    """Return the names of the columns, and the worst state of each check as a row, failures first."""
    rows = sorted(_rows(report), key=lambda entry: WORST_FIRST.index(entry[0]))
    return [list(row) for _, row in rows[:1]] + [list(row.values()) for _, row in rows]


def _rows(report: Findings) -> Iterator[tuple[CheckOutcome, dict[str, str]]]:
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


def _reasons(report: Findings) -> list[RenderableType]:
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


def _failures(report: Findings) -> list[RenderableType]:
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


def _named(report: Findings) -> list[RenderableType]:
    """Return lines on the explanations of a candidate that failed."""
    if report.named is None:
        return []
    first, *others = report.named.lines()
    return [f"[bold]Fault[/] {printable(first)}", *(f"  [bold]{printable(line)}[/]" for line in others), ""]


def _precision(report: Findings, width: int) -> Table:
    strains = sorted({row["strain"] for row in report.precision}, reverse=True)
    shown = strains[:: 2 if width >= 90 else 4]
    title = "Precision: error of F against 50 digits, by strain, on a homogeneous patch of the mesh"
    numbers = tuple(f"{s:.0e}" for s in shown)
    table = grid(title, "form", "rotation", "offset [m]", *numbers, right=numbers)
    errors = {(r["rotation_deg"], r["offset_m"], r["form"], r["strain"]): r["error"] for r in report.precision}
    for degrees, offset, form in dict.fromkeys(key[:3] for key in errors):
        table.add_row(form, f"{degrees} deg", f"{offset:g}", *(f"{errors[degrees, offset, form, s]:.0e}" for s in shown))
    return table


def _speed(report: Findings, width: int) -> Table:
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


def _verdict(report: Findings) -> str:
    counts = ", ".join(f"{report.counts[outcome]} {outcome.value}" for outcome in CheckOutcome)
    word, style = ("PASSED", "bold green") if report.passed else ("NOT PASSED", "bold red")
    return f"[{style}]{word}[/]: {counts} in {report.seconds:.1f} s{', interrupted' if report.interrupted else ''}"
