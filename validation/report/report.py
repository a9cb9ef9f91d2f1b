"""All claims of all parts in one report: HTML, JSON and a table, compared with an earlier run."""

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
from skfem_stvk.results.files import replacing
from skfem_stvk.terminal import WIDTH, grid

from .catalogue import PARTS, Kind
from .job import Claim

#: Seconds that a job may take.
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
    """Run the claims of these groups, all by default. Write the report after each part, so that a run that is ended can be resumed.

    Return 0 if all claims hold and none is missing.
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
        said = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items())
        console.print(f"{', '.join(job)}: {said} ({max((claim.seconds for claim in claims), default=0.0):.0f} s)")
        if out is not None:
            _write(data(), Path(out))
    last = data()
    if out is not None:
        _write(last, Path(out))
    _print(console, [claim for job in jobs for claim in found[job]], last)
    return 0 if last["holds"] else 1


def _run_all(jobs: Sequence[Job], quick: bool) -> Iterator[tuple[Job, list[Claim]]]:
    """Yield each job with its claims when it ends."""
    with ThreadPoolExecutor(PROCESSES) as pool:
        running = {pool.submit(_run, *job, quick): job for job in jobs}
        try:
            for ended in as_completed(running):
                yield running[ended], ended.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _write(data: dict[str, Any], folder: Path) -> None:
    """Write the report; a reader finds the one before or this one, never a part."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (("validation.json", json.dumps(data, indent=1)), ("validation.html", page(data))):
        with replacing(folder / name) as part:
            part.write_text(text, encoding="utf-8")


def _earlier(out: str | None, quick: bool) -> tuple[dict[Job, list[Claim]], float]:
    """Return the claims by job that the report in this folder has, without missing ones, and the seconds that they took."""
    if out is None:
        raise StvkError("--resume needs the folder of the report that is resumed. Add --out FOLDER.")
    file = Path(out) / "validation.json"
    if not file.exists():
        return {}, 0.0
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        given, seconds = (data["provenance"]["commit"], data["quick"]), float(data["seconds"])
        claims = [Claim(**claim) for claim in data["claims"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise StvkError(f"{file} is no report of this command ({type(error).__name__}: {error}). Leave --resume out.") from error
    if given != (_commit(), quick):
        raise StvkError(f"{file} has commit, quick = {given}; expected {(_commit(), quick)}, those of this run: "
                        "claims of two versions are not mixed. Leave --resume out to begin again.")  # fmt: skip
    found: dict[Job, list[Claim]] = {}
    for claim in claims:
        found.setdefault((claim.group, claim.part), []).append(claim)
    return {job: several for job, several in found.items() if all(claim.outcome != "missing" for claim in several)}, seconds


def _jobs(groups: Sequence[str], quick: bool, speed: bool) -> list[Job]:
    """Groups and parts that are run: what measures time only if it is asked for."""
    unknown = [group for group in groups if group not in PARTS]
    if unknown:
        raise StvkError(f"There is no group {', '.join(unknown)}; there are {', '.join(PARTS)}.")
    return [
        (group, name)
        for group in groups or PARTS
        for name, part in PARTS[group].items()
        if (speed or not part.speed) and not (quick and part.whole_only)
    ]


def _run(group: str, name: str, quick: bool) -> list[Claim]:
    """The claims of one part, run in a process of its own; one that is missing if that crashed, or took too long."""
    part, start = PARTS[group][name], time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "claims.json"
        command = [sys.executable, "-m", "validation.report.job", group, name, str(file)] + ["--quick"] * quick
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=MOST[quick], cwd=Path(__file__).parents[2])
            why = done.stderr.strip().splitlines()[-1:] or [f"it ended with exit code {done.returncode}"]
        except subprocess.TimeoutExpired:
            why = [f"it took longer than {MOST[quick]:.0f} s"]
        if file.exists():
            found = [Claim(**claim) for claim in json.loads(file.read_text(encoding="utf-8"))]
            if found:
                return found
            why = ["it made no claim"]
    missing = Claim(part.kind.value, group, name, part.words or name, part.words, part.reference, part.reference_kind, part.source)
    missing.outcome, missing.failures, missing.seconds = "missing", why, time.perf_counter() - start
    return [missing]


def _read(name: str) -> dict[str, float | None]:
    """Values of an earlier report, by the claim's key."""
    try:
        data = json.loads(Path(name).read_text(encoding="utf-8"))
        return {f"{c['group']}/{c['part']}/{c['name']}": c["value"] for c in data["claims"]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise StvkError(f"--compare {name} is no report of this command ({type(error).__name__}: {error}); expected a "
                        "validation.json that an earlier run wrote.") from error  # fmt: skip


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
        "provenance": circumstances(PACKAGES) | {"commit": _commit(), "seeds": "stand in the sources; the referee's is 0"},
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
    """The report as one HTML file that needs no other."""
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
            why = "; ".join(claim.failures or claim.notes[-1:])  # of a study, or of a command that says it in its last line
            if not claim.failures and claim.error is not None and claim.tolerance is not None:
                why = f"{claim.error:.3g} > {claim.tolerance:.3g}: {claim.reason}"
            console.print(
                f"[{MARKS[claim.outcome]}]{claim.outcome}[/] {escape(f'{claim.group}, {claim.part}: {claim.name}: {why}')}"
            )
    moved = [
        c for c in claims if c.previous is not None and c.value is not None and abs(c.value - c.previous) > 1e-6 * abs(c.previous)
    ]
    if data["compared with"] is not None:
        console.print(f"{len(moved)} values moved since {data['compared with']}: {', '.join(c.name for c in moved[:10])}")
    counts = ", ".join(f"{count} {outcome}" for outcome, count in data["counts"].items())
    verdict = "[bold green]ALL HOLD[/]" if data["holds"] else "[bold red]NOT ALL HOLD[/]"
    console.print(f"{verdict}: {counts} in {data['seconds']:.0f} s")
