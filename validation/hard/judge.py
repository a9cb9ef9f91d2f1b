"""Whether a method was right: by what its state is, whatever the method says of it."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import splu, spsolve

from skfem_stvk import System
from skfem_stvk.elements import rule_of

from .case import Array, Truth

#: A smaller J is nothing but rounding: the element is flat.
FLAT = 1e-9
#: Of the lowest eigenvalue of K, its diagonal scaled to 1, below which nothing holds a body: rounding leaves 1e-15 or so.
NOTHING = 1e-13
#: Of K with its diagonal scaled to 1, how far it is from symmetric, or an eigenvalue from real, by rounding.
UNSYMMETRIC = 1e-9
#: Unknowns up to which eigenvalues are those of the full matrix.
DENSE = 1200


class Verdict(Enum):
    """How a method did."""

    RIGHT = "right"
    WRONG = "WRONG"
    SAID_SO = "said so"

    def __str__(self) -> str:
        return self.value


class Judgement(NamedTuple):
    """The verdict, and what speaks for it."""

    verdict: Verdict
    why: str


def judged(system: System, u: Array, claims_success: bool, message: str, truth: Truth) -> Judgement:
    """The verdict on displacements (ndofs,) that a method hands out as the answer at t = 1, or does not."""
    if not claims_success:
        return Judgement(Verdict.SAID_SO, message)
    faults = faults_of(system, u, truth.limit)
    if truth.error is None:
        faults.append("there is no right state")
    elif not faults and not (error := truth.error(system, u)) <= truth.limit:
        faults.append(f"another state, off by {error:.1e}")
    return Judgement(Verdict.WRONG, ", ".join(faults)) if faults else Judgement(Verdict.RIGHT, "")


def faults_of(system: System, u: Array, limit: float) -> list[str]:
    """What speaks against a state at t = 1: elements inside out or flat, instability, or a next Newton step above the limit."""
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
        faults.append(f"not in balance: Newton's next step is {np.abs(step).max() / np.abs(u).max():.1e}")
    return faults


def volume_ratios(system: System, u: Array) -> Array:
    """(nt,) volume of each element at `u` over that at rest, by determinants; of quadratic ones the smallest ratio of all
    points and nodes. Of membranes and cables in space, which have no inside, that of areas or lengths.
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


def _measure(spokes: Array) -> Array:
    """(...,) volumes that spokes in the last two dimensions span, with their sign where they fill the space."""
    if spokes.shape[-1] == spokes.shape[-2]:
        return np.asarray(np.linalg.det(spokes))
    gram = spokes @ np.swapaxes(spokes, -1, -2) if spokes.shape[-2] < spokes.shape[-1] else np.swapaxes(spokes, -1, -2) @ spokes
    return np.asarray(np.sqrt(np.linalg.det(gram)))


def not_positive(K: csr_matrix) -> int:
    """Number of eigenvalues that are negative, or nothing but rounding; of a matrix that is not symmetric of the real ones.

    Of the full matrix its own eigenvalues, its diagonal scaled to 1; of larger ones the pivots of elimination along the diagonal.
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
    """Number of real eigenvalues of a matrix that are negative, or nothing but rounding."""
    values = np.linalg.eigvals(K)
    return int((values.real[np.abs(values.imag) <= UNSYMMETRIC] <= NOTHING).sum())


def _pivots(factors: object) -> NDArray[np.float64]:
    """The pivots of an elimination that exchanged no rows."""
    if not np.array_equal(factors.perm_r, factors.perm_c):  # type: ignore[attr-defined]
        raise RuntimeError("SuperLU exchanged rows, so its pivots do not have the signs of the eigenvalues.")
    return np.asarray(factors.U.diagonal())  # type: ignore[attr-defined]
