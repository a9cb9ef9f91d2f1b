"""Calls that create bodies: materials, terms, meshes, systems."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import numpy as np

from skfem_stvk import (
    Anisotropic,
    BodyForce,
    Box,
    Corotated,
    EdgeNetwork,
    ElasticFoundation,
    ElementMesh,
    Friction,
    Gravity,
    InvertibleStVK,
    Isotropic,
    LinearElastic,
    MeshContact,
    NearestNode,
    NeoHookean,
    NodalLoad,
    Orthotropic,
    Plane,
    Pressure,
    Ramp,
    RigidBox,
    RigidContact,
    RigidCylinder,
    RigidMesh,
    RigidPlane,
    RigidSphere,
    Sine,
    SpringNetwork,
    StVK,
    System,
    Table,
    Traction,
    TransverselyIsotropic,
    VolumePenalty,
    frames_along,
    mesh_quality,
    read_mesh,
)
from skfem_stvk.mesh import bar, box, cylinder
from skfem_stvk.mesh.element import ELEMENTS
from skfem_stvk.mesh.locations import vertices_at

from .call import Call
from .small_bodies import (
    FLAG,
    NOT_NEGATIVE,
    NOTHING_LISTED,
    NUMBER,
    OPTIONAL,
    PLACE,
    POSITIVE,
    TEXT,
    call,
    mesh,
    square,
    tetrahedra,
)

FRAME = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
VOIGT = np.diag([4.0, 5.0, 6.0, 1.0, 2.0, 3.0])
NETWORK = EdgeNetwork.of(tetrahedra(), StVK(young=1.0, poisson=0.25))
#: Coordinates that a mesh may have. A `System` refuses them and names their vertices. A third coordinate makes a membrane.
NOT_FINITE = frozenset({"NaN in it", "inf in it"})
#: Three constants with one value for each element, if the mesh has one element.
ONE_ELEMENT = frozenset({"one axis more"})
#: Shapes of components: the same values for all vertices, or values for each of two vertices.
COMPONENTS = frozenset({"one axis more", "ragged list"})


def on_body(term: Any) -> System:
    """Return the system of a material and this term or load."""
    return System(mesh(), [StVK(young=2.0, poisson=0.25, density=1.0), term], fixed={"left": "xy"})


def _load(kind: type, **good: Any) -> Call:
    numbers = {"pressure": NUMBER, "g": COMPONENTS, "force": COMPONENTS, "traction": COMPONENTS}
    return call(
        kind.__name__,
        lambda **given: on_body(kind(**given)),
        {name: numbers.get(name, frozenset()) | (OPTIONAL if name == "region" else frozenset()) for name in good},
        {"where": PLACE, "region": PLACE},
        **good,
    )


def calls() -> list[Call]:
    """Return the calls of this table."""
    names = dict.fromkeys(("subdomains", "boundaries", "node_sets", "lines"), OPTIONAL | {"empty dict", "dict"})
    one, three = frozenset({"0.5"}), ("young", "poisson", "shear")
    material = {"density": OPTIONAL | POSITIVE, "frame": OPTIONAL}
    return [
        call(
            "Isotropic",
            Isotropic,
            material | {"young": POSITIVE, "poisson": OPTIONAL | NOT_NEGATIVE},
            young=2.0,
            poisson=0.25,
            density=4.0,
        ),
        call(
            "Isotropic.from_lame",
            Isotropic.from_lame,
            material | {"lam": NOT_NEGATIVE | {"-1"}, "mu": POSITIVE},
            lam=2.0,
            mu=2.0,
            density=4.0,
        ),
        call("Anisotropic", Anisotropic, material, voigt=VOIGT, density=4.0, frame=FRAME),
        call(
            "Orthotropic",
            Orthotropic,
            material | dict.fromkeys(three, ONE_ELEMENT),
            {name: rf"\b{name}(_\d\d?)?\b" for name in three},
            young=(4.0, 2.0, 1.0),
            poisson=(0.25, 0.25, 0.125),
            shear=(1.0, 2.0, 0.5),
            density=4.0,
            frame=FRAME,
        ),
        call(
            "frames_along",
            frames_along,
            {"directions": frozenset()},
            {"mesh": "mesh|directions", "directions": "directions|direction"},
            mesh=tetrahedra(),
            directions=[0.5, 0.25, 1.0],
        ),
        call(
            "TransverselyIsotropic",
            TransverselyIsotropic,
            material
            | dict.fromkeys(("young_axial", "young_transverse", "shear_axial", "poisson_axial", "poisson_transverse"), NUMBER),
            {"poisson_axial": "poisson_axial|Poisson's ratios"},
            young_axial=4.0,
            young_transverse=2.0,
            poisson_axial=0.25,
            poisson_transverse=0.25,
            shear_axial=1.0,
            density=4.0,
            frame=FRAME,
        ),
        call(
            "StVK",
            lambda **given: System(mesh(), [StVK(**given), StVK(young=1.0, poisson=0.125)]),
            {
                "young": one,
                "poisson": NOT_NEGATIVE,
                "density": one | OPTIONAL,
                "thickness": one | OPTIONAL,
                "plane": OPTIONAL,
                "region": OPTIONAL,
            },
            {"region": PLACE},
            young=2.0,
            poisson=0.25,
            density=4.0,
            region=[0, 1],
            plane="stress",
            thickness=2.0,
        ),
        call(
            "StVK that wrinkles",
            lambda **given: System(mesh(), [StVK(**given, plane="stress"), StVK(young=1.0, poisson=0.125)]),
            {"young": one, "poisson": NOT_NEGATIVE, "wrinkling": frozenset({"True"})},
            young=2.0,
            poisson=0.25,
            wrinkling=True,
        ),
        call(
            "StVK with simplices",
            lambda **given: System(mesh(), [StVK(**given), StVK(young=1.0, poisson=0.125)]),
            {"simplices": OPTIONAL, "young": one, "poisson": NOT_NEGATIVE | OPTIONAL},
            {"simplices": r"\bsimplices\b|on no element|the same vert|element"},
            young=2.0,
            poisson=0.25,
            simplices=[[0, 1], [1, 2]],
        ),
        call(
            "Corotated",
            lambda **given: System(mesh(), [Corotated(**given), StVK(young=1.0, poisson=0.125)]),
            {"young": one, "poisson": NOT_NEGATIVE, "density": one | OPTIONAL, "region": OPTIONAL},
            {"region": PLACE},
            young=2.0,
            poisson=0.25,
            density=4.0,
            region=[0, 1],
            rotation="vertex",
        ),
        call(
            "InvertibleStVK",
            lambda **given: System(mesh(), [InvertibleStVK(**given), StVK(young=1.0, poisson=0.125)]),
            {"young": one, "poisson": NOT_NEGATIVE, "density": one | OPTIONAL, "region": OPTIONAL},
            {"region": PLACE},
            young=2.0,
            poisson=0.25,
            density=4.0,
            region=[0, 1],
            threshold=0.75,
            extend="stress",
        ),
        call(
            "StVK of segments",
            lambda **given: System(ElementMesh(np.array([[0.0, 1.0]]), np.array([[0], [1]])), StVK(**given)),
            {"area": one | OPTIONAL},
            {"material": r"\bmaterial\b"},
            material=Isotropic(young=2.0),
            area=2.0,
        ),
        call(
            "NeoHookean",
            lambda **given: System(mesh(), [NeoHookean(**given), StVK(young=1.0, poisson=0.125)]),
            {
                "young": one,
                "poisson": NOT_NEGATIVE,
                "density": one | OPTIONAL,
                "thickness": one | OPTIONAL,
                "plane": OPTIONAL,
                "region": OPTIONAL,
            },
            {"region": PLACE, "poisson": r"\bpoisson\b|Poisson's ratio"},
            young=2.0,
            poisson=0.25,
            density=4.0,
            region=[0, 1],
            plane="stress",
            thickness=2.0,
        ),
        call(
            "LinearElastic",
            lambda **given: on_body(LinearElastic(**given)),
            {"young": one, "poisson": NOT_NEGATIVE, "density": one | OPTIONAL, "region": OPTIONAL},
            {"region": PLACE},
            young=2.0,
            poisson=0.25,
            density=4.0,
            region=[0, 1],
        ),
        call(
            "SpringNetwork",
            lambda **given: on_body(SpringNetwork(**given)),
            {
                "young": one,
                "poisson": NOT_NEGATIVE,
                "density": one | OPTIONAL,
                "rule": OPTIONAL,
                "thickness": one | OPTIONAL,
                "plane": OPTIONAL,
                "region": OPTIONAL,
            },
            {"region": PLACE},
            young=2.0,
            poisson=0.25,
            rule="van-gelder",
            density=4.0,
            region=[0, 1],
            plane="stress",
            thickness=2.0,
        ),
        call(
            "SpringNetwork of values",
            lambda **given: System(mesh(), SpringNetwork(**given)),
            {"density": one | OPTIONAL},
            stiffness=np.arange(1.0, 10.0),
            density=4.0,
        ),
        call(
            "SpringNetwork on a mesh",
            lambda mesh: (
                SpringNetwork(young=1.0, poisson=0.25).edges(mesh),
                SpringNetwork(young=1.0, poisson=0.25).constants(mesh),
            ),
            mesh=mesh(),
        ),
        call(
            "VolumePenalty",
            lambda **given: on_body(VolumePenalty(**given)),
            {"stiffness": one | OPTIONAL, "region": OPTIONAL},
            {"region": PLACE},
            stiffness=2.0,
            kind="quadratic",
            region="half",
        ),
        call("EdgeNetwork", EdgeNetwork, edges=NETWORK.edges, L=NETWORK.L),
        call(
            "EdgeNetwork.of",
            lambda **given: System(tetrahedra(), [EdgeNetwork.of(**given)]),
            mesh=tetrahedra(),
            law=StVK(young=1.0, poisson=0.25),
        ),
        call("EdgeNetwork.without", NETWORK.without, {}, {"pairs": "pairs"}, pairs="adjacent"),
        call(
            "ElasticFoundation",
            lambda **given: on_body(ElasticFoundation(**given)),
            {"stiffness": one},
            {"where": PLACE},
            where="left",
            stiffness=(2.0, 0.0),
        ),
        call("RigidPlane", RigidPlane, point=(0.0, -0.5), normal=(0.0, 2.0)),
        call(
            "RigidSphere",
            RigidSphere,
            {"radius": one, "inside": FLAG, "centre": frozenset({"one longer"})},
            centre=(0.0, -0.5),
            radius=2.0,
            inside=False,
        ),
        call(
            "RigidCylinder",
            RigidCylinder,
            {"radius": one, "inside": FLAG},
            point=(0.0, -0.5, 0.0),
            axis=(0.0, 0.5, 0.0),
            radius=2.0,
            inside=True,
        ),
        call("RigidBox", RigidBox, {"radius": NOT_NEGATIVE}, low=(0.0, -0.5), high=(2.0, 1.5), radius=0.25),
        call(
            "RigidMesh",
            RigidMesh,
            {},
            {"file": "RigidMesh"},
            file=(tetrahedra().p, tetrahedra().surface),
        ),
        call(
            "Friction",
            Friction,
            {"coefficient": one, "slip_speed": one | OPTIONAL, "slip_length": one | OPTIONAL},
            coefficient=0.25,
            slip_speed=0.5,
            slip_length=0.5,
        ),
        call(
            "RigidContact",
            lambda **given: on_body(RigidContact(**given)),
            {
                "stiffness": one | OPTIONAL,
                "onset": NOT_NEGATIVE,
                "motion": OPTIONAL | COMPONENTS,
                "where": OPTIONAL,
                "friction": OPTIONAL,
                "name": TEXT - {"NUL", "control characters", "long text", "lone surrogate"},
            },
            {"where": PLACE},
            shape=RigidPlane((0.0, -0.5), (0.0, 2.0)),
            where="left",
            stiffness=2.0,
            friction=Friction(0.25, slip_speed=0.5),
            onset=0.25,
            motion=(0.0, 0.5),
            name="floor",
        ),
        call(
            "MeshContact",
            lambda **given: System(box((1.0, 1.0, 1.0), (1, 1, 1)), [StVK(young=2.0, poisson=0.25), MeshContact(**given)]),
            {
                "distance": one,
                "stiffness": one | OPTIONAL,
                "first": OPTIONAL | {"as bool"},
                "second": OPTIONAL,
                "friction": OPTIONAL,
                "name": TEXT - {"NUL", "control characters", "long text", "lone surrogate"},
            },
            {"first": PLACE, "second": PLACE},
            first=list(range(8)),
            distance=0.5,
            stiffness=2.0,
            friction=Friction(0.25, slip_speed=0.5),
            name="skin",
        ),
        _load(Gravity, g=(0.0, -8.0)),
        _load(BodyForce, force=(0.0, -8.0), region="half"),
        _load(NodalLoad, where=[2, 5], force=(0.0, -8.0)),
        _load(Traction, where="right", traction=(0.0, -8.0)),
        _load(Pressure, where="right", pressure=2.0),
        *(
            call(
                f"{kind.__name__} at a time",
                lambda t=0.25, kind=kind, **given: kind(**given)(t),
                dict.fromkeys(given, NUMBER)
                | {"until": POSITIVE, "frequency": POSITIVE, "value": NUMBER | ONE_ELEMENT | {"one longer"}, "t": NUMBER},
                **given,
                t=0.25,
            )
            for kind, given in (
                (Ramp, {"value": 2.0, "until": 1.0, "start": 0.0}),
                (Sine, {"value": (2.0, 0.5), "frequency": 1.0, "phase": 0.5}),
                (Table, {"value": 2.0, "times": [0.0, 1.0], "factors": [0.0, 1.0]}),
            )
        ),
        call(
            "System",
            System,
            {"fixed": OPTIONAL | NOTHING_LISTED, "prescribed": OPTIONAL | NOTHING_LISTED, "dtype": OPTIONAL},
            {
                "terms": r"terms?\b",
                "fixed": "fixed|components|place|vertices",
                "prescribed": "prescribed|displacements",
            },
            mesh=mesh(),
            terms=[StVK(young=2.0, poisson=0.25)],
            fixed={"left": "xy"},
            prescribed={"right": {"x": 0.25}},
            dtype="float64",
        ),
        call(
            "System of a degree", System, {"degree": OPTIONAL}, mesh=tetrahedra(), terms=[StVK(young=2.0, poisson=0.25)], degree=2
        ),
        call(
            "System of boxes",
            System,
            {"hourglass": OPTIONAL | NOT_NEGATIVE},
            {"terms": r"terms?\b"},
            mesh=square(),
            terms=[StVK(young=2.0, poisson=0.25)],
            quadrature="one-point",
            hourglass=0.125,
        ),
        call(
            "read_mesh",
            lambda **given: read_mesh(str(files("skfem_stvk.mesh") / "data" / "bracket.msh"), **given),
            {"degree": OPTIONAL, "dimension": OPTIONAL},
            degree=2,
            dimension=3,
        ),
        call(
            "System of a place that is fixed",
            lambda where, components, value: System(
                mesh(), StVK(young=2.0, poisson=0.25), [(where, components)], [([2, 5], {"x": value})]
            ),
            {"value": NUMBER},
            {"where": PLACE, "components": "fixed on|components", "value": "prescribed on|component"},
            where=[0, 3],
            components="xy",
            value=[0.25, 0.5],
        ),
        call(
            "ElementMesh",
            ElementMesh,
            names | {"p": NOT_FINITE | {"one longer"}},
            p=mesh().p,
            t=mesh().t,
            subdomains={"a": [0]},
            boundaries={"b": [[0], [3]]},
            node_sets={"c": [5]},
            lines={"d": [[0], [1]]},
        ),
        call(
            "ElementMesh of an element",
            lambda **given: ElementMesh(mesh().p, mesh().t, **given),
            {"element": OPTIONAL},
            element=ELEMENTS["triangles"],
        ),
        call("ElementMesh.of", ElementMesh.of, {}, {}, mesh=(mesh().p, mesh().t)),
        call("mesh_quality", mesh_quality, {}, {}, mesh=(mesh().p, mesh().t)),
        call("ElementMesh.scaled", mesh().scaled, {"factor": POSITIVE}, factor=2.0),
        *(
            call(
                f"{kind.__name__} on a mesh",
                lambda kind=kind, **given: vertices_at(mesh(), kind(**given)),
                {"within": OPTIONAL | POSITIVE},
                dict.fromkeys(given, "|".join([*given, "no vertex", "the node nearest", "none of the"])),
                **given,
            )
            for kind, given in (
                (Box, {"low": (0.0, 0.0), "high": (1.0, 1.0)}),
                (Plane, {"point": (0.0, 0.0), "normal": (1.0, 0.5), "within": 0.25}),
                (NearestNode, {"point": (1.0, 0.75)}),
            )
        ),
        call(
            "box",
            box,
            {"element": OPTIONAL, "origin": OPTIONAL},
            {"size": "size|cells"},
            size=(2.0, 1.0),
            cells=(2, 1),
            element="triangles",
            origin=(0.5, 0.0),
        ),
        call("bar", bar, {"length": POSITIVE, "width": POSITIVE}, length=2.0, width=1.0, cells=(2, 1), element="hexahedra"),
        call(
            "cylinder",
            cylinder,
            {"radius": POSITIVE, "length": POSITIVE, "inner_radius": NOT_NEGATIVE},
            {"radius": "radius"},
            radius=2.0,
            length=1.0,
            cells=(2, 1),
            inner_radius=0.25,
        ),
        call("ElementMesh.with_degree", tetrahedra().with_degree, degree=2),
        call("ElementMesh.elements", mesh().elements, {"region": OPTIONAL}, {"region": PLACE}, region=[0, 2]),
        call(
            "ElementMesh.with_boundaries",
            mesh().with_boundaries,
            {"boundaries": frozenset({"empty dict"})},
            {"boundaries": "boundar"},
            boundaries={"new": [0, 1]},
        ),
    ]
