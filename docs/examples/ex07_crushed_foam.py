"""
Crushed foam: St. Venant-Kirchhoff and neo-Hooke
================================================

A block between two plates is compressed to 40 % of its height. Both laws have the same
constants and the same force at small strains. The St. Venant-Kirchhoff block loses its
stability before half of the way. The neo-Hookean block becomes stiffer and carries the
load.
"""

import warnings

import numpy as np
import skfem

from skfem_stvk import NeoHookean, StVK, StvkWarning, System, solve_static

mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 7)] * 3).with_boundaries(
    {"foot": lambda x: x[2] == 0, "plate": lambda x: x[2] == 1}
)
plate = np.flatnonzero(mesh.p[2] == 1)


def crushed(law, by=0.6):
    """Return the path of the block under a plate that moves down."""
    fixed = {"foot": "xyz", "plate": "xy"}
    moved = {"plate": {"z": -by}}
    body = System(mesh, law(young=1e6, poisson=0.3), fixed=fixed, prescribed=moved)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        return solve_static(body, steps=12, quiet=True, raise_on_failure=False)


paths = {law.__name__: crushed(law) for law in (NeoHookean, StVK)}
forces = {
    name: [
        -path.system.internal_force(u)[3 * plate + 2].sum() / 1e6
        for u in path.history.u
    ]
    for name, path in paths.items()
}
force = {name: values[-1] for name, values in forces.items()}  # at the end [MN]
reached = {name: 0.6 * path.t for name, path in paths.items()}

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, (curve, shape) = plt.subplots(1, 2, figsize=(6, 3))
    for name, path in paths.items():
        way = [0.0, *0.6 * path.history.t]
        curve.plot(way, [0.0, *forces[name]], label=name)
    curve.set(xlabel="displacement of the plate [m]", ylabel="force [MN]")
    curve.legend()
    for name, colour in zip(paths, ("#0072B2", "#E69F00")):
        x, _, z = mesh.p + paths[name].u.reshape(-1, 3).T
        for edge in mesh.edges.T[(mesh.p[1, mesh.edges] == 0.5).all(axis=0)]:
            shape.plot(x[edge], z[edge], "-", color=colour, lw=0.8)
    shape.set(aspect="equal", xlabel="x [m]", ylabel="z [m], at y = 0.5 m")
    shape.set_title("last states")
    for name in paths:
        print(f"{name}: {force[name]:.4f} MN at {reached[name]:.3f} m")
    plt.show()
