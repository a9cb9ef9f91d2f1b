"""
Linear elasticity mistakes a rotation for strain
================================================

The end of a bar is rotated by 0, 45 and 90 degrees, and nothing else acts on the bar. A
St. Venant-Kirchhoff bar follows without strain. Linear elasticity interprets the
rotation as strain, so that the bar has almost twice its area at 90 degrees.
"""

import numpy as np
import skfem

from skfem_stvk import LinearElastic, StVK, System, solve_static

mesh = skfem.MeshTri.init_tensor(np.linspace(0, 4, 33), np.linspace(-0.5, 0.5, 9))
mesh = mesh.with_boundaries({"end": lambda x: x[0] == 0})
angles = (0, 45, 90)


def rotated(law, degrees):
    """Return the equilibrium of the bar after a rotation of its end."""

    def displacement(x, t):
        s, c = np.sin(np.radians(t * degrees)), np.cos(np.radians(t * degrees))
        return np.stack([(c - 1) * x[0] - s * x[1], s * x[0] + (c - 1) * x[1]])

    body = law(young=1e6, poisson=0.3)
    system = System(mesh, body, prescribed={"end": displacement})
    return solve_static(system, steps=max(1, degrees // 9), quiet=True)


def area(result):
    """Return the area of the bar divided by its area at rest."""
    x, y = (mesh.p + result.u.reshape(-1, 2).T)[:, mesh.t]
    twice = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    return float(np.abs(twice).sum() / 2 / 4)


laws = (LinearElastic, StVK)
results = {law.__name__: [rotated(law, angle) for angle in angles] for law in laws}
areas = {name: [area(result) for result in found] for name, found in results.items()}

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, panels = plt.subplots(1, 3, sharex=True, sharey=True, figsize=(6, 2.9))
    looks = (("#E69F00", 0.4, "LinearElastic"), ("#0072B2", 0.8, "StVK"))
    for number, axes in enumerate(panels):
        for colour, width, name in looks:
            x = mesh.p + results[name][number].u.reshape(-1, 2).T
            line = axes.triplot(*x, mesh.t.T, "-", color=colour, lw=width)[0]
            line.set_label(name)
        linear, stvk = (areas[name][number] for name in results)
        axes.set_title(f"{angles[number]} degrees\nareas {linear:.2f} and {stvk:.2f}")
        axes.set(aspect="equal", xlabel="x [m]")
    panels[0].set_ylabel("y [m]")
    panels[0].legend(loc="upper center")
    for name, ratios in areas.items():
        print(f"{name}: areas", ", ".join(f"{ratio:.3f}" for ratio in ratios))
    plt.show()
