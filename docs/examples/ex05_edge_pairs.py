"""
What the edge pairs do
======================

The strain energy of linear tetrahedra is a sum over edges plus a sum over pairs of
edges. The first sum alone is a network of springs. A bar is stretched with both sums
and with the edges alone: only the pairs of edges give the bar its Poisson's ratio.
"""

import numpy as np
import skfem

from skfem_stvk import EdgeNetwork, StVK, System, solve_static

LENGTH, POISSON, STRETCH = 3.0, 0.45, 1.2
across = np.linspace(0, 1, 5)
mesh = skfem.MeshTet.init_tensor(np.linspace(0, LENGTH, 13), across, across)
sides = {"left": (0, 0), "right": (0, LENGTH), "low": (1, 0), "back": (2, 0)}
mesh = mesh.with_boundaries(
    {name: lambda x, i=i, at=at: x[i] == at for name, (i, at) in sides.items()}
)
whole = EdgeNetwork.of(mesh, StVK(young=1e5, poisson=POISSON))
networks = {
    "edges and pairs": whole,
    "without adjacent pairs": whole.without("adjacent"),
    "edges alone": whole.diagonal(),
}


def stretched(network):
    """Return the displacements (nv, 3) of the bar between sliding ends."""
    fixed = [("left", "x"), ("low", "y"), ("back", "z")]
    moved = [("right", {"x": (STRETCH - 1) * LENGTH})]
    system = System(mesh, network, fixed, prescribed=moved)
    return solve_static(system, steps=2, quiet=True).u.reshape(-1, 3)


found = {name: stretched(network) for name, network in networks.items()}
widths = {name: 1 + u[mesh.p[1] == 1, 1].mean() for name, u in found.items()}
expected = np.sqrt(1 - POISSON * (STRETCH**2 - 1))  # closed form under uniaxial stress
error = abs(widths["edges and pairs"] / expected - 1)

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, panels = plt.subplots(2, 1, sharex=True, figsize=(6, 4.4))
    front = [edge for edge in mesh.edges.T if not mesh.p[2, edge].any()]
    for axes, name in zip(panels, ("edges and pairs", "edges alone")):
        x, y = mesh.p[:2] + found[name].T[:2]
        for edge in front:
            axes.plot(x[edge], y[edge], "-", color="#0072B2", lw=0.9)
        axes.axhline(expected, color="#E69F00", ls="--", label="closed form")
        axes.set(title=f"{name}: width {widths[name]:.3f} m", ylabel="y [m]")
        axes.set(aspect="equal", ylim=(-0.05, 1.1))
    panels[0].legend(loc="upper right", bbox_to_anchor=(1, 1.25))
    panels[1].set_xlabel("x [m]")
    print(f"closed form {expected:.4f} m, edges alone {widths['edges alone']:.4f} m")
    plt.show()
