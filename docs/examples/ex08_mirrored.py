"""
A mirrored equilibrium that Newton accepts
==========================================

A cube is compressed by 20 % between two plates in one load step. Newton's method with a
line search converges to an equilibrium with 216 inverted elements, because a mirrored
element has the strain energy of the element. The energy of this state is even lower
than that of the right one, which `solve_static` finds.
"""

import numpy as np
from skfem import MeshTet, condense, solve

from skfem_stvk import StVK, System, solve_static

cube = MeshTet.init_tensor(*[np.linspace(0, 1, 7)] * 3)
cube = cube.with_boundaries({"left": lambda x: x[0] == 0, "right": lambda x: x[0] == 1})
pressed = {"right": {"x": -0.2, "y": 0.0, "z": 0.0}}
law = StVK(young=1e5, poisson=0.3)
body = System(cube, law, fixed={"left": "xyz"}, prescribed=pressed)

plain = np.zeros((cube.p.shape[1], 3))
plain[cube.p[0] == 1, 0] = -0.2
plain = plain.ravel()
plates = np.flatnonzero(np.repeat((cube.p[0] == 0) | (cube.p[0] == 1), 3))
sizes = []
while not sizes or (sizes[-1] > 1e-9 and len(sizes) < 50):
    step = solve(*condense(body.tangent(plain), -body.internal_force(plain), D=plates))
    while body.energy(plain + step) > body.energy(plain) * (1 + 1e-12):
        step *= -0.5  # shorter, and in the other direction
    plain += step
    sizes.append(np.abs(step).max())

guarded = solve_static(body, steps=1, quiet=True).u
states = {"Newton": plain, "solve_static": guarded}
energies = {name: body.energy(u) for name, u in states.items()}
inverted = {name: len(body.inside_out(u)) for name, u in states.items()}

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, panels = plt.subplots(1, 2, sharey=True, figsize=(6, 3.6))
    front = [edge for edge in cube.edges.T if (cube.p[1, edge] == 0.5).all()]
    for axes, (name, u) in zip(panels, states.items()):
        x, _, z = cube.p + u.reshape(-1, 3).T
        for edge in front:
            axes.plot(x[edge], z[edge], "-", color="#0072B2", lw=0.9)
        axes.set(title=f"{name}: {energies[name]:.0f} J", aspect="equal")
        axes.set_xlabel(
            f"x [m]\n{inverted[name]} of {cube.nelements} elements inverted"
        )
    panels[0].set_ylabel("z [m], at y = 0.5 m")
    print(f"Newton: {len(sizes)} iterations, {energies['Newton']:.1f} J")
    print(f"solve_static: {energies['solve_static']:.1f} J, none inverted")
    plt.show()
