"""What tests in several folders need."""

import os

import pytest
from hypothesis import settings

settings.register_profile("house", deadline=None)  # tests never assert a time, and the first example may compile a kernel
settings.load_profile("house")


@pytest.fixture(scope="session")
def gmsh():
    """Gmsh itself. Without it, or without the libraries of the system that its wheel needs, tests that mesh cannot run; in CI they fail."""
    try:
        import gmsh
    except (ImportError, OSError) as error:
        if os.environ.get("CI"):
            raise
        pytest.skip(
            f"Gmsh cannot be imported ({error}): pip install gmsh; on Debian apt install libglu1-mesa libxft2 libxcursor1 libxinerama1"
        )
    return gmsh
