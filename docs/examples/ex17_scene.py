"""One scene, three integrators: Turek and Hron's flag from its file, with other values put in by their keys.

The scene is the one that `skfem-stvk solve docs/scenes/flag.toml` solves. Newmark's method and the energy-momentum method keep the
energy of the flag, which swings to where Turek and Hron found it; backward Euler loses energy, and does not get as far.
"""

from pathlib import Path

import matplotlib.pyplot as plt

from skfem_stvk import Scene

FLAG = Path(__file__).parent.parent / "scenes" / "flag.toml"
INTEGRATORS = ("newmark", "energy-momentum", "backward-euler")
LOWEST = -0.063607 - 0.065160  # mean and amplitude of the tip that Turek and Hron published [m]


def swing(integrator):
    """The flag's first swing and back."""
    return Scene.read(FLAG, set=[f"analysis.integrator={integrator}", "analysis.until=1.0", "expect={}"]).solve(quiet=True)


outcomes = {integrator: swing(integrator) for integrator in INTEGRATORS}
lowest = {integrator: float(outcome.curves["A"].values[:, 1].min()) for integrator, outcome in outcomes.items()}


def picture():
    """The tip over time, beside the lowest point that was published."""
    figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
    for (integrator, outcome), line in zip(outcomes.items(), ("-", "--", "-"), strict=True):
        curve = outcome.curves["A"]
        axes.plot(curve.t, 1e3 * curve.values[:, 1], line, label=integrator)
    axes.axhline(1e3 * LOWEST, color="0.5", linestyle=":", label="Turek and Hron, lowest")
    axes.set(xlabel="time [s]", ylabel="tip, vertical [mm]")
    axes.legend()
    return figure


if __name__ == "__main__":
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=150)
    print({integrator: round(1e3 * value, 2) for integrator, value in lowest.items()})
