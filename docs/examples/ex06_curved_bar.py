"""
Quadratic elements with curved edges
====================================

A couple bends a quarter of a ring open. A thin bar remains an arc, so that its shape
has a closed form. With 150 unknowns, linear triangles are 59 % off, and quadratic
triangles with curved edges are 0.05 % off.
"""

from dataclasses import replace

import numpy as np
import skfem
from scipy.optimize import brentq

from skfem_stvk import ElementMesh, StVK, System, Traction, solve_static

THICKNESS, YOUNG, COUPLE = 0.05, 1e7, 1.5  # radius 1 m; couple in units of EI/L
angle = brentq(lambda phi: phi - COUPLE * np.cos(phi), 0, 2)  # rotation of the end
curvature = 1 - angle / (np.pi / 2)
bend = curvature * np.linspace(0, np.pi / 2, 100)
closed = np.stack([np.sin(bend), curvature - 1 + np.cos(bend)]) / curvature
exact = closed[:, -1] - [1, 0]  # displacement of the end


def traction(x, t):
    """Return a couple on the end: a linear traction along y [Pa]."""
    return np.stack([0 * x[0], t * COUPLE * YOUNG * (x[0] - 1) / (np.pi / 2)])


def bent(along, across, degree):
    """Return mesh and displacements of a bar of `along x across` cells."""
    grid = np.linspace(0, 1, along + 1), np.linspace(-1, 1, across + 1)
    ends = {"clamp": lambda x: x[0] == 0, "end": lambda x: x[0] == 1}
    unit = skfem.MeshTri.init_tensor(*grid).with_boundaries(ends)
    mesh = ElementMesh.of(unit).with_degree(degree)
    angle, radius = np.pi / 2 * mesh.p[0], 1 + THICKNESS / 2 * mesh.p[1]
    mesh = replace(mesh, p=radius * np.stack([np.sin(angle), np.cos(angle)]))
    law = StVK(young=YOUNG, poisson=0.3, plane="stress")
    body = System(mesh, [law, Traction("end", traction)], fixed={"clamp": "xy"})
    return mesh, solve_static(body, steps=5, quiet=True).u.reshape(-1, 2).T


cells = [(24, 2, 1), (96, 8, 1), (6, 1, 2), (12, 1, 2)]  # along, across, degree
bars = {of: bent(*of) for of in cells}
moved = {
    of: u[:, np.argmin(np.hypot(*(mesh.p.T - [1, 0]).T))]
    for of, (mesh, u) in bars.items()
}
errors = {
    of: np.linalg.norm(u - exact) / np.linalg.norm(exact) for of, u in moved.items()
}

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    plt.plot(*closed, "k--", lw=1, label="closed form")
    for (of, (mesh, u)), mark in zip(bars.items(), ("o-", "v-", "s-", "D-")):
        axis = np.flatnonzero(np.isclose(np.hypot(*mesh.p), 1, atol=1e-4))
        axis = axis[np.argsort(mesh.p[0, axis])]
        name = f"degree {of[2]}, {u.size} unknowns: {errors[of]:.2%} off"
        plt.plot(*(mesh.p + u)[:, axis], mark, ms=3, lw=0.8, label=name)
    plt.gca().set(aspect="equal", xlabel="x [m]", ylabel="y [m]", ylim=(0, 1.05))
    plt.legend()
    ends = errors[24, 2, 1], errors[12, 1, 2]
    print(f"150 unknowns: linear {ends[0]:.1%} off, quadratic {ends[1]:.2%}")
    plt.show()
