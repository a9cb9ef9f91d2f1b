"""
A factor of two, found and named
================================

An element loop has twice the correct lambda. It passes simple tests: F is the
derivative of W, forces are in balance, and rigid motions cause no energy. The referee
compares it with closed forms and with independent implementations, and its report names
the fault.
"""

import numpy as np
import skfem

from skfem_stvk import verify


class ElementLoop:
    """Model with W and F of St. Venant-Kirchhoff on linear tetrahedra."""

    def __init__(self, mesh, lam=6e4, mu=4e4):
        self.mesh, self.lam, self.mu = mesh, lam, mu
        rest = (mesh.p[:, mesh.t[1:]] - mesh.p[:, mesh.t[:1]]).T
        self.inverse, self.volume = np.linalg.inv(rest), np.abs(np.linalg.det(rest)) / 6

    def _strain_and_stress(self, u):
        x = self.mesh.p + u.reshape(-1, 3).T
        edges = (x[:, self.mesh.t[1:]] - x[:, self.mesh.t[:1]]).T
        F = np.einsum("nij,njk->nki", self.inverse, edges)
        E = (np.swapaxes(F, 1, 2) @ F - np.eye(3)) / 2
        trace = np.trace(E, axis1=1, axis2=2)[:, None, None]
        return F, E, self.lam * trace * np.eye(3) + 2 * self.mu * E

    def energy(self, u):
        _, E, S = self._strain_and_stress(u)
        return np.einsum("n,nij,nij->", self.volume / 2, S, E)

    def internal_force(self, u):
        F, _, S = self._strain_and_stress(u)
        corners = np.einsum("n,nij,njk,nkc->nci", self.volume, F, S, self.inverse)
        force = np.zeros((self.mesh.p.shape[1], 3))
        np.add.at(force, self.mesh.t[1:].T, corners)
        np.subtract.at(force, self.mesh.t[0], corners.sum(axis=1))
        return force.ravel()


ball, claim = skfem.MeshTet.init_ball(2), {"young": 1.04e5, "poisson": 0.3}
right, wrong = (
    verify(ball, candidate=ElementLoop(ball, lam=lam), quiet=True, **claim)
    for lam in (6e4, 12e4)
)
failures = wrong.failures("candidate")
caught_by = {result.check for result in failures}
error = max(result.measured for result in failures if result.check == "closed forms")

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, axes = plt.subplots(figsize=(6, 2.8))
    for report, name in ((right, "right"), (wrong, wrong.named.names[0])):
        found = [r for r in report.results if r.subject == "candidate" and r.limit]
        worst = {r.check: 1e-5 for r in found}  # zero errors are drawn at 1e-5
        for r in found:
            worst[r.check] = max(worst[r.check], r.measured / r.limit)
        axes.plot(list(worst.values()), list(worst), ls="", ms=6, label=name)
    axes.axvline(1, color="0.5", ls="--")
    axes.set(xscale="log", xlabel="largest error / limit")
    axes.invert_yaxis()
    axes.legend(loc="center right")
    checks = " and ".join(sorted(caught_by))
    print(f"failed: {checks}, off by {error:.0%}; named: {wrong.named.names[0]}")
    plt.show()
