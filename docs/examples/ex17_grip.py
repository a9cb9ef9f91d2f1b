"""
A gripper lifts a ball
======================

Two soft fingers close on a ball and lift it by 20 mm. Contact between the bodies has
friction, which carries the ball. A ball that sticks still slips, slower than
`slip_speed`.
"""

import numpy as np
import skfem

from skfem_stvk import BackwardEuler, Friction, Gravity, MeshContact, NeoHookean
from skfem_stvk import System, simulate

R, GAP = 0.02, 2e-4
WIDE = R + GAP + 0.01
side = np.linspace(-0.012, 0.012, 4)
ball = skfem.MeshTet.init_ball(2).scaled(R)
finger = skfem.MeshTet.init_tensor(np.linspace(0, 0.01, 3), side, side)
mesh = ball + finger.translated((R + GAP, 0, 0)) + finger.translated((-WIDE, 0, 0))
parts = {"left": lambda x: x[0] < -R, "right": lambda x: x[0] > R}
parts["ball"] = lambda x: np.linalg.norm(x, axis=0) < R
nails = {"left nail": lambda x: np.isclose(x[0], -WIDE)}
nails["right nail"] = lambda x: np.isclose(x[0], WIDE)
mesh = mesh.with_subdomains(parts).with_boundaries(nails)


def moved(sign):
    """Return the displacement of a nail: 3 mm towards the ball, then 20 mm up."""
    closing = lambda x, t: sign * 0.003 * np.clip(t / 0.02, 0, 1)
    rising = lambda x, t: 0.02 * np.clip((t - 0.02) / 0.06, 0, 1)
    return {"x": closing, "y": 0.0, "z": rising}


friction = Friction(0.6, slip_speed=0.02)
terms = [NeoHookean(young=1e5, poisson=0.4, density=1e3, region="ball")]
for name in ("left", "right"):
    terms.append(NeoHookean(young=4e4, poisson=0.3, density=1e3, region=name))
    terms.append(MeshContact(name, "ball", distance=5e-4, friction=friction, name=name))
terms.append(Gravity((0, 0, -9.81)))
hand = System(mesh, terms, prescribed={"left nail": moved(1), "right nail": moved(-1)})
run = simulate(hand, BackwardEuler(dt=2e-3), until=0.12, quiet=True)

of_ball = np.unique(mesh.t[:, mesh.subdomains["ball"]])
height = float(run.u.reshape(-1, 3)[of_ball, 2].mean())
weight = 9.81 * float(hand.mass().vertex[of_ball].sum())
grip = -float(run.contact("left").resultant[0])

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, panels = plt.subplots(1, 2, sharex=True, sharey=True, figsize=(6, 3.4))
    faces = hand.mesh.surface[:, (mesh.p[1, hand.mesh.surface] <= 1e-9).any(axis=0)]
    for axes, u, time in zip(panels, (0 * run.u, run.u), (0, run.t)):
        x, y, z = 1e3 * (mesh.p + u.reshape(-1, 3).T)
        order = np.argsort(-y[faces].mean(axis=0))  # the nearest face is the last
        front = faces[:, order].T
        ball = np.isin(front, of_ball).all(axis=1)
        look = {"facecolors": ball * 1.0, "edgecolors": "k", "lw": 0.2}
        axes.tripcolor(x, z, front, cmap="cividis", vmin=-1, vmax=1.2, **look)
        axes.set(title=f"t = {time:.2f} s", aspect="equal", xlabel="x [mm]")
    panels[0].set_ylabel("z [mm]")
    print(f"The ball rises by {1e3 * height:.2f} mm of 20 mm.")
    print(f"Each finger presses with {grip / weight:.1f} times the weight of the ball.")
    plt.show()
