"""Studies of contact with rigid shapes and between bodies, against closed forms and balances."""

from __future__ import annotations

from collections.abc import Sequence

NAMES = (
    "patch",
    "hertz",
    "stiffness",
    "capstan",
    "slope",
    "bar",
    "bounce",
    "pair",
    "balls",
    "ironing",
    "collision",
    "precision",
    "hard",
)
#: Quick runs leave out these studies, unless `--only` names them.
WHOLE_ONLY = ("stiffness", "hard")


def main(quick: bool = False, only: Sequence[str] = ()) -> int:
    """Compare contact with closed forms and balances: pressures, Hertz's ball, friction, impacts and energies."""
    from .studies import run

    return run(only or [name for name in NAMES if not (quick and name in WHOLE_ONLY)], quick)


__all__ = ["NAMES", "main"]
