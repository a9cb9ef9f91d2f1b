"""Protection: how many of sixty small faults in the package the tests catch, which test catches each, and in which tier.

`python -m validation protection --list` prints the mutants (`mutants.py`). Each mutant is judged in a copy of the checkout:

1. One run of the first tier with probes says which tests run each mutated expression. Machine code has no probes: there, these are
   the tests that call a kernel that contains the mutated function, directly or through others.
2. The first tier is run on each mutant: only those tests, quick files first, until two files have caught it.
3. What remains is planted together in one copy, and all tests run, with the slow ones. Each of these mutants alone then runs
   against the tests that have failed.

`mutants.toml` has the verdicts, and is written after each of them, so that a run that was stopped goes on. `--again` judges all
mutants again, first by the tests that have caught them before. A verdict `equivalent = "reason"` is written by hand, for a mutant
that changes nothing that a test could observe; it is retained and not counted.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from queue import Queue
from threading import Lock

from rich.console import Console
from rich.table import Table

from .copies import Copy, Log, file_of
from .mutants import PACKAGE, Mutant, drawn, kernels_with, rooms

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
TABLE = Path(__file__).with_name("mutants.toml")
NAMES = tuple(rooms(ROOT))
#: Share of the mutants caught by all tests that the first tier must catch.
LEAST = 0.95
#: Verdicts: caught by a test of the first tier, by a slow test only, by none; not by the tests of the first tier that run it.
FIRST, SLOW, NONE, OPEN = "first", "slow", "none", "open"


@dataclass(frozen=True)
class Verdict:
    """One row of the table: a mutant, the tier that catches it, its first catching test, and one of another file, or NONE.

    If no test of another file was looked for, `also` is empty.
    """

    name: str
    file: str
    function: str
    line: int
    before: str
    after: str
    tier: str = ""
    test: str = ""
    also: str = ""
    equivalent: str = ""

    @property
    def identity(self) -> tuple[str, ...]:
        return self.name, self.function, self.before, self.after

    @property
    def known(self) -> list[str]:
        """Tests that have caught the mutant, if another file was looked for."""
        return [test for test in (self.test, self.also) if test != NONE] if self.also else []


class Study:
    """Mutants of the checkout `root`, judged in copies within `folder`, with verdicts in the file `table`."""

    def __init__(self, root: Path, folder: Path, table: Path, jobs: int) -> None:
        self.root, self.folder, self.table, self.jobs = root, folder, table, jobs
        self.mutants = {one.name: one for one in drawn(root)}
        old = {one.identity: one for one in _read(table)}
        self.verdicts: dict[str, Verdict] = {}
        for name, one in self.mutants.items():
            row = Verdict(name, one.file, one.function, one.line, *one.lines((root / one.file).read_bytes()))
            known = old.get(row.identity, row)
            self.verdicts[name] = replace(known, file=row.file, line=row.line)
        self._lock = Lock()

    def judge(self, names: Iterable[str]) -> None:
        """Judge the mutants that have no verdict yet."""
        names = [name for name in names if not self.verdicts[name].equivalent]
        new = self._of(names, "")
        if not new and not self._of(names, OPEN):
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        copies = [Copy(self.root, self.folder, number) for number in range(self.jobs)]
        known = {name: self.verdicts[name].known for name in new}
        sound = self._passing(copies[0], sorted({test for tests in known.values() for test in tests}))
        self._each(copies, {name: tests for name, tests in known.items() if tests and sound.issuperset(tests)}, again=True)
        new = self._of(new, "")
        if new:
            self._each(copies, self._tests_by_mutant(copies[0], new))
        self._all_tests(copies[0], self._of(names, OPEN))

    def _of(self, names: Iterable[str], tier: str) -> list[str]:
        return [name for name in names if self.verdicts[name].tier == tier]

    def _passing(self, copy: Copy, tests: list[str]) -> set[str]:
        """Return those of the tests that pass, or are slow, without a fault."""
        if not tests:
            return set()
        with copy.with_faults(()) as environment:
            log = copy.run(environment, tests)
        return log.seconds.keys() - log.failed.keys()

    def _tests_by_mutant(self, copy: Copy, names: list[str]) -> dict[str, list[str]]:
        """Return the tests of the first tier that run each mutant, from one run with probes, which is stored."""
        tree = _hash_of(copy.path, self.mutants.values())
        print(f"one run of the first tier with probes; its log is {self.folder}/probes-{tree}.log", flush=True)
        with copy.with_probes(self.mutants.values()) as environment:
            log = copy.run(environment, jobs=self.jobs, goes_on=f"probes-{tree}")
        return {name: self._in_order(self.mutants[name], log) for name in names}

    def _in_order(self, mutant: Mutant, log: Log) -> list[str]:
        """Return the tests that run a mutant: those in the folder of its room first, then files that take little time."""
        probes = [f"kernel {name}" for name in kernels_with(mutant, self.root)] if mutant.compiled else [mutant.name]
        hits = {test for probe in probes for test in log.hits[probe]}  # tests, and files whose tests share the result
        tests = {test for test in log.seconds.keys() - log.failed.keys() if test in hits or file_of(test) in hits}
        order, spent = {test: number for number, test in enumerate(log.seconds)}, dict.fromkeys(map(file_of, tests), 0.0)
        for test in tests:
            spent[file_of(test)] += log.seconds[test]
        near = f"tests/{mutant.room}/"
        return sorted(tests, key=lambda test: (not test.startswith(near), spent[file_of(test)], file_of(test), order[test]))

    def _each(self, copies: list[Copy], tests: dict[str, list[str]], again: bool = False) -> None:
        """Judge each mutant by its tests; with `again`, leave those open that not all of the tests have caught."""
        free: Queue[Copy] = Queue()
        for copy in copies:
            free.put(copy)

        def one(name: str) -> None:
            copy = free.get()
            try:
                caught = self._caught(copy, name, tests[name]) if tests[name] else []
                if not again or len(caught) == len(tests[name]):
                    self._conclude(name, FIRST if caught else OPEN, caught)
            finally:
                free.put(copy)

        with ThreadPoolExecutor(len(copies)) as pool:
            list(pool.map(one, sorted(tests, key=lambda name: len(tests[name]))))

    def _caught(self, copy: Copy, name: str, tests: list[str], slow: bool = False) -> list[str]:
        """Return the first test that catches a mutant and the first one in another file; with `slow`, a quick one first."""
        with copy.with_faults([self.mutants[name]]) as environment:
            log = copy.run(environment, tests, files=2, slow=slow)
        by_file: dict[str, str] = {}
        for test in log.failed:
            by_file.setdefault(file_of(test), test)
        return sorted(by_file.values(), key=lambda test: log.failed[test] != FIRST)

    def _all_tests(self, copy: Copy, names: list[str]) -> None:
        """Judge mutants that the tests of the first tier that run them did not catch, by all tests, planted together."""
        if not names:
            return
        print(f"all tests, with {len(names)} mutants planted together: {', '.join(names)}", flush=True)
        planted = [self.mutants[name] for name in names]
        with copy.with_faults(planted) as environment:
            log = f"all-{_hash_of(copy.path, planted)}"
            failed = copy.run(environment, slow=True, jobs=self.jobs, goes_on=log).failed
        with copy.with_faults(()) as environment:
            wrong = copy.run(environment, list(failed), slow=True).failed if failed else {}
        suspects = sorted(failed.keys() - wrong.keys(), key=lambda test: (failed[test] != FIRST, file_of(test)))
        for name in names:
            caught = self._caught(copy, name, suspects, slow=True) if suspects else []
            self._conclude(name, failed[caught[0]] if caught else NONE, caught)

    def _conclude(self, name: str, tier: str, caught: list[str]) -> None:
        test, also = (*caught, NONE)[:2] if caught else ("", "")
        with self._lock:
            self.verdicts[name] = replace(self.verdicts[name], tier=tier, test=test, also=also)
            self.write()
            print(f"{name}: {tier}  {test}  {also}", flush=True)

    def write(self) -> None:
        """Write the table: whole, or the old one stays."""
        rows = []
        for one in self.verdicts.values():
            rows += ["[[mutant]]", *(f"{key} = {_quoted(value)}" for key, value in asdict(one).items() if value), ""]
        new = self.table.with_suffix(".new")
        new.write_text("\n".join(rows), encoding="utf-8")
        os.replace(new, self.table)


def _quoted(value: str | int) -> str:
    """Return a value as TOML writes it."""
    return json.dumps(value, ensure_ascii=False)


def _read(table: Path) -> list[Verdict]:
    return [Verdict(**row) for row in tomllib.loads(table.read_text(encoding="utf-8"))["mutant"]] if table.exists() else []


def _hash_of(root: Path, mutants: Iterable[Mutant]) -> str:
    """Return a hash of the package, its tests and the mutants."""
    files = [path for folder in (PACKAGE, "tests") for path in sorted((root / folder).rglob("*.py"))]
    return sha256(b"".join([*(path.read_bytes() for path in files), repr(list(mutants)).encode()])).hexdigest()[:12]


def report(verdicts: Iterable[Verdict], console: Console) -> bool:
    """Print the numbers of caught mutants by room, the others, and the files that alone catch one; return whether LEAST holds."""
    counted = [one for one in verdicts if not one.equivalent]
    table = Table("room", *(heading for heading in ("first tier", "slow only", "none", "not judged")), box=None)
    tiers: dict[str, Counter[str]] = defaultdict(Counter)
    for one in counted:
        tiers[one.name.partition("/")[0]][one.tier] += 1
    tiers["all"] = Counter(one.tier for one in counted)
    for room, number in tiers.items():
        table.add_row(room, *(str(sum(number[tier] for tier in some)) for some in ((FIRST,), (SLOW,), (NONE,), ("", OPEN))))
    console.print(table)
    for one in counted:
        if one.tier in (SLOW, NONE):
            console.print(f"{one.name}, {one.file}:{one.line} {one.function}, caught by {one.test or 'no test'}", markup=False)
            console.print(f"    {one.before}\n    {one.after}", markup=False)
    alone = Counter(file_of(one.test) for one in counted if one.also == NONE)
    console.print("files that alone catch mutants:", ", ".join(f"{file} ({n})" for file, n in alone.most_common()), markup=False)
    first, slow = tiers["all"][FIRST], tiers["all"][SLOW]
    share = first / max(first + slow, 1)
    console.print(f"the first tier catches {share:.1%} of the mutants that all tests catch (expected at least {LEAST:.0%})")
    return share >= LEAST


def main(only: list[str], again: bool = False, listed: bool = False) -> int:
    """Plant sixty small faults in copies of the package; the first tier of the tests catches 95 % of those that all tests catch."""
    folder = Path(tempfile.gettempdir()) / f"skfem-stvk-protection-{sha256(str(ROOT).encode()).hexdigest()[:12]}"
    study = Study(ROOT, folder, TABLE, os.cpu_count() or 1)
    names = [name for name in study.mutants if not only or name.partition("/")[0] in only]
    console = Console(width=132, highlight=False)
    if listed:
        for one in (study.verdicts[name] for name in names):
            console.print(f"{one.name}, {one.file}:{one.line} {one.function}\n    {one.before}\n    {one.after}", markup=False)
        return 0
    for name in names:
        if again:
            study.verdicts[name] = replace(study.verdicts[name], tier="")
    study.judge(names)
    return 0 if report([study.verdicts[name] for name in names], console) else 1
