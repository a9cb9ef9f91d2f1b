"""
Seven integrators spin a body
=============================

A soft plate spins and vibrates in free flight, so that its energy and its angular
momentum are constant. The energy-momentum method conserves both to round-off. Backward
Euler and its linear form lose energy, and their errors are of first order in the step.
"""

from datetime import date
from time import process_time

import numpy as np

from skfem_stvk import BackwardEuler, EnergyMomentum, ForwardEuler, GeneralizedAlpha
from skfem_stvk import LinearBackwardEuler, Newmark, StVK, System, VelocityVerlet
from skfem_stvk import simulate
from skfem_stvk.about import machine
from skfem_stvk.mesh import box

mesh = box(size=(0.4, 0.1), cells=(16, 4))
plate = System(mesh, StVK(young=2e5, poisson=0.3, density=1000.0))
x, y = mesh.p - mesh.p.mean(axis=1, keepdims=True)
v0 = np.stack([-10 * y, 10 * x + np.cos(2 * np.pi * x / 0.4)], axis=1)  # [m/s]
v0 -= plate.mass().vertex @ v0 / plate.mass().vertex.sum()


def flight(integrator):
    """Return the motion in 0.125 s and its processor time [s]."""
    begin = process_time()
    run = simulate(plate, integrator, until=0.125, v0=v0.ravel(), quiet=True)
    return run, process_time() - begin


explicit = (ForwardEuler, VelocityVerlet)
implicit = (LinearBackwardEuler, BackwardEuler, Newmark, GeneralizedAlpha)
steps = dict.fromkeys(explicit, (5e-4, 2.5e-4, 1.25e-4))
steps |= dict.fromkeys((*implicit, EnergyMomentum), (5e-3, 2.5e-3, 1.25e-3))
exact = flight(VelocityVerlet(4e-5))[0].u
runs, cost, error, energy, momentum = {}, {}, {}, {}, {}
for method in steps:
    name, flights = method.__name__, [flight(method(dt)) for dt in steps[method]]
    runs[name] = flights[-1][0].ledger
    cost[name] = [seconds for _, seconds in flights]
    error[name] = [np.abs(run.u - exact).max() for run, _ in flights]  # [m]
    total, spin = runs[name]["total_energy"], runs[name]["angular_momentum_z"]
    energy[name], momentum[name] = total / total[0], spin / spin[0] - 1

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, panels = plt.subplots(1, 3, figsize=(6.8, 3.8))
    for name, ledger in runs.items():
        t = 1e3 * ledger["time"]
        panels[0].plot(t, energy[name], markevery=0.2, lw=1, label=name)
        panels[1].plot(t, 100 * momentum[name], markevery=0.2, lw=1)
        panels[2].loglog(cost[name], error[name], lw=1)
    panels[2].loglog([0.5, 2], [1e-3, 1e-3 / 16], "k:", label="time$^{-2}$")
    panels[0].set(xlabel="time [ms]", ylabel="total energy / first")
    panels[1].set(xlabel="time [ms]", ylabel="change of angular momentum [%]")
    panels[2].set(xlabel="processor time [s]", ylabel="error at the end [m]")
    panels[2].tick_params(axis="x", which="minor", labelbottom=False)
    figure.legend(loc="outside lower center", ncols=4)
    where = f"{machine()['processor']}, one run, {date.today()}"
    panels[2].set_title(where, size=6)
    for name in ("BackwardEuler", "EnergyMomentum"):
        print(f"{name} changes the energy by {abs(energy[name][-1] - 1):.0e}")
    plt.show()
