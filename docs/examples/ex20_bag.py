"""A bag that hangs on four ropes: tetrahedra, membranes and cables on shared nodes, each term with its own elements.

A soft ball is in a bag of cloth, which is the surface of the ball. The cloth distributes the forces of the ropes; without cloth the
ball has large local deformations at the ropes. The forces at the hooks equal the weight of ball, cloth and ropes. The tension of
each rope follows from its stretch.
"""

from pathlib import Path

import numpy as np
import skfem

from skfem_stvk import ElementMesh, Gravity, StVK, System, solve_static

RADIUS, G = 0.3, 9.81
ball = ElementMesh.of(skfem.MeshTet.init_ball(3))
hooks = np.array([[-1, -1, 1, 1], [-1, 1, -1, 1], [1.4, 1.4, 1.4, 1.4]]) * 0.6
points = np.concatenate([RADIUS * ball.p, hooks], axis=1)
held = [int(np.argmax(towards @ ball.p)) for towards in hooks.T]
ropes = np.array([held, range(ball.nv, ball.nv + 4)])

filling = StVK(young=2e4, poisson=0.45, density=300.0, simplices=ball.t)
cloth = StVK(young=2e7, poisson=0.3, thickness=5e-4, density=900.0, simplices=ball.surface)
rope = StVK(young=1e9, area=2e-5, density=1000.0, simplices=ropes)


def hung(*terms):
    """Return the equilibrium of the ball with these terms, suspended from the hooks."""
    fixed = {tuple(range(ball.nv, ball.nv + 4)): "xyz"}
    return solve_static(System(points, [*terms, Gravity(g=(0, 0, -G))], fixed=fixed), steps=4, quiet=True)


bag, bare = hung(filling, cloth, rope), hung(filling, rope)
weight = bag.system.mass().total * G
pulled = bag.reaction().resultant[2]


def tension(result):
    """Return the tension of each rope [N] from its stretch s: `E A (s^3 - s)/2`."""
    x = points + result.u.reshape(-1, 3).T
    s = np.linalg.norm(x[:, ropes[1]] - x[:, ropes[0]], axis=0) / np.linalg.norm(points[:, ropes[1]] - points[:, ropes[0]], axis=0)
    return 1e9 * 2e-5 * (s**3 - s) / 2


def dent(result):
    """Return the mean displacement of the nodes at the ropes relative to the mean of the ball [m]."""
    u = result.u.reshape(-1, 3)
    return float(np.linalg.norm(u[held] - u[: ball.nv].mean(axis=0), axis=1).mean())


def picture():
    """Draw the bag on its ropes, coloured by the stress of the cloth and the ball."""
    figure = bag.plot("von_mises_stress")
    figure.axes[0].set(xlim=(-0.7, 0.7), ylim=(-0.45, 0.85))  # on the screen [m], without the upper ends of the ropes
    return figure


if __name__ == "__main__":
    print(f"The ropes pull {tension(bag).round(3)} N each; at their hooks {pulled:.4f} N upwards, of a weight of {weight:.4f} N.")
    print(f"Where they hold it, the ball is pulled out by {1e3 * dent(bag):.1f} mm, without its bag by {1e3 * dent(bare):.1f} mm.")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=80)
