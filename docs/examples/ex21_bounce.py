"""
A block that bounces
====================

A soft block falls on a floor with friction. The floor holds its corners back, so that
it tumbles. The energy-momentum method accounts for all energy of motion, strain,
contact and height, and for the energy that friction takes.
"""

import numpy as np

from skfem_stvk import EnergyMomentum, Friction, Gravity, NeoHookean, RigidContact
from skfem_stvk import RigidPlane, Simulation, System
from skfem_stvk.mesh import box

mesh = box((0.1, 0.1, 0.1), (4, 4, 4))
rubber = NeoHookean(young=5e4, poisson=0.4, density=1000.0)
plane, friction = RigidPlane((0, 0, -0.02), (0, 0, 1)), Friction(0.4, slip_speed=0.05)
floor = RigidContact(plane, friction=friction, name="floor")
block = System(mesh, [rubber, Gravity((0, 0, -9.81)), floor])
v0 = np.tile([0.8, 0, -0.5], mesh.nv)
sim = Simulation(block, EnergyMomentum(dt=1e-3), v0=v0, ledger=True)
states = []
while sim.t < 0.3:
    states.append((sim.t, sim.u))
    for _ in range(8):
        sim.step()

ledger = sim.ledger
energies = {
    "motion": ledger["kinetic_energy"],
    "strain": ledger["strain_energy NeoHookean 0"],
    "contact": ledger["strain_energy RigidContact 2"],
    "height": ledger["potential_energy"],
    "lost to friction": ledger["friction_work"],
}
missing = np.abs(ledger["closure_error"]).max() / ledger["kinetic_energy"][0]

if __name__ == "__main__":
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation

    plt.style.use("skfem_stvk.gallery")
    figure, (shape, curves) = plt.subplots(2, 1, figsize=(6, 5))
    faces = mesh.surface[:, (mesh.p[1, mesh.surface] == 0).all(axis=0)].T
    for number, (t, u) in enumerate(states[::8]):
        x, _, z = mesh.p + u.reshape(-1, 3).T
        x += 0.2 * number - x.mean()  # side by side
        shape.triplot(x, z, faces, "-", color="#0072B2", lw=0.6)
        shape.text(0.2 * number, 0.15, f"{t:.2f} s", ha="center")
    shape.set(aspect="equal", xticks=[], ylabel="z [m]", ylim=(-0.02, 0.18))
    for name, energy in energies.items():
        curves.plot(ledger["time"], energy, markevery=0.1, label=name)
    curves.plot(ledger["time"], sum(energies.values()), "k--", label="sum")
    curves.set(xlabel="time [s]", ylabel="energy [J]")
    curves.legend(loc="upper left", bbox_to_anchor=(1, 1))
    screen, axes = plt.subplots(figsize=(6, 2.4))

    def draw(state):
        x, _, z = mesh.p + state[1].reshape(-1, 3).T
        axes.clear()
        axes.triplot(x, z, faces, "-", color="#0072B2", lw=0.6)
        axes.set(title=f"t = {state[0]:.3f} s", xlabel="x [m]", ylabel="z [m]")
        axes.set(aspect="equal", xlim=(-0.05, 0.25), ylim=(-0.02, 0.15))

    film = FuncAnimation(screen, draw, states, interval=60)
    print(f"energy missing: at most {missing:.1e} of the first kinetic energy")
    plt.show()
