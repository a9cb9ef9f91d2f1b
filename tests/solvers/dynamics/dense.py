"""Motions in dense NumPy, from Green's strain on; of the package only the mesh is used."""

import numpy as np


class Dense:
    """Bar of `motions`: F, K, D and M of its real or complex displacements.

    Derivatives are by complex steps, exact to round-off.
    """

    def __init__(self, mesh, young, density, damping=(0.0, 0.0, 0.0), consistent=False):
        self.mesh, self.alpha, self.beta, self.tau = mesh, *damping
        d, t, self.n = mesh.d, mesh.t, mesh.p.size
        corners = np.concatenate([mesh.p[:, t], np.ones((1, *t.shape))]).transpose(2, 1, 0)  # (nt, k + 1, d + 1)
        self.gradients = np.linalg.inv(corners)[:, :d].transpose(0, 2, 1)
        section = 0.7 if d == 2 else 1.0
        self.volumes = np.abs(np.linalg.det(corners)) / {2: 2, 3: 6}[d] * section
        lam, self.mu = young * 0.3 / 1.3 / 0.4, young / 2.6
        self.lam = 2 * lam * self.mu / (lam + 2 * self.mu) if d == 2 else lam  # plane stress
        self.at = np.eye(mesh.nv)[t]  # (k + 1, nt, nv)
        shares = density * self.volumes / ((d + 1) * (d + 2) if consistent else d + 1)
        both = np.ones((d + 1, d + 1)) + np.eye(d + 1) if consistent else np.eye(d + 1)
        self.M = np.kron(np.einsum("e,ab,aei,bej->ij", shares, both, self.at, self.at), np.eye(d))
        self.K0 = self.K(np.zeros(self.n))

    def deformation(self, u):
        vertices = u.reshape(self.mesh.nv, self.mesh.d)[self.mesh.t.T]
        return np.eye(self.mesh.d) + np.einsum("eai,eaj->eij", vertices, self.gradients)

    def strain(self, u):
        F = self.deformation(u)
        return (np.einsum("eki,ekj->eij", F, F) - np.eye(self.mesh.d)) / 2

    def pull(self, u, strain):
        """Return the nodal forces of the stresses of a strain, for deformed elements at `u`; this is F for the strain at `u`."""
        stress = 2 * self.mu[:, None, None] * strain + np.einsum("e,ekk,ij->eij", self.lam, strain, np.eye(self.mesh.d))
        forces = np.einsum("e,eik,ekj,eaj->eai", self.volumes, self.deformation(u), stress, self.gradients)
        return np.einsum("eai,aev->vi", forces, self.at).ravel()

    def F(self, u):
        return self.pull(u, self.strain(u))

    def K(self, u):
        return jacobian(self.F, u)

    def gauss_newton(self, u):
        """Return K without stresses: the derivative with respect to the strains only."""
        return jacobian(lambda w: self.pull(u, self.strain(w)), u)

    def D(self, u):
        return self.alpha * self.M + self.beta * self.K0 + self.tau * self.gauss_newton(u)

    def strain_rate(self, u, v):
        """Return the strain rate of velocities `v` at `u`; both may be complex."""
        F, rate = self.deformation(u), self.deformation(v) - np.eye(self.mesh.d)
        return (np.einsum("eki,ekj->eij", F, rate) + np.einsum("eki,ekj->eij", rate, F)) / 2

    def resistance(self, u, v):
        """Return `D(u) v`."""
        return self.linear_resistance(v) + self.tau * self.pull(u, self.strain_rate(u, v))

    def linear_resistance(self, v):
        return self.alpha * (self.M @ v) + self.beta * (self.K0 @ v)


def jacobian(function, x):
    return np.stack([function(x + 1e-30j * column).imag / 1e-30 for column in np.eye(len(x))], axis=1)


def root(residual, w, free):
    """Return a root over the free degrees of freedom, by Newton's method until changes are below 1e-14."""
    for _ in range(12):
        change = np.linalg.solve(jacobian(residual, w)[np.ix_(free, free)], residual(w)[free])
        w = w.copy()
        w[free] -= change
        if np.abs(change).max() < 1e-14:
            return w
    raise AssertionError("no root")
