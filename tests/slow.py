"""Parameters that take too long for .ci/run; `python -m pytest -n auto -m slow` runs them."""

import pytest


def slow(*values, **options):
    """Return one parameter, or one row of parameters, marked as slow."""
    return pytest.param(*values, marks=pytest.mark.slow, **options)


def slow_but(quick, values):
    """Return the parameters `values`, all marked as slow except those in `quick`."""
    assert not set(quick) - set(values)
    return [value if value in quick else slow(value) for value in values]
