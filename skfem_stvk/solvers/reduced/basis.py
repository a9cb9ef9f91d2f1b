"""Displacement fields that span a reduced body: modes, modal derivatives, snapshots, and the lifts of prescribed motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from ...arguments import Array, array
from ...errors import StvkError, SupportError
from ...mesh import ElementMesh
from ...system import System
from ...terms import Body, BoundTerm, Term
from ...terms.loads.load import Moment
from ..dynamics.at_rest import AtRest

#: A field whose remainder after projection on the others is smaller than this fraction is rounding.
INDEPENDENT = 1e-10
#: Maximum distance of prescribed displacements from the span of their lifts, as a fraction of the largest.
EXACT = 1e-10
#: Default times at which functions are sampled, and their maximum number of independent fields.
TIMES, MOST_LIFTS = tuple(np.linspace(0.0, 1.0, 33).tolist()), 12
#: Default number of unknowns.
SIZE = 30
#: Tolerance of the residual of modes.
CONVERGED = 1e-5
#: Block size of the Krylov space for modes, in excess of the requested number, and maximum number of blocks.
MORE, MOST_BLOCKS = 8, 12
#: Largest displacement of fields for second derivatives of F: for a quartic energy as a fraction of the body's size. For others,
#: where the result is not exact, as a fraction of the least distance of two nodes of an element.
LARGE, SMALL = 0.3, 1e-3


class _UnitDensity(Term):
    """A term with elements of density 1."""

    has_mass = True

    def __init__(self, of: Term) -> None:
        self._of, self.region = of, of.region

    def bind(self, body: Body, dtype: DTypeLike) -> BoundTerm:
        return self._of.bind(body, dtype)

    def section(self, mesh: ElementMesh, n: int) -> Any:
        return self._of.section(mesh, n)

    def mass(self, mesh: ElementMesh, sizes: Array) -> Array:
        section = self.section(mesh, len(sizes))
        return np.zeros(len(sizes)) if section is None else np.asarray(sizes * section)


def masses_of(system: System) -> Array:
    """Return the lumped masses (ndofs,), by which fields are orthogonal; for a body without any density those of density 1."""
    bodies = [system.body, *system.body.beside]
    heavy = [term for body in bodies for term in body.terms if term.has_mass]
    if any(term.material is None or term.material.density is not None for term in heavy):
        return np.repeat(system.mass().vertex, system.mesh.d)
    return np.repeat(_of_unit_density(system.body).lumped_mass, system.mesh.d)


def _of_unit_density(body: Body) -> Body:
    terms = [_UnitDensity(term) for term in body.terms]
    dense = Body(body.mesh, terms, body.quadrature, [_of_unit_density(one) for one in body.beside])
    return dense.without(body.removed, body.bare)


class Lifts:
    """Prescribed displacements as `fields @ s(t)`, with the response of the body at rest to each: `fields` (ndofs, l).

    `at_supports` (n, l) are their displacements at the constrained degrees of freedom, with orthogonal columns.
    """

    def __init__(self, body: System, fields: Array) -> None:
        self._body, self.fields = body, fields
        self.at_supports = fields[body.supports.held]
        self._squares = (self.at_supports**2).sum(axis=0)
        self._last: tuple[float | bytes | None, Array] = None, np.empty(0)

    @classmethod
    def of(cls, body: System, rest: AtRest, times: Sequence[float] | None) -> Lifts:
        """Return the lifts of all supports at any of the times, and of constant displacements at any factor.

        The last ones are those of `Supports.moved`: the same displacement of all nodes at a location, one for each component.
        """
        supports, moments = body.supports, TIMES if times is None else times
        seen = np.array([supports.values(Moment(t, factor)) for t in moments for factor in (0.0, 1.0)]).T
        left = np.zeros((len(seen), 0))
        if seen.any():
            left, sizes, _ = np.linalg.svd(seen, full_matrices=False)
            left = left[:, sizes > EXACT / 10 * sizes[0]]
        inputs = [np.isin(np.arange(len(seen)), column) for one in supports.moved.values() for column in one.indices.T]
        left = np.column_stack([left, *inputs])
        if left.shape[1] > MOST_LIFTS:
            raise SupportError(
                f"Prescribed displacements have {left.shape[1]} independent fields at {len(moments)} times, {len(inputs)} of them "
                f"components of inputs; expected at most {MOST_LIFTS}, one lift for each. Prescribe rigid motions or a few fields "
                "times functions of t; or name the times at which the motion is needed: times=."
            )
        fields = np.zeros((body.ndofs, left.shape[1]))
        for i, column in enumerate(left.T):
            w = np.zeros(body.ndofs)
            w[supports.held] = column / np.abs(column).max()
            fields[:, i] = rest.follow(w)
        return cls(body, fields)

    def without_basis(self, masses: Array, basis: Array) -> Array:
        """Return the fields minus their part in the span of a basis: orthogonal to it by mass, and unchanged at supports."""
        across = self.fields
        for _ in range(2):  # the second pass removes rounding
            across = across - basis @ (basis.T @ (masses[:, None] * across))
        return across

    def amounts(self, moment: Moment) -> Array:
        """Return `s(t)` (l,) [m]; SupportError if the prescribed displacements at `t` are off the span of the lifts."""
        supports, (key, s) = self._body.supports, self._last  # read once, since other threads write it
        if supports.steady and key == moment.factor:
            return s
        values = supports.values(moment)  # functions may depend on more than time
        key_now = moment.factor if supports.steady else values.tobytes()
        if key == key_now:
            return s
        s = self.amounts_of(values)
        off = np.abs(values - self.at_supports @ s).max(initial=0.0)
        if off > EXACT * np.abs(values).max(initial=0.0):
            raise SupportError(
                f"Prescribed displacements at t = {moment.time:g} are off the span of the lifts by {off:.3g}; expected a motion in "
                "their span. Make the reduced body with times= that include this one."
            )
        self._last = key_now, s
        return s

    def amounts_of(self, held: Array) -> Array:
        """Return the least-squares amounts (l,) for displacements (n,) or (n, m) at constrained degrees of freedom."""
        return np.asarray(((self.at_supports.T @ held).T / self._squares).T)


class Candidates(NamedTuple):
    """Fields from which a basis is made, each of unit mass times its weight.

    Attributes
    ----------
    fields
        (ndofs, n) displacements, one field in each column.
    words
        Numbers of the fields in words, for messages.
    """

    fields: Array
    words: str


def vibration_modes(masses: Array, rest: AtRest, n: int) -> tuple[Array, Array]:
    """Return eigenvalues (n,) and vectors (free, n) of unit mass of the lowest modes at rest: `K x = omega^2 M x`.

    The method is a block Krylov space of `K^-1 M`, so that one factorisation is enough for all solves, each with many right sides.
    Blocks are larger than the likely multiplicity of any eigenvalue.
    """
    count, M = len(rest.free), masses[rest.free]
    if not 1 <= n <= count:
        raise StvkError(f"modes = {n}; expected a number from 1 to {count}, that of the free degrees of freedom.")
    block = np.random.default_rng(0).standard_normal((count, min(n + MORE, count)))
    space, small = np.zeros((count, 0)), np.zeros((0, 0))
    for _ in range(MOST_BLOCKS):
        block = rest.solve_free(M[:, None] * block)
        for _ in range(2):
            block = _independent(M, block - space @ (space.T @ (M[:, None] * block)))
        block, m = block[:, : count - space.shape[1]], space.shape[1]
        space = np.hstack([space, block])
        small = np.pad(small, (0, block.shape[1]))
        small[:, m:] = space.T @ (rest.K @ block)
        small[m:, :m] = small[:m, m:].T
        values, c = np.linalg.eigh((small + small.T) / 2)
        vectors = space @ c[:, :n]
        residuals = (rest.K @ vectors - M[:, None] * vectors * values[:n]) / np.sqrt(M)[:, None]
        enough = space.shape[1] >= n and (np.linalg.norm(residuals, axis=0) <= CONVERGED * values[:n]).all()
        if enough or space.shape[1] >= count or not block.shape[1]:
            break
    if space.shape[1] < n or not values[0] > 0:
        raise SupportError(f"modes = {n}: {min(n, space.shape[1])} were found, the lowest with omega^2 = {values[0]:.3g}.")
    return values[:n], vectors


def _independent(masses: Array, fields: Array) -> Array:
    """Return orthonormal fields (n, k) that span `fields` (n, m), without remainders that are rounding."""
    sizes = np.sqrt((masses[:, None] * fields**2).sum(axis=0))
    fields = fields[:, sizes > 0] / sizes[sizes > 0]
    values, c = np.linalg.eigh(fields.T @ (masses[:, None] * fields))
    retained = values > INDEPENDENT
    independent: Array = fields @ (c[:, retained] / np.sqrt(values[retained]))
    return independent


def second_derivatives(body: System, fields: Array) -> Callable[[int, int], Array]:
    """Return `d2F/du2` at rest along two of the `fields` (ndofs, n): `(i, j) -> (ndofs,)`, exact if the energy is a quartic.

    F is then a cubic, so that `F(v) + F(-v)` is its second derivative applied twice to v; no step is small.
    """
    mesh = body.mesh
    if body.quartic:
        reach = LARGE * float(np.linalg.norm(np.ptp(mesh.p, axis=1)))
    else:
        a, b = np.concatenate([term.nodes_paired for term in body.bound_terms], axis=1)
        lengths = np.linalg.norm(mesh.p[:, a] - mesh.p[:, b], axis=0)
        reach = SMALL * float(lengths.min(initial=np.inf, where=lengths > 0))
    sizes = reach / np.abs(fields).max(axis=0)
    known: dict[int, Array] = {}

    def twice(v: Array) -> Array:
        return np.asarray(body.internal_force(v) + body.internal_force(-v))

    def along(i: int, j: int) -> Array:
        for one in (i, j):
            if one not in known:
                known[one] = twice(sizes[one] * fields[:, one])
        if i == j:
            return known[i] / sizes[i] ** 2
        both = twice(sizes[i] * fields[:, i] + sizes[j] * fields[:, j])
        return np.asarray((both - known[i] - known[j]) / (2 * sizes[i] * sizes[j]))

    return along


def candidates_of(
    body: System,
    masses: Array,
    rest: AtRest,
    modes: int,
    derivatives: bool,
    snapshots: Array | None,
    *,
    tick: Callable[[str], None] = lambda done: None,
) -> Candidates:
    """Return modes, modal derivatives and snapshots (ndofs, m), which are 0 where the body is constrained.

        K(0) phi_ij = -(dK/du . phi_j) phi_i        weights: l_1/l_i of a mode, l_1^2/(l_i l_j) of a derivative

    `l` are the eigenvalues `omega^2`. Source: Barbic, James (2005). Here fields have unit mass before they are weighted, so that
    units make no difference.
    """
    free, words = rest.free, []
    count = modes + (modes * (modes + 1) // 2 if derivatives else 0)
    fields = np.zeros((body.ndofs, count + (0 if snapshots is None else snapshots.shape[1])), order="F")
    if modes:
        tick("modes")
        values, vectors = vibration_modes(masses, rest, modes)
        fields[free, :modes] = vectors
        words.append(f"{modes} modes")
    if derivatives and modes:
        along, at = second_derivatives(body, fields[:, :modes]), modes
        for i in range(modes):
            tick(f"derivatives of mode {i + 1} of {modes}")
            forces = np.array([along(i, j)[free] for j in range(i + 1)]).T
            fields[free, at : at + i + 1] = rest.solve_free(-forces)
            weights = values[0] ** 2 / (values[i] * values[: i + 1])
            fields[:, at : at + i + 1] *= weights / np.maximum(_sizes(masses, fields[:, at : at + i + 1]), np.finfo(float).tiny)
            at += i + 1
        words.append(f"{modes * (modes + 1) // 2} modal derivatives")
    if modes:
        fields[:, :modes] *= values[0] / values
    if snapshots is not None:
        largest = _sizes(masses, snapshots).max()
        fields[:, count:] = snapshots / (largest if largest > 0 else 1.0)
        words.append(f"{snapshots.shape[1]} snapshots")
    return Candidates(fields, " and ".join(words))


def checked_snapshots(body: System, lifts: Lifts, value: ArrayLike | None) -> Array | None:
    """Return snapshots (ndofs, m) minus their lifts, 0 at supports; refuse snapshots that violate the supports."""
    if value is None:
        return None
    n, held = body.ndofs, body.supports.held
    snapshots = array("snapshots", value, (n, None), f"({n}, m) displacements, a column for each state, such as the u of results")
    if not snapshots.shape[1]:
        raise StvkError(f"snapshots have the shape ({n}, 0); expected a column for each state, or None for modes alone.")
    s = lifts.amounts_of(snapshots[held])
    own = np.asfortranarray(snapshots - lifts.fields @ s)
    off = np.flatnonzero(np.abs(own[held]).max(axis=0, initial=0.0) > 1e-8 * np.abs(snapshots).max(axis=0, initial=0.0))
    if len(off):
        raise StvkError(
            f"snapshots violate the supports in {len(off)} of {snapshots.shape[1]} columns (first {off[0]}); expected "
            "displacements of this body that satisfy its supports. Do they belong to other supports?"
        )
    own[held] = 0
    return own


def principal_basis(masses: Array, candidates: Candidates, size: int | None) -> Array:
    """Return fields (ndofs, size), orthonormal by mass, that represent most of the candidates: the first principal components.

    By default `size` is `SIZE`, or the number of independent fields. StvkError if there are fewer.
    """
    fields, there = candidates.fields, candidates.fields.shape[1]
    if size is not None and size > there:
        raise StvkError(
            f"size = {size}; expected at most {there}: there are {candidates.words}. Use more modes, or a smaller size."
        )
    if not np.isfinite(fields).all():
        raise StvkError("The basis is not finite. Is the body supported, and are its elements valid?")
    root = np.sqrt(masses)
    fields *= root[:, None]
    _, sizes, directions = np.linalg.svd(np.linalg.qr(fields, mode="r"))
    independent = int(np.count_nonzero(sizes > INDEPENDENT * sizes[0])) if sizes[0] > 0 else 0
    size = min(SIZE, max(independent, 1)) if size is None else size
    if size > independent:
        raise StvkError(
            f"size = {size}; expected at most {independent}: so many of {candidates.words} are independent. Use more modes, or a "
            "smaller size."
        )
    retained = fields @ (directions[:size].T / sizes[:size])
    weighted = np.linalg.qr(retained)[0]
    weighted *= np.sign(np.einsum("ij,ij->j", weighted, retained))
    weighted[~retained.any(axis=1)] = 0  # supports, except for rounding
    inverse = np.divide(1.0, root, out=np.zeros_like(root), where=root > 0)
    basis = np.ascontiguousarray(weighted * inverse[:, None])
    off = orthonormality_error(masses, basis)
    if not off < 1e-12:
        raise StvkError(f"The basis is orthonormal to {off:.1g} only; expected 1e-12. Are there nodes without mass?")
    return basis


def orthonormality_error(masses: Array, basis: Array) -> float:
    """Return the largest entry of `V' M V - I`."""
    product: Array = basis.T @ (masses[:, None] * basis)
    return float(np.abs(product - np.eye(basis.shape[1])).max(initial=0.0))


def _sizes(masses: Array, fields: Array) -> Array:
    """Return the norms (n,) of fields (ndofs, n) by mass."""
    return np.asarray(np.sqrt(np.einsum("in,i,in->n", fields, masses, fields)))
