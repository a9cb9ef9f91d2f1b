"""A user's neo-Hookean body, judged as in the tests of a user's package, and two mistakes in it.

The checks need no reference. F must be the derivative of W, and K the derivative of F. W must be invariant under rigid motions.
Forces must be in balance, K must be symmetric with six rigid modes, and inner nodes must have no force under an affine motion.
"""

import numpy as np
import skfem
from skfem.helpers import ddot, det, grad, inv, transpose

from skfem_stvk.testing import Inconsistent, assert_consistent, small_mesh

MESH, LAM, MU = small_mesh("tetrahedra"), 6e4, 4e4
BASIS = skfem.Basis(MESH, skfem.ElementVector(MESH.elem()))


class Rubber:
    """Body with W = mu/2 (F:F - 3 - 2 log J) + lam/2 (log J)^2 and its F and K, possibly with a mistake in F or K."""

    def __init__(self, mistake=""):
        self.mistake = mistake

    def gradient(self, u):
        H = BASIS.interpolate(u).grad
        return H + np.eye(3)[:, :, None, None]

    def energy(self, u):
        F, log = self.gradient(u), np.log(det(self.gradient(u)))
        form = skfem.Functional(lambda w: MU / 2 * (ddot(w["F"], w["F"]) - 3 - 2 * w["log"]) + LAM / 2 * w["log"] ** 2)
        return form.assemble(BASIS, F=F, log=log)

    def internal_force(self, u):
        F, G = self.gradient(u), transpose(inv(self.gradient(u)))
        P = MU * (F - G) + LAM * np.log(det(F)) * G
        if self.mistake == "log 2J":
            P = P + LAM * np.log(2) * G
        return skfem.LinearForm(lambda v, w: ddot(w["P"], grad(v))).assemble(BASIS, P=P)

    def tangent(self, u):
        F, G = self.gradient(u), transpose(inv(self.gradient(u)))
        indices = "ij...,kl...->ijkl..." if self.mistake == "indices of K" else "il...,kj...->ijkl..."
        A = MU * np.einsum("ik,jl->ijkl", np.eye(3), np.eye(3))[..., None, None] + LAM * np.einsum("ij...,kl...->ijkl...", G, G)
        A = A + (MU - LAM * np.log(det(F))) * np.einsum(indices, G, G)
        return skfem.BilinearForm(lambda u, v, w: np.einsum("ijkl...,ij...,kl...", A, grad(v), grad(u))).assemble(BASIS)


def judged(mistake):
    """Return the report on the body; if the assertion fails, the report of the failure."""
    try:
        return assert_consistent(Rubber(mistake), MESH)
    except Inconsistent as failure:
        return failure.report


reports = {mistake: judged(mistake) for mistake in ("", "indices of K", "log 2J")}
failed = {mistake: sorted({f"{r.check} ({r.quantity})" for r in report.failures()}) for mistake, report in reports.items()}


def worst_errors(report):
    """Return the largest ratio of error and limit for each check with a measured error."""
    measured = [r for r in report.results if r.measured is not None and r.limit]
    names = dict.fromkeys(f"{r.check} ({r.quantity})" for r in measured)
    return {name: max(r.measured / r.limit for r in measured if f"{r.check} ({r.quantity})" == name) for name in names}


def picture():
    import matplotlib.pyplot as plt

    sizes = {mistake or "right": worst_errors(report) for mistake, report in reports.items()}
    rows, colors = list(sizes["right"]), ("#0072B2", "#E69F00", "#000000")
    figure, axes = plt.subplots(figsize=(9, 4.6), layout="constrained")
    for number, ((name, errors), color) in enumerate(zip(sizes.items(), colors, strict=True)):
        y = [len(rows) - row - 0.2 * (number - 1) for row in range(len(rows))]
        axes.plot([errors[row] for row in rows], y, "osD"[number], color=color, label=name)
    axes.axvline(1, color="0.4", ls="--")
    figure.legend(loc="outside lower center", ncols=3)
    axes.set(xscale="log", xlabel="largest error over its limit", title="A neo-Hookean body, right and with two mistakes")
    axes.set_yticks(range(len(rows), 0, -1), rows)
    return figure


if __name__ == "__main__":
    for mistake, names in failed.items():
        print(f"{mistake or 'right'}: {', '.join(names) or 'passed'}")
