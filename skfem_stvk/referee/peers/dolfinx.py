"""DOLFINx, with UFL's derivatives of the energy compiled to C by FFCx."""

from __future__ import annotations

from importlib import import_module

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_matrix, csr_matrix

from ...arguments import Array
from ...errors import StvkError
from . import PEERS, Reordering, lame, require

OPTIONS = {"cffi_extra_compile_args": ["-O3", "-march=native", "-ffast-math"]}


class DOLFINx:
    """Peer with `W` and its first and second derivatives as forms with one quadrature point, on one process. See `Peer`.

    DOLFINx renumbers vertices and degrees of freedom, and leaves out vertices that belong to no tetrahedron. The forces and rows of
    K of these vertices are zero here.
    """

    name = "DOLFINx"

    def __init__(self, p: Array, t: NDArray[np.int32], young: float, poisson: float) -> None:
        dolfinx = require("DOLFINx")
        try:
            mpi, ufl, basix = (import_module(module) for module in ("mpi4py.MPI", "ufl", "basix.ufl"))
            fem, la, meshes = (import_module(f"dolfinx.{module}") for module in ("fem", "la", "mesh"))
        except ImportError as error:
            raise StvkError(
                f"DOLFINx {dolfinx.__version__} lacks what 0.9 and later come with ({error}): it is older, or parts of it are "
                f"missing. Get it: {PEERS[self.name].install}"
            ) from error
        self.version: str = dolfinx.__version__
        self._fem, self._ndofs = fem, p.size
        mesh = meshes.create_mesh(
            mpi.COMM_SELF,
            cells=np.ascontiguousarray(t.T, dtype=np.int64),
            x=np.ascontiguousarray(p.T, dtype=float),
            e=ufl.Mesh(basix.element("Lagrange", "tetrahedron", 1, shape=(3,))),
        )
        space = fem.functionspace(mesh, ("Lagrange", 1, (3,)))
        index_map, block_size = space.dofmap.index_map, space.dofmap.index_map_bs

        node = np.empty(index_map.size_local, dtype=np.intp)  # node of each block of degrees of freedom
        node[space.dofmap.list.ravel()] = mesh.geometry.dofmap.ravel()
        vertex = np.asarray(mesh.geometry.input_global_indices)[node]
        self._dofs = (3 * vertex[:, None] + np.arange(3)).ravel()

        self._u = fem.Function(space)
        dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 0})
        F = ufl.Identity(3) + ufl.grad(self._u)
        E = 0.5 * (F.T * F - ufl.Identity(3))
        lam, mu = lame(young, poisson)
        W = (lam / 2 * ufl.tr(E) ** 2 + mu * ufl.inner(E, E)) * dx
        dW = ufl.derivative(W, self._u, ufl.TestFunction(space))
        d2W = ufl.derivative(dW, self._u, ufl.TrialFunction(space))
        self._W, self._dW, self._d2W = (fem.form(form, jit_options=OPTIONS) for form in (W, dW, d2W))

        self._f = la.vector(index_map, block_size)
        self._K = fem.create_matrix(self._d2W)
        blocks = np.arange(1.0, self._K.data.size + 1).reshape(-1, *self._K.block_size)
        numbered = bsr_matrix((blocks, self._K.indices, self._K.indptr), shape=(len(self._dofs), len(self._dofs)))
        self._reordered = Reordering(numbered, self._dofs, p.size)

    def energy(self, u: Array) -> float:
        self._u.x.array[:] = u[self._dofs]
        return float(self._fem.assemble_scalar(self._W))

    def internal_force(self, u: Array) -> Array:
        self._u.x.array[:] = u[self._dofs]
        self._f.array[:] = 0
        self._fem.assemble_vector(self._f.array, self._dW)
        force = np.zeros(self._ndofs)
        force[self._dofs] = self._f.array
        return force

    def tangent(self, u: Array) -> csr_matrix:
        self._u.x.array[:] = u[self._dofs]
        self._K.data[:] = 0
        self._fem.assemble_matrix(self._K, self._d2W)
        return self._reordered(self._K.data.ravel())
