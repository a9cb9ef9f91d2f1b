"""A round bar with helical fibres: under tension the bar twists against the direction of the winding.

The direction of the fibres is a function of the coordinates. A bar without fibres and a bar with axial fibres do not twist.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import skfem

from skfem_stvk import StVK, System, Traction, TransverselyIsotropic, frames_along, solve_static

RADIUS, LENGTH, LOAD = 0.01, 0.08, 2e4  # [m], [m], [Pa]
block = skfem.MeshHex.init_tensor(np.linspace(-1, 1, 7), np.linspace(-1, 1, 7), np.linspace(0, LENGTH, 15))
a, b, z = block.p
x, y = RADIUS * a * np.sqrt(1 - b**2 / 2), RADIUS * b * np.sqrt(1 - a**2 / 2)  # maps a square to a disc
bar = skfem.MeshHex(np.stack([x, y, z]), block.t).with_boundaries({"clamp": lambda x: x[2] == 0, "end": lambda x: x[2] == LENGTH})


def winding(degrees):
    """Return the directions of helical fibres around the z axis.

    Their angle to the axis has this value on the surface of the bar and decreases towards the axis.
    """

    def directions(x):
        slope = np.tan(np.radians(degrees)) / RADIUS
        return np.stack([-slope * x[1], slope * x[0], np.ones(x.shape[1])])

    return directions


def pulled(degrees, along=6e5):
    """Return the bar under the load, with an isotropic stiffness and an additional stiffness along the fibres [Pa]."""
    fibres = TransverselyIsotropic.from_lame(lam=6e4, mu=4e4, along=along, frame=frames_along(bar, winding(degrees)))
    system = System(bar, [StVK(fibres), Traction("end", (0, 0, LOAD))], fixed={"clamp": "xyz"})
    return solve_static(system, quiet=__name__ != "__main__")


def turn(result):
    """Return the rotation of the end [degrees] and the relative elongation of the bar."""
    rim = (bar.p[2] == LENGTH) & (np.hypot(*bar.p[:2]) > RADIUS / 2)
    (x, y, _), (u, v, w) = bar.p[:, rim], result.u.reshape(-1, 3)[rim].T
    angles = np.degrees(np.angle(((x + u) + 1j * (y + v)) / (x + 1j * y)))
    return round(float(angles.mean()), 6) + 0.0, float(w.mean() / LENGTH)


results = {f"{degrees} degrees": pulled(degrees) for degrees in (0, 45, -45)}
results["no fibres"] = pulled(0, along=0.0)
turns = {name: turn(result) for name, result in results.items()}


def picture():
    """Draw the bars with lines that are straight at rest; lines on the front are blue."""
    figure, axes = plt.subplots(1, len(results), figsize=(11, 4.6), layout="constrained")
    lines = [
        np.flatnonzero(np.isclose(np.hypot(x, y), RADIUS) & np.isclose(np.arctan2(y, x), angle))
        for angle in np.unique(np.round(np.arctan2(y, x)[np.isclose(np.hypot(x, y), RADIUS)], 9))
    ]
    for axis, (name, result) in zip(axes, results.items(), strict=True):
        moved = bar.p + result.u.reshape(-1, 3).T
        for line in lines:
            line = line[np.argsort(bar.p[2, line])]
            front = moved[1, line] < 0  # visible side
            axis.plot(
                1e3 * moved[0, line], 1e3 * moved[2, line], color="tab:blue" if front.all() else "0.85", lw=1, zorder=front.all()
            )
        axis.set(
            aspect="equal", title=f"{name}\n{turns[name][0]:.1f}°, +{100 * turns[name][1]:.1f} %", xlim=(-14, 14), ylim=(-2, 105)
        )
        axis.set_axis_off()
    return figure


if __name__ == "__main__":
    for name, (angle, longer) in turns.items():
        print(f"{name:12} turns by {angle:7.3f} degrees, longer by {100 * longer:.2f} %")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=90)
