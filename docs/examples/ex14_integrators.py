"""
Seven integrators spin a body
=============================

A soft plate spins and vibrates in free flight, so that its energy and its angular
momentum are constant. The energy-momentum method conserves both to round-off. Backward
Euler and its linear form lose energy, and their errors are of first order in the step.
"""

from time import perf_counter

import numpy as np

from skfem_stvk import BackwardEuler, EnergyMomentum, ForwardEuler, GeneralizedAlpha
from skfem_stvk import (
    LinearBackwardEuler,
    Newmark,
    StVK,
    System,
    VelocityVerlet,
    simulate,
)
from skfem_stvk.mesh import box

mesh = box(size=(0.4, 0.1), cells=(16, 4))
plate = System(mesh, StVK(young=2e5, poisson=0.3, density=1000.0))
x, y = mesh.p - mesh.p.mean(axis=1, keepdims=True)
v0 = np.stack([-10 * y, 10 * x + np.cos(2 * np.pi * x / 0.4)], axis=1)  # [m/s]
v0 -= plate.mass().vertex @ v0 / plate.mass().vertex.sum()


def flight(integrator):
    """Return the motion in 0.25 s and the time that it takes [s]."""
    begin = perf_counter()
    run = simulate(plate, integrator, until=0.25, v0=v0.ravel(), quiet=True)
    return run, perf_counter() - begin


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
    size = np.abs(exact).max()
    error[name] = [np.abs(run.u - exact).max() / size for run, _ in flights]
    total, spin = runs[name]["total_energy"], runs[name]["angular_momentum_z"]
    energy[name], momentum[name] = total / total[0], spin / spin[0] - 1

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, panels = plt.subplots(1, 3, figsize=(7.6, 3.8))
    for name, ledger in runs.items():
        t = 1e3 * ledger["time"]
        panels[0].plot(t, energy[name], markevery=0.2, lw=1, label=name)
        panels[1].plot(t, 100 * momentum[name], markevery=0.2, lw=1)
        panels[2].loglog(cost[name], error[name], lw=1)
    panels[2].loglog([3, 12], [0.03, 0.03 / 16], "k:", label="time$^{-2}$")
    panels[0].set(xlabel="time [ms]", ylabel="total energy / first")
    panels[1].set(xlabel="time [ms]", ylabel="change of angular momentum [%]")
    panels[2].set(xlabel="time of the run [s]", ylabel="relative error at the end")
    figure.legend(loc="outside lower center", ncols=4)
    lost = {name: 1 - values[-1] for name, values in energy.items()}
    print("lost energy:", ", ".join(f"{name} {lost[name]:.0e}" for name in lost))
    plt.show()
