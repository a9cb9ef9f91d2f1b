"""The referee as a pytest plugin: a fixture that checks models, meshes to check them on, and marks.

    @pytest.mark.stvk_meshes("tetrahedra", "triangles")
    def test_my_model(stvk_referee, stvk_mesh):
        stvk_referee.assert_consistent(MyModel(stvk_mesh), stvk_mesh, young=1e5, poisson=0.3)

Every run of pytest in an environment with skfem-stvk imports this file. The file imports only pytest at first. It imports other
parts of this package when a test uses one of its fixtures.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from inspect import signature
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from .referee.report import Report

MARKS = (
    "stvk(**arguments): checked by skfem-stvk; the arguments are defaults of stvk_referee's assertions. "
    "Every test that uses stvk_referee has this mark: -m stvk, -m 'not stvk'.",
    "stvk_meshes(*kinds): the kinds of elements of the fixture stvk_mesh, one test for each; by default all kinds.",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--stvk-report FOLDER`."""
    parser.getgroup("skfem-stvk").addoption(
        "--stvk-report", metavar="FOLDER", help="write report.json and report.html of each check by stvk_referee to this folder"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Register the marks, so that --strict-markers accepts them."""
    for mark in MARKS:
        config.addinivalue_line("markers", mark)
    folder = config.getoption("--stvk-report")
    if folder is not None:
        try:  # before the tests, which may take a long time
            Path(folder).mkdir(parents=True, exist_ok=True)
            with TemporaryFile(dir=folder):
                pass
        except OSError as error:
            raise pytest.UsageError(f"--stvk-report={folder}: no reports can be written there ({error.strerror}).") from error


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Generate a test for each kind of elements in the mark of a test."""
    if "stvk_mesh" in metafunc.fixturenames:
        mark = metafunc.definition.get_closest_marker("stvk_meshes")
        if mark is not None:
            kinds = mark.args
        else:
            from .testing import KINDS

            kinds = tuple(KINDS)
        metafunc.parametrize("stvk_mesh", kinds, indirect=True)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that use the referee, so that they can be selected or excluded."""
    for item in items:
        if "stvk_referee" in getattr(item, "fixturenames", ()) and item.get_closest_marker("stvk") is None:
            item.add_marker("stvk")


@pytest.fixture
def stvk_mesh(request: pytest.FixtureRequest) -> Any:
    """Return a small scikit-fem mesh with edges of different lengths, elements of both orientations, and inner nodes."""
    from .testing import small_mesh

    return small_mesh(request.param)


@pytest.fixture
def stvk_referee(request: pytest.FixtureRequest) -> Referee:
    """Return the assertions of `skfem_stvk.testing`, which add counts of checks to the JUnit properties of the test."""
    return Referee(request.node, request.config.getoption("--stvk-report"))


class Referee:
    """Assertions of `skfem_stvk.testing` for one test; the mark `stvk` of the test may hold arguments for them."""

    def __init__(self, test: pytest.Item, folder: str | None) -> None:
        self.test, self.folder = test, folder
        self.judged = 0

    def assert_consistent(self, model: Any, mesh: Any, material: Any = None, **options: Any) -> Report:
        """Assert that W, F and K of a model are those of an elastic body, see `skfem_stvk.testing.assert_consistent`."""
        __tracebackhide__ = True
        from .testing import assert_consistent

        return self._judge(assert_consistent, assert_consistent, model, mesh, material, **options)

    def assert_law(self, **law: Any) -> Report:
        """Assert that energy, stress and tangent, or a subset, form a hyperelastic law, see `skfem_stvk.testing.assert_law`."""
        __tracebackhide__ = True
        from .referee.law import verify_law
        from .testing import assert_law

        return self._judge(assert_law, verify_law, **law)

    def _judge(self, judge: Callable[..., Report], declared: Callable[..., Report], *candidate: Any, **options: Any) -> Report:
        """Return the report of an assertion with the arguments of the mark; `declared` is a function with the valid ones."""
        __tracebackhide__ = True
        from .testing import Inconsistent

        mark = self.test.get_closest_marker("stvk")
        given = {} if mark is None else dict(mark.kwargs)
        known = signature(declared).parameters
        unknown = [name for name in given if name not in known]
        if unknown or (mark is not None and mark.args):
            got = ", ".join([*unknown, *map(repr, mark.args if mark is not None else ())])
            pytest.fail(
                f"The mark stvk has {got}; expected arguments of {judge.__name__} by name: {', '.join(known)}.", pytrace=False
            )
        arguments = {**given, **options}
        try:
            report = judge(*candidate, **arguments)
        except Inconsistent as failure:
            self._record(failure.report)
            raise
        self._record(report)
        return report

    def _record(self, report: Report) -> None:
        """Add the counts of checks to the properties of the test, and save the report in the folder, if there is one.

        The file name derives from the test's name.
        """
        self.judged += 1
        counts = ", ".join(f"{number} {outcome}" for outcome, number in report.to_dict()["counts"].items())
        properties = self.test.user_properties  # `record_property` fills it too, but warns about pytest's own default for JUnit
        properties.append(("skfem-stvk", f"{'passed' if report.passed else 'not passed'}: {counts}"))
        if self.folder is not None:
            name = re.sub(r"[^\w.-]+", "-", self.test.nodeid).strip("-")
            properties.append(("skfem-stvk report", str(report.save(Path(self.folder) / f"{name}-{self.judged}"))))
