"""What a body is made of and what acts on it: specifications without a mesh, one a file."""

from .body import Body
from .body_force import BodyForce
from .foundation import ElasticFoundation
from .gravity import Gravity
from .load import Load
from .nodal_load import NodalLoad
from .pressure import Pressure
from .protocols import BoundLoad, BoundTerm, HasVolume, Term
from .stvk import StVK
from .traction import Traction

__all__ = [
    "Body",
    "BodyForce",
    "BoundLoad",
    "BoundTerm",
    "ElasticFoundation",
    "Gravity",
    "HasVolume",
    "Load",
    "NodalLoad",
    "Pressure",
    "StVK",
    "Term",
    "Traction",
]
