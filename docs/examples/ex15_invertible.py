"""A block with random node positions recovers: its inverted elements return to positive orientation.

All nodes of a block except those on its left side start at random positions in the block, so that half of its elements are
inverted. With `InvertibleStVK` the damped motion ends in the undeformed state. With `StVK` it ends in a crumpled state, because an
inverted element has the same energy as its mirror image. The example also shows the second use of singular values: a bar in pure
rotation has no stress with `Corotated`, but large stress with `LinearElastic`.
"""

import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import skfem
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from skfem_stvk import (
    Corotated,
    ElementMesh,
    InvertibleStVK,
    LinearElastic,
    Rayleigh,
    StVK,
    StvkWarning,
    System,
    VelocityVerlet,
    simulate,
)

CELLS, YOUNG = 3, 1e3
mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, CELLS + 1)] * 3).with_boundaries({"left": lambda x: x[0] < 1e-9})
x = mesh.p.T
start = ((np.random.default_rng(7).uniform(0, 1, x.shape) - x) * (x[:, :1] > 1e-9)).ravel()


def after(law):
    """Return the displacements after three seconds of damped motion, and the number of inverted elements."""
    body = System(mesh, law(young=YOUNG, poisson=0.3, density=1.0), fixed={"left": "xyz"})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)  # ignore warnings about inverted elements
        motion = simulate(
            body, VelocityVerlet(), until=3.0, u0=start, damping=Rayleigh(alpha=12.0), quiet=True, raise_on_failure=False
        )
    return motion.u, len(body.inside_out(motion.u))


inside_out = len(System(mesh, StVK(young=YOUNG, poisson=0.3)).inside_out(start))
laws = {law.__name__: after(law) for law in (InvertibleStVK, Corotated, StVK)}

bar = ElementMesh.of(skfem.MeshTet.init_tensor(np.linspace(0, 4, 9), np.linspace(0, 1, 3), np.linspace(0, 1, 3)))
angles = np.radians(np.arange(0, 91, 5))
energies = {
    law.__name__: [
        System(bar, law(young=YOUNG, poisson=0.3)).energy(
            (np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]) @ bar.p - bar.p).ravel("F")
        )
        for a in angles
    ]
    for law in (LinearElastic, Corotated)
}


def draw(axes, u, title):
    """Draw the elements at displacements `u`, at half their size about their centres; inverted elements are red."""
    corners = (x + u.reshape(-1, 3))[mesh.t.T]
    middles = corners.mean(axis=1, keepdims=True)
    faces = (middles + 0.5 * (corners - middles))[:, [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]].reshape(-1, 3, 3)
    colours = np.full(mesh.nelements, "#56B4E9")
    colours[System(mesh, StVK(young=YOUNG, poisson=0.3)).inside_out(u)] = "#D62728"
    axes.add_collection3d(Poly3DCollection(faces, facecolors=colours.repeat(4), edgecolors="black", linewidths=0.15, shade=True))
    axes.set(xlim=(-0.6, 1), ylim=(0, 1), zlim=(0, 1), title=title)
    axes.set_box_aspect((1.6, 1, 1), zoom=1.25)
    axes.set_axis_off()


def picture():
    """Draw the block at the start and at the end with each law, and the energy of a bar in pure rotation."""
    figure = plt.figure(figsize=(15, 3.4), layout="constrained")
    states = {f"start: {inside_out} of {mesh.nelements} inverted": start}
    states |= {f"{name}: {inverted} inverted": u for name, (u, inverted) in laws.items()}
    for number, (title, u) in enumerate(states.items(), 1):
        draw(figure.add_subplot(1, 5, number, projection="3d"), u, title)
    axes = figure.add_subplot(1, 5, 5)
    for name, values in energies.items():
        axes.plot(np.degrees(angles), values, "o-", markersize=3, label=name)
    axes.set(xlabel="a bar that only rotates [degrees]", ylabel="strain energy [J]")
    axes.legend()
    return figure


if __name__ == "__main__":
    for name, (u, turned) in laws.items():
        print(f"{name}: {turned} elements inside out in the end, nodes {np.abs(u).max():.1e} m from rest.")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=90)
