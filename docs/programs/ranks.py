"""The bracket of the scenes in parts, each on a rank of MPI.

`mpiexec -n 4 python -m mpi4py docs/programs/ranks.py` solves it on four ranks, `python docs/programs/ranks.py` on one.
All ranks run every line. Vectors hold the nodes of a rank, and `system.space` combines numbers of all ranks.
"""

from pathlib import Path

import numpy as np

from skfem_stvk import Gravity, StVK, System, Traction, read_mesh, solve_static
from skfem_stvk.mesh.facets import facets_of, find_facets
from skfem_stvk.ranks import distribute

FILE = Path(__file__).parent.parent / "scenes" / "bracket.msh"
part = distribute(FILE)
system = System(
    part,
    [StVK(young=70e9, poisson=0.33, density=2700.0), Gravity((0, 0, -9.81)), Traction("tip", (0, 0, -1.5e6))],
    fixed={"wall": "xyz"},
)
result = solve_static(system, 2, solver="block-jacobi-cg", rtol=1e-10, quiet=True)
space = system.space
tip = space.comm.least(float(result.u[2::3].min()))  # lowest displacement along z of all ranks [m]
gathered = space.comm.mpi.gather((part.element_numbers, result.state["von_mises_stress"]))  # None on other ranks than the first


def picture():
    """Draw the surface of the whole body on the first rank, coloured by the rank and by the stress of its elements."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    whole = read_mesh(FILE)
    rank, stress, element = np.empty(whole.nt), np.empty(whole.nt), np.empty(whole.nt * 4, dtype=int)
    for number, (elements, values) in enumerate(gathered):
        rank[elements], stress[elements] = number, values / 1e6
    facets, of_elements = facets_of(whole.t, whole.nv, whole.element)
    element[of_elements] = np.arange(whole.nt)
    at = element[find_facets(whole.surface, facets, whole.nv)]
    corners = whole.p.T[whole.surface[:3].T]
    figure = Figure(figsize=(7.2, 3.2), layout="constrained")
    last = max(len(gathered) - 1, 1)
    for i, (values, name, label, top) in enumerate([(rank, "tab10", "rank", 9), (stress, "cividis", "von Mises stress [MPa]", 80)]):
        axes = figure.add_subplot(1, 2, i + 1, projection="3d")
        axes.view_init(elev=24, azim=-58)
        axes.set_axis_off()
        colours = ScalarMappable(Normalize(0, top), colormaps[name])
        axes.add_collection3d(Poly3DCollection(corners, facecolors=colours.to_rgba(values[at]), shade=True))
        axes.auto_scale_xyz(*corners.reshape(-1, 3).T)
        axes.set_box_aspect(np.ptp(corners, axis=(0, 1)), zoom=1.15)
        if i:
            figure.colorbar(colours, ax=axes, shrink=0.6, label=label)
        else:
            axes.set_title(f"ranks 0 to {last}" if len(gathered) > 1 else "one rank", fontsize=10)
    return figure


if __name__ == "__main__" and gathered is not None:
    print(f"{len(gathered)} rank(s): the tip sinks by {-1e3 * tip:.4f} mm")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=80)
