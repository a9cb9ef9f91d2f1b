"""A system: terms that share one mesh and one pattern of K."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_matrix

from ..edges import Places
from ..errors import StateError, StvkError, StvkWarning, name_ids
from ..mesh import MeshLike, SimplexMesh
from ..mesh.diagnostics import check_mesh
from ..terms import BoundTerm, Term
from .pattern import Pattern

Array = NDArray[np.float64]


class System:
    """An elastic body: its strain energy W, internal force F and tangent stiffness K.

        W = 1/4 sum L_ij zeta_i zeta_j        F = dW/du        K = d2W/du2

    over edges and tetrahedron-sharing edge pairs, `zeta` the squared elongations of the edges. Displacements `u` are flat vectors
    with the degree of freedom `d * vertex + component`, scikit-fem's for `ElementVector(ElementTetP1())`.

    Parameters
    ----------
    mesh : scikit-fem mesh of simplices, arrays `(p, t)`, or `SimplexMesh`.
    terms : a term, or several that add up.

    Raises
    ------
    MeshError, MaterialError, RegionError
        for what cannot carry an elastic body, before any work, with ids.

    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK
    >>> mesh = skfem.MeshTet().refined(2)
    >>> body = System(mesh, StVK(young=1e5, poisson=0.3))
    >>> u = 0.01 * mesh.p.ravel("F")                     # 1 % larger in all directions
    >>> round(body.energy(u), 4), round(9 / 2 * 1e5 / 1.2 * 0.01005**2, 4)
    (37.8759, 37.8759)
    >>> bool(abs(body.internal_force(u).reshape(-1, 3).sum(axis=0)).max() < 1e-10)
    True
    >>> K = body.tangent(u)
    >>> K.shape, bool(abs(K - K.T).max() < 1e-10)
    ((345, 345), True)
    """

    def __init__(self, mesh: MeshLike, terms: Term | Sequence[Term]) -> None:
        self.mesh = SimplexMesh.of(mesh)
        check_mesh(self.mesh)
        self.terms = tuple(terms) if isinstance(terms, Sequence) else (terms,)
        if not self.terms:
            raise StvkError("No terms came; expected at least one, such as StVK(young=..., poisson=...).")
        for term in self.terms:
            if not hasattr(term, "bind"):
                raise StvkError(f"A term of type {type(term).__name__} came; expected StVK(...) or a list of terms.")
        self._bound: list[BoundTerm] = [term.bind(self.mesh) for term in self.terms]
        self._warn_of_bare_vertices()

    @property
    def ndofs(self) -> int:
        """Number of degrees of freedom, `d * nv`."""
        return self.mesh.p.size

    @cached_property
    def pattern(self) -> Pattern:
        """The pattern that every K of this system has; made when it is first needed."""
        return Pattern(self.mesh.nv, self.mesh.d, [term.edges for term in self._bound])

    @cached_property
    def _places(self) -> list[Places]:
        return [self.pattern.places(term.edges) for term in self._bound]

    def energy(self, u: ArrayLike) -> float:
        """Strain energy `W(u)` [J].

        Raises
        ------
        StateError
            if `u` does not have one finite entry for each degree of freedom, or is so large that the result overflows.
        """
        x = self._state(u)
        with np.errstate(over="ignore", invalid="ignore"):
            energy = sum(term.energy(x) for term in self._bound)
        _refuse_overflow(energy, "W", x)
        return energy

    def internal_force(self, u: ArrayLike) -> Array:
        """Internal force `F = dW/du` (ndofs,) [N]; the residual of statics is `F - f_ext`.

        Raises
        ------
        StateError
            if `u` does not have one finite entry for each degree of freedom, or is so large that the result overflows.
        """
        x = self._state(u)
        force = np.zeros_like(x)
        with np.errstate(over="ignore", invalid="ignore"):
            for term in self._bound:
                term.add_force(x, force)
        _refuse_overflow(force, "F", x)
        return force.ravel()

    def tangent(self, u: ArrayLike, out: csr_matrix | None = None) -> csr_matrix:
        """Tangent stiffness `K = d2W/du2` (ndofs, ndofs) [N/m], always of the same pattern, zeros kept.

        Parameters
        ----------
        u : displacements (ndofs,) [m].
        out : a matrix that this method returned before, to be filled anew; by default a new one.

        Raises
        ------
        StateError
            if `u` does not have one finite entry for each degree of freedom, or is so large that the result overflows.
        StvkError
            if `out` has another pattern.
        """
        x = self._state(u)
        if out is None:
            out = self.pattern.matrix(np.zeros(self.pattern.nnz))
        elif self.pattern.fits(out):
            out.data[:] = 0
        else:
            raise StvkError(
                f"out, a {type(out).__name__} of shape {np.shape(out)}, does not have the pattern and type of this system's K "
                f"({self.pattern.shape}, {self.pattern.nnz} values). Hand in a matrix that tangent() returned, unchanged by "
                "eliminate_zeros() and the like."
            )
        with np.errstate(over="ignore", invalid="ignore"):
            for term, places in zip(self._bound, self._places, strict=True):
                term.add_tangent(x, places, out.data)
        _refuse_overflow(out.data, "K", x)
        return out

    def _state(self, u: ArrayLike) -> Array:
        """The displacements as (nv, d)."""
        u = np.asarray(u)
        if u.dtype.kind not in "fiu":
            raise StateError(f"u has dtype {u.dtype}; expected real numbers, displacements in m.")
        u = u.astype(np.float64, copy=False)
        if u.shape != (self.ndofs,):
            raise StateError(
                f"u has shape {u.shape}; expected ({self.ndofs},): {self.mesh.d} components at each of {self.mesh.nv} vertices, "
                "degree of freedom d * vertex + component. Is u of another mesh or of second order?"
            )
        bad = np.flatnonzero(~np.isfinite(u))
        if len(bad):
            raise StateError(f"u is not finite in {name_ids(bad, 'entry')}: did the step before diverge?")
        return u.reshape(-1, self.mesh.d)

    def _warn_of_bare_vertices(self) -> None:
        used = np.zeros(self.mesh.nv, dtype=bool)
        for term in self._bound:
            used[term.edges.ravel()] = True
        bare = np.flatnonzero(~used)
        if len(bare):
            warnings.warn(
                f"{name_ids(bare, 'vertex')}: in no term, so their rows of K are zero. Is a region missing from the terms?",
                StvkWarning,
                stacklevel=3,
            )

    def __repr__(self) -> str:
        return f"System: {self.mesh.nt} {self.mesh.kind}, {self.ndofs} degrees of freedom, {len(self.terms)} term(s)"


def _refuse_overflow(values: ArrayLike, name: str, u: Array) -> None:
    if not np.isfinite(values).all():
        raise StateError(
            f"{name} overflows at displacements of up to {np.abs(u).max():.1e}: did the step before diverge, or are units mixed up?"
        )
