"""Rest state of a body, common to all algorithms. Its computation is not counted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skfem_stvk import ElementMesh
from skfem_stvk.edges.stiffness import isotropic_coefficients
from skfem_stvk.edges.topology import edge_topology
from skfem_stvk.mesh.geometry import Geometry

#: Faces of a tetrahedron by local vertices, each in ascending order.
LOCAL_FACES = ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))


class Body:
    """Homogeneous, isotropic body of tetrahedra at rest; the vertices of each tetrahedron are in ascending order.

    Attributes
    ----------
    p, t
        Rest coordinates (3, nv) and vertices (4, nt).
    edges, t2e, faces, t2f
        (2, ne), (6, nt), (3, nf), (4, nt), vertices in ascending order.
    geometry
        Volumes and gradients.
    coefficients
        (nt, 6, 6) `L` of the edges of each tetrahedron.
    """

    def __init__(self, mesh: ElementMesh, lam: float, mu: float) -> None:
        self.p, self.t, self.lam, self.mu = mesh.p, np.sort(mesh.t, axis=0), lam, mu
        self.edges, self.t2e = edge_topology(self.t)
        corners = self.t[np.array(LOCAL_FACES).T].reshape(3, -1)
        faces, t2f = np.unique(corners, axis=1, return_inverse=True)
        self.faces: NDArray[np.int32] = faces
        self.t2f: NDArray[np.int64] = t2f.reshape(4, -1)
        self.geometry = Geometry(self.p, self.t)
        self.coefficients = isotropic_coefficients(self.geometry, np.full(self.nt, lam), np.full(self.nt, mu))

    @property
    def nv(self) -> int:
        """Number of vertices."""
        return self.p.shape[1]

    @property
    def nt(self) -> int:
        """Number of tetrahedra."""
        return self.t.shape[1]

    @property
    def entities(self) -> NDArray[np.int64]:
        """Numbers of vertices, edges, faces and tetrahedra."""
        return np.array([self.nv, self.edges.shape[1], self.faces.shape[1], self.nt])

    @property
    def pairs(self) -> int:
        """Number of pairs of edges that share a tetrahedron (TSEPs): three per face and three per tetrahedron."""
        return 3 * self.faces.shape[1] + 3 * self.nt
