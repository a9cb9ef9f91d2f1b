"""Whole schema of a scene: first state, output files and expected results."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, create_model

from ...edges.materials import MATERIALS
from ...solvers.dynamics.integrators import INTEGRATORS
from ...terms import TERMS
from ...units import UNITS, implausible_moduli
from .analyses import ReducedBasis, Solver, analyses
from .derived import one_of
from .places import Mesh, Place, PlaceOrName
from .quantities import Components, InputFile, Name, Part, key
from .terms import Time, material_tables, term_tables


class Prescribed(Part):
    """Displacements that are prescribed at a place."""

    x: Annotated[float | None, key("Along x, at the full load or at all times.", "length")] = None
    y: Annotated[float | None, key("Along y.", "length")] = None
    z: Annotated[float | None, key("Along z.", "length")] = None
    time: Annotated[
        Time | None, key("Factor of time; by default it grows with the load factor in statics, and is 1 in motion.")
    ] = None


class Initial(Part):
    """The first state of a motion, of a path, or the state that modes are about; by default rest."""

    file: Annotated[
        InputFile | None, key("Result file (.vtu, .pvd) with the first displacements and velocities, relative to the scene.")
    ] = None
    at: Annotated[float | None, key("Which state of a .pvd file, by its time or load factor; by default the last.", "time")] = None
    velocity: Annotated[Components | None, key("Velocity of all nodes, instead of those of the file.", "velocity")] = None
    t0: Annotated[float, key("Time, or load factor of a path, of the first state.", "time")] = 0.0


class Output(Part):
    """Files in the folder of results, in addition to summary.json, resolved.toml and report.html."""

    file: Annotated[
        str | None, key("File of all saved states (.pvd), or of the last state (.vtu), for ParaView.", pattern=r"\.(pvd|vtu)$")
    ] = None
    every: Annotated[int, key("Number of time steps between saved states of a motion.", ge=1)] = 10
    fields: Annotated[
        list[Name] | None, key("Fields in these files in addition to displacements; by default stresses and strains.")
    ] = None
    probes: Annotated[dict[Name, PlaceOrName], key("Places by name; their mean displacements are recorded.")] = {}
    reactions: Annotated[dict[Name, PlaceOrName], key("Places by name; the forces of their supports are recorded.")] = {}
    plots: Annotated[
        list[Name], key("Curves to draw: names of probes and reactions, `ledger` (energies of a motion), `path` (load and size).")
    ] = []
    picture: Annotated[str, key("Field that colours the picture of the deformed body; empty for no picture.")] = "von_mises_stress"
    animation: Annotated[str | None, key("Animated picture (.gif or .mp4) of the states in `file`.", pattern=r"\.(gif|mp4)$")] = (
        None
    )
    checkpoint: Annotated[bool, key("Write the checkpoint that --resume needs.")] = True


class Expectation(Part):
    """A result that the scene is expected to give."""

    value: Annotated[float, key("The value.")]
    rtol: Annotated[float | None, key("Largest allowed difference, relative to the value.", ge=0)] = None
    atol: Annotated[float | None, key("Largest difference.", ge=0)] = None


def _kind(given: Any) -> str:
    if isinstance(given, Expectation) or not isinstance(given, Mapping):
        return "value"
    return "value" if given.keys() & Expectation.model_fields.keys() else "components"


#: Expectations by result, such as `energy.strain` or `tip.z`.
Expect = dict[
    Name,
    Annotated[Annotated[Expectation, Tag("value")] | Annotated[dict[Name, Expectation], Tag("components")], Discriminator(_kind)],
]


class SceneTables(Part):
    """A scene: the tables and keys of its file."""

    # the types of materials, terms and analysis are filled in by `scene_tables`
    title: Annotated[str, key("Title of the reports.")] = ""
    units: Annotated[
        Literal[tuple(UNITS)],  # type: ignore[valid-type]
        key("System of units of all values: shown in outputs, and used to check whether stiffnesses are plausible."),
    ] = "SI"
    threads: Annotated[int | None, key("Number of threads of kernels; by default one for each core.", ge=1)] = None
    mesh: Annotated[Mesh, key("The mesh: a file, or one that is generated.")]
    places: Annotated[dict[Name, Place], key("Places by name, in addition to the boundaries and node sets of the mesh.")] = {}
    materials: Annotated[dict[Name, Any], key("Materials by name.")] = {}
    terms: Annotated[list[Any], key("Laws, loads, foundations and contacts of the body.")]
    fixed: Annotated[
        dict[Name, Annotated[str, Field(pattern="^[xyz]+$")]], key("Constrained components, by name of the place.")
    ] = {}
    prescribed: Annotated[dict[Name, Prescribed], key("Prescribed displacements, by name of the place.")] = {}
    initial: Annotated[Initial, key("The first state; by default rest.")] = Initial()
    analysis: Annotated[Any, key("What is solved.")]
    reduced: Annotated[ReducedBasis | None, key("Reduced basis on which the analysis is solved; by default none.")] = None
    solver: Annotated[Solver, key("Linear solver, and tolerance of the residual.")] = Solver()
    output: Annotated[Output, key("What is written.")] = Output()
    expect: Annotated[Expect, key("Expected results; the command fails if they are not met.")] = {}

    def implausible(self, size: float = 0.0) -> list[str]:
        """Return, in a sentence each, the Young's moduli that are implausible in these units for a body of this largest extent."""
        moduli = {f"materials.{name}.young": getattr(one, "young", None) for name, one in self.materials.items()}
        return implausible_moduli(moduli, UNITS[self.units], size)


def scene_tables() -> type[SceneTables]:
    """Return the tables of a scene, with all materials, terms and integrators that are registered."""
    return _filled(SceneTables, tuple(MATERIALS.items()), tuple(TERMS.items()), tuple(INTEGRATORS.items()))


@cache
def _filled(base: type[SceneTables], *registered: tuple[tuple[str, Any], ...]) -> type[SceneTables]:
    """Return the tables with the kinds of materials, terms and analyses, made once for the objects that are registered."""
    kinds: dict[str, tuple[Any, Any, dict[str, Any]]] = {
        "materials": (dict[Name, one_of(material_tables(), "model")], {}, {}),  # type: ignore[misc]
        "terms": (list[one_of(term_tables(), "type")], ..., {"min_length": 1}),  # type: ignore[misc]
        "analysis": (one_of(analyses(), "type"), ..., {}),
    }
    filled: Any = {
        name: (Annotated[kind, key(base.model_fields[name].description or "", **limits)], default)
        for name, (kind, default, limits) in kinds.items()
    }
    made = create_model(base.__name__, __base__=base, __module__=__name__, **filled)
    made.__doc__ = base.__doc__
    return made
