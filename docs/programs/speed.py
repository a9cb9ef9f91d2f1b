"""Times of W, F, K and K v: this package against scikit-fem's assembly, on one mesh.

Both compute the same numbers; `error` is the largest difference. This package uses all threads of numba, which has little influence
on such a small mesh. `python -m validation bench` measures more quantities, meshes and codes.
"""

from pathlib import Path
from time import perf_counter

import numpy as np
import skfem

from skfem_stvk import StVK, System
from skfem_stvk.about import write_machine
from skfem_stvk.referee.reference import ReferenceStVK, isotropic_tensor

mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 11)] * 3)  # 6 000 tetrahedra
body = System(mesh, StVK(young=1e5, poisson=0.3))
standard = ReferenceStVK(mesh.p, mesh.t, isotropic_tensor(1e5, 0.3, 3, False))  # optimised forms of scikit-fem
u = 0.1 * np.sin(2 * np.pi * mesh.p[[1, 2, 0]]).ravel("F")  # strains of 0.6
v = np.cos(np.arange(body.ndofs))


def best(call):
    """Return the shortest time of five calls, after one call to warm up [ns per tetrahedron]."""
    times = []
    for _ in range(6):
        begin = perf_counter()
        call()
        times.append(perf_counter() - begin)
    return 1e9 * min(times[1:]) / mesh.nelements


K, standard_K, at_u = body.tangent(u), standard.tangent(u), body.linear_operator(u)
error = max(
    abs(body.energy(u) / standard.energy(u) - 1),
    abs(body.internal_force(u) - standard.internal_force(u)).max() / abs(body.internal_force(u)).max(),
    abs(K - standard_K).max() / abs(K).max(),
    abs(at_u @ v - standard_K @ v).max() / abs(standard_K @ v).max(),
)
times = {
    "W and F": (best(lambda: body.energy_and_force(u)), best(lambda: (standard.energy(u), standard.internal_force(u)))),
    "K": (best(lambda: body.tangent(u, out=K)), best(lambda: standard.tangent(u))),
    "K v, applied": (best(lambda: at_u @ v), best(lambda: standard_K @ v)),
}


def picture():
    """Draw the times as bars."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 3), layout="constrained")
    axes = figure.subplots()
    for i, (name, colour) in enumerate({"skfem-stvk": "#0072B2", "scikit-fem": "#D55E00"}.items()):
        bars = axes.barh(np.arange(len(times)) + 0.4 * i, [pair[i] for pair in times.values()], 0.38, color=colour, label=name)
        axes.bar_label(bars, fmt="%.0f", padding=3)
    axes.set(xscale="log", xlabel="ns per tetrahedron", yticks=np.arange(len(times)) + 0.2, yticklabels=times)
    axes.invert_yaxis()
    axes.set_xlim(1, 10 * max(map(max, times.values())))
    axes.legend()
    write_machine(figure)
    return figure


if __name__ == "__main__":
    for name, (ours, theirs) in times.items():
        print(f"{name:>14}: {ours:7.1f} and {theirs:7.1f} ns per tetrahedron, {theirs / ours:.1f} times")
    print(f"largest difference: {error:.1e}")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=150)
