"""Elements as the kernels read them: in blocks of lanes, in an order of their own, with scratch vectors."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array, choice, number, shown
from ..errors import StvkError
from ..kernels import node_blocks as block_kernels
from ..kernels.lanes import LANES, MeanPoints, Points
from ..kernels.simplex_geometry import frames, frames_of_base_vectors
from ..kernels.simplex_topology import lexicographic_order
from ..kernels.threads import CopyableLock, threads
from ..mesh import ElementMesh
from ..mesh.element import Element, linear_simplex
from ..mesh.points import HOURGLASS, Rule, are_straight, base_vectors_at, rule_of, sizes_of
from .topology import KernelEdges, KernelOrder, Shares, in_lanes, kernel_edges, out_of_lanes, shares_of


class KernelVertices:
    """Vertices (n,) in the kernels' order, scratch vectors with three components per vertex, and the threads' shares in their sums.

    Calls of several Python threads wait for the `lock`, because the vectors are in use during a call.
    """

    def __init__(self, vertices: NDArray[np.int32], dtype: DTypeLike) -> None:
        self.vertices, self.dtype, self.lock = vertices, np.dtype(dtype), CopyableLock()
        self._threads = 0
        self._shared: dict[str, Shares] = {}
        self._scratch: dict[str, Array] = {}

    def share(self, name: str, make: Callable[[int], Shares]) -> Shares:
        """Return the shares for numba's number of threads. They are made once; shares for another number are discarded."""
        if threads() != self._threads:
            self._threads, self._shared = threads(), {}
        if name not in self._shared:
            self._shared[name] = make(self._threads)
        return self._shared[name]

    def scratch(self, name: str, size: int, dtype: DTypeLike) -> Array:
        """Return a scratch vector of this name, which is retained from call to call; a new one is zero."""
        if name not in self._scratch or len(self._scratch[name]) != size:
            self._scratch[name] = np.zeros(size, dtype=dtype)
        return self._scratch[name]

    def gathered(self, name: str, x: Array, dtype: DTypeLike) -> Array:
        """Return a field `x` (nv, d) of the mesh in the kernels' order, (3 n,)."""
        own = self.scratch(name, 3 * len(self.vertices), dtype)
        block_kernels.gather(x, self.vertices, own)
        return own

    def slots(self, name: str, shares: Shares) -> Array:
        """Return zeros for the sums that the shares add to vertices."""
        slots = self.scratch(name, 3 * (len(self.vertices) + len(shares.extra)), self.dtype)
        slots[:] = 0
        return slots

    def add(self, f: Array, shares: Shares, out: Array) -> None:
        """Add the values in the slots to `out` (nv, d) of the mesh."""
        block_kernels.fold(f, len(self.vertices), shares.extra, 3)
        block_kernels.add_scattered(f, self.vertices, out)

    def memory(self) -> dict[str, int]:
        """Return the bytes of its arrays, by part."""
        return {
            "shares of threads": nbytes([value for value in self._shared.values() if len(value.parts) > 2]),
            "vectors": nbytes(list(self._scratch.values())),
        }


class Quadrature(NamedTuple):
    """Kind of element and its integration points.

    Attributes
    ----------
    element
        Kind of the elements.
    rule
        Points and weights of the rule.
    hourglass
        Coefficient of the hourglass control (`System`) of boxes with one point and mean gradients; None for other elements.
    """

    element: Element
    rule: Rule
    hourglass: float | None = None

    @classmethod
    def of(cls, element: Element, kind: str = "usual", hourglass: float | None = None) -> Quadrature:
        """Return the quadrature of the element with its rule of this kind, as `elements.rule_of` names them."""
        return cls(element, rule_of(element, kind), hourglass)


def simplex_quadrature(k: int) -> Quadrature:
    """Return the quadrature of linear simplices of dimension `k`, with their one point."""
    return Quadrature.of(linear_simplex(k))


