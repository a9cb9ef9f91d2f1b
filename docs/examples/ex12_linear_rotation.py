"""A bar whose end is rotated by 0, 45 and 90 degrees: linear elasticity interprets the rotation as strain, and the bar grows.

This is the classic motivation of stiffness warping and of Green's strain. The linear body needs one factorisation.
"""

from pathlib import Path

import numpy as np
import skfem

from skfem_stvk import LinearElastic, StVK, System, solve_static

mesh = skfem.MeshTri.init_tensor(np.linspace(0, 4, 33), np.linspace(-0.5, 0.5, 9)).with_boundaries({"end": lambda x: x[0] == 0})
angles = (0, 45, 90)


def turned(law, degrees):
    """Return the equilibrium of the bar after a rotation of its end about the origin."""

    def moved(component):
        def displacement(x, t):
            s, c = np.sin(np.radians(t * degrees)), np.cos(np.radians(t * degrees))
            return ((c - 1) * x[0] - s * x[1], s * x[0] + (c - 1) * x[1])[component]

        return displacement

    system = System(mesh, law(young=1e6, poisson=0.3), prescribed={"end": {"x": moved(0), "y": moved(1)}})
    return solve_static(system, steps=max(1, degrees // 9), quiet=True)


results = {(law, degrees): turned(law, degrees) for law in (StVK, LinearElastic) for degrees in angles}


def area(result):
    """Return the area of the bar divided by its area at rest."""
    x, y = (mesh.p + result.u.reshape(-1, 2).T)[:, mesh.t]
    return float(np.abs((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])).sum() / 2 / 4)


areas = {law.__name__: [area(results[law, degrees]) for degrees in angles] for law in (StVK, LinearElastic)}


def picture():
    """Draw both bars at the three angles."""
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.4), layout="constrained")
    for axes, k in zip(figure.subplots(1, 3, sharey=True), range(3), strict=True):
        for law, colour in ((LinearElastic, "#D55E00"), (StVK, "#0072B2")):
            x = mesh.p.T + results[law, angles[k]].u.reshape(-1, 2)
            axes.add_collection(PolyCollection(x[mesh.t.T], fc=colour, ec="white", lw=0.2, alpha=0.75, label=law.__name__))
        axes.set(title=f"{angles[k]} degrees: areas {areas['StVK'][k]:.2f}, {areas['LinearElastic'][k]:.2f}", aspect="equal")
        axes.set(xlim=(-1.2, 4.9), ylim=(-1.2, 4.9), xlabel="x [m]")
    figure.axes[0].set_ylabel("y [m]")
    figure.axes[0].legend(loc="upper left", fontsize=8)
    return figure


if __name__ == "__main__":
    for law, ratios in areas.items():
        print(f"{law:14} area over that at rest at {angles} degrees: {', '.join(f'{ratio:.3f}' for ratio in ratios)}")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=110)
