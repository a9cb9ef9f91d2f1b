"""Network of edges and pairs of edges with coefficients: the sum of the paper as a term."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.sparse import csr_matrix, issparse, triu

from ...arguments import Array, Quantity, choice, own, shown, whole_array
from ...edges.form import EdgeForm, meet
from ...edges.network import ElementNetwork, QuarticNetwork
from ...edges.stiffness import GeneralStiffness
from ...edges.topology import edge_topology
from ...errors import MeshError, StvkError, name_ids
from ...linear.choose import COUNTED, inertia
from ...linear.solver import Unknowns
from ...mesh import ElementMesh, MeshLike
from ..body import Body
from ..term import Term
from .stvk import StVK

#: Sums of coefficients that cancel to less than this fraction of them are rounding errors.
ROUNDED = 1e-13
#: Kinds of pairs of edges in a network.
PAIRS = ("all", "none", "adjacent", "opposite")


@dataclass(frozen=True, eq=False)
class EdgeNetwork(Term):
    """Sum over edges and pairs of edges: `W = 1/4 sum_i L_ii zeta_i^2 + 1/2 sum_{pairs i < j} L_ij zeta_i zeta_j`.

    The variables are `zeta = |p|^2 - |P|^2` of each edge [m^2], and coefficients `L` of any origin. With the `L` of linear
    simplices (`EdgeNetwork.of`) the network is the finite-element model, and its pairs share a simplex (TSEPs). Its first sum alone
    (`diagonal`) is a network of quartic springs. Any other symmetric `L` is allowed, even one that is not positive semi-definite
    (`definite`); some states then have less energy than rest. A network has edges and no elements: for volumes and stresses use
    `StVK`.

    Parameters
    ----------
    edges
        (2, ne) vertices of the edges, each edge once.
    L
        (ne, ne) sparse symmetric matrix [J/m^4], off the diagonal the pairs of edges, each twice.
    laws
        The `StVK` laws of the coefficients, which supply mass, thickness and area to the elements of their regions; none if L comes
        from elsewhere.

    Raises
    ------
    StvkError
        if an edge is repeated, or joins a vertex with itself, or L has another shape, is not symmetric or not finite.
    MeshError
        when it is made of elements that have no edge form; when it is bound, if the mesh lacks vertices.

    Notes
    -----
    Source: Kikuuwe, Tabuchi, Yamamoto (2009), equations 12 - 14 of Kikuuwe's overview.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import StVK, System
    >>> mesh, law = skfem.MeshTet().refined(1), StVK(young=1e5, poisson=0.3)
    >>> network = EdgeNetwork.of(mesh, law)
    >>> u = 0.1 * (mesh.p**2).ravel("F")
    >>> bool(abs(System(mesh, network).energy(u) / System(mesh, law).energy(u) - 1) < 1e-13)
    True
    >>> network, network.without("opposite")
    (EdgeNetwork(89 edges, 312 adjacent and 72 opposite pairs), EdgeNetwork(89 edges, 312 adjacent and 0 opposite pairs))
    """

    has_mass: ClassVar[bool] = True

    edges: NDArray[Any]
    L: csr_matrix = field(repr=False)
    laws: tuple[StVK, ...] = ()

    def __post_init__(self) -> None:
        edges, L = _checked_edges(self.edges), _checked_coefficients(self.L)
        if L.shape[0] != edges.shape[1]:
            raise StvkError(f"EdgeNetwork: L has shape {L.shape}; expected {(edges.shape[1],) * 2} for {edges.shape[1]} edges.")
        order = np.lexsort((edges[1], edges[0]))
        object.__setattr__(self, "edges", np.ascontiguousarray(edges[:, order]))
        object.__setattr__(self, "L", L if (np.diff(order) == 1).all() else L[order][:, order].tocsr())
        own(self)

    @classmethod
    def of(
        cls,
        mesh: MeshLike,
        law: StVK | Sequence[StVK],
        pairs: Annotated[
            str, Quantity(None, "Pairs of edges that count: those that meet in a vertex, or do not.", values=PAIRS)
        ] = "all",
    ) -> EdgeNetwork:
        """Return the network of a St. Venant-Kirchhoff body of linear simplices, with one law or several on their regions.

        Parameters
        ----------
        mesh
            Mesh of linear simplices.
        law
            St. Venant-Kirchhoff law, or several on their regions.
        pairs
            Pairs of edges in the sum: "all", "none", the "adjacent" or the "opposite" ones.
        """
        choice("EdgeNetwork.of: pairs", pairs, PAIRS)
        body = ElementMesh.of(mesh)
        laws = tuple(law) if isinstance(law, list | tuple) else (law,)
        if not laws or not all(isinstance(each, StVK) for each in laws):
            raise StvkError(f"EdgeNetwork.of: law = {shown(law)}; expected StVK(...) or a list of them.")
        if not body.element.is_linear_simplex:
            raise MeshError(
                f"EdgeNetwork.of: the mesh has {body.kind}, whose strain varies within an element, so edge lengths do not "
                "determine it. Take linear simplices (degree=1)."
            )
        elements = np.concatenate([body.elements(each.region) for each in laws])
        edges = edge_topology(body.t[:, elements])[0]
        return cls(edges, _coefficients(body, laws, edges, np.ones(body.nt, dtype=bool)), laws)._with(pairs)

    def _with(self, pairs: str) -> EdgeNetwork:
        """Return the network with only these pairs."""
        if pairs == "all":
            return self
        return self.diagonal() if pairs == "none" else self.without("opposite" if pairs == "adjacent" else "adjacent")

    @property
    def without_mass(self) -> str:
        """Reason for which nodes have no mass; empty if there are laws, which supply it."""
        return (
            "" if self.laws else "an EdgeNetwork(edges, L) has no elements. Make it by EdgeNetwork.of(mesh, StVK(..., density=...))"
        )

    @property
    def per_element(self) -> bool:
        """Whether `L` is a sum over elements, those of the laws."""
        return bool(self.laws)

    @property
    def pairs(self) -> NDArray[np.int64]:
        """Edges `i < j` (2, n) of the pairs with nonzero `L_ij`."""
        upper = triu(self.L, 1).tocoo()
        return np.stack([upper.row, upper.col]).astype(np.int64)

    @property
    def adjacent(self) -> NDArray[np.bool_]:
        """Whether (n,) the edges of each of the `pairs` meet in a vertex ("angular"); the others are opposite ("volumetric")."""
        return meet(self.edges, self.pairs)

    def diagonal(self) -> EdgeNetwork:
        """Return the network without pairs: springs with `W = 1/4 sum L_ii zeta_i^2`, the first sum of eq. 14."""
        n = len(self.edges.T)
        return replace(self, L=csr_matrix((self.L.diagonal(), (np.arange(n), np.arange(n))), shape=(n, n)))

    def without(self, pairs: str) -> EdgeNetwork:
        """Return the network without some of its pairs.

        Parameters
        ----------
        pairs
            Pairs to leave out, "adjacent" or "opposite".
        """
        choice("without: pairs", pairs, ("adjacent", "opposite"))
        upper = triu(self.L, 1).tocoo()
        retained = self.adjacent == (pairs == "opposite")
        U = csr_matrix((upper.data[retained], (upper.row[retained], upper.col[retained])), shape=self.L.shape)
        return replace(self, L=csr_matrix(self.diagonal().L + U + U.T))

    def definite(self) -> bool:
        """Return whether no eigenvalue of `L` is negative, within rounding.

        Then no state has less energy than rest, for any geometry.

        Raises
        ------
        StvkError
            for more than 20 000 edges, where factors of L take too long, and if no solver can decide.
        """
        n = self.L.shape[0]
        if n > COUNTED:
            raise StvkError(
                f"EdgeNetwork.definite: {n} edges; expected at most {COUNTED}, whose L is factorised within seconds. Check a "
                "smaller body with elements of the same shapes."
            )
        L = csr_matrix(self.L + csr_matrix((np.zeros(n), (np.arange(n), np.arange(n))), shape=(n, n)))
        L.sort_indices()
        found = inertia(L, Unknowns(np.arange(n), np.zeros(n, dtype=int), L.indptr, L.indices))
        if found is None:
            raise StvkError("EdgeNetwork.definite: no direct solver can count the negative eigenvalues of this L.")
        return found.negative == 0

    def bind(self, body: Body | ElementMesh, dtype: DTypeLike = np.float64) -> QuarticNetwork:
        mesh = body.mesh if isinstance(body, Body) else body
        last = int(self.edges.max(initial=-1))
        if last >= mesh.nv:
            raise MeshError(f"EdgeNetwork: an edge has vertex {last}; the mesh has {mesh.nv}. Was it made of another mesh?")
        if self.laws:
            self._refuse_another(mesh)
        edges, pairs = self.edges.astype(np.int32), self.pairs.astype(np.int32)
        own, between = self.L.diagonal() / 2, np.asarray(triu(self.L, 1).tocoo().data) / 2
        if not self.laws:
            return QuarticNetwork(mesh.p, edges, pairs, own, between, dtype=dtype)
        return LawNetwork(mesh.p, edges, pairs, own, between, dtype=dtype, remaining=partial(self._without_elements, mesh))

    def _refuse_another(self, mesh: ElementMesh) -> None:
        """Refuse a mesh if its edges, in the regions of the laws, are not those of the network."""
        if not mesh.element.is_linear_simplex:
            raise MeshError(
                f"EdgeNetwork: it has the edges of linear simplices; the mesh has {mesh.kind}, whose other nodes would have no "
                "stiffness. Take degree=1."
            )
        elements = np.unique(np.concatenate([mesh.elements(law.region) for law in self.laws]))
        own, there = (edges[0] * np.int64(mesh.nv) + edges[1] for edges in (self.edges, edge_topology(mesh.t[:, elements])[0]))
        foreign, missing = np.flatnonzero(~np.isin(own, there)), np.setdiff1d(there, own)
        if len(foreign) or len(missing):
            raise MeshError(
                f"EdgeNetwork: the mesh lacks {name_ids(foreign, 'edge')} of the network, and has {len(missing)} other edges; "
                "expected the mesh that the network was made of. Make it again: EdgeNetwork.of(mesh, law)."
            )

    def _without_elements(self, mesh: ElementMesh, removed: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return `L_ii/2`, and `L_ij/2` of the pairs, minus the parts of the `removed` elements (n,) of the region."""
        out = np.zeros(mesh.nt, dtype=bool)
        out[mesh.elements(self.region)] = removed
        lost, upper = _coefficients(mesh, self.laws, self.edges, out), triu(self.L, 1).tocoo()
        size = np.sqrt(np.abs(self.L.diagonal()))
        own = self.L.diagonal() - lost.diagonal()
        between = upper.data - np.asarray(lost[upper.row, upper.col]).ravel()
        own[np.abs(own) < ROUNDED * size**2] = 0  # without any element left, the sum is rounding
        between[np.abs(between) < ROUNDED * size[upper.row] * size[upper.col]] = 0
        return own / 2, between / 2

    @property
    def region(self) -> NDArray[Any] | str | None:
        """Elements of the laws: the region of one law; all elements for several laws, as only a mesh resolves their regions."""
        return self.laws[0].region if len(self.laws) == 1 else None

    def mass(self, mesh: ElementMesh, sizes: Array) -> Array:

        def masses(law: StVK, ids: NDArray[Any]) -> Array:
            return law.mass(mesh, of[ids])

        of = np.zeros(mesh.nt)
        of[mesh.elements(self.region)] = sizes
        return self._of_laws(mesh, masses)

    def section(self, mesh: ElementMesh, n: int) -> Array:
        found = self._of_laws(mesh, lambda law, ids: law.section(mesh, len(ids)))
        return np.where(found == 0, 1.0, found)

    def confined_modulus(self, mesh: ElementMesh, n: int) -> Array:
        return self._of_laws(mesh, lambda law, ids: law.confined_modulus(mesh, len(ids)))

    def _of_laws(self, mesh: ElementMesh, value: Callable[[StVK, NDArray[Any]], Array]) -> Array:
        """Return values (n,) of the region's elements from values of the laws."""
        values = np.zeros(mesh.nt)
        for law in self.laws:
            ids = mesh.elements(law.region)
            values[ids] = value(law, ids)
        return values[mesh.elements(self.region)]

    def __repr__(self) -> str:
        adjacent = int(np.count_nonzero(self.adjacent))
        n = len(self.adjacent)
        return f"EdgeNetwork({self.edges.shape[1]} edges, {adjacent} adjacent and {n - adjacent} opposite pairs)"


