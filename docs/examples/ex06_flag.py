"""A flag that swings under its weight: Turek and Hron's CSM3 on a coarse mesh, by an energy-conserving method and backward Euler.

The flag starts at rest, undeformed and without damping. `EnergyMomentum` conserves the energy to round-off during the whole motion.
Backward Euler dissipates energy in each step, until the flag is at rest.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import skfem

from skfem_stvk import BackwardEuler, EnergyMomentum, Gravity, StVK, System, simulate

square = skfem.MeshTri.init_tensor(np.linspace(0, 1, 71), np.linspace(0, 1, 5))
y = 0.2 + 0.02 * (square.p[1] - 0.5)
arc = 0.2 + np.sqrt(0.05**2 - (y - 0.2) ** 2)  # the flag is clamped to a cylinder
x = arc + square.p[0] * (0.6 - arc)
flag = skfem.MeshTri(np.stack([x, y]), square.t).with_boundaries(
    {"clamp": lambda x: np.hypot(x[0] - 0.2, x[1] - 0.2) < 0.05 + 1e-9}
)
tip = np.flatnonzero(np.isclose(x, 0.6) & np.isclose(y, 0.2))

system = System(flag, [StVK(young=1.4e6, poisson=0.4, density=1000.0), Gravity(g=(0, -2.0))], fixed={"clamp": "xy"})
runs = {
    method: simulate(system, method(dt=0.01), until=3.0, probes={"A": tip}, quiet=__name__ != "__main__")
    for method in (EnergyMomentum, BackwardEuler)
}
swing = runs[EnergyMomentum].ledger
deepest = swing["A y"].min()  # lowest displacement of the tip [m]
drift = np.abs(swing["closure_error"]).max() / swing["kinetic_energy"].max()


def picture():
    """Draw the displacement of the tip, the energies, and the flag in its highest and lowest position."""
    figure, axes = plt.subplot_mosaic([["tip", "energy"], ["flag", "energy"]], figsize=(11, 5), layout="constrained")
    for method, run in runs.items():
        axes["tip"].plot(run.ledger["time"], 1e3 * run.ledger["A y"], label=method.__name__)
        axes["energy"].plot(run.ledger["time"], 1e3 * run.ledger["total_energy"], label=f"total, {method.__name__}")
    for name in ("kinetic_energy", "strain_energy", "potential_energy"):
        axes["energy"].plot(swing["time"], 1e3 * swing[name], lw=1, label=f"{name.partition('_')[0]}, EnergyMomentum")
    for u, name, colour in ((np.zeros(system.ndofs), "at the start", "0.6"), (runs[EnergyMomentum].u, "at t = 3 s", "tab:blue")):
        moved = flag.p + u.reshape(-1, 2).T
        lines = axes["flag"].triplot(*moved, flag.t.T, color=colour, lw=0.5)
        lines[0].set_label(name)
    axes["flag"].legend(loc="lower left")
    axes["tip"].set(xlabel="t [s]", ylabel="u_y of the tip [mm]")
    axes["energy"].set(xlabel="t [s]", ylabel="energy [mJ per m of thickness]")
    axes["flag"].set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    for name in ("tip", "energy"):
        axes[name].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize="small")
    return figure


if __name__ == "__main__":
    print(runs[EnergyMomentum])
    print(f"The tip swings down to {1e3 * deepest:.3f} mm; energy is off by {drift:.1e}.")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=90)
