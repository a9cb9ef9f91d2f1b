"""Control of the benchmark: a plain element loop in C, timed in the same run as the assembly from edges."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import bsr_matrix

from skfem_stvk.arguments import Array
from skfem_stvk.errors import StvkError

SOURCE = Path(__file__).with_name("control.c")
FLAGS = ("-O3", "-march=native", "-ffast-math", "-fPIC", "-c")
COMPILERS = ("gcc", "cc", "clang")


def compiler() -> str | None:
    """Return the path of the C compiler; None if there is none."""
    return next((found for name in COMPILERS if (found := shutil.which(name))), None)


class Control:
    """`W`, `F` and `K` of St. Venant-Kirchhoff's law, Total Lagrangian, element by element on one thread.

    The tetrahedra `t` (4, nt) may have either orientation. Lame's constants [Pa] are numbers or (nt,). Raise StvkError if there is
    no C compiler, or if the compiler fails.
    """

    def __init__(self, p: ArrayLike, t: ArrayLike, lam: ArrayLike, mu: ArrayLike) -> None:
        self._library = _library()
        self._rest = np.ascontiguousarray(np.asarray(p, dtype=float).T)
        self._corners = np.ascontiguousarray(np.asarray(t).T, dtype=np.int32)
        self.nv, self.nt = len(self._rest), len(self._corners)
        edges = self._rest[self._corners[:, 1:]] - self._rest[self._corners[:, :1]]
        self._gradients = np.ascontiguousarray(np.swapaxes(np.linalg.inv(edges), 1, 2))
        volumes = np.abs(np.linalg.det(edges)) / 6
        self._lame = np.asarray(lam) * volumes, np.asarray(mu) * volumes

        corners = self._corners.astype(np.int64)
        keys, positions = np.unique(corners[:, :, None] * self.nv + corners[:, None, :], return_inverse=True)
        self._positions = positions.astype(np.int32).ravel()
        self._columns = (keys % self.nv).astype(np.int32)
        self._begin = np.searchsorted(keys // self.nv, np.arange(self.nv + 1)).astype(np.int32)
        self._x, self._f = np.empty((self.nv, 3)), np.empty(3 * self.nv)
        self._blocks = np.empty((len(keys), 3, 3))
        self._mesh = [_at(array) for array in (self._x, self._corners, self._gradients)]
        self._material = [_at(array) for array in self._lame]

    def energy(self, u: Array) -> float:
        """Return the strain energy `W(u)` [J]."""
        self._move(u)
        return float(self._library.energy(ctypes.c_long(self.nt), *self._mesh, *self._material))

    def internal_force(self, u: Array) -> Array:
        """Return the internal force (3 nv,) [N], in an array that the next call overwrites."""
        self._move(u)
        sizes = ctypes.c_long(self.nt), ctypes.c_long(self.nv)
        self._library.force(*sizes, *self._mesh, *self._material, _at(self._f))
        return self._f

    def tangent(self, u: Array) -> bsr_matrix:
        """Return the tangent stiffness [N/m]. The next call overwrites its values."""
        self._move(u)
        sizes = ctypes.c_long(self.nt), ctypes.c_long(len(self._blocks))
        self._library.tangent(*sizes, *self._mesh, _at(self._positions), *self._material, _at(self._blocks))
        return bsr_matrix((self._blocks, self._columns, self._begin), shape=(3 * self.nv, 3 * self.nv))

    def _move(self, u: Array) -> None:
        np.add(self._rest, np.reshape(u, self._rest.shape), out=self._x)


def _at(array: NDArray[np.float64] | NDArray[np.int32]) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


@cache
def _library() -> ctypes.CDLL:
    """Return the compiled loop. Its file is deleted after loading."""
    found = compiler()
    if found is None:
        raise StvkError(f"No C compiler ({', '.join(COMPILERS)}) is on the PATH; the C loop needs one. On Debian: apt install gcc")
    with TemporaryDirectory() as folder:
        built = Path(folder) / "control.so"
        # linked without -ffast-math: GCC would add code that makes the whole process flush denormal numbers to zero
        compiled = built.with_suffix(".o")
        for command in ([found, *FLAGS, str(SOURCE), "-o", str(compiled)], [found, "-shared", str(compiled), "-o", str(built)]):
            run = subprocess.run(command, capture_output=True, text=True, check=False)
            if run.returncode:
                raise StvkError(f"{found} could not compile {SOURCE.name}: {run.stderr.strip()}")
        library = ctypes.CDLL(str(built))
    library.energy.restype = ctypes.c_double
    return library
