"""Report on all claims of all parts in HTML, JSON and a table, with a comparison with an earlier run."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from skfem_stvk.about import PACKAGES, circumstances
from skfem_stvk.errors import StvkError
from skfem_stvk.results.complete_files import replacing
from skfem_stvk.terminal import WIDTH, grid

from .catalogue import PARTS, Kind
from .job import Claim

#: Time limits of a job [s], for quick and whole reports.
MOST = {True: 400.0, False: 1800.0}
MARKS = {"holds": "green", "does not hold": "bold red", "missing": "yellow", "measured": "dim"}
PROCESSES = 2

#: Group and part.
Job = tuple[str, str]


def report(
    groups: Sequence[str] = (),
    quick: bool = False,
    out: str | None = None,
    speed: bool = False,
    compare: str | None = None,
    resume: bool = False,
) -> int:
    """Run the claims of these groups, by default of all groups, and return 0 if all claims hold and none is missing.

    The report is written after each part, so that an interrupted run can be resumed.
    """
    before = {} if compare is None else _read(compare)
    jobs = _jobs(groups, quick, speed)
    found, seconds = _earlier(out, quick) if resume else ({}, 0.0)
    console, started = Console(width=WIDTH, highlight=False), time.perf_counter() - seconds

    def data() -> dict[str, Any]:
        claims = [claim for job in jobs for claim in found.get(job, ())]
        for claim in claims:
            claim.previous = before.get(claim.key)
        unfinished = [", ".join(job) for job in jobs if job not in found]
        return _data(claims, unfinished, quick, speed, time.perf_counter() - started) | {"compared with": compare}

    for job, claims in _run_all([job for job in jobs if job not in found], quick):
        found[job] = claims
        outcomes = Counter(claim.outcome for claim in claims)
        counts = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items())
        console.print(f"{', '.join(job)}: {counts} ({max((claim.seconds for claim in claims), default=0.0):.0f} s)")
        if out is not None:
            _write(data(), Path(out))
    last = data()
    if out is not None:
        _write(last, Path(out))
    _print(console, [claim for job in jobs for claim in found[job]], last)
    return 0 if last["holds"] else 1


def _run_all(jobs: Sequence[Job], quick: bool) -> Iterator[tuple[Job, list[Claim]]]:
    """Yield each job with its claims as soon as the job ends."""
    with ThreadPoolExecutor(PROCESSES) as pool:
        running = {pool.submit(_run, *job, quick): job for job in jobs}
        try:
            for ended in as_completed(running):
                yield running[ended], ended.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _write(data: dict[str, Any], folder: Path) -> None:
    """Write the report. Files are replaced as a whole, so that a reader never finds an incomplete file."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (("validation.json", json.dumps(data, indent=1)), ("validation.html", page(data))):
        with replacing(folder / name) as part:
            part.write_text(text, encoding="utf-8")


