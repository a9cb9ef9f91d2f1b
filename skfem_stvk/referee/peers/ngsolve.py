"""NGSolve, with compiled derivatives of a symbolic energy."""

from __future__ import annotations

import os
import shutil
import sysconfig
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ...arguments import Array
from . import Reordering, lame, require


class NGSolve:
    """Peer that uses `Variation` of the energy with one quadrature point. See `Peer`.

    The peer runs outside of a task manager, that is, on one thread. If there is a compiler, NGSolve translates the energy and its
    derivatives to C++ and compiles them, which takes seconds. If not, NGSolve interprets them, at two to four times the cost. The
    attribute `compiled` is True in the first case. NGSolve's degrees of freedom by component are reordered.
    """

    name = "NGSolve"

    def __init__(self, p: Array, t: NDArray[np.int32], young: float, poisson: float) -> None:
        ngsolve = require("NGSolve")
        self.version: str = ngsolve.__version__
        space = ngsolve.VectorH1(mesh_of(ngsolve, p, t), order=1)
        F = ngsolve.Id(3) + ngsolve.Grad(space.TrialFunction())
        E = 0.5 * (F.trans * F - ngsolve.Id(3))
        lam, mu = lame(young, poisson)
        density, self.compiled = compiled(lam / 2 * ngsolve.Trace(E) ** 2 + mu * ngsolve.InnerProduct(E, E))
        self.name = "NGSolve" if self.compiled else "NGSolve (no compiler)"
        centre = ngsolve.IntegrationRule([(0.25, 0.25, 0.25)], [1 / 6])
        self._form = ngsolve.BilinearForm(space)
        self._form += ngsolve.Variation(density * ngsolve.dx(intrules={ngsolve.ET.TET: centre}))
        self._field = ngsolve.GridFunction(space)  # keep a reference, because deleting the field would delete its vector
        self._u = self._field.vec
        self._f = self._u.CreateVector()
        self._components = self._u.FV().NumPy().reshape(3, -1), self._f.FV().NumPy().reshape(3, -1)
        self._u[:] = 0
        self._form.AssembleLinearization(self._u)
        values, columns, begin = (vector.NumPy() for vector in self._form.mat.CSR())
        numbered = csr_matrix((1.0 + np.arange(len(values)), columns, begin), shape=(p.size, p.size))
        self._reordered = Reordering(numbered, np.arange(p.size).reshape(-1, 3).T.ravel(), p.size)

    def energy(self, u: Array) -> float:
        return float(self._form.Energy(self._at(u)))

    def internal_force(self, u: Array) -> Array:
        self._form.Apply(self._at(u), self._f)
        return self._components[1].T.ravel()

    def tangent(self, u: Array) -> csr_matrix:
        self._form.AssembleLinearization(self._at(u))
        return self._reordered(self._form.mat.CSR()[0].NumPy())

    def _at(self, u: Array) -> Any:
        self._components[0][:] = u.reshape(-1, 3).T
        return self._u


def mesh_of(ngsolve: Any, p: Array, t: NDArray[np.int32]) -> Any:
    """Return NGSolve's mesh of the arrays, without changes to the order of vertices or the orientation of elements."""
    mesh = import_module("netgen.meshing").Mesh(dim=3)
    mesh.AddPoints(np.ascontiguousarray(p.T, dtype=float))
    mesh.AddElements(dim=3, index=mesh.AddRegion("body", dim=3), data=np.ascontiguousarray(t.T, dtype=np.int32), base=0)
    return ngsolve.Mesh(mesh)


def compiled(density: Any) -> tuple[Any, bool]:
    """Return the energy density, translated to C++ and compiled if possible, and whether it was."""
    with _scripts_on_path():
        if shutil.which("ngscxx") and shutil.which("c++"):
            try:
                return density.Compile(realcompile=True, wait=True), True
            except Exception:  # a compiler that fails: Python's or its own headers are missing, or of another version
                pass
    return density.Compile(), False


@contextmanager
def _scripts_on_path() -> Iterator[None]:
    """Add the scripts folder of this environment to PATH.

    NGSolve searches PATH for the driver of its compiler, which is missing there if the environment is not active.
    """
    before = os.environ.get("PATH", "")
    os.environ["PATH"] = os.pathsep.join([sysconfig.get_path("scripts"), before])
    try:
        yield
    finally:
        os.environ["PATH"] = before
