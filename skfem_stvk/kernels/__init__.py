"""Arithmetic on bare arrays."""

import os

from ..errors import warn


def _usable_number_of_threads() -> None:
    """Take away a `NUMBA_NUM_THREADS` with which numba could not be imported, and say so: it has to be looked at before."""
    given = os.environ.get("NUMBA_NUM_THREADS")
    if given is not None and not (given.strip().isdecimal() and int(given) > 0):
        del os.environ["NUMBA_NUM_THREADS"]
        warn(f"NUMBA_NUM_THREADS = {given!r} is ignored; expected a whole number from 1, or no such variable.")


_usable_number_of_threads()
