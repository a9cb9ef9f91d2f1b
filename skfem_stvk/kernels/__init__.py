"""Kernels: numerical routines on plain arrays, compiled by numba."""

import os

from ..errors import warn


def _usable_number_of_threads() -> None:
    """Remove an invalid `NUMBA_NUM_THREADS` from the environment with a warning, because numba fails to import with it.

    This must run before numba is imported.
    """
    value = os.environ.get("NUMBA_NUM_THREADS")
    if value is not None and not (value.strip().isdecimal() and int(value) > 0):
        del os.environ["NUMBA_NUM_THREADS"]
        warn(f"NUMBA_NUM_THREADS = {value!r} is ignored; expected a whole number from 1, or no such variable.")


_usable_number_of_threads()
