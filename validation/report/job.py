"""Claims of the report, and its jobs, each in a separate process.

`python -m validation.report.job GROUP PART FILE [--quick]` runs one job and writes its claims as JSON.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from .. import study
from . import numbers
from .catalogue import PARTS, Kind, Part


@dataclass
class Claim:
    """Claim with its reference and its outcome.

    Attributes
    ----------
    kind
        Code verification, solution verification, or validation against published values.
    group, part, name, words
        Group and part of the catalogue, name, and text of the claim.
    reference, reference_kind, source
        Reference, its kind, and its source.
    outcome
        "holds", "does not hold", "measured" (a study without a claim) or "missing".
    value, expected, error, tolerance, reason
        For a number: computed value, reference value, error, allowed error and its reason.
    previous
        Value in the earlier run of a comparison.
    failures, columns, rows, notes
        For a study: contradictions to the claim, and the table.
    seconds
        Time of the job [s].
    """

    kind: str
    group: str
    part: str
    name: str
    words: str = ""
    reference: str = ""
    reference_kind: str = ""
    source: str = ""
    outcome: str = "holds"
    value: float | None = None
    expected: float | None = None
    error: float | None = None
    tolerance: float | None = None
    reason: str = ""
    previous: float | None = None
    failures: list[str] = field(default_factory=list)
    columns: list[str] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def key(self) -> str:
        """Key of the claim, equal in all runs."""
        return f"{self.group}/{self.part}/{self.name}"


def of_number(number: numbers.Number, kind: Kind, group: str, part: str) -> Claim:
    """Return the claim of a number. It holds if the error is within the tolerance; NaN and infinity do not hold."""
    error = abs(number.value - number.expected)
    if number.relative and number.expected:
        error /= abs(number.expected)
    holds = math.isfinite(error) and error <= number.tolerance
    text = f"{number.expected:.6g}"
    claim = Claim(kind.value, group, part, number.name, number.words, text, number.reference_kind, number.source)
    claim.outcome = "holds" if holds else "does not hold"
    claim.value, claim.expected, claim.error = number.value, number.expected, error
    claim.tolerance, claim.reason, claim.notes = number.tolerance, number.reason, list(number.notes)
    return claim


def of_study(found: study.Study, part: Part, group: str, name: str) -> Claim:
    """Return the claim of a study, with its table."""
    outcome = "measured" if not found.claim and found.passed else "holds" if found.passed else "does not hold"
    title = found.name or name
    claim = Claim(part.kind.value, group, name, title, found.claim, part.reference, part.reference_kind, part.source, outcome)
    claim.failures = list(found.failures) if found.rows else ["nothing was measured"]
    claim.columns, claim.rows, claim.notes = list(found.columns), [list(row) for row in found.rows], list(found.notes)
    return claim


def claims_of(group: str, name: str, quick: bool) -> Iterator[Claim]:
    """Yield the claims of one part of a group. If the part has no studies, its claim gets the last printed lines as notes."""
    part = PARTS[group][name]
    if part.numbers:
        compute: Callable[[bool], Iterator[numbers.Number]] = getattr(numbers, part.numbers)
        for number in compute(quick):
            yield of_number(number, part.kind, group, name)
        return
    main, printed = import_module(f"validation.{group}").main, io.StringIO()
    options: dict[str, Any] = {"quick": quick} if part.takes_quick else {}
    options |= {"only": [name]} if name != "all" else {}
    with study.recording() as studies, contextlib.redirect_stdout(printed):
        code = main(**options)
    for found in studies:
        yield of_study(found, part, group, name)
    if not studies:
        claim = Claim(part.kind.value, group, name, part.words, part.words, part.reference, part.reference_kind, part.source)
        claim.outcome = "holds" if code == 0 else "does not hold"
        claim.notes = printed.getvalue().rstrip().splitlines()[-60:]
        yield claim


def main() -> int:
    """Run one job and write its claims."""
    parser = argparse.ArgumentParser(prog="python -m validation.report.job", description=__doc__)
    parser.add_argument("group")
    parser.add_argument("part")
    parser.add_argument("file")
    parser.add_argument("--quick", action="store_true")
    given, start = parser.parse_args(), time.perf_counter()
    claims = list(claims_of(given.group, given.part, given.quick))
    for claim in claims:
        claim.seconds = time.perf_counter() - start
    Path(given.file).write_text(json.dumps([asdict(claim) for claim in claims], allow_nan=True), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
