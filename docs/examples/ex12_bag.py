"""
A bag on four ropes
===================

A soft ball hangs in a bag of cloth on four ropes: tetrahedra, membranes and cables
share nodes, and each term has its own elements. The cloth distributes the forces of the
ropes. The ropes pull at their hooks with the weight of all parts.
"""

import numpy as np
import skfem

from skfem_stvk import ElementMesh, Gravity, StVK, System, solve_static

RADIUS, G = 0.3, 9.81
ball = ElementMesh.of(skfem.MeshTet.init_ball(3))
hooks = 0.6 * np.array([[-1, -1, 1, 1], [-1, 1, -1, 1], [1.4, 1.4, 1.4, 1.4]])
points = np.concatenate([RADIUS * ball.p, hooks], axis=1)
held = [int(np.argmax(towards @ ball.p)) for towards in hooks.T]
ropes = np.array([held, range(ball.nv, ball.nv + 4)])

filling = StVK(young=2e4, poisson=0.45, density=300.0, simplices=ball.t)
skin = {"thickness": 5e-4, "density": 900.0, "simplices": ball.surface}
cloth = StVK(young=2e7, poisson=0.3, **skin)
rope = StVK(young=1e9, area=2e-5, density=1000.0, simplices=ropes)


def hung(*terms):
    """Return the equilibrium of the ball with these terms, suspended from the hooks."""
    fixed = {tuple(range(ball.nv, ball.nv + 4)): "xyz"}
    system = System(points, [*terms, Gravity(g=(0, 0, -G))], fixed=fixed)
    return solve_static(system, steps=4, quiet=True)


bag, bare = hung(filling, cloth, rope), hung(filling, rope)
weight = bag.system.mass().total * G
pulled = bag.reaction().resultant[2]


def dent(result):
    """Return the mean displacement at the ropes relative to that of the ball [m]."""
    u = result.u.reshape(-1, 3)
    return float(np.linalg.norm(u[held] - u[: ball.nv].mean(axis=0), axis=1).mean())


if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, panels = plt.subplots(1, 2, sharey=True, figsize=(6, 3.4))
    for axes, name, result in zip(panels, ("bag", "no bag"), (bag, bare)):
        u = result.u.reshape(-1, 3)
        x, y, z = points + u.T
        front = ball.surface[:, y[ball.surface].mean(axis=0) < 0].T
        middle = [[x[: ball.nv].mean()], [0], [z[: ball.nv].mean()]]
        size = 1e3 * (np.linalg.norm(points + u.T - middle, axis=0) - RADIUS)
        look = {"shading": "gouraud", "vmin": -10, "vmax": 30}
        body = axes.tripcolor(x, z, size, triangles=front, **look)
        axes.plot(x[ropes], z[ropes], "k-", lw=1)
        axes.set(title=f"{name}: pulled out by {1e3 * dent(result):.0f} mm")
        axes.set(aspect="equal", xlabel="x [m]")
    panels[0].set_ylabel("z [m]")
    figure.colorbar(body, ax=panels, label="distance from the sphere [mm]", shrink=0.7)
    print(f"The ropes pull with {pulled:.4f} N; the weight is {weight:.4f} N.")
    plt.show()
