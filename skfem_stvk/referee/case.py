"""The case before the referee: a mesh, the players, the states, and the scales that errors are relative to."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..mesh import SimplexMesh
from ..mesh.geometry import aspect_ratios, edge_lengths
from .players import Player

Array = NDArray[np.float64]

EPS = float(np.finfo(float).eps)
OURS, REFERENCE, CANDIDATE = "skfem-stvk", "scikit-fem", "candidate"


@dataclass
class Case:
    """Everything that a check needs.

    Attributes
    ----------
    mesh : the body's simplices.
    ours, reference : the edge form, and scikit-fem's standard assembly.
    candidate : somebody else's model, if one came.
    candidate_is_stvk : whether the candidate claims to be this model.
    states : displacements (ndofs,) [m] by name.
    seed : of all random numbers.
    """

    mesh: SimplexMesh
    ours: Player
    reference: Player
    candidate: Player | None
    candidate_is_stvk: bool
    states: dict[str, Array]
    seed: int
    _state: str = field(default="", init=False)
    _values: dict[tuple[str, str], Any] = field(default_factory=dict, init=False)

    @property
    def players(self) -> list[Player]:
        """Those who are checked: the candidate too, if there is one."""
        return [self.ours] + ([self.candidate] if self.candidate else [])

    def is_stvk(self, player: Player) -> bool:
        """Whether the player claims to be St. Venant-Kirchhoff."""
        return player is not self.candidate or self.candidate_is_stvk

    def value(self, player: Player, quantity: str, state: str) -> Any:
        """W, F or K of a player in a named state; those of the latest state are kept, for several checks hold them against each other."""
        if state != self._state:
            self._state = state
            self._values.clear()
        key = player.name, quantity
        if key not in self._values:
            self._values[key] = getattr(player, quantity)(self.states[state])
        return self._values[key]

    def random(self, name: str) -> np.random.Generator:
        """Random numbers for one check, independent of which others run."""
        return np.random.default_rng([self.seed, *name.encode()])

    def edge_differences(self, x: Array) -> Array:
        """(d, m, nt) differences of a nodal field (d, nv) along the edges of the simplices."""
        a, b = np.array(list(combinations(range(self.mesh.k + 1), 2))).T
        corners = x[:, self.mesh.t]
        return corners[:, a] - corners[:, b]

    @cached_property
    def edges(self) -> Array:
        """(d, m, nt) rest edges of the simplices [m]."""
        return self.edge_differences(self.mesh.p)

    @cached_property
    def median_edge(self) -> float:
        """Median edge of the simplices [m]."""
        return float(np.median(edge_lengths(self.mesh)))

    @cached_property
    def node_size(self) -> Array:
        """(nv,) shortest edge of the simplices around each vertex [m]."""
        shortest = edge_lengths(self.mesh).min(axis=0)
        size = np.full(self.mesh.nv, np.inf)
        np.minimum.at(size, self.mesh.t.ravel(), np.tile(shortest, self.mesh.k + 1))
        return size

    @cached_property
    def centred(self) -> Array:
        """(nv, d) coordinates from the centre of the body [m]: rotations about it cost the fewest digits."""
        return (self.mesh.p - self.mesh.p.mean(axis=1, keepdims=True)).T

    @cached_property
    def stiffness_scale(self) -> float:
        """Largest entry of the reference's K at rest [N/m]."""
        return float(abs(self.reference.K(np.zeros(self.mesh.p.size))).max())

    @cached_property
    def force_scale(self) -> float:
        """Largest entry of K at rest x median edge [N]: what force means on this body where F = 0."""
        return self.stiffness_scale * self.median_edge

    @cached_property
    def flatness(self) -> float:
        """Largest (longest edge / smallest height)^2 of the elements.

        Squared lengths of long edges determine the strain across a flat element as a small difference, so the edge form loses
        eps x flatness where forms that build the deformation gradient lose the root of it.
        """
        return float(aspect_ratios(self.mesh).max()) ** 2

    def limit(self, least: float = 1e-12, growth: float | None = None) -> float:
        """A limit for round-off: `least`, or what the flattest element costs, never above 1e-6.

        That cost was measured as 0.005 to 0.02 x eps x flatness; the limit only leaves 1e-12 at aspect ratios beyond 200.
        """
        return min(max(least, 0.1 * EPS * self.flatness if growth is None else growth), 1e-6)

    def scale(self, quantity: str, reference: float) -> tuple[float, str]:
        """What an error of W, F or K is relative to, and in words.

        `reference` is the largest entry of what it is held against; W and F have a floor, for at rest and under rigid motion they
        vanish.
        """
        if quantity == "K":
            return max(reference, np.finfo(float).tiny), "largest |K_ref|"
        floor, words = {
            "F": (self.force_scale, "largest K at rest x median edge"),
            "W": (self.force_scale * self.median_edge, "largest K at rest x median edge squared"),
        }[quantity]
        return (reference, f"largest |{quantity}_ref|") if reference >= floor else (floor, words)

    def strain(self, u: Array) -> float:
        """Largest relative change of a squared edge length, |zeta|/|P|^2."""
        U = self.edge_differences(u.reshape(-1, self.mesh.d).T)
        change = ((2 * self.edges + U) * U).sum(axis=0)
        return float(np.abs(change / (self.edges**2).sum(axis=0)).max())

    def direction(self, u: Array, rng: np.random.Generator) -> Array:
        """A random direction (ndofs,) scaled to the state: near rest a unit direction would drown it."""
        strain = self.strain(u)
        amplitude = 0.1 if strain < 1e-9 else min(strain, 0.3)
        return (amplitude * self.node_size[:, None] * rng.standard_normal((self.mesh.nv, self.mesh.d))).ravel()