def checked_quadrature(mesh: ElementMesh, quadrature: str | None, hourglass: float | None) -> Quadrature:
    """Return the quadrature of a mesh from the arguments of `System`; raise StvkError if they do not fit the mesh."""
    kind = "usual" if quadrature is None else choice("quadrature", quadrature, ("exact", "one-point"))
    if kind != "one-point":
        if hourglass is not None:
            raise StvkError(
                f'hourglass = {shown(hourglass)}; expected None without quadrature="one-point", for hexahedra and quadrilaterals.'
            )
        return Quadrature.of(mesh.element, kind)
    if not mesh.element.shape.one_point or mesh.k < mesh.d:
        raise StvkError(
            f'quadrature = "one-point" is for hexahedra, and quadrilaterals in the plane; the mesh has {mesh.kind}: '
            f"{_no_mean(mesh)}"
        )
    coefficient = HOURGLASS if hourglass is None else number("hourglass", hourglass, "a number, zero or more")
    if coefficient < 0:
        raise StvkError(f"hourglass = {shown(hourglass)}; expected a number, zero or more, such as {HOURGLASS}.")
    return Quadrature.of(mesh.element, kind, coefficient)


def _no_mean(mesh: ElementMesh) -> str:
    """Return the reason why elements have no mean gradients with hourglass control, and a remedy."""
    if mesh.element.shape.one_point:
        return "mean gradients need fixed axes, but those of a surface in space vary. Leave it out, for 2 x 2 points."
    if mesh.element.is_linear_simplex:
        return "linear simplices have one point anyway. Leave it out."
    return "with one point most motions of quadratic elements meet no resistance. Leave it out, or take degree=1."


class Frames(NamedTuple):
    """Frames at points of elements, one for each of n.

    Attributes
    ----------
    k
        Dimension of the elements.
    `base_vectors`
        (n, k, d) base vectors at rest [m].
    Ri
        (6, n) entries 11, 12, 13, 22, 23, 33 [1/m] of the inverse of R.
    size
        (n,) determinant of R [m^k].
    local
        (k + 1, n) for each vertex of a base vector, its index in the user-supplied simplex; for linear simplices.
    """

    k: int
    base_vectors: Array
    Ri: Array
    size: Array
    local: NDArray[np.int64] | None

    @property
    def axes(self) -> Array:
        """Frame (n, d, k) as columns `Q_j = sum_i Ri_ij P_i`."""
        return np.einsum("nid,nij->ndj", self.base_vectors, self.upper(self.Ri)[:, : self.k, : self.k])

    @staticmethod
    def upper(six: Array) -> Array:
        """Return the upper triangles (n, 3, 3) with the entries 11, 12, 13, 22, 23, 33 (6, n)."""
        out = np.zeros((six.shape[1], 3, 3))
        rows, columns = np.triu_indices(3)
        out[:, rows, columns] = six.T
        return out


def frames_at(p: NDArray[np.float64], t: NDArray[np.int32], quadrature: Quadrature, order: KernelOrder) -> Iterator[Frames]:
    """Yield the frames at each point of elements with nodes `t` (n, nt) of the mesh. Their size times the weight is the size of a
    linear simplex.
    """
    element, rule = quadrature.element, quadrature.rule
    if element.is_linear_simplex:
        found = frames(p, t)
        base_vectors = p.T[t[1:].T] - p.T[t[:1].T]
        yield Frames(element.k, base_vectors, found[:6], found[6] * rule.weights[0], order.local)
        return
    if quadrature.hourglass is not None:
        yield Frames(element.k, np.broadcast_to(np.eye(len(p)), (t.shape[1], len(p), len(p))), *mean_frames(p, t, element), None)
        return
    for xi in rule.points:
        base_vectors = base_vectors_at(p, t, element, xi[None])[:, 0]
        found = frames_of_base_vectors(np.concatenate([base_vectors, np.zeros((*base_vectors.shape[:2], 3 - len(p)))], axis=2))
        yield Frames(element.k, base_vectors, found[:6], found[6], None)


def mean_gradients(p: Array, t: NDArray[np.int32], element: Element) -> tuple[Array, Array]:
    """Return the means `int dN_a/dX dV / V` (nt, n, d) over boxes that fill the space, and their volumes `V` (nt,)."""
    rule = rule_of(element)
    base_vectors = np.ascontiguousarray(base_vectors_at(p, t, element, rule.points))
    volumes = np.abs(np.linalg.det(base_vectors)) * rule.weights
    gradients = np.einsum("qai,tqdi,tq->tad", element.derivatives(rule.points), np.linalg.inv(base_vectors), volumes, optimize=True)
    return gradients / volumes.sum(axis=1)[:, None, None], volumes.sum(axis=1)


