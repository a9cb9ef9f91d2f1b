"""Terms of a body and loads on it: specifications without a mesh, one per file."""

from typing import Any

from ..edges.bound_term import BoundElements, BoundTerm
from .body import Body
from .laws.corotated import Corotated
from .laws.edge_network import EdgeNetwork
from .laws.invertible import InvertibleStVK
from .laws.linear_elastic import LinearElastic
from .laws.neo_hookean import NeoHookean
from .laws.spring_network import SpringNetwork
from .laws.stvk import StVK
from .laws.volume_penalty import VolumePenalty
from .loads.contact import BoundContact, Friction
from .loads.dead_loads import BodyForce, Gravity, NodalLoad, Traction
from .loads.foundation import ElasticFoundation
from .loads.load import BoundLoad, Load, is_load
from .loads.mesh_contact import MeshContact
from .loads.pressure import Pressure
from .loads.rigid_contact import RigidContact
from .loads.rigid_mesh import RigidMesh
from .loads.rigid_shapes import RigidBox, RigidCylinder, RigidPlane, RigidSphere
from .loads.times import Ramp, Sine, Table
from .term import Deformation, PointResponse, Term

#: Terms that scenes know, by their `type`.
TERMS: dict[str, Any] = {
    "stvk": StVK,
    "neo-hookean": NeoHookean,
    "linear-elastic": LinearElastic,
    "corotated": Corotated,
    "invertible-stvk": InvertibleStVK,
    "spring-network": SpringNetwork,
    "edge-network": EdgeNetwork,
    "volume-penalty": VolumePenalty,
    "elastic-foundation": ElasticFoundation,
    "rigid-contact": RigidContact,
    "mesh-contact": MeshContact,
    "gravity": Gravity,
    "body-force": BodyForce,
    "nodal-load": NodalLoad,
    "traction": Traction,
    "pressure": Pressure,
}

__all__ = [
    "TERMS",
    "Body",
    "BodyForce",
    "BoundContact",
    "BoundElements",
    "BoundLoad",
    "BoundTerm",
    "Corotated",
    "Deformation",
    "EdgeNetwork",
    "ElasticFoundation",
    "Friction",
    "Gravity",
    "InvertibleStVK",
    "LinearElastic",
    "Load",
    "MeshContact",
    "NeoHookean",
    "NodalLoad",
    "PointResponse",
    "Pressure",
    "Ramp",
    "RigidBox",
    "RigidContact",
    "RigidCylinder",
    "RigidMesh",
    "RigidPlane",
    "RigidSphere",
    "Sine",
    "SpringNetwork",
    "StVK",
    "Table",
    "Term",
    "Traction",
    "VolumePenalty",
    "is_load",
]
