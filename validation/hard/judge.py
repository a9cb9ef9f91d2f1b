"""Verdict on a static result from its state, independent of the message of the method."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import splu, spsolve

from skfem_stvk import System
from skfem_stvk.mesh.points import rule_of

from .case import Array, Truth

#: Volume ratios of at most this absolute value are round-off: the element is flat.
FLAT = 1e-9
#: Limit of the lowest eigenvalue of K with unit diagonal. Below it a body has a free motion; rounding leaves about 1e-15.
NOTHING = 1e-13
#: Largest asymmetry of K with unit diagonal, and largest imaginary part of an eigenvalue, that are due to rounding.
UNSYMMETRIC = 1e-9
#: Number of unknowns up to which eigenvalues are computed from the dense matrix.
DENSE = 1200


class Verdict(Enum):
    """Verdict on a method: right, wrong without a warning, or a reported failure."""

    RIGHT = "right"
    WRONG = "WRONG"
    REPORTED = "reported"

    def __str__(self) -> str:
        return self.value


class Judgement(NamedTuple):
    """Verdict with its reason."""

    verdict: Verdict
    why: str


def judged(system: System, u: Array, claims_success: bool, message: str, truth: Truth) -> Judgement:
    """Return the verdict on displacements (ndofs,) at t = 1.

    `claims_success` means that the method reports them as the answer.
    """
    if not claims_success:
        return Judgement(Verdict.REPORTED, message)
    faults = faults_of(system, u, truth.limit)
    if truth.error is None:
        faults.append("there is no right state")
    elif not faults and not (error := truth.error(system, u)) <= truth.limit:
        faults.append(f"another state, off by {error:.1e}")
    return Judgement(Verdict.WRONG, ", ".join(faults)) if faults else Judgement(Verdict.RIGHT, "")


def faults_of(system: System, u: Array, limit: float) -> list[str]:
    """Return the faults of a state at t = 1: inverted or flat elements, instability, or a next Newton step above the limit."""
    if not np.isfinite(u).all():
        return ["not finite"]
    faults, J = [], volume_ratios(system, u)
    faults += [f"{(J < -FLAT).sum()} elements inside out"] * bool((J < -FLAT).any())
    faults += [f"{(np.abs(J) <= FLAT).sum()} elements flat"] * bool((np.abs(J) <= FLAT).any())
    free = np.setdiff1d(np.arange(system.ndofs), system.supports.held)
    K = system.jacobian(u)[free][:, free]
    negative = not_positive(K)
    if negative:
        return [*faults, f"unstable, {negative} eigenvalues of K are not positive"]
    step = spsolve(K.tocsc(), system.residual(u)[free])
    if not np.abs(step).max() <= limit * np.abs(u).max():
        faults.append(f"not in equilibrium: the next step of Newton's method is {np.abs(step).max() / np.abs(u).max():.1e}")
    return faults


def volume_ratios(system: System, u: Array) -> Array:
    """Return the volume of each element at `u` over that at rest, (nt,), by determinants.

    For quadratic elements, the value is the smallest ratio at all points and nodes. For membranes and cables in space, which have
    no orientation, it is the ratio of areas or lengths.
    """
    X, element = system.mesh.p.T, system.mesh.element
    if element.degree == 2:
        derivatives = element.derivatives(np.concatenate([rule_of(element).points, element.nodes]))
        both = (np.einsum("qak,tad->tqdk", derivatives, x[system.mesh.t.T], optimize=True) for x in (X, X + u.reshape(X.shape)))
        now_by_rest = [_measure(J) for J in both]
        return np.asarray((now_by_rest[1] / now_by_rest[0]).min(axis=1))
    rest, now = (_measure(x[system.mesh.t[1:].T] - x[system.mesh.t[:1].T]) for x in (X, X + u.reshape(X.shape)))
    ratios: Array = now / rest
    return ratios


def _measure(base_vectors: Array) -> Array:
    """Return the volumes that base vectors in the last two dimensions span, (...,). In the full dimension they have a sign."""
    if base_vectors.shape[-1] == base_vectors.shape[-2]:
        return np.asarray(np.linalg.det(base_vectors))
    columns = base_vectors.shape[-2] >= base_vectors.shape[-1]
    transpose = np.swapaxes(base_vectors, -1, -2)
    gram = transpose @ base_vectors if columns else base_vectors @ transpose
    return np.asarray(np.sqrt(np.linalg.det(gram)))


def not_positive(K: csr_matrix) -> int:
    """Return the number of eigenvalues that are negative or round-off. For an unsymmetric matrix, only real eigenvalues count.

    K is scaled to a unit diagonal. Eigenvalues are computed from the dense matrix; for larger matrices, the pivots of an
    elimination along the diagonal replace them.
    """
    diagonal = K.diagonal()
    if not (diagonal > 0).all():
        return max(1, int((diagonal <= 0).sum()))
    scale = diags(1 / np.sqrt(diagonal))
    scaled = scale @ K @ scale
    if abs(scaled - scaled.T).max() > UNSYMMETRIC:
        return real_not_positive(scaled.toarray())
    if K.shape[0] <= DENSE:
        return int((np.linalg.eigvalsh(scaled.toarray()) <= NOTHING).sum())
    factors = splu(scaled.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return int((_pivots(factors) <= NOTHING).sum())


def real_not_positive(K: Array) -> int:
    """Return the number of real eigenvalues of a matrix that are negative or round-off."""
    values = np.linalg.eigvals(K)
    return int((values.real[np.abs(values.imag) <= UNSYMMETRIC] <= NOTHING).sum())


def _pivots(factors: object) -> NDArray[np.float64]:
    """Return the pivots of an elimination without row exchanges."""
    if not np.array_equal(factors.perm_r, factors.perm_c):  # type: ignore[attr-defined]
        raise RuntimeError("perm_r != perm_c; expected no row exchanges: the pivots do not have the signs of the eigenvalues.")
    return np.asarray(factors.U.diagonal())  # type: ignore[attr-defined]
