"""Parameters that take longer than there is time for in .ci/run; `python -m pytest -n auto -m slow` runs them."""

import pytest


def slow(*values, **options):
    """One parameter, or one row of them, that is slow."""
    return pytest.param(*values, marks=pytest.mark.slow, **options)


def slow_but(quick, values):
    """These parameters, of which all but the `quick` ones are slow."""
    assert not set(quick) - set(values)
    return [value if value in quick else slow(value) for value in values]