def _earlier(out: str | None, quick: bool) -> tuple[dict[Job, list[Claim]], float]:
    """Return the claims by job in the report of this folder, without jobs that have missing claims, and their time [s]."""
    if out is None:
        raise StvkError("--out is missing; expected the folder of the report for --resume. Add --out FOLDER.")
    file = Path(out) / "validation.json"
    if not file.exists():
        return {}, 0.0
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        given, seconds = (data["provenance"]["commit"], data["quick"]), float(data["seconds"])
        claims = [Claim(**claim) for claim in data["claims"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise StvkError(f"{file} is not a report of this command ({type(error).__name__}: {error}). Omit --resume.") from error
    if given != (_commit(), quick):
        raise StvkError(f"{file} has commit, quick = {given}; expected {(_commit(), quick)}, the values of this run, because a "
                        "report must not mix two versions. Omit --resume to start again.")  # fmt: skip
    found: dict[Job, list[Claim]] = {}
    for claim in claims:
        found.setdefault((claim.group, claim.part), []).append(claim)
    return {job: several for job, several in found.items() if all(claim.outcome != "missing" for claim in several)}, seconds


def _jobs(groups: Sequence[str], quick: bool, speed: bool) -> list[Job]:
    """Return the groups and parts to run. Parts that measure time are included only if `speed`."""
    unknown = [group for group in groups if group not in PARTS]
    if unknown:
        raise StvkError(f"groups = {', '.join(unknown)}; expected some of {', '.join(PARTS)}.")
    return [
        (group, name)
        for group in groups or PARTS
        for name, part in PARTS[group].items()
        if (speed or not part.speed) and not (quick and part.whole_only)
    ]


def _run(group: str, name: str, quick: bool) -> list[Claim]:
    """Run one part in a separate process and return its claims. If the process failed or took too long, the claim is missing."""
    part, start = PARTS[group][name], time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "claims.json"
        command = [sys.executable, "-m", "validation.report.job", group, name, str(file)] + ["--quick"] * quick
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=MOST[quick], cwd=Path(__file__).parents[2])
            why = done.stderr.strip().splitlines()[-1:] or [f"the job ended with exit code {done.returncode}"]
        except subprocess.TimeoutExpired:
            why = [f"the job took longer than {MOST[quick]:.0f} s"]
        if file.exists():
            found = [Claim(**claim) for claim in json.loads(file.read_text(encoding="utf-8"))]
            if found:
                return found
            why = ["the job made no claim"]
    missing = Claim(part.kind.value, group, name, part.words or name, part.words, part.reference, part.reference_kind, part.source)
    missing.outcome, missing.failures, missing.seconds = "missing", why, time.perf_counter() - start
    return [missing]


def _read(name: str) -> dict[str, float | None]:
    """Return the values of an earlier report by the keys of the claims."""
    try:
        data = json.loads(Path(name).read_text(encoding="utf-8"))
        return {f"{c['group']}/{c['part']}/{c['name']}": c["value"] for c in data["claims"]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise StvkError(f"--compare {name} is not a report of this command ({type(error).__name__}: {error}); expected the "
                        "validation.json of an earlier run.") from error  # fmt: skip


def _data(claims: Sequence[Claim], unfinished: Sequence[str], quick: bool, speed: bool, seconds: float) -> dict[str, Any]:
    counts = Counter(claim.outcome for claim in claims)
    skipped = [f"{g}, {n}" for g, parts in PARTS.items() for n, part in parts.items() if part.speed and not speed]
    return {
        "holds": bool(claims) and not (unfinished or counts["does not hold"] or counts["missing"]),
        "counts": dict(counts),
        "seconds": seconds,
        "quick": quick,
        "unfinished": list(unfinished),
        "not run without --speed": skipped,
        "provenance": circumstances(PACKAGES) | {"commit": _commit(), "seeds": "fixed in the sources; 0 for the referee"},
        "claims": [asdict(claim) for claim in claims],
    }


def _commit() -> str:
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty"], capture_output=True, text=True, cwd=Path(__file__).parent, timeout=20
        )
        return found.stdout.strip() or "unknown"
    except OSError:
        return "unknown"


def page(data: dict[str, Any]) -> str:
    """Return the report as one self-contained HTML file."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string(files(__package__).joinpath("page.html").read_text(encoding="utf-8"))
    return template.render(data=data, kinds=[kind.value for kind in Kind])


def _print(console: Console, claims: Sequence[Claim], data: dict[str, Any]) -> None:
    for kind in Kind:
        of_kind = [claim for claim in claims if claim.kind == kind.value]
        if not of_kind:
            continue
        columns = ("claim", "computed", "reference", "error", "allowed", "previous", "")
        table = grid(kind.value.capitalize(), *columns, right=columns[1:6])
        for claim in of_kind:
            numbers = (claim.value, claim.expected, claim.error, claim.tolerance, claim.previous)
            shown = ["" if x is None else f"{x:.4g}" for x in numbers]
            table.add_row(escape(f"{claim.group}: {claim.name}"), *shown, f"[{MARKS[claim.outcome]}]{claim.outcome}[/]")
        console.print(table)
    for claim in claims:
        if claim.outcome in ("does not hold", "missing"):
            why = "; ".join(claim.failures or claim.notes[-1:])  # the last note of a command is its last line
            if not claim.failures and claim.error is not None and claim.tolerance is not None:
                why = f"{claim.error:.3g} > {claim.tolerance:.3g}: {claim.reason}"
            console.print(
                f"[{MARKS[claim.outcome]}]{claim.outcome}[/] {escape(f'{claim.group}, {claim.part}: {claim.name}: {why}')}"
            )
    moved = [
        c for c in claims if c.previous is not None and c.value is not None and abs(c.value - c.previous) > 1e-6 * abs(c.previous)
    ]
    if data["compared with"] is not None:
        console.print(f"{len(moved)} values changed since {data['compared with']}: {', '.join(c.name for c in moved[:10])}")
    counts = ", ".join(f"{count} {outcome}" for outcome, count in data["counts"].items())
    verdict = "[bold green]ALL HOLD[/]" if data["holds"] else "[bold red]NOT ALL HOLD[/]"
    console.print(f"{verdict}: {counts} in {data['seconds']:.0f} s")
