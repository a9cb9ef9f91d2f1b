"""The energy of finite elements has a sum over edges, which are springs, and a sum over pairs of edges: effects of each sum.

    W = 1/4 sum_i L_ii zeta_i^2  +  1/2 sum_{pairs i < j} L_ij zeta_i zeta_j        zeta = |p|^2 - |P|^2 of an edge

The first sum is a network of (quartic) springs. The second sum is over pairs of edges of the same tetrahedron: adjacent pairs share
a vertex, opposite pairs do not. With both sums, a stretched bar becomes thinner according to Poisson's ratio. With springs alone,
the lateral contraction depends on the mesh, and no choice of the springs changes it to another value.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import skfem

from skfem_stvk import EdgeNetwork, StVK, System, solve_static

LENGTH, YOUNG, POISSON, STRETCH = 3.0, 1e5, 0.45, 1.2
across = np.linspace(0, 1, 5)
mesh = skfem.MeshTet.init_tensor(np.linspace(0, LENGTH, 13), across, across).with_boundaries(
    {"left": lambda x: x[0] == 0, "right": lambda x: x[0] == LENGTH, "low": lambda x: x[1] == 0, "back": lambda x: x[2] == 0}
)
whole = EdgeNetwork.of(mesh, StVK(young=YOUNG, poisson=POISSON))
networks = {"edges and pairs": whole, "without adjacent pairs": whole.without("adjacent"), "edges alone": whole.diagonal()}


def pulled(network):
    """Return the bar between sliding ends, stretched to `STRETCH` times its length."""
    fixed = [("left", "x"), ("low", "y"), ("back", "z")]
    system = System(mesh, network, fixed, prescribed=[("right", {"x": (STRETCH - 1) * LENGTH})])
    return solve_static(system, steps=2, quiet=True)


def width(found):
    """Return the mean width of the stretched bar along y."""
    top = mesh.p[1] == 1
    return 1 + found.u.reshape(-1, 3)[top, 1].mean()


found = {name: pulled(network) for name, network in networks.items()}
widths = {name: width(one) for name, one in found.items()}
expected = np.sqrt(1 - POISSON * (STRETCH**2 - 1))  # closed form: a St. Venant-Kirchhoff bar under uniaxial stress
error = abs(widths["edges and pairs"] / expected - 1)

u = found["edges and pairs"].u
energies = {
    "edges": System(mesh, whole.diagonal()).energy(u),
    "adjacent pairs": System(mesh, whole.without("opposite")).energy(u) - System(mesh, whole.diagonal()).energy(u),
    "opposite pairs": System(mesh, whole.without("adjacent")).energy(u) - System(mesh, whole.diagonal()).energy(u),
}
shares = {name: energy / System(mesh, whole).energy(u) for name, energy in energies.items()}


def picture():
    """Draw the end of the bar for each network, viewed along its axis, and the shares of the energy."""
    figure, (shape, parts) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    end = mesh.p[0] == LENGTH
    y, z = mesh.p[1:, end]
    outline = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
    shape.plot(*outline.T, color="0.6", label="at rest")
    shape.plot(*(expected * outline).T, color="0.2", ls="--", label="closed form")
    for (name, one), colour in zip(found.items(), ("#0072B2", "#009E73", "#E69F00"), strict=True):
        moved = one.u.reshape(-1, 3)[end]
        shape.plot(y + moved[:, 1], z + moved[:, 2], "o", ms=4, color=colour, label=name)
    shape.set(aspect="equal", xlabel="y [m]", ylabel="z [m]", title=f"cross-section of a bar stretched to {STRETCH}")
    shape.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
    parts.bar(list(shares), list(shares.values()), color=("#E69F00", "#56B4E9", "#D55E00"))
    parts.axhline(0, color="0.3", lw=0.8)
    parts.set(ylabel="part of the strain energy", title="what the halves of the sum carry")
    return figure


if __name__ == "__main__":
    for name, one in widths.items():
        print(f"{name}: width {one:.5f} m, closed form {expected:.5f} m")
    print(", ".join(f"{share:.0%} of the energy in {name}" for name, share in shares.items()))
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=110)
