"""A body that is thrown into disorder comes back: elements that are inside out are pushed the right way round again.

All nodes of a block but those of its left side start anywhere within it, so that half of its elements are inside out. With
`InvertibleStVK` the damped motion ends where it is at rest; `StVK` does not know that the elements are inside out, for they have no
more energy than their mirror images, and comes to rest crumpled. Beside it the other thing that singular values are good for: a
bar that only turns has no stress with `Corotated`, and much with `LinearElastic`.
"""

import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import skfem

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
    """The displacements after three seconds of damped motion, and how many elements are inside out then."""
    body = System(mesh, law(young=YOUNG, poisson=0.3, density=1.0), fixed={"left": "xyz"})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)  # that elements are inside out
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
    """The edges of the block at displacements `u`."""
    p = x + u.reshape(-1, 3)
    edges = skfem.MeshTet(mesh.p, mesh.t).edges
    flat = p @ np.array([[1.0, 0.0], [0.35, 0.25], [0.0, 1.0]])
    axes.plot(*np.stack([flat[edges[0]], flat[edges[1]], np.full((edges.shape[1], 2), np.nan)], axis=1).reshape(-1, 2).T, lw=0.5)
    axes.set(aspect="equal", title=title)
    axes.axis("off")


def picture():
    """The block at its start and where it ends with each law, and what a turned bar costs."""
    figure, axes = plt.subplots(1, 5, figsize=(15, 3.4), layout="constrained")
    draw(axes[0], start, f"start: {inside_out} of {mesh.nelements} inside out")
    for place, (name, (u, turned)) in zip(axes[1:], laws.items(), strict=False):
        draw(place, u, f"{name}: {turned} inside out")
    for name, values in energies.items():
        axes[4].plot(np.degrees(angles), values, "o-", markersize=3, label=name)
    axes[4].set(xlabel="a bar that only turns [degrees]", ylabel="strain energy [J]")
    axes[4].legend()
    return figure


if __name__ == "__main__":
    for name, (u, turned) in laws.items():
        print(f"{name}: {turned} elements inside out in the end, nodes {np.abs(u).max():.1e} m from rest.")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=90)
