"""
A muscle with wound fibres
==========================

A round bar whose fibres wind around its axis twists when it is pulled, against the
direction of the winding. Bars with axial fibres or without fibres do not twist. The
direction of the fibres is a function of the coordinates.
"""

import numpy as np
import skfem

from skfem_stvk import ElementMesh, StVK, System, Traction
from skfem_stvk import TransverselyIsotropic, frames_along, solve_static

RADIUS, LENGTH = 0.01, 0.08  # [m]
grid = [np.linspace(-1, 1, 7)] * 2 + [np.linspace(0, LENGTH, 15)]
block = skfem.MeshHex.init_tensor(*grid)
a, b, z = block.p
x, y = RADIUS * a * np.sqrt(1 - b**2 / 2), RADIUS * b * np.sqrt(1 - a**2 / 2)  # a disc
ends = {"clamp": lambda x: x[2] == 0, "end": lambda x: x[2] == LENGTH}
bar = skfem.MeshHex(np.stack([x, y, z]), block.t).with_boundaries(ends)


def pulled(degrees, along=6e5):
    """Return the bar under the load; the fibres have this angle at its surface."""

    def winding(x):
        slope = np.tan(np.radians(degrees)) / RADIUS
        return np.stack([-slope * x[1], slope * x[0], np.ones(x.shape[1])])

    frame = frames_along(bar, winding)
    law = TransverselyIsotropic.from_lame(lam=6e4, mu=4e4, along=along, frame=frame)
    terms = [StVK(law), Traction("end", (0, 0, 2e4))]
    return solve_static(System(bar, terms, fixed={"clamp": "xyz"}), quiet=True)


def turn(result):
    """Return the rotation of the end [degrees] and the relative elongation."""
    rim = (bar.p[2] == LENGTH) & (np.hypot(*bar.p[:2]) > RADIUS / 2)
    (x, y, _), (u, v, w) = bar.p[:, rim], result.u.reshape(-1, 3)[rim].T
    angles = np.degrees(np.angle(((x + u) + 1j * (y + v)) / (x + 1j * y)))
    return round(float(angles.mean()), 6) + 0.0, float(w.mean() / LENGTH)


results = {f"{degrees}°": pulled(degrees) for degrees in (0, 45, -45)}
results["no fibres"] = pulled(0, along=0.0)
turns = {name: turn(result) for name, result in results.items()}

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    quads = ElementMesh.of(bar).surface
    faces = np.concatenate([quads[:3], quads[[0, 2, 3]]], axis=1)
    stripe = np.cos(6 * np.angle((x + 1j * y)[faces].mean(axis=0))) > 0
    figure, panels = plt.subplots(1, 3, sharey=True, figsize=(6, 4))
    for axes, name in zip(panels, ("45°", "-45°", "no fibres")):
        moved = 1e3 * (bar.p + results[name].u.reshape(-1, 3).T)
        seen = moved[1, faces].mean(axis=0) < -1  # from the front
        body = faces[:, seen].T, stripe[seen]
        axes.tripcolor(moved[0], moved[2], body[0], facecolors=body[1], cmap="cividis")
        axes.set(title=f"{name}:\n{turns[name][0]:.0f}°, +{turns[name][1]:.0%}")
        axes.set(aspect="equal", xlabel="x [mm]")
    panels[0].set_ylabel("z [mm]")
    angles = ", ".join(f"{name} {turns[name][0]:.2f}°" for name in turns)
    print(f"rotation of the end: {angles}")
    plt.show()
