"""
Recovery from inverted elements
===============================

The nodes of a block start at random positions in it, so that more than 40 of its
elements are inverted. The damped motion of `InvertibleStVK` ends in the undeformed
state. The motion of `StVK` ends in a crumpled state, because an inverted element has
the energy of its mirror image.
"""

import numpy as np
import skfem

from skfem_stvk import InvertibleStVK, Rayleigh, Simulation, StVK, System
from skfem_stvk import VelocityVerlet

mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 4)] * 3)
mesh = mesh.with_boundaries({"left": lambda x: x[0] < 1e-9})
x = mesh.p.T
random = np.random.default_rng(7).uniform(0, 1, x.shape)
start = ((random - x) * (x[:, :1] > 1e-9)).ravel()


def states(law):
    """Return times, displacements and inverted elements, at the start and 30 times."""
    body = law(young=1e3, poisson=0.3, density=1.0)
    system = System(mesh, body, fixed={"left": "xyz"})
    sim = Simulation(system, VelocityVerlet(5e-4), u0=start, damping=Rayleigh(12))
    found = [(0.0, sim.u, sim.inside_out())]
    for until in np.geomspace(0.02, 3, 30):
        sim.step(until=until)
        found.append((sim.t, sim.u, sim.inside_out()))
    return found


motions = {law.__name__: states(law) for law in (InvertibleStVK, StVK)}
inverted = len(motions["StVK"][0][2])

if __name__ == "__main__":
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    def draw(axes, name, state):
        t, u, turned = state
        corners = (x + u.reshape(-1, 3))[mesh.t.T]
        corners += 0.4 * (corners.mean(axis=1, keepdims=True) - corners)  # smaller
        faces = corners[:, [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]]
        dark = np.isin(np.arange(mesh.nelements), turned).repeat(4)
        look = {"fc": np.where(dark, "#000000", "#56B4E9"), "ec": "0.3", "lw": 0.2}
        axes.clear()
        axes.add_collection3d(Poly3DCollection(faces.reshape(-1, 3, 3), **look))
        axes.set(xlim=(-0.6, 1), ylim=(0, 1), zlim=(0, 1), yticks=[])
        axes.set(xticks=[0, 1], zticks=[0, 1], xlabel="x [m]")
        axes.set_title(f"{name} {t:.2f} s:\n{len(turned)} inverted")
        axes.set_box_aspect((1.6, 1, 1), zoom=1.1)

    plt.style.use("skfem_stvk.gallery")
    solid = {"subplot_kw": {"projection": "3d", "proj_type": "ortho"}}
    _, panels = plt.subplots(1, 3, figsize=(6, 2.6), **solid)
    draw(panels[0], "StVK", motions["StVK"][0])
    screen, moving = plt.subplots(1, 2, figsize=(4.6, 2.6), **solid)
    for axes, (name, found) in zip(panels[1:], motions.items()):
        draw(axes, name, found[-1])

    def both(number):
        for axes, (name, found) in zip(moving, motions.items()):
            draw(axes, name, found[number])

    film = FuncAnimation(screen, both, 31, interval=150)
    off = [f"{np.abs(found[-1][1]).max():.0e} m" for found in motions.values()]
    print(f"{inverted} elements start inverted; nodes end off by {off[0]}, {off[1]}")
    plt.show()
