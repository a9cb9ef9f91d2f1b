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

square = skfem.MeshQuad.init_tensor(np.linspace(0, 1.5, 31), np.linspace(0, 1, 21))
square = square.to_meshtri(style="x")
random = np.random.default_rng(4).uniform(-0.008, 0.008, square.p.shape)
random[:, square.boundary_nodes()] = 0.0
p = square.p + random  # on regular meshes, cracks follow the lines
sides = {"bottom": lambda x: x[1] == 0, "top": lambda x: x[1] == 1}
sheet = skfem.MeshTri(p, square.t).with_boundaries(sides)


def pull(t):
    """Return the displacement of the upper grip [m]: 0.2 m in 1.5 s."""
    return 0.2 * (t / 1.5) ** 2 * (3 - t / 0.75)


rubber = StVK(young=1e5, poisson=0.4, density=1e3, plane="stress", thickness=0.01)
terms, moved = [rubber, VolumePenalty(kind="compression")], {"x": 0.0, "y": pull}
system = System(sheet, terms, fixed={"bottom": "xy"}, prescribed={"top": moved})
x, y = sheet.p[:, sheet.t].mean(axis=1)
system = system.without((x < 0.3) & (np.abs(y - 0.525) < 0.02))  # the notch
strength = np.where((y < 0.1) | (y > 0.9), np.inf, 1.8e4)  # [Pa]
options = {"remove": PrincipalStressLimit(strength, every=5), "until": 0.06}
options |= {"damping": Rayleigh(5.0, 2e-4), "reactions": {"grip": "top"}, "quiet": True}
runs = [simulate(system, VelocityVerlet(6e-4), **options)]
while (run := runs[-1]).t < 1.2 - 1e-9:
    options |= {"u0": run.u, "v0": run.v, "t0": run.t, "until": run.t + 0.06}
    runs.append(simulate(run.system, VelocityVerlet(6e-4), **options))

time = np.concatenate([run.ledger["time"] for run in runs])
force = np.concatenate([run.ledger["reaction grip y"] for run in runs])
torn = sum(np.count_nonzero(run.removed_at > 0) for run in runs)
most = max(run.ledger["strain_energy"].max() for run in runs)
closure = max(np.abs(run.ledger["closure_error"]).max() for run in runs) / most

if __name__ == "__main__":
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation

    plt.style.use("skfem_stvk.gallery")
    figure, panels = plt.subplots(1, 3, figsize=(6.8, 2.8))

    def draw(run, axes):
        tensor = np.ma.filled(run.state["cauchy_stress"], 0.0) / 1e3
        stress = np.linalg.eigvalsh(tensor)[:, -1]
        left = ~np.ma.getmaskarray(run.state["von_mises"])
        x, t = sheet.p + run.u.reshape(-1, 2).T, sheet.t[:, left].T
        axes.clear()
        axes.set(title=f"t = {run.t:.2f} s", aspect="equal", xlabel="x [m]")
        axes.set(xlim=(-0.1, 1.6), ylim=(-0.1, 1.3), ylabel="y [m]")
        return axes.tripcolor(*x, t, facecolors=stress[left], vmin=0, vmax=18)

    body = [draw(run, axes) for run, axes in zip((runs[7], run), panels)][-1]
    figure.colorbar(body, ax=panels[:2], label="principal stress [kPa]", shrink=0.7)
    panels[2].plot(time, force, "-")
    panels[2].set(xlabel="time [s]", ylabel="force of the grip [N]")
    screen, moving = plt.subplots(figsize=(5, 4))
    film = FuncAnimation(screen, draw, runs, fargs=(moving,), interval=200)
    print(f"{torn} elements torn by {force.max():.1f} N; energy off by {closure:.0e}")
    plt.show()
