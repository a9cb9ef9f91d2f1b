"""What a run measures: the quick one for a look, the full one for the page of the docs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

MESHES = ("box 5 k", "part 5 k", "box 40 k", "part 40 k", "box 250 k", "part 250 k")


@dataclass(frozen=True)
class Plan:
    """Sizes are numbers of tetrahedra that a mesh comes near to.

    Attributes
    ----------
    name : of the run.
    boxes, parts : sizes of the structured meshes, and of those that Gmsh makes of a part.
    judged : sizes that the targets are for.
    referenced : sizes at which scikit-fem's assembly and the textbook form are timed.
    peers : names of the meshes that each peer is timed on; peers that are not named are left to the full run.
    seconds : spent on each call at least, after warming up.
    first_use : whether compiling into an empty cache is timed.
    """

    name: str
    boxes: tuple[int, ...]
    parts: tuple[int, ...]
    judged: tuple[int, ...]
    referenced: tuple[int, ...]
    peers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    seconds: float = 1.0
    first_use: bool = False


QUICK = Plan(
    name="quick",
    boxes=(5_000, 40_000, 250_000),
    parts=(),
    judged=(40_000, 250_000),
    referenced=(40_000,),
    peers={"MuJoCo": ("box 40 k",), "FElupe": ("box 40 k",)},
    seconds=0.2,
)
FULL = Plan(
    name="full",
    boxes=(5_000, 40_000, 250_000, 2_000_000),
    parts=(5_000, 40_000, 250_000),
    judged=(40_000, 250_000),
    referenced=(5_000, 40_000, 250_000),
    peers={
        "MuJoCo": MESHES[:4],  # it takes 10 minutes and more to set up 250 k tetrahedra
        "FElupe": MESHES,
        "NGSolve": MESHES,
        "DOLFINx": MESHES,
    },
    first_use=True,
)
