"""Picture of the edges of one tetrahedron and of its pairs of edges: `python docs/topics/edge_pairs.py`."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import skfem

from skfem_stvk import ElementMesh, StVK

BLACK, ORANGE, BLUE = "#000000", "#D55E00", "#0072B2"  # of Okabe and Ito
regular = skfem.MeshTet(np.array([[1.0, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]]) / np.sqrt(8), np.arange(4)[:, None])
form = StVK(young=1.0, poisson=0.3).bind(ElementMesh.of(regular)).form
shown = np.array([[0.0, 0.62, 0.45, 1.1], [0.2, 0.0, 1.0, 0.45]])  # vertices of the drawing
panels = {
    "6 edges": [],
    f"{form.adjacent.sum()} adjacent pairs": [0, 1],
    f"{(~form.adjacent).sum()} opposite pairs": [0, 5],
}


def picture(file):
    """Draw the edges of a tetrahedron, an adjacent pair and an opposite pair with their coefficients."""
    figure, axes = plt.subplots(1, 3, figsize=(6, 2.5), layout="constrained")
    for axis, (title, pair) in zip(axes, panels.items(), strict=True):
        for i, edge in enumerate(form.edges.T):
            color = (ORANGE, BLUE)[pair.index(i)] if i in pair else "0.45"
            axis.plot(*shown[:, edge], "-" if i in pair or tuple(edge) != (0, 3) else "--", color=color, lw=4 if i in pair else 1.3)
            if i in pair or not pair:
                at = shown[:, edge] @ ((0.7, 0.3) if tuple(edge) == (0, 3) else (0.5, 0.5))
                name = f"$\\zeta_{{{edge[0]}{edge[1]}}}$"
                axis.text(*at, name, ha="center", va="center", bbox={"fc": "w", "ec": "none", "pad": 0.8})
        axis.plot(*shown, "o", color=BLACK, ms=4)
        for a, (x, y) in enumerate(shown.T):
            axis.annotate(str(a), (x, y), ((-9, -4), (5, -6), (0, 4), (6, 2))[a], textcoords="offset points", fontsize=9)
        numbers = f"$L_{{ij}} = {form.L[tuple(pair)]:.3f}$" if pair else f"$L_{{ii}} = {form.L[0, 0]:.3f}$"
        axis.set(title=title, xlabel=numbers, aspect="equal", xticks=[], yticks=[], xlim=(-0.12, 1.24), ylim=(-0.1, 1.14))
        axis.title.set_fontsize(9)
        axis.spines[:].set_visible(False)
    figure.savefig(file, dpi=150)
    plt.close(figure)


if __name__ == "__main__":
    picture(Path(__file__).with_suffix(".png"))
