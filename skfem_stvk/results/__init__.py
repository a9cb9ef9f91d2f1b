"""Results of a body at given displacements: strains, stresses, reactions, files and pictures."""

from .animation import animate
from .fields import Fields
from .plotting import plot
from .reactions import Reaction
from .series import Series
from .state import State
from .table import names
from .vtu import write_vtu

__all__ = ["Fields", "Reaction", "Series", "State", "animate", "names", "plot", "write_vtu"]
