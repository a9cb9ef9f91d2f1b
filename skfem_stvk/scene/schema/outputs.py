"""Where a scene begins, what it writes, and what it is expected to give."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Discriminator, Tag

from .places import PlaceOrName
from .quantities import Components, Name, Part, key


class Initial(Part):
    """The first state of a motion, of a path, or the state that modes are about; by default rest."""

    file: Annotated[
        str | None, key("Result file (.vtu, .pvd) whose displacements and velocities are the first ones, relative to the scene.")
    ] = None
    at: Annotated[float | None, key("Which state of a .pvd file, by its time or load factor; by default the last.", "time")] = None
    velocity: Annotated[Components | None, key("Velocity of all nodes, in place of those of the file.", "velocity")] = None
    t0: Annotated[float, key("Time, or load factor of a path, of the first state.", "time")] = 0.0


class Output(Part):
    """What is written into the folder of results, beside summary.json, resolved.toml and report.html."""

    file: Annotated[str | None, key("States on the way (.pvd), or the last one (.vtu), for ParaView.", pattern=r"\.(pvd|vtu)$")] = (
        None
    )
    every: Annotated[int, key("Steps of a motion from one saved state to the next.", ge=1)] = 10
    fields: Annotated[list[Name] | None, key("Fields in these files beside displacements; by default stresses and strains.")] = None
    probes: Annotated[dict[Name, PlaceOrName], key("Places by name whose mean displacements are followed.")] = {}
    reactions: Annotated[dict[Name, PlaceOrName], key("Places by name whose forces of supports are followed.")] = {}
    plots: Annotated[
        list[Name], key("Curves to draw: names of probes and reactions, `ledger` (energies of a motion), `path` (load and size).")
    ] = []
    picture: Annotated[str, key("Field that colours the picture of the deformed body; empty for no picture.")] = "von_mises_stress"
    animation: Annotated[str | None, key("Animated picture (.gif or .mp4) of the states in `file`.", pattern=r"\.(gif|mp4)$")] = (
        None
    )
    checkpoint: Annotated[bool, key("Keep what --resume needs.")] = True


class Expectation(Part):
    """A result that the scene is expected to give."""

    value: Annotated[float, key("The value.")]
    rtol: Annotated[float | None, key("Largest difference, as a part of the value.", ge=0)] = None
    atol: Annotated[float | None, key("Largest difference.", ge=0)] = None


def _kind(given: Any) -> str:
    if isinstance(given, Expectation) or not isinstance(given, Mapping):
        return "value"
    return "value" if given.keys() & Expectation.model_fields.keys() else "components"


#: By result, as `energy.strain` or `tip.z`.
Expect = dict[
    Name,
    Annotated[Annotated[Expectation, Tag("value")] | Annotated[dict[Name, Expectation], Tag("components")], Discriminator(_kind)],
]
