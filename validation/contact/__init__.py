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
    "hard": "hard.hard",
}
NAMES = tuple(STUDIES)
#: Quick runs leave out this study, unless `--only` names it.
WHOLE_ONLY = ("hard",)


def main(quick: bool = False, only: Sequence[str] = ()) -> int:
    """Compare contact with closed forms and balances: pressures, Hertz's ball, friction, impacts and energies."""
    return run(__name__, STUDIES, only or [name for name in NAMES if not (quick and name in WHOLE_ONLY)], quick)


__all__ = ["NAMES", "STUDIES", "main"]
