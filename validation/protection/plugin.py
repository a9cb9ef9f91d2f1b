"""Plugin of pytest in copies of a checkout: it records tests and probes in a log, and runs chosen tests in a chosen order.

It is copied next to the tests as `protection_plugin`, and imports no other file of the project.
"""

from __future__ import annotations

import faulthandler
import os
from collections.abc import Iterator
from time import monotonic
from typing import Any

import pytest

LOG, FILES = os.environ.get("PROTECTION_LOG", os.devnull), int(os.environ.get("PROTECTION_FILES", 0))
#: Seconds after which a test hangs. Tests with a fault often do.
LONGEST = 600 if FILES else 3600
_nowhere = os.open(os.devnull, os.O_WRONLY)
_hits: set[tuple[str, str]] = set()
_failed: set[str] = set()


def write(*words: object) -> None:
    """Append one line to the log. One call of the system writes it whole, although several processes share the file."""
    file = os.open(LOG, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(file, ("\t".join(map(str, words)) + "\n").encode())
    os.close(file)


def hit(name: str) -> None:
    """Record that a test, perhaps in a process that it started, has run the probe of a mutant or a kernel.

    During the setup of a test and the import of its file, all tests of the file count as such, because they may share the result.
    """
    test = os.environ.get("PROTECTION_TEST")
    if test and (name, test) not in _hits:
        _hits.add((name, test))
        write("hit", name, test)


def report_kernels() -> None:
    """Let each kernel that Python calls from now on report its name."""
    from numba.core.registry import CPUDispatcher

    from skfem_stvk.kernels import compiled

    class Reporting(CPUDispatcher):
        def __call__(self, *arguments: Any, **named: Any) -> Any:
            hit(f"kernel {self.py_func.__name__}")
            return super().__call__(*arguments, **named)

    def kernel(function: Any, made: Any = compiled.kernel) -> Any:
        dispatcher = made(function)
        if dispatcher is not function:  # numba returns the function itself when it is switched off
            dispatcher.__class__ = Reporting
        return dispatcher

    compiled.kernel = kernel


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave the chosen tests or files, in their order, without those that have ended in an earlier run with this log."""
    ended = {line.split("\t")[1] for line in _lines(LOG) if line.startswith("end\t")}
    items[:] = [item for item in items if item.nodeid not in ended]
    if chosen := os.environ.get("PROTECTION_TESTS"):
        order = {test: number for number, test in enumerate(_lines(chosen))}
        order |= {item.nodeid: order[_file(item.nodeid)] for item in items if _file(item.nodeid) in order}
        items[:] = sorted((item for item in items if item.nodeid in order), key=lambda item: order[item.nodeid])


def _lines(name: str) -> list[str]:
    if not os.path.exists(name):
        return []
    with open(name, encoding="utf-8") as file:
        return file.read().splitlines()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Record the start and the end of a test. If it takes too long, the process ends without the latter."""
    began = monotonic()
    write("start", item.nodeid, "slow" if item.get_closest_marker("slow") else "first")
    faulthandler.dump_traceback_later(LONGEST, exit=True, file=_nowhere)
    result = yield
    faulthandler.cancel_dump_traceback_later()
    write("end", item.nodeid, round(monotonic() - began, 3))
    if FILES and len(_failed) >= FILES:
        item.session.shouldstop = "enough files have caught the fault"
    return result


@pytest.hookimpl(tryfirst=True)
def pytest_make_collect_report(collector: pytest.Collector) -> None:
    os.environ["PROTECTION_TEST"] = _file(collector.nodeid)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    os.environ["PROTECTION_TEST"] = _file(item.nodeid)
    if FILES and _file(item.nodeid) in _failed:
        pytest.skip("another test of this file has caught the fault")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_call(item: pytest.Item) -> None:
    os.environ["PROTECTION_TEST"] = item.nodeid


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.failed:
        _failed.add(_file(report.nodeid))
        write("fail", report.nodeid, "slow" if "slow" in report.keywords else "first")


def pytest_collectreport(report: pytest.CollectReport) -> None:
    if report.failed:
        write("fail", report.nodeid, "first")


def _file(test: str) -> str:
    return test.partition("::")[0]
