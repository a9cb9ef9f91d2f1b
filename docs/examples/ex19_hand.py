"""A hand on an organ, 1000 times a second: displacements of the grip go in, the force that the hand feels comes out.

The organ is a bent ellipsoid of 0.16 m, reduced to 30 unknowns, with states of a coarse run of the whole mesh in its basis. The
hand is a recorded motion, so that each run is the same: a push, a pull to the side, and a tremor of 9 Hz. The same motion of the
whole mesh shows the error of the reduced body.
"""

import time

import numpy as np
import skfem

from skfem_stvk import (
    Gravity,
    LinearBackwardEuler,
    Rayleigh,
    ReducedSystem,
    Simulation,
    StVK,
    System,
)

DT, SECONDS = 1e-3, 1.0
ball = skfem.MeshTet.init_ball(2)
x, y, z = ball.p * [[0.08], [0.045], [0.03]]
mesh = skfem.MeshTet(np.array([x, y, z + 4.0 * x**2]), ball.t).with_boundaries(
    {
        "grip": lambda p: p[2] > 4.0 * p[0] ** 2 + 0.022,
        "back": lambda p: p[2] < 4.0 * p[0] ** 2 - 0.015,
    }
)
tissue = StVK(young=6e3, poisson=0.45, density=1050.0)
organ = System(
    mesh,
    [tissue, Gravity((0, 0, -9.81))],
    fixed={"back": "xyz"},
    prescribed={"grip": "xyz"},
)


def recorded(t):
    """Return the displacement of the hand [m] at time `t` [s]."""
    push, aside = np.clip(t / 0.3, 0, 1), np.clip((t - 0.4) / 0.3, 0, 1)
    smooth = [s**3 * (10 - 15 * s + 6 * s**2) for s in (push, aside)]
    tremor = 3e-4 * np.sin(2 * np.pi * 9 * t) * smooth[0]
    return np.array([0.012 * smooth[1], tremor, -0.008 * smooth[0]])


def moved(system, dt):
    """Return the forces (n, 3) [N] that the hand feels, the displacements (ndofs, n / 4), and the times (n,) of the steps [s]."""
    sim, forces, states, seconds = (
        Simulation(system, LinearBackwardEuler(dt), damping=Rayleigh(beta=2e-3)),
        [],
        [],
        [],
    )
    for step in range(1, round(SECONDS / dt) + 1):
        begin = time.perf_counter()
        sim.step(grip=recorded(step * dt))
        forces.append(-sim.reaction("grip"))
        seconds.append(time.perf_counter() - begin)
        if step % 4 == 0:
            states.append(sim.u)
    return np.array(forces), np.array(states).T, np.array(seconds)


snapshots = moved(organ, 10 * DT)[1]
reduced = ReducedSystem(organ, size=30, modes=10, snapshots=snapshots, quiet=True)
force, states, seconds = moved(reduced, DT)
whole, _, seconds_whole = moved(organ, DT)
size = np.linalg.norm(whole, axis=1).max()
error = np.linalg.norm(force - whole, axis=1).max() / size


def picture():
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(9, 3.6), layout="constrained")
    axes = figure.add_subplot(1, 2, 1)
    t = DT * np.arange(1, len(force) + 1)
    for i, letter in enumerate("xyz"):
        axes.plot(
            t, whole[:, i], color="0.6", lw=3, label="whole mesh" if i == 0 else None
        )
        axes.plot(t, force[:, i], color=f"C{i}", lw=1.2, label=f"{letter}, 30 unknowns")
    axes.set(xlabel="time [s]", ylabel="force on the hand [N]")
    axes.legend(frameon=False)
    body = figure.add_subplot(1, 2, 2, projection="3d")
    facets = mesh.facets[:, mesh.boundary_facets()]
    for u, colour, alpha in (
        (0 * states[:, -1], "0.6", 0.15),
        (states[:, -1], "tab:red", 0.8),
    ):
        body.plot_trisurf(
            *(mesh.p + u.reshape(-1, 3).T),
            triangles=facets.T,
            color=colour,
            alpha=alpha,
            lw=0,
        )
    body.set_box_aspect(np.ptp(mesh.p, axis=1), zoom=1.2)
    body.set_axis_off()
    return figure


if __name__ == "__main__":
    print(
        f"{mesh.t.shape[1]} tetrahedra, {organ.ndofs} degrees of freedom; largest force {size:.3g} N"
    )
    print(f"force of the reduced body: within {100 * error:.1f} % of the largest")
    for name, one in (("reduced", seconds), ("whole mesh", seconds_whole)):
        print(
            f"a step, {name}: median {1e3 * np.median(one):.3f} ms, worst {1e3 * one.max():.3f} ms"
        )
