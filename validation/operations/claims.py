"""Published claims on the cost of the edge form (Kikuuwe, Tabuchi, Yamamoto 2009, and Kikuuwe's overview), and verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Claim(NamedTuple):
    """Claim that the operations of the algorithm `of` are `low` to `high` times those of the algorithm `against`."""

    quantity: str
    against: str
    low: float
    high: float
    of: str = "edges"


CLAIMS = (
    Claim("F", "Total Lagrangian", 0.15, 0.27),
    Claim("F", "Total Lagrangian, matrix B", 0.15, 0.27),
    Claim("K", "Total Lagrangian", 0.27, 0.38),
    Claim("K", "Total Lagrangian, matrix B", 0.27, 0.38),
    Claim("F", "O'Brien-Hodgins", 0.25, 0.35),
    Claim("F", "O'Brien-Hodgins, as printed", 0.25, 0.35),
    Claim("F", "Picinbono", 0.25, 0.35),
    Claim("F", "linear elements", 4.5, 5.5, of="Picinbono"),
)


class Verdict(NamedTuple):
    """Measured ratios by mesh, and the meshes on which the claim holds."""

    claim: Claim
    ratios: dict[str, float]
    holds: tuple[str, ...]


def ratio(costs: dict[tuple[str, str], NDArray[np.int64]], claim: Claim, entities: NDArray[np.int64]) -> float:
    """Return the ratio of operations of both algorithms on a mesh. `entities`: numbers of vertices, edges, faces and tetrahedra."""
    return float(costs[claim.quantity, claim.of] @ entities / (costs[claim.quantity, claim.against] @ entities))


def verdicts(costs: dict[tuple[str, str], NDArray[np.int64]], meshes: dict[str, NDArray[np.int64]]) -> Sequence[Verdict]:
    """Return the verdict on each claim on meshes given by their numbers of entities."""
    out = []
    for claim in CLAIMS:
        ratios = {name: ratio(costs, claim, entities) for name, entities in meshes.items()}
        holds = tuple(name for name, found in ratios.items() if claim.low <= found <= claim.high)
        out.append(Verdict(claim, ratios, holds))
    return out
