"""What a body is made of and what acts on it: specifications without a mesh, one a file."""

from .body import Body
from .body_force import BodyForce
from .foundation import ElasticFoundation
from .gravity import Gravity
from .load import Load, is_load
from .nodal_load import NodalLoad
from .pressure import Pressure
from .protocols import (
    BoundLoad,
    BoundTerm,
    Grounded,
    HasDampingForce,
    HasMeanForce,
    HasPressure,
    HasStress,
    HasStretch,
    HasVolume,
    Quartic,
    Term,
)
from .stvk import StVK
from .traction import Traction
from .volume_penalty import VolumePenalty

__all__ = [
    "Body",
    "BodyForce",
    "BoundLoad",
    "BoundTerm",
    "ElasticFoundation",
    "Gravity",
    "Grounded",
    "HasDampingForce",
    "HasMeanForce",
    "HasPressure",
    "HasStress",
    "HasStretch",
    "HasVolume",
    "Load",
    "NodalLoad",
    "Pressure",
    "Quartic",
    "StVK",
    "Term",
    "Traction",
    "VolumePenalty",
    "is_load",
]
