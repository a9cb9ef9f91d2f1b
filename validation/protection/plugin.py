"""Plugin of pytest in the copies of a checkout: it records tests and probes in a log, and runs chosen tests in a chosen order.

It is copied next to the tests as `protection_plugin`, and imports nothing of the project.
"""

from __future__ import annotations

import faulthandler
import os
from collections.abc import Iterator
from time import monotonic
from typing import Any

import pytest

_hits: set[tuple[str, str]] = set()
_failed: set[str] = set()
_null = os.open(os.devnull, os.O_WRONLY)


def write(*words: object) -> None:
    """Append one line to the log. One call of the system writes it whole, although several processes share the file."""
    log = os.environ.get("PROTECTION_LOG")
    if log:
        file = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        os.write(file, ("\t".join(map(str, words)) + "\n").encode())
        os.close(file)


def hit(name: str) -> None:
    """Record that the running test, perhaps in a process that it started, has run the probe of a mutant or a kernel."""
    test = os.environ.get("PYTEST_CURRENT_TEST", "").rpartition(" (")[0]
    if test and (name, test) not in _hits:
        _hits.add((name, test))
        write("hit", name, test)


def report_kernels() -> None:
    """Make each kernel that Python calls from now on report its name. Called in the copy when `kernels` is imported."""
    from numba.core.registry import CPUDispatcher

    from skfem_stvk.kernels import compiled

    class Reporting(CPUDispatcher):
        def __call__(self, *arguments: Any, **named: Any) -> Any:
            hit(f"kernel {self.py_func.__name__}")
            return super().__call__(*arguments, **named)

    def kernel(function: Any, made: Any = compiled.kernel) -> Any:
        dispatcher = made(function)
        if dispatcher is not function:
            dispatcher.__class__ = Reporting
        return dispatcher

    compiled.kernel = kernel


def pytest_sessionstart(session: pytest.Session) -> None:
    session.config.stash[_SESSION] = session


_SESSION = pytest.StashKey[pytest.Session]()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave the chosen tests, in their order."""
    if chosen := os.environ.get("PROTECTION_TESTS"):
        with open(chosen, encoding="utf-8") as file:
            order = {test: number for number, test in enumerate(file.read().splitlines())}
        items[:] = sorted((item for item in items if item.nodeid in order), key=lambda item: order[item.nodeid])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """End the process if a test takes too long, as one with a fault may. The log then has its start and no end."""
    began = monotonic()
    write("start", item.nodeid, "slow" if item.get_closest_marker("slow") else "first")
    faulthandler.dump_traceback_later(float(os.environ.get("PROTECTION_SECONDS", 600)), exit=True, file=_null)
    result = yield
    faulthandler.cancel_dump_traceback_later()
    write("end", item.nodeid, round(monotonic() - began, 3))
    if len(_failed) >= int(os.environ.get("PROTECTION_FILES", 1_000_000)):
        item.config.stash[_SESSION].shouldstop = "enough files have caught the fault"
    return result


def pytest_runtest_setup(item: pytest.Item) -> None:
    if "PROTECTION_FILES" in os.environ and _file(item.nodeid) in _failed:
        pytest.skip("another test of this file has caught the fault")


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.failed:
        _failed.add(_file(report.nodeid))
        write("fail", report.nodeid, "slow" if "slow" in report.keywords else "first")


def pytest_collectreport(report: pytest.CollectReport) -> None:
    if report.failed:
        write("fail", report.nodeid, "first")


def _file(test: str) -> str:
    return test.partition("::")[0]
