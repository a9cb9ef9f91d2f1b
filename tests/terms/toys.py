"""Minimal laws and loads that are not part of the package, written with numpy only, without edges or elements.

- `Springs` are nonlinear springs between any vertices: with energy, symmetric, balanced. Springs have mass, so that bodies move.
- `Areas` have an energy of the areas of vertex triples in space. One Hessian serves both orders of its pairs.
- `Anchors` are nonlinear springs to the ground: not balanced, with diagonal blocks only.
- `Wind` is a force that rotates with pairs of vertices: without energy, neither symmetric nor balanced.
- `Friction` has springs to the last accepted state: a term with history.
- `Contacts` are springs whose pairs change.
- `Floor` is a contact of vertices with a floor.
- `Vortex` is a load that rotates about an axis, without potential.
"""

from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from skfem_stvk.edges import ALL
from skfem_stvk.terms import BoundContact, Load
from skfem_stvk.terms.loads.load import Assumed, Moment, StepStart


class MinimalTerm:
    """Base class of the toys: a specification that binds by passing the mesh to its `Bound` class."""

    region = None

    def bind(self, body, dtype=np.float64):
        return self.Bound(self, getattr(body, "mesh", body))


def in_step(term, u, begin, end, in_time=True, after=None, contact=None, **more):
    """Return a term at the end of a step that begins at displacements `u` (nv, d), and the history at its beginning."""
    history = term.advanced(term.first_history() if after is None else after, u, Moment(begin, 1.0 if in_time else begin))
    step = StepStart((history,), in_time, **more)
    return term.at(Moment(end, 1.0 if in_time else end, step=step, contact=contact), history), history


def outer(a, b):
    return a[:, :, None] * b[:, None, :]


@dataclass(frozen=True, eq=False)
class Springs(MinimalTerm):
    """Springs with the quartic energy `W = sum 1/4 k (|p|^2 - |P|^2)^2 / |P|^2` over pairs of vertices.

    The springs are stiff in tension and compression.
    """

    pairs: Any
    stiffness: float = 1.0
    mass_of_all: float = 1.0

    def mass(self, mesh, sizes):
        return self.mass_of_all * sizes / sizes.sum()

    class Bound:
        symmetric = balanced = has_energy = True

        def __init__(self, spec, mesh):
            self.nodes_paired = np.asarray(spec.pairs, dtype=np.int32)
            a, b = self.nodes_paired
            self._P = mesh.p.T[b] - mesh.p.T[a]
            self._k = spec.stiffness / (self._P**2).sum(axis=1)

        def _now(self, u):
            a, b = self.nodes_paired
            U = u[b] - u[a]
            return self._P + U, ((2 * self._P + U) * U).sum(axis=1)

        def energy_and_force(self, u, force=None):
            p, zeta = self._now(u)
            if force is not None:
                pull = (self._k * zeta)[:, None] * p
                np.add.at(force, self.nodes_paired[1], pull)
                np.subtract.at(force, self.nodes_paired[0], pull)
            return float((self._k * zeta**2).sum() / 4)

        def add_blocks(self, u, blocks, kept=ALL):
            p, zeta = self._now(u)
            t = self._k * zeta * np.where(zeta > 0, kept.positive, kept.negative)
            blocks.pairs -= 2 * self._k[:, None, None] * outer(p, p) + t[:, None, None] * np.eye(u.shape[1])


