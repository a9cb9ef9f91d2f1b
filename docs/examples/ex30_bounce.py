"""A soft block that bounces on a floor with friction: energy-momentum accounts for all of its energy.

The block of 10 cm falls 2 cm with a sideways speed. Where the floor holds its corners back, it tumbles. Friction takes energy; the
rest is exchanged between motion, strain, height and the contact, and what is missing from their sum is round-off.
"""

import numpy as np

from skfem_stvk import (
    EnergyMomentum,
    Friction,
    Gravity,
    NeoHookean,
    RigidContact,
    RigidPlane,
    System,
    simulate,
)
from skfem_stvk.mesh import box

L = 0.1
mesh = box((L, L, L), (4, 4, 4))
rubber = NeoHookean(young=5e4, poisson=0.4, density=1000.0)
floor = RigidContact(
    RigidPlane((0, 0, -0.02), (0, 0, 1)),
    friction=Friction(0.4, slip_speed=0.05),
    name="floor",
)
block = System(mesh, [rubber, Gravity((0, 0, -9.81)), floor])
v0 = np.zeros((mesh.nv, 3))
v0[:, 0], v0[:, 2] = 0.8, -0.5
run = simulate(block, EnergyMomentum(dt=1e-3), until=0.2, v0=v0.ravel(), quiet=True)

ledger = run.ledger
energies = {
    "motion": ledger["kinetic_energy"],
    "strain": ledger["strain_energy NeoHookean 0"],
    "contact": ledger["strain_energy RigidContact 2"],
    "height": ledger["potential_energy"],
    "lost to friction": ledger["friction_work"],
}
missing = float(np.abs(ledger["closure_error"]).max() / ledger["kinetic_energy"][0])


def picture():
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(9, 3.4), layout="constrained")
    left, right = figure.add_subplot(121, projection="3d"), figure.add_subplot(122)
    x = mesh.p + run.u.reshape(-1, 3).T
    left.plot_trisurf(
        *x, triangles=mesh.surface.T, color="tab:blue", edgecolor="white", linewidth=0.3
    )
    ends = np.array([x.min(axis=1) - 0.02, x.max(axis=1) + 0.02])
    plane = np.meshgrid(ends[:, 0], ends[:, 1])
    left.plot_surface(*plane, np.full((2, 2), -0.02), color="0.8", alpha=0.5)
    left.set_aspect("equal")
    left.view_init(12, -70)
    left.set_axis_off()
    left.set_title(f"the block at t = {run.t:.2f} s")
    for name, energy in energies.items():
        right.plot(ledger["time"], energy, label=name)
    right.plot(ledger["time"], sum(energies.values()), "k--", label="sum")
    right.set(xlabel="t [s]", ylabel="energy [J]")
    right.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
    return figure


if __name__ == "__main__":
    picture().savefig("ex30_bounce.png", dpi=110)
    print(
        f"energy missing at most: {missing:.1e} of the first kinetic energy; {run.contact('floor')!r}"
    )