def _checked_edges(value: Any) -> NDArray[np.int64]:
    """Return the edges (2, ne) with `a < b`, each once."""
    edges = whole_array(value)
    if edges is None or edges.ndim != 2 or len(edges) != 2 or edges.dtype == bool or edges.shape[1] == 0:
        raise StvkError(f"EdgeNetwork: edges = {shown(value)}; expected the vertices (2, ne) of at least one edge, whole numbers.")
    edges = np.sort(edges.astype(np.int64), axis=0)
    bad = np.flatnonzero((edges[0] == edges[1]) | (edges[0] < 0))
    if len(bad):
        raise StvkError(f"EdgeNetwork: {name_ids(bad, 'edge')} with a vertex below zero or with the same vertex twice.")
    _, first, count = np.unique(edges, axis=1, return_index=True, return_counts=True)
    if (count > 1).any():
        raise StvkError(f"EdgeNetwork: {name_ids(np.sort(first[count > 1]), 'edge')} given more than once; expected each once.")
    return edges


def _checked_coefficients(value: Any) -> csr_matrix:
    """Return a copy of L, symmetric to the last bit."""
    if not issparse(value):
        raise StvkError(f"EdgeNetwork: L = {shown(value)}; expected a sparse matrix, such as scipy.sparse.csr_matrix(...).")
    L = csr_matrix(value, dtype=np.float64, copy=True)
    L.sum_duplicates()
    if not np.isfinite(L.data).all():
        raise StvkError("EdgeNetwork: L has entries that are not finite.")
    if L.shape[0] != L.shape[1]:
        raise StvkError(f"EdgeNetwork: L has shape {L.shape}; expected a square matrix, a row for each edge.")
    difference = abs(L - L.T)
    if difference.nnz and difference.max() > 1e-12 * abs(L).max():
        rows = np.unique(difference.tocoo().row[difference.tocoo().data > 1e-12 * abs(L).max()])
        raise StvkError(f"EdgeNetwork: L is not symmetric, in the rows of {name_ids(rows, 'edge')}; expected L_ij = L_ji.")
    return L


def _coefficients(mesh: ElementMesh, laws: Sequence[StVK], edges: NDArray[Any], chosen: NDArray[np.bool_]) -> csr_matrix:
    """Return `L` (ne, ne) for `edges` (2, ne) in lexicographic order: the sum over the `chosen` elements (nt,) of the laws."""
    codes, ne = edges[0].astype(np.int64) * mesh.nv + edges[1], edges.shape[1]
    rows, columns, values = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)], [np.empty(0)]
    for law in laws:
        ids, L = mesh.elements(law.region), law.coefficients(mesh)
        own = chosen[ids]
        if own.any():
            form = EdgeForm(mesh.p, mesh.t[:, ids[own]], GeneralStiffness(partial(np.compress, own, L, axis=0)))
            indices, entries = np.searchsorted(codes, form.edges[0].astype(np.int64) * mesh.nv + form.edges[1]), form.L.tocoo()
            rows.append(indices[entries.row])
            columns.append(indices[entries.col])
            values.append(entries.data)
    return csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(ne, ne))


class LawNetwork(ElementNetwork, QuarticNetwork):
    """Quartic network of elements."""