@dataclass(frozen=True, eq=False)
class Areas(MinimalTerm):
    """Energy `W = sum 1/2 k |A|^2`, `A = 1/2 (x_1 - x_0) x (x_2 - x_0)`, over triples of vertices in space."""

    triples: Any
    stiffness: float = 1.0

    class Bound:
        symmetric = balanced = has_energy = True

        def __init__(self, spec, mesh):
            self._t, self._k, self._X = np.asarray(spec.triples), spec.stiffness, mesh.p.T
            ends = np.sort(np.stack([self._t[[0, 1, 0]], self._t[[1, 2, 2]]]).reshape(2, -1), axis=0)
            self.nodes_paired, self._of = (
                np.ascontiguousarray(x, dtype=np.int32) for x in np.unique(ends, axis=1, return_inverse=True)
            )
            self._of = self._of.reshape(3, -1)

        def _slopes(self, u):
            """Return the area vectors and their derivatives by the vertices (3, n, 3, 3).

            The derivatives are the matrices of cross products with half the opposite edges.
            """
            x = self._X[self._t] + u[self._t]
            edges = np.stack([x[1] - x[2], x[2] - x[0], x[0] - x[1]]) / 2
            slopes = np.zeros((*edges.shape, 3))
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                slopes[..., i, j], slopes[..., j, i] = edges[..., k], -edges[..., k]
            return np.cross(x[1] - x[0], x[2] - x[0]) / 2, slopes

        def energy_and_force(self, u, force=None):
            A, slopes = self._slopes(u)
            if force is not None:
                for vertices, slope in zip(self._t, slopes, strict=True):
                    np.add.at(force, vertices, self._k * np.einsum("nij,ni->nj", slope, A))
            return float(self._k * (A**2).sum() / 2)

        def add_blocks(self, u, blocks, kept=ALL):
            A, S = self._slopes(u)
            cross = np.zeros((len(A), 3, 3))
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                cross[:, i, j], cross[:, j, i] = A[:, k] / 2, -A[:, k] / 2
            for of, (i, j), sign in zip(self._of, ((0, 1), (1, 2), (0, 2)), (1, 1, -1), strict=True):
                own = self._k * (np.einsum("nki,nkj->nij", S[i], S[j]) + kept.negative * sign * cross)
                swapped = self._t[i] > self._t[j]
                np.add.at(blocks.pairs, of, np.where(swapped[:, None, None], own.transpose(0, 2, 1), own))


@dataclass(frozen=True, eq=False)
class Anchors(MinimalTerm):
    """Springs to the ground with the energy `W = sum 1/2 k |u|^2 + 1/4 k |u|^4` over some vertices."""

    vertices: Any
    stiffness: float = 1.0

    class Bound:
        symmetric = has_energy = True
        balanced = False
        nodes_paired = np.empty((2, 0), dtype=np.int32)

        def __init__(self, spec, mesh):
            self.nodes, self._k = np.unique(spec.vertices), spec.stiffness

        @property
        def grounded(self):
            return (3 * self.nodes[:, None] + np.arange(3)).ravel()

        def energy_and_force(self, u, force=None):
            own = u[self.nodes]
            size = (own**2).sum(axis=1)
            if force is not None:
                force[self.nodes] += self._k * (1 + size)[:, None] * own
            return float(self._k * (size / 2 + size**2 / 4).sum())

        def add_blocks(self, u, blocks, kept=ALL):
            own = u[self.nodes]
            blocks.own += self._k * ((1 + (own**2).sum(axis=1))[:, None, None] * np.eye(u.shape[1]) + 2 * outer(own, own))


@dataclass(frozen=True, eq=False)
class Wind(MinimalTerm):
    """Force `F_a = c (x_b - x_a) x e_z + h u_a`.

    The force acts on `a` as `b` moves, not on `b` as `a` moves, and has no energy.
    """

    pairs: Any
    strength: float = 0.1

    class Bound:
        symmetric = balanced = has_energy = False

        def __init__(self, spec, mesh):
            self.nodes_paired = np.asarray(spec.pairs, dtype=np.int32)
            self.nodes = np.unique(self.nodes_paired[0])
            self._skew = spec.strength * np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 0]])
            self._drag = 2 * spec.strength

        def energy_and_force(self, u, force=None):
            if force is not None:
                a, b = self.nodes_paired
                np.add.at(force, a, (u[b] - u[a]) @ self._skew.T + self._drag * u[a])
            return 0.0

        def add_blocks(self, u, blocks, kept=ALL):
            blocks.pairs += self._skew
            at = np.searchsorted(self.nodes, self.nodes_paired[0])
            np.add.at(blocks.own, at, np.broadcast_to(self._drag * np.eye(3) - self._skew, (len(at), 3, 3)))


@dataclass(frozen=True, eq=False)
class Friction(MinimalTerm):
    """Sticking ground with the force `F_a = k (u_a - u_a(accepted))`; each accepted state releases the springs."""

    vertices: Any
    stiffness: float = 1.0

    class Bound(Anchors.Bound):
        def __init__(self, spec, mesh):
            super().__init__(spec, mesh)
            self._start, self.begun = np.zeros(mesh.p.size), []

        def first_history(self):
            return self._start

        def advanced(self, history, u, moment):
            self.begun.append((moment.time, u.copy()))
            return u.ravel().copy()

        def after_step(self, history):
            return history

        def return_to(self, history):
            pass

        def at(self, moment, history):
            other = copy(self)
            other._start = self._start if history is None else history
            return other

        def energy_and_force(self, u, force=None):
            slip = (u - self._start.reshape(u.shape))[self.nodes]
            if force is not None:
                force[self.nodes] += self._k * slip
            return float(self._k * (slip**2).sum() / 2)

        def add_blocks(self, u, blocks, kept=ALL):
            blocks.own += self._k * np.eye(u.shape[1])


