"""
Fluid pressure on a ring
========================

A thin ring becomes oval under a fluid, whose pressure follows the surface, and under a
dead load of fixed directions. The critical pressure of the fluid is 3/4 of that of the
dead load for a thin ring, and 0.78 of it for a thickness of R/25.
"""

from dataclasses import replace

import numpy as np
import skfem

from skfem_stvk import ElementMesh, Pressure, Stop, StVK, System, Traction, solve_static

H, YOUNG, POISSON = 0.04, 1e9, 0.3  # thickness [m]; the radius R is 1 m
outer = 1 + H / 2
unit = YOUNG / (1 - POISSON**2) * H**3 / 12 / outer  # EI/R^3 on the outside [Pa]
full = 5.0  # load at t = 1, in this unit

grid = np.linspace(0, np.pi / 2, 161), np.linspace(1 - H / 2, outer, 5)
strip = skfem.MeshQuad.init_tensor(*grid).to_meshtri(style="x")
angle, radius = strip.p
where = {"outside": radius > outer - 1e-9, "top": angle == 0, "side": angle > 1.57}
edges = strip.facets
sides = {name: edges[:, at[edges].all(axis=0)] for name, at in where.items()}
p = radius * np.stack([np.sin(angle), np.cos(angle)])
ring = ElementMesh(p, strip.t, boundaries=sides)


def squeezed(load, imperfection=0.0, stop=None):
    """Return the path of a ring with an oval imperfection, a part of its thickness."""
    mesh = replace(ring, p=ring.p * (1 + imperfection * H * np.cos(2 * angle)))
    terms = [StVK(young=YOUNG, poisson=POISSON), load]
    system = System(mesh, terms, fixed={"top": "x", "side": "y"})
    how = {"method": "arc-length", "quiet": True, "raise_on_failure": False}
    return solve_static(system, steps=5, stop=stop or Stop(load=0.9), **how)


loads = {
    "fluid": Pressure("outside", full * unit),
    "dead": Traction("outside", lambda x, t: -t * full * unit * x / np.hypot(*x)),
}
perfect = {name: squeezed(load) for name, load in loads.items()}
critical = {name: full * path.critical_points[0].t for name, path in perfect.items()}
ratio = critical["fluid"] / critical["dead"]

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, (curve, shape) = plt.subplots(1, 2, figsize=(6, 3))
    top = np.flatnonzero((angle == 0) & (radius > outer - 1e-9))
    stop = Stop(displacement=(top, "y", 0.3))
    for name, colour in (("dead", "#E69F00"), ("fluid", "#0072B2")):
        oval = squeezed(loads[name], imperfection=0.02, stop=stop)
        sag, way = oval.history.u[:, 2 * top[0] + 1], full * oval.history.t
        mark = "os"[name == "dead"]
        curve.plot(sag, way, color=colour, marker=mark, label=f"{name} load")
        curve.axhline(critical[name], color=colour, lw=0.8, ls="--")
    x, y = oval.system.mesh.p + oval.u.reshape(-1, 2).T  # under the fluid
    for sx, sy in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        shape.triplot(sx * x, sy * y, strip.t.T, "-", color="#0072B2", lw=0.2)
    curve.set(xlabel="displacement of the top [m]", ylabel="pressure / (EI/R³)")
    curve.legend(loc="lower right")
    shape.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    values = ", ".join(f"{name} {value:.3f} EI/R³" for name, value in critical.items())
    print(f"critical load: {values}, ratio {ratio:.4f}")
    plt.show()
