"""A robot's soft finger that looks ahead: it tries forces for ten steps, goes back to the last bit, and takes the best one.

The finger of silicone is 0.1 m long, reduced to 12 unknowns. A tendon pushes its tip across. The target jumps three times. A
controller without looking ahead, whose force is proportional to the distance, swings about the target.
"""

import numpy as np
import skfem

from skfem_stvk import LinearBackwardEuler, Rayleigh, ReducedSystem, Simulation, StVK, System

DT, HORIZON, STEPS = 2e-3, 10, 600
mesh = skfem.MeshTri.init_tensor(np.linspace(0, 0.1, 41), np.linspace(0, 0.012, 6)).with_boundaries(
    {"root": lambda x: x[0] == 0, "tip": lambda x: x[0] == 0.1}
)
silicone = StVK(young=4e5, poisson=0.45, density=1100.0, thickness=0.012, plane="stress")
finger = ReducedSystem(System(mesh, silicone, fixed={"root": "xy"}), size=12, modes=5, quiet=True)
FORCES = np.linspace(-0.3, 0.3, 25)


def target(t):
    """Return the wanted deflection of the tip [m]."""
    return (0.02, -0.01, 0.03)[min(int(t / 0.4), 2)]


def begun():
    return Simulation(finger, LinearBackwardEuler(DT), pushed=["tip"], damping=Rayleigh(alpha=2.0))


def cost(sim, force, wanted):
    """Return the squared distance from the target, summed over the steps ahead, and a price of speed at their end."""
    saved, total = sim.copy_state(), 0.0
    for _ in range(HORIZON):
        before = sim.mean("tip")[1]
        sim.step(tip=(0.0, force))
        total += (sim.mean("tip")[1] - wanted) ** 2
    speed = (sim.mean("tip")[1] - before) / DT
    sim.restore(saved)
    return total + HORIZON * (0.02 * speed) ** 2


def looking_ahead(sim, wanted):
    return FORCES[int(np.argmin([cost(sim, force, wanted) for force in FORCES]))]


def proportional(sim, wanted):
    return float(np.clip(15.0 * (wanted - sim.mean("tip")[1]), FORCES[0], FORCES[-1]))


def driven(control):
    """Return the deflections of the tip (n,) [m] and the forces (n,) [N]."""
    sim, tip, forces = begun(), [], []
    for step in range(STEPS):
        if step % 5 == 0:
            force = control(sim, target(sim.t))
        sim.step(tip=(0.0, force))
        tip.append(sim.mean("tip")[1])
        forces.append(force)
    return np.array(tip), np.array(forces)


times = DT * np.arange(1, STEPS + 1)
wanted = np.array([target(t - DT) for t in times])
paths = {control.__name__.replace("_", " "): driven(control) for control in (looking_ahead, proportional)}
miss = {name: float(np.sqrt(np.mean((tip - wanted) ** 2))) for name, (tip, _) in paths.items()}


def picture():
    import matplotlib.pyplot as plt

    figure, (above, below) = plt.subplots(2, 1, figsize=(8, 4.4), sharex=True, layout="constrained", height_ratios=(2, 1))
    above.plot(times, 1e3 * wanted, color="k", ls="--", lw=1, label="target")
    for (name, (tip, forces)), colour in zip(paths.items(), ("tab:blue", "tab:orange"), strict=True):
        above.plot(times, 1e3 * tip, color=colour, label=f"{name}: {1e3 * miss[name]:.1f} mm off on average")
        below.plot(times, forces, color=colour, lw=1)
    above.set(ylabel="deflection of the tip [mm]")
    below.set(xlabel="time [s]", ylabel="force [N]")
    above.legend(frameon=False)
    return figure


if __name__ == "__main__":
    for name, distance in miss.items():
        print(f"{name}: {1e3 * distance:.2f} mm off the target on average (root mean square)")
