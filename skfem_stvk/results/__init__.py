"""Results of a body at given displacements: strains, stresses, reactions, files and pictures."""

from .fields import Fields, State
from .network_comparison import NetworkComparison, compare_networks
from .plotting import animate, plot
from .reactions import Reaction
from .series import Series
from .table import names
from .vtu import write_mesh, write_vtu

__all__ = [
    "Fields",
    "NetworkComparison",
    "Reaction",
    "Series",
    "State",
    "animate",
    "compare_networks",
    "names",
    "plot",
    "write_mesh",
    "write_vtu",
]
