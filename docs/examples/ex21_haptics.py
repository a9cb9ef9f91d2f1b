"""A hand that moves the end of a soft bar: a thousand responses in one second, from a table of static solves.

The end of the bar is the handle. The static solves on a grid of its displacements are computed once. Interpolation in the table
then gives the force and the displacements of all nodes for each position of the hand. Static solves at eight moments of the motion,
which are not in the table, give the error.
"""

from pathlib import Path

import numpy as np

from skfem_stvk import BodyForce, PrecomputedResponse, StVK, System, solve_static
from skfem_stvk.mesh import box

mesh = box(size=(3.0, 1.0), cells=(18, 6))
terms = [StVK(young=1e4, poisson=0.4), BodyForce((0, -20.0))]
body = System(mesh, terms, fixed={"left": "xy"})
grid = np.linspace(-0.1, 0.6, 6), np.linspace(-1.0, 1.0, 9)
answers = PrecomputedResponse(body, handle="right", displacements=grid, quiet=True)

seconds = np.linspace(0, 1, 1001)  # a thousand responses, one per millisecond
hand = np.stack(
    [0.25 + 0.3 * np.sin(2 * np.pi * seconds), 0.9 * np.sin(4 * np.pi * seconds)],
    axis=1,
)
forces = np.array([answers(place)[0] for place in hand])
work = float(
    np.sum((forces[1:] + forces[:-1]) / 2 * np.diff(hand, axis=0))
)  # zero for a closed path of the hand

moments = np.arange(62, 1000, 125)


def solved(place):
    """Return the force at a position of the hand and the displacements by a static solve."""
    found = solve_static(
        System(
            mesh, terms, {"left": "xy"}, {"right": dict(zip("xy", place, strict=True))}
        ),
        quiet=True,
    )
    return found.reaction("right").resultant, found.u


checked = [solved(hand[k]) for k in moments]
largest = np.linalg.norm(forces, axis=1).max()
error = (
    max(
        np.linalg.norm(forces[k] - force)
        for k, (force, _) in zip(moments, checked, strict=True)
    )
    / largest
)


def picture():
    """Draw the bar at two moments of the motion, and the force over time with the results of the solves."""
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.6), layout="constrained")
    shape, force = figure.subplots(1, 2)
    end = np.array([3.0, 0.5])
    shape.plot(*(hand + end).T, color="0.6", lw=1, label="way of the hand")
    for k, colour in zip(moments[[1, 6]], ("#E69F00", "#009E73"), strict=True):
        u = answers(hand[k])[1].reshape(-1, 2)
        shape.add_collection(
            PolyCollection((mesh.p.T + u)[mesh.t.T], fc="none", ec=colour, lw=0.5)
        )
        shape.annotate(
            "",
            hand[k] + end + forces[k] / 5000,
            hand[k] + end,
            arrowprops={
                "arrowstyle": "-|>",
                "color": colour,
                "lw": 2.5,
                "shrinkA": 0,
                "shrinkB": 0,
            },
        )
        force.axvline(seconds[k], color=colour, lw=0.8)
    shape.set(
        aspect="equal",
        xlabel="x [m]",
        ylabel="y [m]",
        title="the bar at two moments, and the force of the hand",
    )
    shape.set_xlim(-0.1, 4.3)
    shape.legend(loc="upper left", fontsize=8)
    for c, (letter, colour) in enumerate(
        zip("xy", ("#0072B2", "#D55E00"), strict=True)
    ):
        force.plot(
            seconds, forces[:, c], color=colour, label=f"along {letter}, from the table"
        )
        force.plot(
            seconds[moments],
            [one[c] for one, _ in checked],
            "o",
            color=colour,
            ms=4,
            label=f"along {letter}, static solves",
        )
    force.set(
        xlabel="time [s]",
        ylabel="force per metre of depth [N/m]",
        title=f"wrong by {error:.0e} of the largest force at most",
    )
    force.legend(fontsize=8)
    return figure


if __name__ == "__main__":
    print(answers)
    print(
        f"on the way of the hand: wrong by {error:.1e} of the largest force; work left over {work:.2e} J/m"
    )
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=110)
