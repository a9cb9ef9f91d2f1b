"""Settings and fixtures of tests in several folders."""

import os

import pytest
from hypothesis import settings
from slow import mark_all_but_few

# Tests have no time limit, because the first example may compile a kernel. Examples are the same in every run. Failing examples are
# printed, so that they can be run again.
settings.register_profile("house", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("house")


def pytest_report_header() -> str:
    """Return the line of the report header that names the seeds of random numbers."""
    hypothesis = "Hypothesis derandomized, its failing examples are printed"
    return f"seeds: {hypothesis}; NumPy's generators are seeded in the tests"


@pytest.fixture(scope="session")
def gmsh():
    """Return the module gmsh.

    If gmsh or a system library that it needs is missing, the tests are skipped. In CI they fail.
    """
    try:
        import gmsh
    except (ImportError, OSError) as error:
        if os.environ.get("CI"):
            raise
        pytest.skip(
            f"Gmsh cannot be imported ({error}): pip install gmsh; on Debian "
            "apt install libglu1-mesa libxft2 libxcursor1 libxinerama1"
        )
    return gmsh


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Return a scheduler that gives neighbouring tests to one process, so that fixtures and kernels are made once per process.

    A process that has finished takes over tests of other processes.
    """
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark slow tests. Run tests on several ranks last: the kernels are compiled then, and not by all ranks at the same time."""
    mark_all_but_few(items)
    items.sort(key=lambda item: "on_ranks" in getattr(item, "fixturenames", ()))