@dataclass(frozen=True, eq=False)
class Contacts(MinimalTerm):
    """Springs whose pairs change with each call of `take`; `pattern_version` counts the changes."""

    pairs: Any

    class Bound(Springs.Bound):
        pattern_version = 0

        def __init__(self, spec, mesh):
            self._mesh = mesh
            super().__init__(Springs(spec.pairs), mesh)

        def take(self, pairs):
            self.pattern_version += 1
            super().__init__(Springs(pairs), self._mesh)


@dataclass(frozen=True, eq=False)
class Floor(MinimalTerm):
    """Contact of all vertices with the floor `z = height`: `W = sum 1/2 k p^2` of their depths p. Nothing passes a floor."""

    height: float
    stiffness: float = 1.0

    class Bound(BoundContact):
        name, assumed = "floor", None

        def __init__(self, spec, mesh):
            self.nodes, self._k, self._z = np.arange(mesh.nv, dtype=np.int32), spec.stiffness, mesh.p[2] - spec.height

        def at(self, moment, history):
            return self._with(assumed=moment.contact)

        def _depths(self, u):
            return np.maximum(-(self._z + u[:, 2]), 0)

        def energy_and_force(self, u, force=None):
            p = self._depths(u)
            if force is not None:
                force[:, 2] -= self._k * p
            return float(self._k * (p**2).sum() / 2)

        def add_blocks(self, u, blocks, kept=ALL):
            if isinstance(self.assumed, tuple):
                (p0, p1), change = map(self._depths, self.assumed), self.assumed[0][:, 2] - self.assumed[1][:, 2]
                slope = np.divide(p1 + self._mean(*self.assumed), change, out=np.zeros(len(change)), where=change != 0)
                blocks.own[:, 2, 2] += 2 * self._k * np.where((p0 > 0) & (p1 > 0), 0.5, slope)
            elif self.assumed is not Assumed.APART:
                blocks.own[:, 2, 2] += self._k * ((self._depths(u) > 0) | (self.assumed is Assumed.TOUCHING))

        def _mean(self, u0, u1):
            """Return minus the mean depth (nv,), the difference of `p^2/2` over that of the gaps."""
            (p0, p1), change = map(self._depths, (u0, u1)), u1[:, 2] - u0[:, 2]
            one = np.divide((p1**2 - p0**2) / 2, change, out=-p0, where=change != 0)
            return np.where((p0 > 0) & (p1 > 0), -(p0 + p1) / 2, one)

        def mean_force(self, u0, u1, weights, theta, force):
            force[:, 2] += sum(weights) * self._k * self._mean(u0, u1)
            return 0.0

        def contact_limit(self, u, v):
            return np.inf

        def passes(self, u0, u1):
            return False

        def refuse_start(self, u):
            pass

        def identity(self):
            return [self._k, float(self._z.sum())]

        def held_directions(self, u):
            touching = np.flatnonzero(self._z + u[:, 2] <= 0)
            return touching, np.tile([0.0, 0, 1], (len(touching), 1))

        def evaluated(self, u):
            p = self._depths(u)
            return self._k * p, self._z + u[:, 2], float((p > 0).sum())


@dataclass(frozen=True, eq=False)
class Vortex(Load):
    """Load `f_a = t c e_z x (x_a + u_a)` on some vertices, without potential, with diagonal blocks only."""

    vertices: Any
    strength: float = 0.1

    def bind(self, body):
        return self.Bound(self, body.mesh)

    class Bound:
        has_potential = dead = symmetric = balanced = False
        steady = True
        nodes_paired = np.empty((2, 0), dtype=np.int32)

        def __init__(self, spec, mesh):
            self.nodes, self._x = np.asarray(spec.vertices), mesh.p.T
            self._skew = spec.strength * np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])

        def add_force(self, u, t, out):
            factor = t if isinstance(t, float) else t.factor
            out[self.nodes] += factor * (self._x + u)[self.nodes] @ self._skew.T

        def add_blocks(self, u, t, blocks):
            blocks.own -= (t if isinstance(t, float) else t.factor) * self._skew

        def memory(self):
            return {"loads": self.nodes.nbytes}

        def potential(self, u, t):
            from skfem_stvk import LoadError

            raise LoadError("A vortex has no potential.")
