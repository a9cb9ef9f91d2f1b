"""A block compressed to two fifths of its height: a neo-Hookean body remains stable, a St. Venant-Kirchhoff body fails.

Both bodies have the same constants, and the same force at strains of a few percent. The plates constrain the block laterally, so
that it bulges between them. The force on the St. Venant-Kirchhoff body grows more and more slowly, until no equilibrium without
inverted elements is found. The neo-Hookean body becomes stiffer, and its elements are not inverted.
"""

import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import skfem

from skfem_stvk import ElementMesh, NeoHookean, StVK, StvkWarning, System, solve_static

mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 7)] * 3).with_boundaries(
    {"foot": lambda x: x[2] == 0, "plate": lambda x: x[2] == 1}
)


def crushed(law, by=0.6):
    """Return the path of the block under a plate that moves down."""
    body = System(
        mesh,
        law(young=1e6, poisson=0.3),
        fixed={"foot": "xyz", "plate": "xy"},
        prescribed={"plate": {"z": -by}},
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        return solve_static(body, steps=12, quiet=True, raise_on_failure=False)


paths = {law.__name__: crushed(law) for law in (NeoHookean, StVK)}
force = {name: -float(path.reaction("plate").resultant[2]) / 1e6 for name, path in paths.items()}  # at the end of each path [MN]
reached = {name: 0.6 * path.t for name, path in paths.items()}


def picture():
    """Draw the forces against the displacement of the plate, and the neo-Hookean block at the end."""
    figure = plt.figure(figsize=(11, 4.5), layout="constrained")
    path = figure.add_subplot(1, 2, 1)
    for name, colour in (("NeoHookean", "tab:blue"), ("StVK", "tab:orange")):
        found = paths[name]
        plate = np.unique(mesh.facets[:, mesh.boundaries["plate"]])
        body = found.system
        pushes = [0.0] + [-body.internal_force(u)[3 * plate + 2].sum() / 1e6 for u in found.history.u]
        path.plot([0.0, *0.6 * found.history.t], pushes, ".-", color=colour, label=name)
    path.set(xlabel="way of the plate [m]", ylabel="force [MN]")
    path.legend()
    shape = figure.add_subplot(1, 2, 2, projection="3d")
    found = paths["NeoHookean"]
    p = mesh.p + found.u.reshape(-1, 3).T
    outwards = ElementMesh.of(mesh).surface.T
    shape.plot_trisurf(*p, triangles=outwards, color="tab:blue", edgecolor="white", linewidth=0.3)
    shape.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]", zticks=[0, 0.2, 0.4])
    shape.set_box_aspect(np.ptp(p, axis=1))
    return figure


if __name__ == "__main__":
    for name, path in paths.items():
        print(f"{name}: {path.status.value} at {reached[name]:.3f} m, {force[name]:.4f} MN. {path.message}")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=110)
