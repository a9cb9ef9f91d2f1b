"""The case before the referee: a mesh, the players, the states, and the scales that errors are relative to."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import issparse

from ..mesh import SimplexMesh
from ..mesh.geometry import aspect_ratios, edge_differences, edge_lengths, vertex_sizes
from .players import Player
from .states import INVERTED, STRETCH
from .tasks import NotApplicable

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
    bare : number of elements that belong to no term.
    """

    mesh: SimplexMesh
    ours: Player
    reference: Player
    candidate: Player | None
    candidate_is_stvk: bool
    states: dict[str, Array]
    seed: int
    bare: int = 0
    _state: str = field(default="", init=False)
    _values: dict[tuple[str, str], Any] = field(default_factory=dict, init=False)
    _stiffness: dict[str, float] = field(default_factory=dict, init=False)

    @property
    def players(self) -> list[Player]:
        """Those who are checked: the candidate too, if there is one."""
        return [self.ours] + ([self.candidate] if self.candidate else [])

    def is_stvk(self, player: Player) -> bool:
        """Whether the player claims to be St. Venant-Kirchhoff."""
        return player is not self.candidate or self.candidate_is_stvk

    def refuse_undefined(self, player: Player, state: str) -> None:
        """States in which elements may be inside out, where laws other than St. Venant-Kirchhoff may not be defined."""
        if state in INVERTED and not self.is_stvk(player):
            raise NotApplicable("elements may be inside out, where the candidate's law may not be defined")

    def value(self, player: Player, quantity: str, state: str) -> Any:
        """W, F or K of a player in a named state; those of the latest state are kept, for several checks hold them against each other."""
        if state != self._state:
            self._state = state
            self._values.clear()
        key = player.name, quantity
        if key not in self._values:
            value = getattr(player, quantity)(self.states[state])
            reused = player is self.candidate and issparse(value)  # a candidate may fill the same matrix again
            self._values[key] = value.copy() if reused else value
        return self._values[key]

    def random(self, name: str) -> np.random.Generator:
        """Random numbers for one check, independent of which others run."""
        return np.random.default_rng([self.seed, *name.encode()])

    @cached_property
    def edges(self) -> Array:
        """(d, m, nt) rest edges of the simplices [m]."""
        return edge_differences(self.mesh, self.mesh.p)

    @cached_property
    def median_edge(self) -> float:
        """Median edge of the simplices [m]."""
        return float(np.median(edge_lengths(self.mesh)))

    @cached_property
    def node_size(self) -> Array:
        """(nv,) shortest edge of the simplices around each vertex [m]."""
        return vertex_sizes(self.mesh)

    @cached_property
    def centred(self) -> Array:
        """(nv, d) coordinates from the centre of the body [m]: rotations about it cost the fewest digits."""
        return (self.mesh.p - self.mesh.p.mean(axis=1, keepdims=True)).T

    def stiffness_scale(self, player: Player) -> float:
        """Largest entry of K at rest [N/m]: the reference's, or of a player of another law its own, estimated if it has no matrix."""
        judge = self.reference if self.is_stvk(player) else player
        if judge.name not in self._stiffness:
            self._stiffness[judge.name] = self._largest_at_rest(judge)
        return self._stiffness[judge.name]

    def _largest_at_rest(self, player: Player) -> float:
        if player.has("K"):
            K = player.K(np.zeros(self.mesh.p.size))
            if issparse(K):
                return float(abs(K).max())
            return float(np.abs(K @ self.random("scale").choice([-1.0, 1.0], size=self.mesh.p.size)).max())
        if player.has("F"):
            return float(np.abs(player.F(self.states[STRETCH])).max()) / self.median_edge
        return abs(player.W(self.states[STRETCH])) / self.median_edge**2

    def force_scale(self, player: Player) -> float:
        """Largest entry of K at rest x median edge [N]: what force means on this body where F = 0."""
        return self.stiffness_scale(player) * self.median_edge

    @cached_property
    def flatness(self) -> float:
        """Largest (longest edge / smallest height)^2 of the elements.

        Squared lengths of long edges determine the strain across a flat element as a small difference, so the edge form loses
        eps x flatness where forms that build the deformation gradient lose the root of it.
        """
        return float(aspect_ratios(self.mesh).max()) ** 2

    @cached_property
    def fineness(self) -> float:
        """Size of the body over its shortest edge: displacements of the body's size carry eps x fineness into every strain."""
        return float(np.ptp(self.mesh.p, axis=1).max() / self.node_size.min())

    def limit(self, least: float = 1e-12, growth: float = 0.0) -> float:
        """A limit for round-off: `least`, or what flat or many small elements cost, or `growth`, never above 1e-6.

        Single slivers cost up to 5 eps x flatness and long chains 6 eps x fineness, as measured; so the limit leaves 1e-12 at aspect
        ratios beyond 20 and at bodies of more than 200 shortest edges in a row.
        """
        return min(max(least, 10 * EPS * self.flatness, 20 * EPS * self.fineness, growth), 1e-6)

    def scale(self, quantity: str, reference: float, player: Player) -> tuple[float, str]:
        """What an error of W, F or K is relative to, and in words.

        `reference` is the largest entry of what it is held against; W and F have a floor, for at rest and under rigid motion they
        vanish.
        """
        if quantity == "K":
            return max(reference, np.finfo(float).tiny), "largest |K_ref|"
        edge = self.median_edge if quantity == "W" else 1.0
        floor = max(self.force_scale(player) * edge, np.finfo(float).tiny)
        words = f"largest K at rest x median edge{' squared' if quantity == 'W' else ''}"
        return (reference, f"largest |{quantity}_ref|") if reference >= floor else (floor, words)

    def strain(self, u: Array) -> float:
        """Largest relative change of a squared edge length, |zeta|/|P|^2."""
        U = edge_differences(self.mesh, u.reshape(-1, self.mesh.d).T)
        change = ((2 * self.edges + U) * U).sum(axis=0)
        return float(np.abs(change / (self.edges**2).sum(axis=0)).max())

    def direction(self, u: Array, rng: np.random.Generator) -> Array:
        """A random direction (ndofs,) scaled to the state: near rest a unit direction would drown it."""
        strain = self.strain(u)
        amplitude = 0.1 if strain < 1e-9 else min(strain, 0.3)
        return (amplitude * self.node_size[:, None] * rng.standard_normal((self.mesh.nv, self.mesh.d))).ravel()
