"""A bracket with a rubber bushing under a load at the bushing's bore: Newton's method with scikit-fem's own functions.

K, F and u have scikit-fem's types, so that `condense` and `solve` accept them. Rotations and stretches of the rubber are too large
for linear elasticity. Plain Newton solves each load step.
"""

from pathlib import Path

import numpy as np
from skfem import condense, solve

from skfem_stvk import StVK, System, embedded_mesh
from skfem_stvk.mesh.facets import boundary_facets

mesh = embedded_mesh()
body = System(
    mesh,
    [
        StVK(young=70e9, poisson=0.33, region="bracket"),  # aluminium
        StVK(young=5e6, poisson=0.45, region="bushing"),  # rubber
    ],
)

bolt, bore = np.unique(mesh.boundaries["bolt"]), np.unique(mesh.boundaries["bore"])
clamped = (3 * bolt[:, None] + np.arange(3)).ravel()
load = np.zeros((mesh.nv, 3))
load[bore, 0] = 600.0 / len(bore)  # 600 N along x, shared by the vertices of the bore

u = np.zeros(body.ndofs)
K = body.tangent(u)
for factor in (0.25, 0.5, 0.75, 1.0):
    residual = factor * load.ravel() - body.internal_force(u)
    while np.abs(np.delete(residual, clamped)).max() > 1e-9 * np.abs(load).max():
        u += solve(*condense(body.tangent(u, out=K), residual, D=clamped))
        residual = factor * load.ravel() - body.internal_force(u)

shift = float(u.reshape(-1, 3)[bore, 0].mean())  # mean displacement of the bore along x [m]
energy = body.energy(u)


def picture():
    """Draw the deformed surface, coloured by the displacement."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    faces, moved = boundary_facets(mesh).T, u.reshape(-1, 3)
    size = 1e3 * np.linalg.norm(moved, axis=1)[faces].mean(axis=1)
    colours = ScalarMappable(Normalize(0, size.max()), colormaps["cividis"])
    figure = Figure(figsize=(5.6, 3.6), layout="constrained")
    axes = figure.add_subplot(projection="3d", proj_type="ortho")
    axes.view_init(elev=24, azim=-38)
    axes.set_axis_off()
    corners = (mesh.p.T + moved)[faces]
    axes.add_collection3d(Poly3DCollection(corners, facecolors=colours.to_rgba(size), edgecolor="0.5", linewidth=0.3, shade=True))
    axes.auto_scale_xyz(*corners.reshape(-1, 3).T)
    axes.set_box_aspect(np.ptp(corners, axis=(0, 1)), zoom=1.15)
    figure.colorbar(colours, ax=axes, shrink=0.6, label="displacement [mm]")
    return figure


if __name__ == "__main__":
    print(f"the bore moves by {1e3 * shift:.4f} mm; strain energy {energy:.5f} J")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=150)
