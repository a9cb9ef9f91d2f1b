"""What round-off may cost a right W, F and K in a given state, by vertex: the model behind the limits of the checks.

Of an element with the steepest gradient `g` of its shape functions (1/smallest height), longest edges `l` at rest and `m` deformed,
deformation gradient `A` and displacements up to `|u|`, with `V C` its volume times the largest entry of its elasticity tensor:

    form                                what is lost, over eps                  of W               of F                    of K
    squared lengths (l^2 + m^2)         strain g^2 (l^2 + m^2)                  V C |E| x strain   V C g^2 x strain x m    V C g^2 x strain
    sums over edges, their change z     strain g^2 z, relative                  V C (g^2 z)^2
    gradient of the displacement        gradient g |u| (strain: x |A|)          V C |E| x strain   V C g^2 (1 + A^2) |u|   V C g^2 (1 + |A|) g |u|
    gradients of the shape functions    g l, relative                           W g l              V C g^2 (1 + A^2) l |A| V C g^2 (1 + A^2) g l

Right forms keep to the sum: the edge form to less than half of it on needles, random clouds and single slivers, scikit-fem's to a tenth.
Slivers come in groups where one vertex lies almost in the plane of its neighbours, up to six of them around an edge; what they lose adds
up to five times the sum, for which the margin of flat elements is eight times that of ordinary ones. On
ordinary elements it is far below the limit of 1e-12, on flat ones in small strain it grows with (l g)^2; where an element is strained
by more than its flatness, what is lost is small beside the forces themselves.
"""

from __future__ import annotations

from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..mesh import SimplexMesh
from ..mesh.geometry import Geometry, edge_differences

#: Several elements meet at a vertex, and twice what was seen: the margin of ordinary elements, and of the flattest.
MARGIN, LARGEST_MARGIN = 4.0, 32.0
#: In between the margin is the aspect ratio times this.
MARGIN_BY_ASPECT = 0.2
#: States whose round-off is kept: those of the stencils along two lines.
KEPT = 9


class Lost(NamedTuple):
    """Round-off of the elements in a state, each (nt,), times its margin.

    Attributes
    ----------
    energy : of W [J].
    force : of F, over V C g^2 [m].
    stiffness : of K, over V C g^2.
    """

    energy: Array
    force: Array
    stiffness: Array


class RoundOff:
    """The model on a mesh whose elements have the largest entries `modulus` (nt,) of their elasticity tensors (times section) [Pa m^(d-k)]."""

    def __init__(self, mesh: SimplexMesh, modulus: Array) -> None:
        geometry = Geometry(mesh.p, mesh.t)
        self.mesh, self._gradients = mesh, geometry.gradients
        self.steepest = np.linalg.norm(geometry.gradients, axis=2).max(axis=1)
        self._edges, self._longest = edge_differences(mesh, mesh.p), _longest(mesh, mesh.p)
        self._weight = geometry.volume * modulus
        self._kept: dict[bytes, Lost] = {}

    @property
    def aspect(self) -> Array:
        """(nt,) longest edge over smallest height."""
        return self._longest * self.steepest

    def lost(self, u: Array) -> Lost:
        """Round-off of each element at `u` (ndofs,); that of the latest states is kept, for several checks ask for it."""
        key = u.tobytes()
        if key not in self._kept:
            while len(self._kept) >= KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[key] = self._lost(u)
        return self._kept[key]

    def _lost(self, u: Array) -> Lost:
        mesh, g, l = self.mesh, self.steepest, self._longest
        displacement = u.reshape(-1, mesh.d).T
        x = mesh.p + displacement
        A = np.einsum("ina,naj->nij", x[:, mesh.t.T], self._gradients)
        strain = np.linalg.norm(np.swapaxes(A, 1, 2) @ A - np.eye(mesh.k), axis=(1, 2)) / 2
        stretch, moved, m = (
            np.linalg.norm(A, axis=(1, 2)),
            np.linalg.norm(displacement, axis=0)[mesh.t].max(axis=0),
            _longest(mesh, x),
        )
        eps = np.clip(MARGIN_BY_ASPECT * self.aspect, MARGIN, LARGEST_MARGIN) * np.finfo(float).eps
        squared = g**2 * (l**2 + m**2)
        U = edge_differences(mesh, displacement)
        z = np.abs(((2 * self._edges + U) * U).sum(axis=0)).max(axis=0)
        return Lost(
            eps * self._weight * (strain * (squared + stretch * g * moved + strain * g * l) + (g**2 * z) ** 2),
            eps * (squared * m + (1 + stretch**2) * (moved + l * stretch)),
            eps * (squared + (1 + stretch) * g * moved + (1 + stretch**2) * g * l),
        )

    def by_vertex(self, values: Array) -> Array:
        """(nv,) the largest value (nt,) of the elements of each vertex."""
        largest = np.zeros(self.mesh.nv)
        np.maximum.at(largest, self.mesh.t.ravel(), np.tile(values, self.mesh.k + 1))
        return largest

    def by_pair(self, values: Array) -> csr_matrix:
        """(nv, nv) the largest value (nt,) of the elements of each pair of vertices."""
        order, first, rows, columns = self._pairs
        largest = np.maximum.reduceat(values[order], first)
        return csr_matrix((largest, (rows, columns)), shape=(self.mesh.nv,) * 2)

    @cached_property
    def _pairs(self) -> tuple[NDArray[np.int64], ...]:
        """Elements in the order of their pairs of vertices, where each pair begins, and its two vertices."""
        local = np.array(list(product(range(self.mesh.k + 1), repeat=2)))
        a, b = self.mesh.t[local[:, 0]].ravel(), self.mesh.t[local[:, 1]].ravel()
        order = np.lexsort((b, a))
        first = np.flatnonzero(np.diff(a[order], prepend=-1) | np.diff(b[order], prepend=-1))
        return order % self.mesh.nt, first, a[order][first], b[order][first]

    def around(self, values: Array) -> Array:
        """(nv,) the largest value (nv,) among the vertices of the elements of each vertex."""
        return self.by_vertex(values[self.mesh.t].max(axis=0))


def _longest(mesh: SimplexMesh, x: Array) -> Array:
    longest: Array = np.linalg.norm(edge_differences(mesh, x), axis=0).max(axis=0)
    return longest
