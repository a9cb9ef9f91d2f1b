"""A cantilever of equilateral triangles in plane stress, and the same with springs: springs are correct only at nu = 1/3.

`compare_networks` reports the error before any solve: without pairs of edges, springs represent only one Poisson's ratio.
"""

from pathlib import Path

import numpy as np

from skfem_stvk import BodyForce, ElementMesh, SpringNetwork, StVK, System, compare_networks, solve_static

columns, rows, side = 40, 6, 0.25
i, j = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1), indexing="ij")
p = side * np.stack([(i + j % 2 / 2).ravel(), (np.sqrt(3) / 2 * j).ravel()])
a, odd = (i * (rows + 1) + j)[:-1, :-1], j[:-1, :-1] % 2
b, c, d = a + rows + 1, a + 1, a + rows + 2  # neighbours to the right, above, and diagonally
t = np.concatenate([np.stack([a, b, np.where(odd, d, c)]), np.stack([np.where(odd, a, b), d, c])], axis=1).reshape(3, -1)
mesh = ElementMesh(p, t)
wall = {tuple(np.flatnonzero(i.ravel() == 0)): "xy"}


def bent(body):
    """Return the displacements of the beam under its weight, and the deflection of its tip [m]."""
    result = solve_static(System(mesh, [body, BodyForce((0, -500.0))], fixed=wall), steps=5, quiet=True)
    return result.u, -result.u[1::2].min()


sags, states = {}, {}
for nu in (0.0, 1 / 3, 0.49):
    law = StVK(young=1e6, poisson=nu, plane="stress")
    springs = SpringNetwork(law.material, rule="least-squares", plane="stress")
    (u, elastic), (v, sprung) = bent(law), bent(springs)
    sags[nu], states[nu] = (elastic, sprung), (u, v)
    if __name__ == "__main__":
        print(f"nu = {nu:.2f}: the tip sags by {elastic:.3f} m, that of springs by {sprung:.3f} m")
        print(compare_networks(mesh, law, u), end="\n\n")


def picture():
    """Draw both beams for the three Poisson's ratios."""
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 2.9), layout="constrained")
    styles = {"fc": "#56B4E9", "ec": "none", "label": "StVK"}, {"fc": "none", "ec": "#D55E00", "lw": 0.5, "label": "springs"}
    for axes, (nu, both) in zip(figure.subplots(1, 3, sharex=True, sharey=True), states.items(), strict=True):
        for u, style in zip(both, styles, strict=True):
            axes.add_collection(PolyCollection((mesh.p.T + u.reshape(-1, 2))[mesh.t.T], **style))
        elastic, sprung = sags[nu]
        axes.set(title=f"nu = {nu:.2f}\nsag {elastic:.2f} m, of springs {sprung:.2f} m", aspect="equal", xlabel="x [m]")
    figure.axes[0].set_ylabel("y [m]")
    figure.axes[0].legend(loc="lower left", fontsize=8)
    return figure


if __name__ == "__main__":
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=110)
