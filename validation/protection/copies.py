"""Copies of the checkout, in which mutants are planted and tests run. The files of the user do not change."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections import defaultdict
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from .mutants import PACKAGE, Mutant

#: Tests that read the source instead of running it would reject a mutant for its form; and the tests of this study.
FORM = (*(f"tests/test_{name}.py" for name in ("house", "words", "numpydoc")), "tests/validation/test_protection.py")
LEFT_OUT = shutil.ignore_patterns(".git", ".venv", ".hypothesis", "*_cache", "build", "dist")
FOLDER_OF_KERNELS = "from skfem_stvk.kernels.compiled import cache_folder; print(cache_folder())"
KERNELS = f"{PACKAGE}/kernels/__init__.py"
_stamps = count(1_000_000_000)  # times of edited files, all different, so that Python compiles each of them


class Log:
    """Events of one run of pytest: tests by probe, seconds of tests, and tiers of failed tests in their order."""

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
        self.failed |= {test: tiers[test] for test in tiers if test not in self.seconds}
        if code not in (0, 1, 5) and not self.failed:
            self.failed["pytest"] = "first"


class Copy:
    """Copy number `number` of the checkout `root` within `folder`."""

    def __init__(self, root: Path, folder: Path, number: int) -> None:
        self.path, self._folder, self._machine_code = folder / f"copy{number}", folder, folder / "machine-code"
        shutil.rmtree(self.path, ignore_errors=True)
        shutil.copytree(root, self.path, ignore=LEFT_OUT)
        shutil.copy(Path(__file__).with_name("plugin.py"), self.path / "protection_plugin.py")
        if (root / KERNELS).exists():
            self._share_machine_code(root)

    def _share_machine_code(self, root: Path) -> None:
        """Let all copies use one folder of machine code, which begins with that of `root`.

        Machine code belongs to the contents of the kernels. The package names its folder by the path of a checkout, however.
        """

        def folder_of(path: Path, **more: str) -> Path:
            command, environment = [sys.executable, "-c", FOLDER_OF_KERNELS], {**os.environ, "PYTHONPATH": str(path), **more}
            return Path(subprocess.run(command, cwd=path, env=environment, stdout=-1, text=True, check=True).stdout.strip())

        shared, own = self._machine_code / "shared", folder_of(self.path, NUMBA_CACHE_DIR=str(self._machine_code))
        if not shared.exists():
            shutil.copytree(folder_of(root), shared)
        if not own.is_symlink():
            own.rmdir()
            own.symlink_to("../shared")

    @contextmanager
    def with_faults(self, mutants: Collection[Mutant]) -> Iterator[dict[str, str]]:
        """Plant mutants within the block; yield the environment of its tests.

        Mutants in kernels have machine code of their own. It begins with hard links, because numba replaces files and never writes
        into them.
        """
        own = self._folder / f"machine-code-{self.path.name}"
        with self._edited([(one.file, one.start, one.end, one.text) for one in mutants]):
            if not any(one.compiled for one in mutants):
                yield {"NUMBA_CACHE_DIR": str(self._machine_code)}
                return
            shutil.rmtree(own, ignore_errors=True)
            shutil.copytree(self._machine_code, own, copy_function=os.link, symlinks=True)
            yield {"NUMBA_CACHE_DIR": str(own)}
            shutil.rmtree(own)

    @contextmanager
    def with_probes(self, mutants: Collection[Mutant]) -> Iterator[dict[str, str]]:
        """Within the block, mutated expressions and kernels report the tests that run them."""
        edits = [(one.file, at, at, text) for one in mutants if not one.compiled for at, text in one.probes()]
        if (self.path / KERNELS).exists():
            end = (self.path / KERNELS).stat().st_size
            edits.append((KERNELS, end, end, "\n__import__('protection_plugin').report_kernels()\n"))
        with self._edited(edits):
            yield {"NUMBA_CACHE_DIR": str(self._machine_code)}

    @contextmanager
    def _edited(self, edits: list[tuple[str, int, int, str]]) -> Iterator[None]:
        """Replace bytes of files (name, first, last, text) within the block."""
        before = {name: ((self.path / name).read_bytes(), (self.path / name).stat().st_mtime) for name, *_ in edits}
        try:
            for name, start, end, text in sorted(edits, key=lambda edit: edit[1], reverse=True):
                source = (self.path / name).read_bytes()
                self._write(name, source[:start] + text.encode() + source[end:], next(_stamps))
            yield
        finally:
            for name, old in before.items():
                self._write(name, *old)

    def _write(self, name: str, source: bytes, time: float) -> None:
        (self.path / name).write_bytes(source)
        os.utime(self.path / name, (time, time))

    def run(
        self, environment: dict[str, str], tests: list[str] | None = None, files: int = 0, slow: bool = False, jobs: int = 1,
        goes_on: str = "",
    ) -> Log:  # fmt: skip
        """Run tests, by default all of the first tier, until tests of so many files have failed (0: to the end).

        The log may have a name. Tests that have ended in a log of this name do not run again.
        """
        log = self._folder / (f"{goes_on}.log" if goes_on else f"{self.path.name}.log")
        if not goes_on:
            log.unlink(missing_ok=True)
        command = [sys.executable, "-m", "pytest", "-q", "--tb=line", "-p", "protection_plugin", "-p", "no:cacheprovider"]
        command += [f"--ignore={file}" for file in FORM] + ["-m", ""] * slow + ["-n", str(jobs)] * (jobs > 1)
        path = os.pathsep.join([str(self.path), *filter(None, [os.environ.get("PYTHONPATH")])])
        environment = {**os.environ, **environment, "PYTHONPATH": path, "PROTECTION_LOG": str(log), "PROTECTION_FILES": str(files)}
        if tests is not None:
            chosen = log.with_suffix(".tests")
            chosen.write_text("\n".join(tests), encoding="utf-8")
            environment["PROTECTION_TESTS"] = str(chosen)
            command += [file for file in sorted({file_of(test) for test in tests}) if (self.path / file).exists()]
        with open(log.with_suffix(".output"), "w") as output:
            process = subprocess.Popen(
                command, cwd=self.path, env=environment, stdout=output, stderr=output, start_new_session=True
            )
            try:
                process.wait()
            finally:
                with suppress(ProcessLookupError):  # what a hanging test has started
                    os.killpg(process.pid, signal.SIGKILL)
        return Log(log, process.returncode)


def file_of(test: str) -> str:
    """Return the file of a test."""
    return test.partition("::")[0]
