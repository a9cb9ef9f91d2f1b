"""A bracket under its weight and a load, while its bore is displaced by 10 mm: a complete quasi-static solve.

Loads and supports refer to the names of boundaries, which the mesh gets first. The path starts with ten steps. The step size grows
if Newton's method converges fast.
"""

from pathlib import Path

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
system = System(
    mesh,
    [StVK(young=70e9, poisson=0.33, density=2700.0), Gravity(g=(0, 0, -9.81)), Traction("tip", (0, 0, -2e6))],
    fixed={"wall": "xyz", "symmetry": "y"},
    prescribed={"handle": {"x": 0.01}},  # value at t = 1; a function of (x, t) is possible, too
)
result = solve_static(system, steps=10, quiet=__name__ != "__main__")
push = float(result.reaction("handle").resultant[0])  # force that displaces the bore [N]


def picture():
    """Draw the deformed bracket, coloured by the von Mises stress."""
    return result.plot(backend="matplotlib")


if __name__ == "__main__":
    print(result)
    print(f"The bore is pushed by {push:.0f} N.")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=110)
