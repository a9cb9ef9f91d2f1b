"""A ring under pressure: fluid pressure is a follower load and buckles the ring at 3/4 of the critical dead load.

A thin ring of radius R becomes oval at 3 EI/R^3 under a fluid and at 4 EI/R^3 under forces with fixed directions. Above this load
the round ring is still in equilibrium, but this state is unstable, and a solve that ends in it does not report success. The
thickness here is R/25, which is not very thin, and the ratio is 0.78. The model is a quarter of the ring.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import skfem

from skfem_stvk import ElementMesh, Pressure, Stop, StVK, System, Traction, solve_static

RADIUS, THICKNESS, YOUNG, POISSON = 1.0, 0.04, 1e9, 0.3
outer = RADIUS + THICKNESS / 2
unit = (
    YOUNG / (1 - POISSON**2) * THICKNESS**3 / 12 / (RADIUS**2 * outer)
)  # EI/R^3 in plane strain, as a pressure on the outside [N/m^2]
full = 5.0  # load at t = 1, in this unit

strip = skfem.MeshQuad.init_tensor(np.linspace(0, np.pi / 2, 161), np.linspace(RADIUS - THICKNESS / 2, outer, 5)).to_meshtri(
    style="x"
)
angle, radius = strip.p
boundaries = {
    "outside": strip.facets[:, strip.facets_satisfying(lambda x: np.isclose(x[1], outer))],
    "top": strip.facets[:, strip.facets_satisfying(lambda x: x[0] == 0)],
    "side": strip.facets[:, strip.facets_satisfying(lambda x: np.isclose(x[0], np.pi / 2))],
}
round_ring = np.stack([radius * np.sin(angle), radius * np.cos(angle)])


def squeezed(load, imperfection=0.0, stop=None):
    """Return the path of a ring with an oval imperfection, a fraction of its thickness, under a load that grows to `full`."""
    p = round_ring * (1 + imperfection * THICKNESS * np.cos(2 * angle))
    mesh = ElementMesh(p, strip.t, boundaries=boundaries)
    system = System(mesh, [StVK(young=YOUNG, poisson=POISSON), load], fixed={"top": "x", "side": "y"})
    stop = stop or Stop(load=0.9)
    return solve_static(system, steps=5, method="arc-length", stop=stop, quiet=True, raise_on_failure=False)


top = np.flatnonzero((angle == 0) & np.isclose(radius, outer))
loads = {
    "fluid": Pressure("outside", full * unit),
    "dead": Traction("outside", lambda x, t: -t * full * unit * x / np.linalg.norm(x, axis=0)),
}
perfect = {name: squeezed(load) for name, load in loads.items()}
critical = {name: full * path.critical_points[0].t for name, path in perfect.items()}
ratio = critical["fluid"] / critical["dead"]


def picture():
    """Draw the loads against the ovality of a nearly round ring, and the deformed ring under a fluid."""
    figure, (path, shape) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    for (name, load), colour in zip(loads.items(), ("tab:blue", "tab:orange"), strict=True):
        oval = squeezed(load, imperfection=0.02, stop=Stop(displacement=(top, "y", 0.3 * RADIUS)))
        sags = oval.history.u[:, 2 * top[0] + 1]
        path.plot(sags / RADIUS, full * oval.history.t, ".-", color=colour, label=f"{name}, a ring that is nearly round")
        path.axhline(critical[name], color=colour, linewidth=0.8, linestyle="--", label=f"{name}, bifurcation of the round ring")
        if name == "fluid":
            p = oval.system.mesh.p + oval.u.reshape(-1, 2).T
            for mirror in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                signs = np.array(mirror)[:, None]
                shape.tripcolor(
                    *(signs * round_ring), strip.t.T, facecolors=np.full(strip.nelements, 0.3), cmap="Greys", vmin=0, vmax=1
                )
                shape.tripcolor(*(signs * p), strip.t.T, facecolors=np.full(strip.nelements, 0.6), cmap="Blues", vmin=0, vmax=1)
    path.set(xlabel="radial displacement of the top / R", ylabel="pressure / (EI/R³)")
    path.legend(loc="lower right")
    shape.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    return figure


if __name__ == "__main__":
    print(perfect["fluid"])
    fluid, dead = (f"{critical[name]:.3f} EI/R^3" for name in ("fluid", "dead"))
    print(f"A fluid buckles the ring at {fluid}, a dead load at {dead}: ratio {ratio:.4f}.")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=110)
