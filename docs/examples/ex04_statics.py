"""A bracket that carries its weight and a load, while its bore is pushed by 10 mm: a quasi-static solve from end to end.

Loads and supports go by the names of boundaries; here they are given to the mesh first. The path has ten steps to begin with and
grows them as Newton's method allows.
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
    prescribed={"handle": {"x": 0.01}},  # reached at t = 1; or a function of (x, t)
)
result = solve_static(system, steps=10, quiet=__name__ != "__main__")
push = float(result.reaction("handle").resultant[0])  # force that moves the bore [N]


def picture():
    """The deformed bracket, coloured by the von Mises stress."""
    return result.plot(backend="matplotlib")


if __name__ == "__main__":
    print(result)
    print(f"The bore is pushed by {push:.0f} N.")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=110)
