"""Springs between the surface of a body and the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from scipy.sparse import csr_matrix

from ...arguments import Array, Quantity, own, real_array, shown
from ...edges import ALL, NodeBlocks, Tensions
from ...edges.bound_term import BoundTerm
from ...errors import LoadError
from ...kernels.simplex_topology import edges_of_simplices
from ...mesh import ElementMesh
from ...mesh.locations import Where, describe, facets_at
from ..body import Body
from ..term import Term
from .spread import Spread


@dataclass(frozen=True, eq=False)
class ElasticFoundation(Term):
    """Elastic bedding: `W = 1/2 integral of k_x u_x^2 + k_y u_y^2 + k_z u_z^2 dA` over facets of the body at rest.

    The bedding pulls and pushes along the coordinate axes, over curved facets too. The area of edges is length times thickness, and
    that of the ends of segments is the segment's area.

    Parameters
    ----------
    where
        Location of the facets, as in `Traction`.
    stiffness
        Stiffness `k` per area at rest [N/m^3], a number for all components or one for each; zero frees a component.

    Raises
    ------
    LoadError
        if the stiffness is negative, not finite or entirely zero; when it is bound, if it does not have one value per
        component.
    RegionError
        when it is bound, if there is no facet.

    Examples
    --------
    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> cube = System(skfem.MeshTet(), [StVK(young=1.0, poisson=0.3), ElasticFoundation(lambda x: x[2] == 0, (0, 0, 1e6))])
    >>> round(cube.energy(np.full(cube.ndofs, 0.01)), 9)
    50.0
    """

    per_element = True

    where: Annotated[Where, Quantity(None, "Place with the boundary facets that the foundation supports.")]
    stiffness: Annotated[
        float | ArrayLike, Quantity("stiffness per area", "Stiffness per area, of all components or of each.", components=True)
    ]

    def __post_init__(self) -> None:
        k = real_array(self.stiffness)
        if k is None or k.ndim > 1:
            raise LoadError(
                f"ElasticFoundation: stiffness is {shown(self.stiffness)}; expected a number, or one per component [N/m^3]."
            )
        if not np.isfinite(k).all() or (k < 0).any() or not k.any():
            raise LoadError(
                f"ElasticFoundation: stiffness is {self.stiffness!r}; expected finite values, none negative and not all zero."
            )
        object.__setattr__(self, "stiffness", k)
        own(self)

    def bind(self, body: Body | ElementMesh, dtype: DTypeLike = np.float64) -> Bedding:
        body = body if isinstance(body, Body) else Body(body, [])
        what, d = f"ElasticFoundation on {describe(self.where)}", body.mesh.d
        k = np.asarray(self.stiffness)
        if k.shape not in ((), (d,)):
            raise LoadError(
                f"{what}: stiffness has shape {k.shape}; expected a number, or {d} components ({', '.join('xyz'[:d])})."
            )
        facets = facets_at(body.mesh, self.where, what)
        return Bedding(body, self.where, facets, np.broadcast_to(k, d), dtype)


class Bedding(BoundTerm):
    """Foundation on a mesh: `K = k (x) M` with the mass matrix `M` of its facets, constant.

    The foundation pairs the nodes of each facet, and ties the degrees of freedom `grounded` of its `nodes` (n,) to the ground.
    `where` is its location.
    """

    constant_tangent = quartic = removable = True
    balanced = False

    def __init__(self, body: Body, where: Where, facets: NDArray[np.int32], stiffness: Array, dtype: DTypeLike) -> None:
        self.where = where
        self._k, self._body, self._facets, self._dtype = stiffness, body, facets, dtype
        spread = Spread(body.mesh, body.facet, facets, body.facet_areas(facets))
        self.nodes = spread.vertices
        local, self._between, self._own = _masses(spread, self._dtype)
        self.nodes_paired = spread.vertices[local].astype(np.int32)
        self.nodes_joined = self.nodes_paired[:, self._between > 0]
        self._M = _matrix(local, self._between, self._own)
        self._sizes = abs(self._M)
        tied = self.nodes[self._own > 0]
        self.grounded = (len(self._k) * tied[:, None] + np.flatnonzero(self._k)).ravel()

    def without(self, removed: NDArray[np.bool_]) -> Bedding:
        """Return the foundation without the facets whose elements are all removed, `removed` (nt,); the pairs stay, with zeros."""
        return Bedding(self._body.without(removed, self._body.bare), self.where, self._facets, self._k, self._dtype)

    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        own = u[self.nodes]
        pull = self._pull(own)
        if force is not None:
            force[self.nodes] += pull
        return float(np.vdot(own, pull)) / 2

    def add_blocks(self, u: Array, blocks: NodeBlocks, kept: Tensions = ALL) -> None:
        """Add `k M_ab`, the same at all `u`."""
        assert blocks.own is not None
        for c, k in enumerate(self._k):
            blocks.pairs[:, c, c] += k * self._between
            blocks.own[:, c, c] += k * self._own

    def along(self, u: Array, v: Array) -> NDArray[np.float64]:
        """Return the coefficients (5,) of the energy along `u + s v`: the last two are zero."""
        U, V = u[self.nodes].astype(np.float64), v[self.nodes].astype(np.float64)
        pull = self._pull(V)
        return np.array([np.vdot(U, self._pull(U)) / 2, np.vdot(U, pull), np.vdot(V, pull) / 2, 0.0, 0.0])

    def add_round_off(self, u: Array, out: Array) -> None:
        """Add `|K| |u|`, the sum of the absolute values of the force's summands [N], to `out` (nv, d)."""
        out[self.nodes] += self._sizes @ np.abs(u[self.nodes]) * self._k.astype(self._M.dtype)

    def memory(self) -> dict[str, int]:
        M = self._M
        arrays = M.data, M.indices, M.indptr, self._between, self._own, self.nodes, self.grounded, self.nodes_paired
        return {"foundations": sum(array.nbytes for array in arrays)}

    def _pull(self, own: Array) -> Array:
        """Return `K u` (n, d) from the displacements of its own nodes."""
        return np.asarray(self._M @ own * self._k.astype(self._M.dtype))


def _masses(spread: Spread, dtype: DTypeLike) -> tuple[NDArray[np.int32], Array, Array]:
    """Return pairs (2, n) of nodes of facets, as indices within the spread, and `M_ab = integral of N_a N_b` of pairs and of single
    nodes.
    """
    each, pairs = spread.matrices(), np.array(spread.element.pairs, dtype=np.int64).reshape(-1, 2)
    own = spread.add(each[range(len(each)), range(len(each))])
    if not len(pairs):
        return np.empty((2, 0), dtype=np.int32), np.empty(0, dtype=dtype), own.astype(dtype)
    local, sides = edges_of_simplices(np.ascontiguousarray(spread.nodes, dtype=np.int32), pairs, len(own))
    between = np.bincount(sides.ravel(), weights=each[pairs[:, 0], pairs[:, 1]].ravel(), minlength=local.shape[1])
    return local, between.astype(dtype), own.astype(dtype)


def _matrix(local: NDArray[np.int32], between: Array, own: Array) -> csr_matrix:
    """Return the symmetric matrix with these entries `between` nodes, and `own` entries on the diagonal."""
    every = np.arange(len(own), dtype=np.int32)
    row, column = np.concatenate([local[0], local[1], every]), np.concatenate([local[1], local[0], every])
    M = csr_matrix((np.concatenate([between, between, own]), (row, column)), shape=(len(own),) * 2)
    M.sort_indices()
    return M
