"""A soft block that bounces on a floor with friction: energy-momentum accounts for all of its energy.

The block of 10 cm falls 2 cm with a sideways speed. Where the floor holds its corners back, it tumbles. Friction takes energy; the
rest is exchanged between motion, strain, height and the contact, and what is missing from their sum is round-off. The film is
coloured by the speed, with the floor in grey.
"""

import numpy as np

from skfem_stvk import EnergyMomentum, Friction, Gravity, NeoHookean, RigidContact, RigidPlane, Simulation, System
from skfem_stvk.mesh import box
from skfem_stvk.results import Fields, animate

L = 0.1
mesh = box((L, L, L), (4, 4, 4))
rubber = NeoHookean(young=5e4, poisson=0.4, density=1000.0)
floor = RigidContact(RigidPlane((0, 0, -0.02), (0, 0, 1)), friction=Friction(0.4, slip_speed=0.05), name="floor")
block = System(mesh, [rubber, Gravity((0, 0, -9.81)), floor])
v0 = np.tile([0.8, 0, -0.5], mesh.nv)
sim, fields, states = Simulation(block, EnergyMomentum(dt=1e-3), v0=v0, ledger=True), Fields.of(block), []
while sim.t < 0.3:
    states.append((sim.t, fields.at(sim.u, sim.v, [sim.contact("floor")])))
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
missing = float(np.abs(ledger["closure_error"]).max() / ledger["kinetic_energy"][0])


def picture():
    """Draw five frames of the film, and the energies."""
    from tempfile import TemporaryDirectory

    import matplotlib.pyplot as plt
    from PIL import Image, ImageSequence

    with TemporaryDirectory() as folder:
        film = Image.open(animate(states[::8], folder + "/film.gif", "velocity"))
        frames = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(film)]
    figure, axes = plt.subplots(2, 3, figsize=(11, 5), layout="constrained")
    for frame, ax in zip(frames, axes.flat, strict=False):
        ax.imshow(frame)
        ax.set_axis_off()
    last = axes[1, 2]
    for name, energy in energies.items():
        last.plot(ledger["time"], energy, label=name)
    last.plot(ledger["time"], sum(energies.values()), "k--", label="sum")
    last.set(xlabel="t [s]", ylabel="energy [J]")
    last.legend(fontsize=7, frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
    return figure


if __name__ == "__main__":
    picture().savefig("ex30_bounce.png", dpi=110)
    animate(states, "ex30_bounce.gif", "velocity")
    print(f"energy missing at most: {missing:.1e} of the first kinetic energy; {sim.contact('floor')!r}")
