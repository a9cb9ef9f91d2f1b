"""A shallow arch that snaps through: its whole path of equilibria through both limit points, and its instability.

Under a growing load the arch jumps from the first limit point to the far branch. The arc-length method follows the unstable states
in between and counts the negative eigenvalues of K on the path.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import skfem

from skfem_stvk import ElementMesh, Stop, StVK, System, Traction, solve_static

SPAN, RISE, THICKNESS = 1.0, 0.03, 0.01

strip = skfem.MeshQuad.init_tensor(np.linspace(-SPAN / 2, SPAN / 2, 61), np.linspace(-THICKNESS / 2, THICKNESS / 2, 5)).to_meshtri()
x, y = strip.p
arch = ElementMesh(
    np.stack([x, y + RISE * np.cos(np.pi * x / SPAN) ** 2]),
    strip.t,
    boundaries={
        "ends": strip.facets[:, strip.facets_satisfying(lambda x: np.abs(x[0]) == SPAN / 2)],
        "top": strip.facets[:, strip.facets_satisfying(lambda x: x[1] == THICKNESS / 2)],
    },
)
apex = np.flatnonzero((np.abs(x) < 1e-12) & (y == THICKNESS / 2))
load = 400.0  # [N/m^2] at t = 1
system = System(arch, [StVK(young=70e6, poisson=0.3), Traction("top", (0, -load))], fixed={"ends": "xy"})
result = solve_static(
    system, steps=40, method="arc-length", stop=Stop(displacement=(apex, "y", -2.0 * RISE)), quiet=__name__ != "__main__"
)
limit = load * result.critical_points[0].t  # the arch snaps through above this load [N/m^2]


def picture():
    """Draw the load against the displacement of the apex, and the arch at rest, at the first critical point and at the end."""
    sags = -result.history.u[:, 2 * apex[0] + 1] / RISE
    loads, stable = result.history.t * load, np.array([step.negative == 0 for step in result.history])
    figure, (path, shapes) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    path.plot(sags, loads, color="0.7", zorder=1)
    path.scatter(sags[stable], loads[stable], s=14, color="tab:blue", label="stable", zorder=2)
    path.scatter(sags[~stable], loads[~stable], s=14, color="tab:red", label="unstable", zorder=2)
    for point in result.critical_points:
        path.plot(-point.u[2 * apex[0] + 1] / RISE, point.t * load, "k*" if point.kind == "limit point" else "kD", label=point.kind)
    handles = dict(zip(*path.get_legend_handles_labels()[::-1], strict=True))
    path.legend(handles.values(), handles.keys())
    path.set(xlabel="sag of the apex / rise", ylabel="load [N/m²]")
    for u, name in (
        (0 * result.u, "at rest"),
        (result.critical_points[0].u, result.critical_points[0].kind),
        (result.u, "snapped through"),
    ):
        p = arch.p + u.reshape(-1, 2).T
        shapes.tripcolor(
            *p, arch.t.T, facecolors=np.full(arch.nt, 0.25), cmap="Blues", vmin=0, vmax=1, edgecolors="0.5", linewidth=0.2
        )
        at = np.argmin(p[0] ** 2 - 1e-3 * p[1])
        shapes.annotate(name, p[:, at], (0, 9), textcoords="offset points", ha="center")
    shapes.set(xlabel="x [m]", ylabel="y [m]", ylim=(-0.06, 0.06))
    return figure


if __name__ == "__main__":
    print(result)
    print(f"The arch snaps at {limit:.0f} N/m^2.")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=110)
