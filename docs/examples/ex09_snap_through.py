"""
An arch snaps through
=====================

A shallow arch under a growing load jumps at a limit point to a state far away. The
arc-length method follows the unstable equilibria in between. It counts the negative
eigenvalues of K on the path and finds both limit points.
"""

import numpy as np
import skfem

from skfem_stvk import Stop, StVK, System, Traction, solve_static

SPAN, RISE, THICKNESS = 1.0, 0.03, 0.01

strip = skfem.MeshQuad.init_tensor(
    np.linspace(-SPAN / 2, SPAN / 2, 61), np.linspace(-THICKNESS / 2, THICKNESS / 2, 5)
).to_meshtri()
sides = {"ends": lambda x: np.abs(x[0]) == SPAN / 2}
sides |= {"top": lambda x: x[1] == THICKNESS / 2}
strip = strip.with_boundaries(sides)
x, y = strip.p
apex = np.flatnonzero((np.abs(x) < 1e-12) & (y == THICKNESS / 2))
p = np.stack([x, y + RISE * np.cos(np.pi * x / SPAN) ** 2])
arch = skfem.MeshTri(p, strip.t, _boundaries=strip.boundaries)

load = 400.0  # [N/m^2] at t = 1
rubber = StVK(young=70e6, poisson=0.3)
system = System(arch, [rubber, Traction("top", (0, -load))], fixed={"ends": "xy"})
stop = Stop(displacement=(apex, "y", -2.0 * RISE))
result = solve_static(system, steps=40, method="arc-length", stop=stop, quiet=True)
limit = load * result.critical_points[0].t  # the arch snaps above this load [N/m^2]

if __name__ == "__main__":
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation

    plt.style.use("skfem_stvk.gallery")
    figure, (path, shape) = plt.subplots(1, 2, figsize=(6, 3))
    sags = -1e3 * result.history.u[:, 2 * apex[0] + 1]
    loads = load * result.history.t
    stable = np.array([step.negative == 0 for step in result.history])
    path.plot(sags, loads, "-", color="0.7", lw=0.8)
    path.plot(sags[stable], loads[stable], "o", ms=3, label="stable")
    path.plot(sags[~stable], loads[~stable], "s", ms=3, mfc="none", label="unstable")
    path.set(xlabel="deflection of the apex [mm]", ylabel="load [N/m²]")
    moments = {"at rest": 0 * result.u, "last state": result.u}
    for point, name in zip(result.critical_points, ("first limit", "second limit")):
        path.plot(-1e3 * point.u[2 * apex[0] + 1], load * point.t, "k*", ms=9)
        moments[name] = point.u
    path.plot([], "k*", ms=9, label="limit point")
    path.legend()
    for name, colour in zip(moments, ("0.6", "#0072B2", "#000000", "#E69F00")):
        moved = arch.p + moments[name].reshape(-1, 2).T
        shape.triplot(*(1e3 * moved), arch.t.T, "-", color=colour, lw=0.4)
        height = 1e3 * moved[1, apex[0]] + 2
        shape.text(0, height, name, ha="center", color=colour)
    shape.set(xlabel="x [mm]", ylabel="y [mm]")
    screen, axes = plt.subplots(figsize=(6, 2))

    def draw(step):
        axes.clear()
        axes.set(xlabel="x, y [mm]", ylim=(-42, 42), title=f"{load * step.t:.0f} N/m²")
        moved = 1e3 * (arch.p + step.u.reshape(-1, 2).T)
        axes.triplot(*moved, arch.t.T, "-", color="#0072B2", lw=0.5)

    film = FuncAnimation(screen, draw, list(result.history)[::2], interval=150)
    print(f"The arch snaps through at {limit:.0f} N/m².")
    plt.show()
