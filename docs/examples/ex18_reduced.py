"""
A bar with thirty unknowns
==========================

A bar bends and twists under a load and is then released. Its reduced model has thirty
displacement fields: vibration modes and their derivatives, which correct the volume of
large rotations. Thirty modes alone make the bar much too stiff.
"""

import numpy as np
import skfem

from skfem_stvk import EnergyMomentum, Newmark, ReducedSystem, StVK, System, Traction
from skfem_stvk import simulate, solve_static

LENGTH, HEIGHT, WIDTH, SIZE = 5.0, 1.0, 0.5, 30
grid = [np.linspace(0, a, n) for a, n in ((LENGTH, 16), (HEIGHT, 4), (WIDTH, 3))]
ends = {"wall": lambda x: x[0] == 0, "end": lambda x: x[0] == LENGTH}
mesh = skfem.MeshTet.init_tensor(*grid).with_boundaries(ends)
rubber = StVK(young=1e6, poisson=0.3, density=1e3)


def traction(x, t):
    """Return the load on the end [Pa]: a torque about the axis and a vertical force."""
    y, z = x[1] - HEIGHT / 2, x[2] - WIDTH / 2
    return t * np.stack([0 * y, -8e4 * z, 8e4 * y - 2.5e3])


loaded = System(mesh, [rubber, Traction("end", traction)], fixed={"wall": "xyz"})
free = System(mesh, rubber, fixed={"wall": "xyz"})
bases = {"modes and derivatives": {"modes": 12}}
bases["modes alone"] = {"modes": SIZE, "derivatives": False}

full = solve_static(loaded, steps=4, quiet=True)
states = {"full": full.u}
for name, basis in bases.items():
    reduced = ReducedSystem(loaded, SIZE, quiet=True, **basis)
    states[name] = solve_static(reduced, steps=4, quiet=True).u
size = np.linalg.norm(full.u)
errors = {name: np.linalg.norm(states[name] - full.u) / size for name in bases}

released = {"until": 8.0, "u0": full.u, "probes": {"end": "end"}, "quiet": True}
moving = ReducedSystem(free, SIZE, quiet=True, **bases["modes and derivatives"])
motion = simulate(moving, EnergyMomentum(0.02), **released).ledger
truth = simulate(free, Newmark(0.02), **released).ledger
apart = np.abs(motion["end z"] - truth["end z"]).max() / np.abs(truth["end z"]).max()
drift = np.abs(motion["closure_error"]).max() / motion["total_energy"][0]

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, (shape, curve) = plt.subplots(1, 2, figsize=(6, 3.2))
    looks = (("0.75", 2.0), ("#0072B2", 0.8), ("#E69F00", 0.8))
    lines = mesh.edges[:, np.ptp(mesh.p[1:, mesh.edges], axis=1).max(axis=0) < 1e-9]
    side = lines[:, np.isin(mesh.p[1, lines[0]], (0, HEIGHT))]
    for (name, u), (colour, width) in zip(states.items(), looks):
        x, _, z = (mesh.p + u.reshape(-1, 3).T)[:, side]
        shape.plot(x, z, "-", color=colour, lw=width)
        shape.plot([], "-", color=colour, lw=width, label=name)
    shape.set(aspect="equal", xlabel="x [m]", ylabel="z [m]", ylim=(-3.6, 0.8))
    shape.legend(loc="lower left")
    curve.plot(truth["time"], truth["end z"], "-", color="0.75", lw=3, label="full")
    curve.plot(motion["time"], motion["end z"], "-", label=f"{SIZE} unknowns")
    curve.set(xlabel="time [s]", ylabel="z of the released end [m]", ylim=(-2, 3))
    curve.legend(loc="upper right")
    print(
        "errors:", ", ".join(f"{error:.1%} of {name}" for name, error in errors.items())
    )
    print(f"released: end within {apart:.1%}, energy drift {drift:.0e}")
    plt.show()
