"""Contact with rigid shapes and between bodies, against closed forms and balances."""

from __future__ import annotations

from collections.abc import Sequence

from ..study import run

#: Modules and functions of the studies by name.
STUDIES = {
    "patch": "pressed.patch",
    "hertz": "hertz.hertz",
    "capstan": "pressed.capstan",
    "slope": "motions.slope",
    "bar": "motions.bar",
    "bounce": "motions.bounce",
    "pair": "pairs.pair",
    "balls": "between.balls",
    "ironing": "between.ironing",
    "collision": "pairs.collision",
}
NAMES = tuple(STUDIES)


def main(quick: bool = False, only: Sequence[str] = ()) -> int:
    """Compare contact with closed forms and balances: pressures, Hertz's ball, friction, impacts and energies."""
    return run(__name__, STUDIES, only or NAMES, quick)


__all__ = ["NAMES", "STUDIES", "main"]
