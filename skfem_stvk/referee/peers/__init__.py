"""W, F and K of other codes for the same model, in this package's conventions, to compare results and speed.

The package of a peer is imported only when an object of its class is made. None of them is needed to use skfem_stvk.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module, metadata
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from ...arguments import Array, shown
from ...errors import StvkError


class Peer(Protocol):
    """Isotropic St. Venant-Kirchhoff body of tetrahedra in another code.

    The methods of a peer are `energy(u) -> float` [J], `internal_force(u) -> (3 nv,)` = dW/du [N] and `tangent(u) -> csr_matrix`
    [N/m], as far as its code can compute them. Their argument is `u` (3 nv,) [m] with the degree of freedom
    `3 * vertex + component`. All work that does not depend on `u` is done when the peer is made. So the time of a call is that of
    the other code.

    Parameters
    ----------
    p
        (3, nv) coordinates [m].
    t
        (4, nt) vertices of the tetrahedra, of either orientation.
    young, poisson
        Young's modulus [Pa] and Poisson's ratio, the same in all elements.

    Attributes
    ----------
    name, version
        Name and version of the code.

    Raises
    ------
    StvkError
        if the code is not installed or too old, with the line that installs it.
    """

    name: str
    version: str

    def __init__(self, p: Array, t: NDArray[np.int32], young: float, poisson: float) -> None: ...


def lame(young: float, poisson: float) -> tuple[float, float]:
    """Return Lame's constants `lambda = E nu / ((1 + nu) (1 - 2 nu))` and `mu = E / (2 (1 + nu))` [Pa].

    >>> lame(2.5, 0.25)
    (1.0, 1.0)
    """
    return young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))


class Reordering:
    """Reordering of the degrees of freedom of matrices with one pattern, at the cost of one indexing operation.

    `numbered` is a matrix of the pattern with the values 1, 2, 3, ... in their order in memory. `dofs` are the new indices of its
    rows and columns. `ndofs` is the new number of rows and columns.

    >>> two = csr_matrix(([1.0, 2.0, 3.0], [0, 0, 1], [0, 1, 3]))
    >>> two.toarray().tolist(), Reordering(two, np.array([1, 0]), 2)(np.array([7.0, 8.0, 9.0])).toarray().tolist()
    ([[1.0, 0.0], [2.0, 3.0]], [[9.0, 8.0], [0.0, 7.0]])
    """

    def __init__(self, numbered: Any, dofs: NDArray[np.intp], ndofs: int) -> None:
        entries = numbered.tocoo()
        self._pattern = coo_matrix((entries.data, (dofs[entries.row], dofs[entries.col])), shape=(ndofs, ndofs)).tocsr()
        self._order = self._pattern.data.astype(np.intp) - 1

    def __call__(self, data: NDArray[np.float64]) -> csr_matrix:
        """Return the reordered matrix with a copy of these values."""
        return csr_matrix((data[self._order], self._pattern.indices, self._pattern.indptr), shape=self._pattern.shape)


@dataclass(frozen=True)
class Package:
    """Optional package of a peer.

    Attributes
    ----------
    module
        Name for the import.
    distribution
        Name in the package registry.
    install
        Line that installs the package.
    least
        First major version that computes this model.
    why
        Fault of the versions before `least`. The class of such a peer accepts `any_version`, so that these can be verified too.
    elements
        Kinds of elements that the peer supports.
    gives
        The quantities among W, F and K that the peer has.
    deviates
        Known deviations from this package.
    tried
        Versions that were verified (docs/measurements/peers.md).
    file
        Name of the file in this folder that wraps the package, if it is not `module`.
    """

    module: str
    distribution: str
    install: str
    least: int = 0
    why: str = ""
    elements: tuple[str, ...] = ("tetrahedra",)
    gives: str = "W, F and K"
    deviates: str = ""
    tried: str = ""
    file: str = ""

    def version(self) -> str | None:
        """Return the installed version, or None if the package is missing or too old."""
        try:
            version = metadata.version(self.distribution)
        except metadata.PackageNotFoundError:
            return None
        return version if self.fits(version) else None

    def fits(self, version: str) -> bool:
        return int(version.split(".")[0]) >= self.least


#: The package of each peer, by the name of its class.
PEERS = {
    "MuJoCo": Package(
        "mujoco",
        "mujoco",
        'pip install "mujoco>=4"',
        least=4,
        why="Releases before 4.0 take lambda twice.",
        gives="F",
        deviates="its energy leaves flexes out, and its tangent keeps tensile tensions alone; Poisson's ratio is at least 0",
        tried="3.3.7, 3.17.0 (fail: twice lambda), 4.0.0",
    ),
    "FElupe": Package(
        "felupe",
        "felupe",
        "pip install felupe",
        elements=("tetrahedra", "quadratic tetrahedra"),
        deviates="nothing",
        tried="11.3.0",
    ),
    "NGSolve": Package("ngsolve", "ngsolve", "pip install ngsolve", deviates="nothing", tried="6.2.2608"),
    "DOLFINx": Package(
        "dolfinx",
        "fenics-dolfinx",
        "conda install -c conda-forge fenics-dolfinx",
        deviates="nothing",
        tried="0.9.0, 0.11.0",
    ),
    "JAX": Package(
        "jax",
        "jax",
        "pip install jax",
        deviates="it computes in single precision, to 1e-7, until jax_enable_x64 is set, which this class does",
        tried="0.10.2",
        file="differentiated",
    ),
    "PyTorch": Package(
        "torch",
        "torch",
        "pip install torch",
        deviates="nothing, in torch.float64",
        tried="2.15.0",
        file="differentiated",
    ),
}


def require(name: str, any_version: bool = False) -> Any:
    """Import the package of a peer and return it. If `any_version`, its version is not checked.

    Raise StvkError with the line that installs the package if it is missing or too old.
    """
    package = PEERS[name]
    module = package.module
    try:
        imported = import_module(module)
    except ImportError as error:
        raise StvkError(f"The package {module} cannot be imported ({error}). It is optional: {package.install}") from error
    version = str(getattr(imported, "__version__", ""))
    if package.least and not any_version and not package.fits(version):
        raise StvkError(f"Expected {module} {package.least}.0 or later, got {version}. {package.why} Get it: {package.install}")
    return imported


def available() -> dict[str, str]:
    """Return for each peer the version of its package, or the line that installs it.

    >>> list(available())
    ['MuJoCo', 'FElupe', 'NGSolve', 'DOLFINx', 'JAX', 'PyTorch']
    """
    return {name: package.version() or package.install for name, package in PEERS.items()}


def load(name: str) -> type[Peer]:
    """Return the class of a peer. Its package is imported only when the class is called.

    Raises
    ------
    StvkError
        if there is no peer of that name.
    """
    if not isinstance(name, str) or name not in PEERS:
        raise StvkError(f"There is no peer {shown(name)}; there are {', '.join(PEERS)}.")
    peer: type[Peer] = getattr(import_module(f".{PEERS[name].file or PEERS[name].module}", __name__), name)
    return peer
