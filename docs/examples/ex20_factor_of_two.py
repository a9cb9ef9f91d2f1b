"""The referee detects a factor of two: a user's model has twice the correct lambda.

The model below is a plain element loop. It passes simple tests: F is the derivative of W, forces are in balance, rigid motions
cause no energy. Only a comparison with nu != 0 shows the fault, and the report names it.
"""

from pathlib import Path

import numpy as np
import skfem

from skfem_stvk import verify


class ElementLoop:
    """Model with W and F of St. Venant-Kirchhoff on P1 tetrahedra."""

    def __init__(self, mesh, young, poisson, blunder=1.0):
        self.mesh, self.mu = mesh, young / (2 * (1 + poisson))
        self.lam = blunder * young * poisson / ((1 + poisson) * (1 - 2 * poisson))
        rest = mesh.p[:, mesh.t[1:]] - mesh.p[:, mesh.t[:1]]  # (3, 3, nt)
        self.inverse, self.volume = (
            np.linalg.inv(rest.T),
            np.abs(np.linalg.det(rest.T)) / 6,
        )

    def _gradient_strain_stress(self, u):
        x = self.mesh.p + u.reshape(-1, 3).T
        F = np.einsum(
            "nij,njk->nki",
            self.inverse,
            (x[:, self.mesh.t[1:]] - x[:, self.mesh.t[:1]]).T,
        )
        E = (np.swapaxes(F, 1, 2) @ F - np.eye(3)) / 2
        S = (
            self.lam * np.trace(E, axis1=1, axis2=2)[:, None, None] * np.eye(3)
            + 2 * self.mu * E
        )
        return F, E, S

    def energy(self, u):
        _, E, S = self._gradient_strain_stress(u)
        return np.einsum("n,nij,nij->", self.volume / 2, S, E)

    def internal_force(self, u):
        F, _, S = self._gradient_strain_stress(u)
        corners = np.einsum("n,nij,njk,nkc->nci", self.volume, F, S, self.inverse)
        force = np.zeros((self.mesh.p.shape[1], 3))
        np.add.at(force, self.mesh.t[1:].T, corners)
        np.subtract.at(force, self.mesh.t[0], corners.sum(axis=1))
        return force.ravel()


mesh = skfem.MeshTet.init_ball(2)
right = verify(
    mesh, young=1e5, poisson=0.3, candidate=ElementLoop(mesh, 1e5, 0.3), quiet=True
)
wrong = verify(
    mesh,
    young=1e5,
    poisson=0.3,
    candidate=ElementLoop(mesh, 1e5, 0.3, blunder=2.0),
    quiet=True,
)
caught_by = {result.check for result in wrong.failures("candidate")}
error = max(
    result.measured
    for result in wrong.failures("candidate")
    if result.check == "closed forms"
)


def picture():
    """Draw the error of F against strain for this package, the textbook form and scikit-fem."""
    from skfem_stvk.referee.plots import error_against_strain

    return error_against_strain(right)


if __name__ == "__main__":
    print(wrong)
    print(
        f"right: {right.passed}; wrong: {wrong.passed}, caught by {sorted(caught_by)}, off by {100 * error:.0f} %"
    )
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=90)
