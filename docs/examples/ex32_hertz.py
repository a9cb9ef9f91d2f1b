"""A ball that is pressed on a plate: linear elasticity against Hertz's force, and two other laws, which are softer.

A cube of quadratic tetrahedra, finer near one corner, is mapped to an octant of a ball with radius 1 and E = 1. Hertz's force at
the contact radius a is `F = 4/3 E* a^3`, with `E* = 1/(1 - nu^2)`. The ball approaches the plate as in his theory, with Tatara's
correction for its finite size.
"""

import numpy as np
import skfem

from skfem_stvk import ElementMesh, LinearElastic, NeoHookean, RigidContact, RigidPlane, StVK, System, solve_static

NU, A = 0.3, 0.15
s = np.linspace(0, 1, 8) ** 2.2
cube = ElementMesh.of(skfem.MeshTet.init_tensor(s, s, 1 - s[::-1])).with_degree(2)
octant = cube.p * cube.p.max(axis=0) / np.maximum(np.linalg.norm(cube.p, axis=0), 1e-9) * [[1], [1], [-1]]
mesh = ElementMesh(octant, cube.t, element=cube.element)


def hertz_force(a):
    return 4 / 3 * a**3 / (1 - NU**2)


def approach(a):
    far = 2 * (1 + NU) / (a**2 + 4) ** 1.5 + (1 - NU**2) / (a**2 + 4) ** 0.5
    return a**2 - hertz_force(a) * far / np.pi


def below(x):
    return (np.linalg.norm(x, axis=0) > 0.999) & (np.hypot(x[0], x[1]) < 2 * A)


plate = RigidContact(RigidPlane((0, 0, -1), (0, 0, 1)), below, stiffness=5e3, name="plate")
sides = {(lambda x, i=i: np.abs(x[i]) < 1e-9): "xy"[i] for i in range(2)}
lowered = {lambda x: np.abs(x[2]) < 1e-9: {"z": -approach(A)}}
results, forces = {}, {}
for law in (LinearElastic, NeoHookean, StVK):
    ball = System(mesh, [law(young=1.0, poisson=NU), plate], sides, lowered)
    results[law.__name__] = result = solve_static(ball, steps=3, quiet=True)
    forces[law.__name__] = [4 * ball.contact_force(step.u)[2::3].sum() for step in result.history]
ratios = {name: force[-1] / hertz_force(A) for name, force in forces.items()}


def picture():
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    a, r = np.linspace(0, A, 50), np.linspace(0, A, 50)
    left.plot(approach(a), hertz_force(a), "k", label="Hertz, Tatara")
    right.plot(r, 1.5 * hertz_force(A) / (np.pi * A**2) * np.sqrt(1 - (r / A) ** 2), "k", label="Hertz")
    for (name, result), marker in zip(results.items(), "o^s", strict=True):
        left.plot(approach(A) * result.history.t, forces[name], marker, label=name)
        pressure, radius = result.contact("plate").pressure, np.hypot(*(mesh.p[:2] + result.u.reshape(-1, 3).T[:2]))
        right.plot(radius[pressure > 0], pressure[pressure > 0], marker, ms=4, label=name)
    left.set(xlabel="approach/R", ylabel="force/(E R$^2$)")
    right.set(xlabel="distance from the axis/R", ylabel="pressure/E")
    left.legend()
    return figure


if __name__ == "__main__":
    picture().savefig("ex32_hertz.png", dpi=110)
    print(f"force over Hertz's: {', '.join(f'{name} {ratio:.4f}' for name, ratio in ratios.items())}")
