"""Picture of the error of springs against Poisson's ratio: `python docs/tutorials/springs_or_elements.py`."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import skfem

from skfem_stvk import SpringNetwork, StVK, System, solve_static

BLACK, ORANGE, BLUE, GREEN = "#000000", "#D55E00", "#0072B2", "#009E73"  # of Okabe and Ito
triangle = skfem.MeshTri(np.array([[0, 1, 0.5], [0, 0, np.sqrt(3) / 2]]), np.arange(3)[:, None])
tetrahedron = skfem.MeshTet(np.array([[1.0, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]]) / np.sqrt(8), np.arange(4)[:, None])
across = np.linspace(0, 1, 5)
bar = skfem.MeshTet.init_tensor(np.linspace(0, 3, 13), across, across)
held = {lambda x: x[0] == 0: "x", lambda x: x[1] == 0: "y", lambda x: x[2] == 0: "z"}


def error(mesh, nu, **options):
    """Return the relative error of K at rest of the best springs, in the Frobenius norm."""
    exact, springs = (System(mesh, law(young=1.0, poisson=nu, **options)) for law in (StVK, SpringNetwork))
    rest = np.zeros(mesh.p.size)
    return np.linalg.norm((springs.tangent(rest) - exact.tangent(rest)).toarray()) / np.linalg.norm(exact.tangent(rest).toarray())


def contraction(term):
    """Return the lateral strain over the axial strain of a bar that is stretched by 1 %."""
    system = System(bar, term, fixed=held, prescribed={lambda x: x[0] == 3: {"x": 0.03}})
    u = solve_static(system, steps=1, quiet=True).u
    return -u[1::3][bar.p[1] == 1].mean() / 0.01


def picture(file):
    """Draw the error of the best springs on one element, and the contraction of a bar."""
    figure, (one, whole) = plt.subplots(1, 2, figsize=(6, 3.2), layout="constrained")
    nus = np.linspace(0, 0.45, 46)
    one.plot(nus, [100 * error(tetrahedron, nu) for nu in nus], color=ORANGE, ls="--", label="regular tetrahedron")
    one.plot(nus, [100 * error(triangle, nu, plane="stress") for nu in nus], color=BLUE, label="equilateral triangle")
    one.set(xlabel="Poisson's ratio", ylabel="error of the best springs [%]", ylim=(0, 70))
    nus = np.linspace(0, 0.45, 4)
    whole.plot(nus, [contraction(StVK(young=1e5, poisson=nu)) for nu in nus], "o-", color=BLACK, label="StVK")
    for rule, mark, color in (("least-squares", "s--", ORANGE), ("van-gelder", "^:", BLUE), ("lloyd", "D-.", GREEN)):
        springs = [contraction(SpringNetwork(young=1e5, poisson=nu, rule=rule)) for nu in nus]
        whole.plot(nus, springs, mark, color=color, ms=5, label=f"springs, {rule}")
    whole.set(xlabel="Poisson's ratio of the material", ylabel="contraction / extension of a bar", ylim=(0, 0.5))
    for axis in (one, whole):
        axis.legend(fontsize=8, loc="upper left", frameon=False)
        axis.tick_params(labelsize=9)
        axis.xaxis.label.set_size(9)
        axis.yaxis.label.set_size(9)
        axis.grid(color="0.9")
    figure.savefig(file, dpi=150)
    plt.close(figure)


if __name__ == "__main__":
    picture(Path(__file__).with_suffix(".png"))
