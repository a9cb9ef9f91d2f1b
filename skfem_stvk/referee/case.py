"""Case of a verification: a mesh, the models under test, named states, and the scales of relative errors."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import issparse
from scipy.spatial.transform import Rotation

from ..arguments import Array
from ..errors import StvkWarning
from ..mesh import ElementMesh
from ..system import System
from ..terms import StVK
from .bodies import Homogeneous
from .discretisation import Discretisation, Shape
from .implementations import Implementation
from .judgement import Limits, largest_component, largest_rows
from .results import NotApplicable

EPS = float(np.finfo(float).eps)
OURS, EDGES, REFERENCE, CANDIDATE = "skfem-stvk", "edges and TSEPs", "scikit-fem", "candidate"
STRETCH = "100 % stretch"
#: States in which elements may be inverted.
INVERTED = ("large random", "reflected random")
#: Distances of the two nearby states: of all entries, each relative to itself, and of one node, relative to the largest entry.
NEARBY, NEAREST = 1e-6, 2e-11
#: Functions of u by which a cache may be keyed, and number of changes that are tried until all of them have the same values.
KEYS: tuple[Callable[[Array], Any], ...] = (np.linalg.norm, np.sum, np.max, np.min, np.array_str)
MOST_TRIED = 60


def built(mesh: ElementMesh, terms: Sequence[StVK], discretisation: Discretisation) -> System:
    """Return a body of this package without warnings, because they have been issued already or the mesh is only a piece."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        return System(mesh, terms, **discretisation.options)


