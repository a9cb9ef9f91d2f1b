"""
Turek and Hron's flag
=====================

An elastic flag swings under its weight, without damping. The energy-momentum method
conserves its energy to round-off, while backward Euler dissipates energy. The same flag
is a scene file with a finer mesh, whose integrator is replaced by its key.
"""

from pathlib import Path

import numpy as np
import skfem

from skfem_stvk import EnergyMomentum, Gravity, Scene, Simulation, StVK, System

square = skfem.MeshTri.init_tensor(np.linspace(0, 1, 71), np.linspace(0, 1, 5))
y = 0.2 + 0.02 * (square.p[1] - 0.5)
arc = 0.2 + np.sqrt(0.05**2 - (y - 0.2) ** 2)  # the flag is clamped to a cylinder
x = arc + square.p[0] * (0.6 - arc)
flag = skfem.MeshTri(np.stack([x, y]), square.t).with_boundaries(
    {"clamp": lambda x: np.hypot(x[0] - 0.2, x[1] - 0.2) < 0.05 + 1e-9}
)
law = StVK(young=1.4e6, poisson=0.4, density=1000.0)
system = System(flag, [law, Gravity(g=(0, -2.0))], fixed={"clamp": "xy"})
sim = Simulation(system, EnergyMomentum(dt=0.01), ledger=True)
states = [(0.0, sim.u)]
while sim.steps < 200:
    sim.step()
    states.append((sim.t, sim.u))
swing = sim.ledger
drift = np.abs(swing["closure_error"]).max() / swing["kinetic_energy"].max()

folders = Path("docs/scenes"), Path("../scenes")  # from the root, and from here
file = next(path for path in folders if path.exists()) / "flag.toml"
LOWEST = -0.063607 - 0.065160  # of the tip, published: mean minus amplitude [m]
outcomes = {}
for name in ("newmark", "energy-momentum", "backward-euler"):
    keys = [f"analysis.integrator={name}", "analysis.until=1.0", "expect={}"]
    outcomes[name] = Scene.read(file, set=keys).solve(quiet=True)
lowest = {name: out.curves["A"].values[:, 1].min() for name, out in outcomes.items()}

if __name__ == "__main__":
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation

    plt.style.use("skfem_stvk.gallery")
    figure, (energy, path) = plt.subplots(1, 2, figsize=(6, 3))
    for number, (name, outcome) in enumerate(outcomes.items()):
        shown = {"markevery": (5 * number, 15), "label": name}
        rows, tip = outcome.result.ledger, outcome.curves["A"]
        energy.plot(rows["time"], 1e3 * rows["total_energy"], **shown)
        path.plot(tip.t, 1e3 * tip.values[:, 1], **shown)
    energy.set(xlabel="time [s]", ylabel="total energy [mJ/m]")
    path.axhline(1e3 * LOWEST, color="0.5", ls=":", label="published, lowest")
    path.set(xlabel="time [s]", ylabel="tip, vertical [mm]", ylim=(-135, 65))
    path.legend(loc="upper left")
    screen, axes = plt.subplots(figsize=(6, 2.8))

    def draw(state):
        axes.clear()
        moved = flag.p + state[1].reshape(-1, 2).T
        axes.triplot(*moved, flag.t.T, "-", color="#0072B2", lw=0.5)
        axes.set(aspect="equal", xlim=(0.2, 0.65), ylim=(0.03, 0.25))
        axes.set(title=f"t = {state[0]:.2f} s", xlabel="x [m]", ylabel="y [m]")

    film = FuncAnimation(screen, draw, states[::4], interval=80)
    print(f"energy drift {drift:.0e}; lowest {1e3 * lowest['energy-momentum']:.1f} mm")
    plt.show()
