"""Copies of the checkout, in which mutants are planted and tests run. The files of the user do not change."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from .mutants import PACKAGE, Mutant

#: Tests that read the source instead of running it would reject a mutant for its form; and the tests of this study.
FORM = (
    *(f"tests/test_{name}.py" for name in ("house", "words", "numpydoc")),
    "tests/validation/test_protection.py",
)
LEFT_OUT = shutil.ignore_patterns(".git", ".venv", ".hypothesis", "*_cache", "__pycache__", "build", "dist")
FOLDER_OF_KERNELS = "from skfem_stvk.kernels.compiled import cache_folder; print(cache_folder())"
_stamps = count(1_000_000_000)  # times of mutated files, all different, so that Python compiles each of them


class Log:
    """Events of one run of pytest: tests by probe, tiers of started and of failed tests, seconds, and whether pytest worked."""

    def __init__(self, file: Path, code: int) -> None:
        self.hits: dict[str, set[str]] = defaultdict(set)
        self.failed: dict[str, str] = {}
        self.seconds: dict[str, float] = {}
        tiers: dict[str, str] = {}
        for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else ():
            event, name, value = line.split("\t")
            if event == "hit":
                self.hits[name].add(value)
            elif event == "start":
                tiers[name] = value
            elif event == "end":
                self.seconds[name] = float(value)
            else:
                self.failed[name] = value
        # A test that did not end hung or crashed. Without any test, the package or a test cannot be imported.
        self.failed |= {test: tiers[test] for test in tiers.keys() - self.seconds.keys()}
        if code not in (0, 1, 5) and not self.failed:
            self.failed["pytest"] = "first"


class Copy:
    """A copy of the checkout `root` in `folder`, and the folder with the machine code of its kernels."""

    def __init__(self, root: Path, folder: Path, number: int) -> None:
        self.path, self._folder = folder / f"copy{number}", folder
        self._log = folder / f"log{number}"
        self.cache = folder / "machine-code"
        shutil.rmtree(self.path, ignore_errors=True)
        shutil.copytree(root, self.path, ignore=LEFT_OUT)
        shutil.copy(Path(__file__).with_name("plugin.py"), self.path / "protection_plugin.py")
        if (root / PACKAGE / "kernels" / "compiled.py").exists():
            self._machine_code_of(self._folder_of_kernels(root, {}))

    def _folder_of_kernels(self, path: Path, more: dict[str, str]) -> Path:
        command = [sys.executable, "-c", FOLDER_OF_KERNELS]
        environment = {**os.environ, "PYTHONPATH": str(path), **more}
        return Path(subprocess.run(command, cwd=path, env=environment, capture_output=True, text=True, check=True).stdout.strip())

    def _machine_code_of(self, source: Path) -> None:
        """Copy machine code that is there for another checkout. It belongs to the contents of the kernels, not to their path."""
        own = self._folder_of_kernels(self.path, {"NUMBA_CACHE_DIR": str(self.cache)})
        if source != own and not any(own.iterdir()):
            shutil.copytree(source, own, dirs_exist_ok=True)

    def adopt(self, other: Copy) -> None:
        """Take the machine code that another copy has compiled."""
        if (self.path / PACKAGE / "kernels" / "compiled.py").exists():
            own, theirs = (one._folder_of_kernels(one.path, {"NUMBA_CACHE_DIR": str(one.cache)}) for one in (self, other))
            if own != theirs:
                shutil.rmtree(own)
                shutil.copytree(theirs, own)

    @contextmanager
    def with_faults(self, mutants: Collection[Mutant]) -> Iterator[dict[str, str]]:
        """Plant mutants within the block; yield the environment of tests.

        Mutants in machine code have a cache of their own: hard links, because numba replaces files and never writes into them.
        """
        cache, own = self.cache, self._folder / f"machine-code-{self.path.name}"
        with self._edited({one.file: [] for one in mutants}, mutants):
            if any(one.compiled for one in mutants):
                shutil.rmtree(own, ignore_errors=True)
                cache = Path(shutil.copytree(self.cache, own, copy_function=os.link))
            yield {"NUMBA_CACHE_DIR": str(cache)}
        shutil.rmtree(own, ignore_errors=True)

    @contextmanager
    def with_probes(self, mutants: Iterable[Mutant]) -> Iterator[dict[str, str]]:
        """Have mutated places and kernels report the tests that run them, within the block."""
        insertions: dict[str, list[tuple[int, str]]] = defaultdict(list)
        for one in mutants:
            if not one.compiled:
                insertions[one.file] += one.probes()
        kernels = f"{PACKAGE}/kernels/__init__.py"
        if (self.path / kernels).exists():
            end = len((self.path / kernels).read_bytes())
            insertions[kernels] = [(end, "\n\n__import__('protection_plugin').report_kernels()\n")]
        with self._edited(insertions):
            yield {"NUMBA_CACHE_DIR": str(self.cache)}

    @contextmanager
    def _edited(self, insertions: dict[str, list[tuple[int, str]]], mutants: Collection[Mutant] = ()) -> Iterator[None]:
        before = {self.path / file: (self.path / file).read_bytes() for file in insertions}
        times = {file: file.stat().st_mtime for file in before}
        try:
            for file, source in before.items():
                name = file.relative_to(self.path).as_posix()
                edits = [(at, at, text) for at, text in insertions[name]]
                edits += [(one.start, one.end, one.text) for one in mutants if one.file == name]
                for start, end, text in sorted(edits, key=lambda edit: edit[0], reverse=True):
                    source = source[:start] + text.encode() + source[end:]
                file.write_bytes(source)
                stamp = next(_stamps)
                os.utime(file, (stamp, stamp))
            yield
        finally:
            for file, source in before.items():
                file.write_bytes(source)
                os.utime(file, (times[file], times[file]))

    def run(self, environment: dict[str, str], tests: list[str] | None = None, *, files: int = 0, slow: bool = False,
            jobs: int = 1) -> Log:  # fmt: skip
        """Run tests, by default all of the first tier, until tests of so many files have failed (0: to the end)."""
        command = [sys.executable, "-m", "pytest", "-q", "--tb=line", "-p", "protection_plugin", "-p", "no:cacheprovider"]
        command += [f"--ignore={file}" for file in FORM] + ["-m", ""] * slow + ["-n", str(jobs)] * (jobs > 1)
        environment = {
            **os.environ,
            **environment,
            "PROTECTION_LOG": str(self._log),
            "PYTHONPATH": os.pathsep.join([str(self.path), *filter(None, [os.environ.get("PYTHONPATH")])]),
        }
        if files:
            environment["PROTECTION_FILES"] = str(files)
        if tests is not None:
            chosen = self._log.with_suffix(".tests")
            chosen.write_text("\n".join(tests), encoding="utf-8")
            environment["PROTECTION_TESTS"] = str(chosen)
            command += sorted({file for file in (test.partition("::")[0] for test in tests) if (self.path / file).exists()})
        self._log.unlink(missing_ok=True)
        with open(self._log.with_suffix(".output"), "w") as output:
            process = subprocess.Popen(
                command, cwd=self.path, env=environment, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
            )
            try:
                process.wait()
            finally:  # processes that a hanging test has started
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
        return Log(self._log, process.returncode)
