"""What tests in several folders need."""

import os

import pytest
from hypothesis import settings

# Tests never assert a time, and the first example may compile a kernel; examples are the same in every run, and one that fails is
# printed so that it can be run again.
settings.register_profile("house", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("house")

# From Python 3.12 on numba says which kernels run only if it is asked to before it is imported (`kernels.parts.kernels_run`).
os.environ["NUMBA_ENABLE_SYS_MONITORING"] = "1"


def pytest_report_header() -> str:
    """Where the random numbers of the tests come from."""
    hypothesis = "Hypothesis derandomized, its failing examples are printed"
    return f"seeds: {hypothesis}; NumPy's generators have the seeds that stand in the tests"


@pytest.fixture(scope="session")
def gmsh():
    """Gmsh itself. Without it, or without the libraries of the system that its wheel needs, tests that mesh cannot run; in CI they
    fail.
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
    """Neighbouring tests go to the same process, which makes their fixtures and compiles their kernels once; who is done takes over
    the others'.
    """
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log)
