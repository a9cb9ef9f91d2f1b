"""
A sheet tears
=============

A sheet with a notch is pulled until it tears. Elements are removed when their largest
principal stress exceeds a limit, so that a crack grows from the notch. The ledger
records the energy of removed elements, and the energy balance closes.
"""

import numpy as np
import skfem

from skfem_stvk import PrincipalStressLimit, Rayleigh, StVK, System
from skfem_stvk import VelocityVerlet, VolumePenalty, simulate

grid = np.linspace(0, 1.5, 31), np.linspace(0, 1, 21)
square = skfem.MeshQuad.init_tensor(*grid).to_meshtri(style="x")
inner = np.setdiff1d(np.arange(square.p.shape[1]), square.boundary_nodes())
random = np.random.default_rng(4).uniform(-1, 1, square.p.shape)
p = square.p.copy()  # on regular meshes, cracks follow the lines
p[:, inner] += 0.008 * random[:, inner]
sides = {"bottom": lambda x: x[1] == 0, "top": lambda x: x[1] == 1}
sheet = skfem.MeshTri(p, square.t).with_boundaries(sides)


def pull(t):
    """Return the displacement of the upper grip [m]: 0.2 m in 1.5 s."""
    s = min(t / 1.5, 1.0)
    return 0.2 * s**2 * (3 - 2 * s)


rubber = StVK(young=1e5, poisson=0.4, density=1e3, plane="stress", thickness=0.01)
terms, moved = [rubber, VolumePenalty(kind="compression")], {"x": 0.0, "y": pull}
system = System(sheet, terms, fixed={"bottom": "xy"}, prescribed={"top": moved})
x, y = sheet.p[:, sheet.t].mean(axis=1)
system = system.without((x < 0.3) & (np.abs(y - 0.525) < 0.02))  # the notch
strength = np.where((y < 0.1) | (y > 0.9), np.inf, 1.8e4)  # [Pa]
limit = PrincipalStressLimit(strength, every=5)

runs, t, u, v = [], 0.0, None, None
for until in (0.5, 0.62, 1.2):
    options = {"u0": u, "v0": v, "t0": t, "until": until, "reactions": {"grip": "top"}}
    options |= {"damping": Rayleigh(5.0, 2e-4), "remove": limit, "quiet": True}
    run = simulate(system, VelocityVerlet(6e-4), **options)
    runs, system, t, u, v = [*runs, run], run.system, until, run.u, run.v

time = np.concatenate([run.ledger["time"] for run in runs])
force = np.concatenate([run.ledger["reaction grip y"] for run in runs])
torn = sum(np.count_nonzero(run.removed_at > 0) for run in runs)
strongest = force.max()
most = max(run.ledger["strain_energy"].max() for run in runs)
closure = max(np.abs(run.ledger["closure_error"]).max() for run in runs) / most

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, panels = plt.subplots(1, 3, figsize=(7.6, 2.8))
    for axes, run in zip(panels, runs[::2]):
        tensor = np.ma.filled(run.state["cauchy_stress"], 0.0) / 1e3
        stress = np.linalg.eigvalsh(tensor)[:, -1]
        left = ~np.ma.getmaskarray(run.state["von_mises"])
        x, t = sheet.p + run.u.reshape(-1, 2).T, sheet.t[:, left].T
        body = axes.tripcolor(*x, t, facecolors=stress[left], vmin=0, vmax=18)
        axes.set(title=f"t = {run.t:.1f} s", aspect="equal", xlabel="x [m]")
    panels[0].set_ylabel("y [m]")
    figure.colorbar(body, ax=panels[:2], label="principal stress [kPa]", shrink=0.7)
    panels[2].plot(time, force, "-")
    panels[2].set(xlabel="time [s]", ylabel="force of the grip [N]")
    print(f"{torn} elements torn by {strongest:.1f} N; energy is off by {closure:.0e}")
    plt.show()