@dataclass
class Case:
    """Input of all checks.

    This package (`ours`) and a candidate are compared with the reference (`Truth`). `scikit_fem` is the assembly of all elements by
    scikit-fem, used for timings. `states` are displacements (ndofs,) [m]. `elements_without_term` counts elements.
    `precision` holds the rows of error against strain, which the check of precision fills. `candidate_is_homogeneous` matters only
    for laws other than St. Venant-Kirchhoff's. `build` makes the model of this package on other meshes: homogeneous copies and
    patches.

    `network` is the same body as the sum of eq. 14 over edges and pairs of edges, or None for elements without an edge form. It is
    checked in a separate case (`of_edges`), in which it replaces `ours`.
    """

    shape: Shape
    ours: Implementation
    reference: Implementation
    scikit_fem: Implementation
    candidate: Implementation | None
    states: dict[str, Array]
    seed: int
    homogeneous: Homogeneous
    candidate_is_stvk: bool = True
    candidate_is_homogeneous: bool = False
    elements_without_term: int = 0
    network: Implementation | None = None
    by_edges: bool = False
    build: Callable[[ElementMesh, Sequence[StVK], Discretisation], Any] = built
    precision: list[dict[str, Any]] = field(default_factory=list)
    _state: str = field(default="", init=False)
    _values: dict[tuple[str, str], Any] = field(default_factory=dict, init=False)
    _stiffness: dict[str, Array] = field(default_factory=dict, init=False)

    @property
    def mesh(self) -> ElementMesh:
        """Mesh at rest."""
        return self.shape.mesh

    @property
    def discretisation(self) -> Discretisation:
        """Kind of element and integration rule."""
        return self.shape.discretisation

    @property
    def implementations(self) -> list[Implementation]:
        """Models that are checked: this package, and the candidate if there is one."""
        return [self.ours] + ([self.candidate] if self.candidate else [])

    def of_edges(self) -> Case | None:
        """Return the case that compares the network with the reference, with the limits of the edge form, or None."""
        return None if self.network is None else replace(self, ours=self.network, candidate=None, by_edges=True)

    def is_stvk(self, implementation: Implementation) -> bool:
        """Return whether the implementation claims to be St. Venant-Kirchhoff."""
        return implementation is not self.candidate or self.candidate_is_stvk

    def refuse_undefined(self, implementation: Implementation, state: str) -> None:
        """Raise NotApplicable for states with possibly inverted elements, unless the implementation claims to be StVK.

        Other laws may be undefined there.
        """
        if state in INVERTED and not self.is_stvk(implementation):
            raise NotApplicable("elements may be inverted, where the candidate's law may be undefined")

    def value(self, implementation: Implementation, quantity: str, state: str) -> Any:
        """Return W, F or K of an implementation in a named state.

        Values of the latest state are cached, because several checks use them.
        """
        if state != self._state:
            self._state = state
            self._values.clear()
        key = implementation.name, quantity
        if key not in self._values:
            self._values[key] = getattr(implementation, quantity)(self.states[state])
        return self._values[key]

    def random(self, name: str) -> np.random.Generator:
        """Return the random number generator of one check, which does not depend on the other checks."""
        return np.random.default_rng([self.seed, *name.encode()])

    @cached_property
    def edges(self) -> Array:
        """Differences of the rest positions of the nodes of each pair in an element [m], (d, m, nt)."""
        return self.shape.differences(self.mesh.p)

    @cached_property
    def nearby(self) -> list[Array]:
        """The two states near the stretched one that a cache may confuse with it."""
        return nearby_states(self.states[STRETCH], self.mesh.d)

    @cached_property
    def median_edge(self) -> float:
        """Median distance between two nodes of an element [m]."""
        return float(np.median(np.linalg.norm(self.edges, axis=0)))

    @cached_property
    def node_size(self) -> Array:
        """Shortest distance between two nodes in the elements around each node [m], (nv,)."""
        return self.shape.node_size

    @cached_property
    def centred(self) -> Array:
        """Coordinates relative to the centre of the body [m], (nv, d). Rotations about the centre lose the fewest digits."""
        return (self.mesh.p - self.mesh.p.mean(axis=1, keepdims=True)).T

    def stiffness(self, implementation: Implementation) -> Array:
        """Return the largest entry of K at rest in the rows of each node [N/m], (nv,).

        K is that of the reference, or for another law that of the implementation. If there is no matrix, one value for all nodes is
        estimated.
        """
        judge = self.reference if self.is_stvk(implementation) else implementation
        if judge.name not in self._stiffness:
            self._stiffness[judge.name] = self._at_rest(judge)
        return self._stiffness[judge.name]

    def _at_rest(self, implementation: Implementation) -> Array:
        ndofs = self.mesh.p.size
        if implementation.has("K"):
            K = implementation.K(np.zeros(ndofs))
            if issparse(K):
                return largest_rows(K, self.mesh.d)
            estimate = float(np.abs(K @ self.random("scale").choice([-1.0, 1.0], size=ndofs)).max())
        elif implementation.has("F"):
            estimate = float(np.abs(implementation.F(self.states[STRETCH])).max()) / self.median_edge
        else:
            estimate = abs(implementation.W(self.states[STRETCH])) / self.median_edge**2
        return np.full(self.mesh.nv, estimate)

    def force_floor(self, implementation: Implementation) -> Array:
        """Return stiffness at rest x shortest edge of each node [N], (nv,). This is the scale of forces where F = 0."""
        return self.stiffness(implementation) * self.node_size

    def force_scale(self, implementation: Implementation, *forces: Array) -> Array:
        """Return the largest of these forces (ndofs,) at each node and its neighbours, at least `force_floor` [N], (nv,)."""
        largest = np.max([largest_component(force, self.mesh.d) for force in forces], axis=0)
        return np.maximum(self.limits.around(largest), self.force_floor(implementation))

    def energy_floor(self, implementation: Implementation) -> float:
        """Return the median over nodes of stiffness at rest x shortest edge squared [J], the scale of energy where W = 0."""
        floor = self.force_floor(implementation) * self.node_size
        return float(np.median(floor[floor > 0])) if (floor > 0).any() else 0.0

    @cached_property
    def limits(self) -> Limits:
        """Limits of relative errors in each state. They are larger for the edge form, whose sums cancel more."""
        return Limits(self.shape, self.shape.aspect if self.by_edges else np.ones(self.mesh.nt))

    def amplitude(self, u: Array) -> float:
        """Return the size of a direction relative to an element, scaled to the strain of the state.

        A direction of unit size would hide the effect of a small strain.
        """
        U = self.shape.differences(u.reshape(-1, self.mesh.d).T)
        change = ((2 * self.edges + U) * U).sum(axis=0)
        strain = float(np.abs(change / (self.edges**2).sum(axis=0)).max())
        return 0.1 if strain < 1e-9 else min(strain, 0.3)

    def direction(self, u: Array, rng: np.random.Generator) -> Array:
        """Return a random direction (ndofs,) scaled to the strain of the state."""
        return (self.amplitude(u) * self.node_size[:, None] * rng.standard_normal((self.mesh.nv, self.mesh.d))).ravel()