def mean_frames(p: Array, t: NDArray[np.int32], element: Element) -> tuple[Array, Array]:
    """Return `Ri = I` (6, nt) and the volumes (nt,): mean gradients are taken along the axes of space."""
    unit = np.array([1.0, 0, 0, float(len(p) > 1), 0, float(len(p) > 2)])
    return np.repeat(unit[:, None], t.shape[1], axis=1), sizes_of(p, t, element, "usual")


def mean_points(p: Array, order: KernelOrder, quadrature: Quadrature, hourglass_stiffness: Array, dtype: DTypeLike) -> MeanPoints:
    """Return the table of boxes with one point; `hourglass_stiffness` (nt,) is `hourglass/16 (lam + 2 mu)` times section."""
    element = quadrature.element
    t = order.vertices[order.t]
    gradients, volumes = mean_gradients(p, t, element)
    n, blocks = element.n, -(-t.shape[1] // LANES)
    B = np.zeros((-(-(n - 1) // 3) * 3, 3, t.shape[1]))
    B[: n - 1, : element.k] = gradients[:, 1:].transpose(1, 2, 0)
    c = hourglass_stiffness[order.elements] * volumes * (gradients**2).sum(axis=(1, 2))
    c = in_lanes(c[None])
    c.ravel()[t.shape[1] :] = 0  # unused lanes of the last block
    signs = 2 * element.nodes - 1
    modes = [signs[:, list(axes)].prod(axis=1) for size in range(2, element.k + 1) for axes in combinations(range(element.k), size)]
    H = np.zeros((len(modes), len(B)))
    H[:, : n - 1] = np.array(modes)[:, 1:]
    lanes = in_lanes(B.reshape(-1, t.shape[1])).reshape(blocks, *B.shape[:2], LANES)
    return MeanPoints(lanes.astype(dtype), np.ones(1, dtype), np.arange(blocks + 1), H.astype(dtype), c.astype(dtype))


class KernelElements:
    """Elements in blocks of lanes. The data that only K needs are made at the first K, and vectors when they are first used.

    The elements have `k` dimensions in a space of `d` dimensions, and the nodes `own`. `elements` (nt,) are their positions in the
    user's order. `t` (blocks, n LANES) are their nodes; those of linear simplices are padded to four. `X`, `u` (3 n,) are rest
    coordinates and the displacements gathered last. `points` is the table of the kernels, None for linear simplices.
    """

    def __init__(
        self,
        p: NDArray[np.float64],
        order: KernelOrder,
        quadrature: Quadrature,
        hourglass_stiffness: Array | None,
        dtype: DTypeLike,
    ) -> None:
        element = quadrature.element
        self.element, self.k, self.d = element, element.k, len(p)
        self.own, self.elements = KernelVertices(order.vertices, dtype), order.elements
        t = order.t[[*range(self.k + 1), *[0] * (3 - self.k)]] if element.is_linear_simplex else order.t
        self.t = in_lanes(t.astype(np.uint32))
        self.X, self.u = np.zeros(3 * len(order.vertices)), np.zeros(3 * len(order.vertices))
        block_kernels.gather(np.ascontiguousarray(p.T), order.vertices, self.X)
        self._rule, self._straight = quadrature.rule, np.zeros(len(self.t), dtype=np.bool_)
        self.points: Points | MeanPoints | None = None
        if quadrature.hourglass is not None:
            hourglass_stiffness = np.zeros(len(order.elements)) if hourglass_stiffness is None else hourglass_stiffness
            self.points = mean_points(p, order, quadrature, hourglass_stiffness, dtype)
        elif not element.is_linear_simplex:
            straight = in_lanes(are_straight(p, order.vertices[order.t], element)[None])
            self._straight = np.logical_and.reduce(straight, axis=1)
            self.points = self._table(*quadrature.rule, dtype)

    def _table(self, xi: Array, weights: Array, dtype: DTypeLike) -> Points:
        """Return the kernels' table of reference points `xi` (nq, k), for one lane with one number at each point."""
        element = self.element
        B = np.zeros((len(xi), -(-(element.n - 1) // 3) * 3, 3))
        B[:, : element.n - 1, : element.k] = element.derivatives(xi)[:, 1:]
        counts = np.where(self._straight, 1, len(xi))
        return Points(B.astype(dtype), weights.astype(dtype), np.concatenate([[0], np.cumsum(counts)]))

    @cached_property
    def at_points(self) -> Points | MeanPoints | None:
        """Table of the points in double, for the shape of elements there: one number per point."""
        if isinstance(self.points, MeanPoints):
            return _in_double(self.points)
        return None if self.points is None else _one_number(self._table(*self._rule, np.float64))

    @cached_property
    def at_nodes(self) -> Points | None:
        """Table of the nodes of the element, in double: an element may invert at a node first."""
        if self.points is None:
            return None
        xi = self.element.nodes
        return _one_number(self._table(xi, np.ones(len(xi)), np.float64))

    def in_points(self, numbers: NDArray[Any]) -> tuple[Points | MeanPoints | None, NDArray[Any]]:
        """Return a law's numbers (m, nq, nt) at points in the layout of the kernels, and the table of points for them."""
        m, nq, _ = numbers.shape
        lanes = in_lanes(numbers.reshape(m * nq, -1)).reshape(-1, m, nq, LANES).transpose(0, 2, 1, 3)
        if self.points is None:
            return None, np.ascontiguousarray(lanes).ravel()
        needed = np.arange(nq) < np.diff(self.points.starts)[:, None]
        return self.points._replace(starts=self.points.starts * m * LANES), np.ascontiguousarray(lanes[needed]).ravel()

    @cached_property
    def edges(self) -> KernelEdges:
        """Pairs of nodes of all elements, in the kernels' order."""
        return kernel_edges(out_of_lanes(self.t, len(self.elements))[: self.element.n].astype(np.int32), self.element)

    @cached_property
    def lexicographic(self) -> NDArray[np.int32]:
        """Index (ne,) in the kernels' order of each edge in the mesh's lexicographic order."""
        ends = np.sort(self.own.vertices[self.edges.edges].T, axis=0)
        return lexicographic_order(ends, int(ends.max()) + 1)

    @property
    def force_shares(self) -> Shares:
        """Shares of threads in the sums of elements at nodes."""
        return self.own.share("F", lambda n: shares_of(self.t, len(self.own.vertices), self._work, n))

    @property
    def block_shares(self) -> Shares:
        """Shares of threads in the sums of elements at pairs of nodes."""

        def shares(n: int) -> Shares:
            made = shares_of(self.edges.t2e, self.edges.total, self._work, n)
            return made._replace(slots=made.slots | self.edges.transposed.ravel()) if self.edges.transposed.size else made

        return self.own.share("K", shares)

    @property
    def _work(self) -> float:
        """Work of one block of elements, in linear simplices."""
        return LANES * (1.0 if self.points is None else len(self.points.weights) * self.element.n / 4)

    def gather(self, u: Array) -> None:
        """Gather the displacements `u` (nv, d) of the mesh into `u` of the kernels."""
        block_kernels.gather(u, self.own.vertices, self.u)

    def in_user_order(self, own: Array) -> Array:
        """Return the values (nt,) of the elements in the user's order."""
        values = np.empty(len(self.elements))
        values[self.elements] = own[: len(values)]
        return values

    def memory(self) -> dict[str, int]:
        """Return the bytes of its arrays, by part."""
        made = [self.__dict__.get(name, ()) for name in ("edges", "lexicographic")]
        own = self.t, self.own.vertices, self.elements, self.X, self.u
        return {"elements": nbytes(own), "own edges": nbytes(made)} | self.own.memory()


def _one_number(points: Points) -> Points:
    """Return the table for elements with one number at each point."""
    return points._replace(starts=points.starts * LANES)


def _in_double(points: MeanPoints) -> MeanPoints:
    """Return the table in double, for elements with one number at their point."""
    reals = {name: getattr(points, name).astype(np.float64) for name in ("B", "weights", "modes", "hourglass_stiffness")}
    return points._replace(starts=points.starts * LANES, **reals)


def nbytes(arrays: Any) -> int:
    """Return the bytes of an array, of an object with `nbytes`, or of a tree of both."""
    return int(arrays.nbytes) if hasattr(arrays, "nbytes") else sum(map(nbytes, arrays))
