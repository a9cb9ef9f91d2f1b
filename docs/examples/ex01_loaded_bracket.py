"""
A bracket, loaded and pushed
============================

A bracket of aluminium carries its weight and a load at its tip, while its bore is
displaced by 10 mm. Loads and supports name boundaries, which the mesh gets first.
`solve_static` begins with ten load steps and adapts their size.
"""

import numpy as np

from skfem_stvk import Gravity, StVK, System, Traction, embedded_mesh, solve_static

mesh = embedded_mesh().with_boundaries(
    {
        "wall": lambda x: np.isclose(x[2], 0),
        "symmetry": lambda x: np.isclose(x[1], 0),
        "tip": lambda x: np.isclose(x[2], 0.08),
        "handle": "bore",
    }
)
aluminium = StVK(young=70e9, poisson=0.33, density=2700.0)
system = System(
    mesh,
    [aluminium, Gravity(g=(0, 0, -9.81)), Traction("tip", (0, 0, -2e6))],
    fixed={"wall": "xyz", "symmetry": "y"},
    prescribed={"handle": {"x": 0.01}},  # at t = 1; a function of (x, t) is possible
)
result = solve_static(system, steps=10, quiet=True)
push = float(
    result.reaction("handle").resultant[0]
)  # force that displaces the bore [N]

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    axes = plt.figure().add_subplot(projection="3d", proj_type="ortho")
    stress = np.repeat(result.state["von_mises_stress"], 4) / 1e9  # [GPa]
    nodal = np.bincount(mesh.t.T.ravel(), stress) / np.bincount(mesh.t.ravel())
    x, faces = 1e3 * (mesh.p + result.u.reshape(-1, 3).T), system.mesh.surface
    body = axes.plot_trisurf(*x, triangles=faces.T, cmap="cividis", ec="0.4", lw=0.2)
    body.set_array(nodal[faces].mean(axis=0))
    body.autoscale()
    axes.set(xlabel="x [mm]", zlabel="z [mm]", yticks=[], aspect="equal")
    axes.view_init(20, -50)
    plt.colorbar(body, label="von Mises stress [GPa]", shrink=0.7, pad=0.12)
    print(f"{result.status.value}; the bore takes {push:.0f} N")
    plt.show()