def nearby_states(u: Array, d: int) -> list[Array]:
    """Return two states near `u` (ndofs,) that a cache may confuse with `u`.

    The first one is `u` times 1.000001. The second one differs at a node in the middle of the list (two in the plane, three on a
    line). The change is `NEAREST` times the largest entry, up to twice that. All `KEYS` have the same values as at `u`, or as many
    as possible.
    """
    count, unit = min(-(-3 // d), len(u) // d), 2 * np.spacing(np.abs(u).sum())  # sums of multiples of `unit` are exact
    starts, keys = np.arange(len(u) // d - count + 1), [key(u) for key in KEYS]
    outwards = starts[np.argsort(np.abs(starts - len(starts) // 2), kind="stable")]
    most, found = -1, u
    for number, start in enumerate(np.resize(outwards, MOST_TRIED)):
        entries, changed = slice(d * start, d * (start + count)), u.copy()
        along = np.linalg.svd(np.stack([np.ones(d * count), u[entries]]))[2][-1]  # no change of the sum and the norm
        steps = np.round(max(NEAREST * np.abs(u).max() / unit, 8.0) * (1 + number / MOST_TRIED) * along)
        steps[-1] -= steps.sum()
        changed[entries] += unit * steps
        same = sum(key(changed) == before for key, before in zip(KEYS, keys, strict=True))
        if same > most:
            most, found = same, changed
        if most == len(KEYS):
            break
    return [(1 + NEARBY) * u, found]


def random_rotation(d: int, rng: np.random.Generator, degrees: float = 170.0) -> Array:
    """Return the (d, d) rotation by this angle, in space about a random axis. On a line it is the identity."""
    return rotation(d, degrees, rng.standard_normal(3) if d == 3 else np.array([0.0, 0.0, 1.0]))


def rotation(d: int, degrees: float, axis: Array) -> Array:
    """Return the (d, d) rotation by this angle, in space about `axis`, in the plane about its normal, on a line the identity."""
    R = np.asarray(Rotation.from_rotvec(np.deg2rad(degrees) * axis / np.linalg.norm(axis)).as_matrix())
    return R[:d, :d] if d > 1 else np.eye(1)


def named_states(X: Array, node_size: Array, rng: np.random.Generator) -> dict[str, Array]:
    """Return displacements (ndofs,) [m] by name, for coordinates `X` (nv, d) relative to the centre.

    Random displacements are multiples of `node_size` (nv,).
    """
    d = X.shape[1]
    Q = random_rotation(d, rng)
    shift = np.ptp(X, axis=0).max() * rng.standard_normal(d)
    along = np.linalg.svd(X, full_matrices=False)[2][0]  # the direction in which the body is longest

    def noise(amplitude: float) -> Array:
        return amplitude * node_size[:, None] * rng.standard_normal(X.shape)

    def stretched(s: float) -> Array:
        return (s - 1) * np.outer(X @ along, along) + noise(0.02)

    strained = 0.1 * np.outer(X @ along, along) + noise(0.05)
    mirror = np.eye(d) - 2 * np.outer(along, along)
    states = {
        "rest": np.zeros_like(X),
        "small random strain": noise(1e-3),
        "rigid rotation": X @ Q.T - X + shift,
        "rotated strained": (X + strained) @ Q.T - X + shift,
        STRETCH: stretched(2.0),
        "35 % compression": stretched(0.65),
        "large random": noise(0.3),
        "reflected random": (X + noise(0.3)) @ mirror.T - X,
    }
    if d == 1:  # no rotations in one dimension
        states["rigid translation"] = states.pop("rigid rotation")
        states["translated strained"] = states.pop("rotated strained")
    return {name: u.ravel() for name, u in states.items()}
