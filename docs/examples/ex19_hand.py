"""
A haptic hand at 1000 Hz
========================

A recorded hand moves the grip of a soft organ a thousand times a second and feels its
force. The organ has a reduced model with 30 unknowns, from its vibration modes and from
states of a coarse run. The same motion of the whole mesh gives the error of the force.
"""

from datetime import date
from time import perf_counter

import numpy as np
import skfem

from skfem_stvk import Gravity, LinearBackwardEuler, Rayleigh, ReducedSystem
from skfem_stvk import Simulation, StVK, System, about

ball = skfem.MeshTet.init_ball(2)
x, y, z = ball.p * [[0.08], [0.045], [0.03]]  # [m]
sides = {"grip": lambda p: p[2] > 4.0 * p[0] ** 2 + 0.022}
sides["back"] = lambda p: p[2] < 4.0 * p[0] ** 2 - 0.015
mesh = skfem.MeshTet(np.array([x, y, z + 4.0 * x**2]), ball.t).with_boundaries(sides)
terms = [StVK(young=6e3, poisson=0.45, density=1050.0), Gravity((0, 0, -9.81))]
organ = System(mesh, terms, fixed={"back": "xyz"}, prescribed={"grip": "xyz"})


def recorded(t):
    """Return the displacement of the hand [m]: a push, a pull aside, and a tremor."""
    s = np.clip([t / 0.3, (t - 0.4) / 0.3], 0, 1)
    push, aside = s**3 * (10 - 15 * s + 6 * s**2)
    return 1e-3 * np.array([12 * aside, 0.3 * np.sin(18 * np.pi * t) * push, -8 * push])


def moved(system, dt):
    """Return forces on the hand (n, 3), states (ndofs, n) and times per step (n,)."""
    sim = Simulation(system, LinearBackwardEuler(dt), damping=Rayleigh(beta=2e-3))
    forces, states, seconds = [], [], []
    for t in dt * np.arange(1, round(1 / dt) + 1):
        begin = perf_counter()
        sim.step(grip=recorded(t))
        forces.append(-sim.reaction("grip"))
        seconds.append(perf_counter() - begin)
        states.append(sim.u)
    return np.array(forces), np.array(states).T, np.array(seconds)


snapshots = moved(organ, 1e-2)[1][:, 3::4]
reduced = ReducedSystem(organ, 30, modes=10, snapshots=snapshots, quiet=True)
force, states, seconds = moved(reduced, 1e-3)
whole, _, seconds_whole = moved(organ, 1e-3)
size = np.linalg.norm(whole, axis=1).max()
error = np.linalg.norm(force - whole, axis=1).max() / size

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, (curves, shape) = plt.subplots(1, 2, figsize=(6, 3.2))
    t = np.linspace(1e-3, 1, 1000)
    curves.plot(t, whole, "-", color="0.7", lw=3)
    curves.plot(t, force, markevery=100, label=list("xyz"))
    curves.legend()
    curves.set(xlabel="time [s]", ylabel="force [N], grey: of the whole mesh")
    faces = mesh.facets[:, mesh.boundary_facets()]
    for part, colour in ((0, "0.7"), (1, "#0072B2")):
        x = 1e3 * (mesh.p + part * states[:, -1].reshape(-1, 3).T)
        shape.triplot(x[0], x[2], faces.T, "-", color=colour, lw=0.5)
    shape.set(aspect="equal", xlabel="x [mm]", ylabel="z [mm]")
    ms = 1e3 * np.median([seconds, seconds_whole], axis=1)
    print(f"force within {error:.1%}; {ms[0]:.2f} ms per step, whole {ms[1]:.2f} ms")
    print(f"one run on {about.machine()['processor']}, {date.today()}")
    plt.show()
