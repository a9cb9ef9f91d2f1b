"""
Newton's method with scikit-fem's own functions
===============================================

A cantilever bends under a load at its end. `tangent` and `internal_force` return the
types of scikit-fem, so that `condense` and `solve` accept them. Plain Newton solves
each of ten load steps, and the residual decreases quadratically.
"""

import numpy as np
from skfem import MeshTri, condense, solve

from skfem_stvk import StVK, System

mesh = MeshTri.init_tensor(np.linspace(0, 1, 41), np.linspace(0, 0.1, 5))
body = System(mesh, StVK(young=1e7, poisson=0.3, plane="stress"))
clamped = np.flatnonzero(np.repeat(mesh.p[0] == 0, 2))
end = np.flatnonzero(mesh.p[0] == 1)
load = np.zeros(body.ndofs)
load[2 * end + 1] = -1500.0 / len(end)  # 1500 N per metre of thickness

u = np.zeros(body.ndofs)
residuals = []  # of each load step: norms [N/m], one per iteration
for factor in np.linspace(0.1, 1, 10):
    residuals.append([])
    while True:
        residual = factor * load - body.internal_force(u)
        free = np.delete(residual, clamped)
        residuals[-1].append(np.linalg.norm(free))
        if residuals[-1][-1] < 1e-8 * np.linalg.norm(load):
            break
        u += solve(*condense(body.tangent(u), residual, D=clamped))
sag = float(-u[2 * end + 1].mean())  # deflection of the end [m]

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, (shape, path) = plt.subplots(1, 2, figsize=(6, 2.8))
    shape.triplot(*mesh.p, mesh.t.T, "-", color="0.7", lw=0.5)
    shape.triplot(
        *(mesh.p + u.reshape(-1, 2).T), mesh.t.T, "-", color="#0072B2", lw=0.5
    )
    shape.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    for number in (0, 4, 9):
        path.semilogy(residuals[number], label=f"load step {number + 1}")
    path.set(xlabel="iteration", ylabel="residual [N/m]", xticks=range(0, 7, 2))
    path.legend()
    print(f"the end sinks by {sag:.4f} m; {sum(map(len, residuals)) - 10} iterations")
    plt.show()
