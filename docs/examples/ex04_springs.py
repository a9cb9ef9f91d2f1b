"""
Springs fit one Poisson's ratio
===============================

A cantilever of equilateral triangles in plane stress bends under its weight, and so
does a network of springs on its edges. The springs have the least-squares stiffness.
Their deflection is right at a Poisson's ratio of 1/3 and wrong at any other.
"""

import numpy as np

from skfem_stvk import BodyForce, ElementMesh, SpringNetwork, StVK, System, solve_static

columns, rows, side = 40, 6, 0.25
i, j = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1), indexing="ij")
p = side * np.stack([(i + j % 2 / 2).ravel(), (np.sqrt(3) / 2 * j).ravel()])
a, odd = (i * (rows + 1) + j)[:-1, :-1], j[:-1, :-1] % 2
b, c, d = a + rows + 1, a + 1, a + rows + 2  # to the right, above, and diagonally
lower, upper = (
    np.stack([a, b, np.where(odd, d, c)]),
    np.stack([np.where(odd, a, b), d, c]),
)
mesh = ElementMesh(p, np.concatenate([lower, upper], axis=1).reshape(3, -1))
wall = {tuple(np.flatnonzero(i.ravel() == 0)): "xy"}


def bent(body):
    """Return the displacements (nv, 2) of the beam under its weight."""
    system = System(mesh, [body, BodyForce((0, -500.0))], fixed=wall)
    return solve_static(system, steps=5, quiet=True).u.reshape(-1, 2)


states = {}
for nu in (0.0, 1 / 3, 0.49):
    law = StVK(young=1e6, poisson=nu, plane="stress")
    springs = SpringNetwork(law.material, rule="least-squares", plane="stress")
    states[nu] = bent(law), bent(springs)
sags = {nu: tuple(-u[:, 1].min() for u in pair) for nu, pair in states.items()}

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, (shape, difference) = plt.subplots(1, 2, figsize=(6, 2.8))
    for u, colour, name in zip(
        states[0.0], ("#0072B2", "#E69F00"), ("StVK", "springs")
    ):
        line = shape.triplot(*(p + u.T), mesh.t.T, "-", color=colour, lw=0.5)[0]
        line.set_label(name)
    shape.set(title="Poisson's ratio 0", aspect="equal", xlabel="x [m]", ylabel="y [m]")
    shape.legend(loc="lower left")
    middle = j.ravel() == rows // 2
    for nu, (u, v) in states.items():
        difference.plot(
            p[0, middle], (v - u)[middle, 1], markevery=5, label=f"ratio {nu:.2f}"
        )
    difference.set(xlabel="x at rest [m]", ylabel="springs above StVK [m]")
    difference.legend()
    ratios = ", ".join(f"{sags[nu][1] / sags[nu][0]:.3f} at {nu:.2f}" for nu in sags)
    print(f"deflection of springs over that of StVK: {ratios}")
    plt.show()
