"""Two soft fingers grip a ball and lift it: contact between bodies, with friction.

The fingers close by 3 mm on each side within 20 ms, and rise by 2 cm afterwards. Their friction carries the ball. As long as
it sticks, it slips by less than `slip_speed`.
"""

import numpy as np
import skfem

from skfem_stvk import BackwardEuler, Friction, Gravity, MeshContact, NeoHookean, System, simulate

R, GAP = 0.02, 2e-4
ball = skfem.MeshTet.init_ball(2).scaled(R)
finger = skfem.MeshTet.init_tensor(np.linspace(0, 0.01, 3), np.linspace(-0.012, 0.012, 4), np.linspace(-0.012, 0.012, 4))
mesh = ball + finger.translated((R + GAP, 0, 0)) + finger.translated((-R - GAP - 0.01, 0, 0))
parts = {"left": lambda x: x[0] < -R, "ball": lambda x: np.linalg.norm(x, axis=0) < R, "right": lambda x: x[0] > R}
nails = {"left nail": lambda x: np.isclose(x[0], -R - GAP - 0.01), "right nail": lambda x: np.isclose(x[0], R + GAP + 0.01)}
mesh = mesh.with_subdomains(parts).with_boundaries(nails)


def closing(t):
    return 0.003 * np.clip(t / 0.02, 0, 1)


def rising(t):
    return 0.02 * np.clip((t - 0.02) / 0.06, 0, 1)


moved = {
    f"{side} nail": {"x": lambda x, t, sign=sign: sign * closing(t), "y": 0.0, "z": lambda x, t: rising(t)}
    for side, sign in (("left", 1), ("right", -1))
}
friction = Friction(0.6, slip_speed=0.02)
terms = [
    NeoHookean(young=1e5, poisson=0.4, density=1000.0, region="ball"),
    *(NeoHookean(young=4e4, poisson=0.3, density=1000.0, region=side) for side in ("left", "right")),
    *(MeshContact(side, "ball", distance=5e-4, friction=friction, name=side) for side in ("left", "right")),
    Gravity((0, 0, -9.81)),
]
hand = System(mesh, terms, prescribed=moved)
run = simulate(hand, BackwardEuler(dt=2e-3), until=0.12, quiet=True)

of_ball = np.unique(mesh.t[:, mesh.subdomains["ball"]])
height = float(run.u.reshape(-1, 3)[of_ball, 2].mean())
weight = 9.81 * float(hand.mass().vertex[of_ball].sum())
grip = -float(run.contact("left").resultant[0])


def picture():
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(7, 3.4), layout="constrained", subplot_kw={"projection": "3d"})
    for axis, u, title in zip(axes, (0 * run.u, run.u), ("at the start", f"at t = {run.t:.2f} s"), strict=True):
        x = mesh.p + u.reshape(-1, 3).T
        for name, colour in (("left", "tab:blue"), ("ball", "tab:orange"), ("right", "tab:blue")):
            surface = hand.mesh.surface
            own = surface[:, np.isin(surface, np.unique(mesh.t[:, mesh.subdomains[name]])).all(axis=0)]
            axis.plot_trisurf(*x, triangles=own.T, color=colour, edgecolor="white", linewidth=0.3)
        axis.set(xlim=(-0.032, 0.032), ylim=(-0.02, 0.02), zlim=(-0.022, 0.042), title=title)
        axis.set_box_aspect((0.064, 0.04, 0.064), zoom=1.5)
        axis.view_init(8, -75)
        axis.set_axis_off()
    return figure


if __name__ == "__main__":
    picture().savefig("ex31_grip.png", dpi=110)
    print(f"the ball has risen by {1e3 * height:.2f} mm of 20 mm; each finger presses with {grip / weight:.1f} of its weight")
