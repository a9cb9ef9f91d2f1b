"""A curved bar that a couple bends open: quadratic elements against linear elements and against the closed form.

The bar is a quarter of a ring, clamped at one end. Tractions with fixed directions on the other end form a couple without resultant
force. A thin bar remains an arc. The couple `M cos(phi)`, where phi is the rotation of the end, changes the curvature 1/R by
`phi/L = M cos(phi)/EI` everywhere.
"""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import skfem
from scipy.optimize import brentq

from skfem_stvk import ElementMesh, StVK, System, Traction, solve_static

RADIUS, THICKNESS, YOUNG, POISSON = 1.0, 0.05, 1e7, 0.3
length, couple = np.pi / 2 * RADIUS, 1.5  # length [m], couple in units of EI/L
largest = couple * YOUNG * THICKNESS / 2 / length  # traction at the outer and inner side: M h/2 / I [Pa]

turn = brentq(lambda phi: phi - couple * np.cos(phi), 0, 2)
curvature = 1 / RADIUS - turn / length
arc = np.linspace(0, length, 100)
closed = np.stack([np.sin(curvature * arc), RADIUS * curvature - 1 + np.cos(curvature * arc)]) / curvature  # the bar's axis
exact = closed[:, -1] - [RADIUS, 0]  # displacement of the end


def bent(along, across, degree):
    """Return the solution of a bar of `along x across` cells of two triangles; edges of quadratic elements are curved."""
    unit = skfem.MeshTri.init_tensor(np.linspace(0, 1, along + 1), np.linspace(-1, 1, across + 1))
    mesh = ElementMesh.of(unit.with_boundaries({"clamp": lambda x: x[0] == 0, "end": lambda x: x[0] == 1}))
    mesh = mesh.with_degree(degree)
    angle, radius = np.pi / 2 * mesh.p[0], RADIUS + THICKNESS / 2 * mesh.p[1]
    mesh = replace(mesh, p=np.stack([radius * np.sin(angle), radius * np.cos(angle)]))
    pull = Traction("end", lambda x, t: t * largest * (x[0] - RADIUS) / (THICKNESS / 2) * np.array([[0.0], [1.0]]))
    body = System(mesh, [StVK(young=YOUNG, poisson=POISSON, plane="stress"), pull], fixed={"clamp": "xy"})
    return solve_static(body, steps=5, quiet=True)


def of_the_end(result):
    """Return the displacement of the middle of the end, the mean of the nodes on both sides."""
    p = result.system.mesh.p
    sides = [np.argmin(np.hypot(p[0] - RADIUS - side * THICKNESS / 2, p[1])) for side in (-1, 1)]
    return result.u.reshape(-1, 2)[sides].mean(axis=0)


results = {
    "linear, 24 x 2 cells": bent(24, 2, 1),
    "linear, 96 x 8 cells": bent(96, 8, 1),
    "quadratic, 6 x 1 cells": bent(6, 1, 2),
    "quadratic, 12 x 1 cells": bent(12, 1, 2),
}
errors = {name: np.linalg.norm(of_the_end(result) - exact) / np.linalg.norm(exact) for name, result in results.items()}


def picture():
    """Draw the bar at rest, the bent bars, and the closed form."""
    figure, axes = plt.subplots(figsize=(7, 5), layout="constrained")
    axes.plot(*closed, "k--", linewidth=1, label="closed form")
    for name, colour in zip(results, ("tab:orange", "tab:red", "tab:blue", "tab:green"), strict=False):
        mesh, u = results[name].system.mesh, results[name].u.reshape(-1, 2).T
        middle = np.abs(np.hypot(*mesh.p) - RADIUS) < 1e-3 * THICKNESS  # nodes on the axis
        x = (mesh.p + u)[:, middle]
        x = x[:, np.argsort(np.arctan2(*mesh.p[:, middle]))]
        axes.plot(*x, "o-", color=colour, markersize=3, linewidth=0.8, label=f"{name}: {errors[name]:.1%} off")
    rest = np.linspace(0, np.pi / 2, 50)
    axes.plot(RADIUS * np.sin(rest), RADIUS * np.cos(rest), color="0.7", linewidth=4, label="at rest")
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.legend(loc="lower left", fontsize=8)
    return figure


if __name__ == "__main__":
    for name, error in errors.items():
        print(f"{name}: {results[name].system.ndofs} unknowns, the end is {error:.2%} off.")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=110)
