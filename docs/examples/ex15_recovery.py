"""
Recovery from inverted elements
===============================

The nodes of a block start at random positions in it, so that more than 40 of its
elements are inverted. The damped motion of `InvertibleStVK` ends in the undeformed
state. The motion of `StVK` ends in a crumpled state, because an inverted element has
the energy of its mirror image.
"""

import warnings

import numpy as np
import skfem

from skfem_stvk import Corotated, InvertibleStVK, Rayleigh, StVK, StvkWarning
from skfem_stvk import System, VelocityVerlet, simulate

mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 4)] * 3)
mesh = mesh.with_boundaries({"left": lambda x: x[0] < 1e-9})
x = mesh.p.T
random = np.random.default_rng(7).uniform(0, 1, x.shape)
start = ((random - x) * (x[:, :1] > 1e-9)).ravel()


def after(law):
    """Return the displacements at the end, and the number of inverted elements."""
    body = law(young=1e3, poisson=0.3, density=1.0)
    system = System(mesh, body, fixed={"left": "xyz"})
    how = {"until": 3.0, "u0": start, "raise_on_failure": False}
    how["damping"] = Rayleigh(alpha=12.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)  # about inverted elements
        motion = simulate(system, VelocityVerlet(), quiet=True, **how)
    return motion.u, len(system.inside_out(motion.u))


block = System(mesh, StVK(young=1e3, poisson=0.3))
inside_out = len(block.inside_out(start))
laws = {law.__name__: after(law) for law in (InvertibleStVK, Corotated, StVK)}

if __name__ == "__main__":
    import matplotlib.pyplot as plt
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    plt.style.use("skfem_stvk.gallery")
    figure = plt.figure(figsize=(6.8, 2.9))
    states = {"start": start, **{name: u for name, (u, _) in laws.items()}}
    del states["Corotated"]
    for number, (name, u) in enumerate(states.items(), 1):
        inverted = block.inside_out(u)
        axes = figure.add_subplot(1, 3, number, projection="3d", proj_type="ortho")
        corners = (x + u.reshape(-1, 3))[mesh.t.T]
        corners += 0.4 * (corners.mean(axis=1, keepdims=True) - corners)  # smaller
        faces = corners[:, [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]]
        colours = np.full(mesh.nelements, "#56B4E9")
        colours[inverted] = "#000000"
        look = {"fc": colours.repeat(4), "ec": "0.3", "lw": 0.2}
        axes.add_collection3d(Poly3DCollection(faces.reshape(-1, 3, 3), **look))
        axes.set(xlim=(-0.6, 1), ylim=(0, 1), zlim=(0, 1), yticks=[])
        axes.set(xticks=[0, 1], zticks=[0, 1], xlabel="x [m]")
        axes.set_title(f"{name}:\n{len(inverted)} inverted")
        axes.set_box_aspect((1.6, 1, 1), zoom=1.1)
    print(f"{inside_out} elements start inverted; at the end, nodes are off by at most")
    print(", ".join(f"{name} {np.abs(u).max():.0e} m" for name, (u, _) in laws.items()))
    plt.show()
