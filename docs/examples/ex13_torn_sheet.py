"""A notched sheet under tension that tears: elements are removed if their largest principal stress exceeds a limit.

The notch also consists of removed elements. The crack grows from the tip of the notch, and the force decreases. The ledger records
the energy of removed elements, so that the energy balance still closes.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import skfem

from skfem_stvk import PrincipalStressLimit, Rayleigh, StVK, System, VelocityVerlet, VolumePenalty, simulate

rng = np.random.default_rng(4)
square = skfem.MeshQuad.init_tensor(np.linspace(0, 1.5, 31), np.linspace(0, 1, 21)).to_meshtri(style="x")
inner = ((square.p > 1e-9) & (square.p < np.array([[1.5], [1.0]]) - 1e-9)).all(axis=0)
p = square.p + 0.008 * inner * rng.uniform(-1, 1, square.p.shape)  # on regular meshes, cracks follow the mesh lines
sheet = skfem.MeshTri(p, square.t).with_boundaries({"bottom": lambda x: x[1] == 0, "top": lambda x: x[1] == 1})


def pull(t):
    """Return the displacement of the upper grip [m]: 0.2 m in 1.5 s, with zero velocity at the beginning and the end."""
    s = min(t / 1.5, 1.0)
    return 0.2 * s**2 * (3 - 2 * s)


rubber = StVK(young=1e5, poisson=0.4, density=1000.0, plane="stress", thickness=0.01)
system = System(
    sheet, [rubber, VolumePenalty(kind="compression")], fixed={"bottom": "xy"}, prescribed={"top": {"x": 0.0, "y": pull}}
)
x, y = sheet.p[:, sheet.t].mean(axis=1)
system = system.without((x < 0.3) & (np.abs(y - 0.525) < 0.02))  # the notch
limit = PrincipalStressLimit(np.where((y < 0.1) | (y > 0.9), np.inf, 1.8e4), every=5)  # no removal at the grips

runs, states, u, v = [], [], None, None
for begin, end in ((0.0, 0.5), (0.5, 0.62), (0.62, 1.2)):  # the picture shows the state at each end
    options = {"u0": u, "v0": v, "t0": begin, "damping": Rayleigh(5.0, 2e-4), "reactions": {"grip": "top"}}
    run = simulate(system, VelocityVerlet(6e-4), until=end, remove=limit, quiet=__name__ != "__main__", **options)
    runs, states = [*runs, run], [*states, run.state]
    system, u, v = run.system, run.u, run.v

time, force = (np.concatenate([one.ledger[name] for one in runs]) for name in ("time", "reaction grip y"))
torn = np.count_nonzero(run.removed_at > 0) + sum(np.count_nonzero(one.removed_at > 0) for one in runs[:-1])
strongest = force.max()
closure = max(np.abs(one.ledger["closure_error"]).max() for one in runs) / max(one.ledger["strain_energy"].max() for one in runs)


def picture():
    """Draw the sheet in three states, coloured by its largest principal stress, and the force of the upper grip."""
    figure, axes = plt.subplot_mosaic(
        [["0", "1", "2"], ["force"] * 3], figsize=(11, 6.2), height_ratios=(1.6, 1), layout="constrained"
    )
    for number, (one, state) in enumerate(zip(runs, states, strict=True)):
        stress = np.linalg.eigvalsh(np.ma.filled(state["cauchy_stress"], 0.0))[:, -1]
        left = ~np.ma.getmaskarray(state["von_mises"])
        moved = sheet.p + one.u.reshape(-1, 2).T
        drawn = axes[str(number)].tripcolor(
            *moved, sheet.t[:, left].T, facecolors=stress[left] / 1e3, vmin=0, vmax=18, cmap="viridis"
        )
        axes[str(number)].set(aspect="equal", title=f"t = {one.t:.2f} s", xlim=(-0.1, 1.6), ylim=(-0.05, 1.35))
        axes[str(number)].set_axis_off()
    figure.colorbar(drawn, ax=axes["2"], label="largest principal stress [kPa]")
    axes["force"].plot(time, force, lw=1)
    axes["force"].set(xlabel="t [s]", ylabel="force of the upper grip [N]")
    return figure


if __name__ == "__main__":
    print(run)
    print(f"{torn} elements tear; at most {strongest:.1f} N; energies add up but for {closure:.1e} of the strain energy.")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=90)
