"""
Hertz's ball on a plate
=======================

A ball is pressed on a plate. With linear elasticity, the force is that of Hertz's
theory with Tatara's correction for the finite size of the ball. Two laws for large
strains are softer. The mesh is an octant of quadratic tetrahedra, finer near the
contact.
"""

import numpy as np
import skfem

from skfem_stvk import ElementMesh, LinearElastic, NeoHookean, RigidContact, RigidPlane
from skfem_stvk import StVK, System, solve_static

NU, A = 0.3, 0.15  # Poisson's ratio, contact radius; radius and Young's modulus are 1
s = np.linspace(0, 1, 8) ** 2.2
cube = ElementMesh.of(skfem.MeshTet.init_tensor(s, s, 1 - s[::-1])).with_degree(2)
stretch = cube.p.max(axis=0) / np.maximum(np.linalg.norm(cube.p, axis=0), 1e-9)
octant = cube.p * stretch * [[1], [1], [-1]]
mesh = ElementMesh(octant, cube.t, element=cube.element)


def hertz_force(a):
    return 4 / 3 * a**3 / (1 - NU**2)


def approach(a):
    far = 2 * (1 + NU) / (a**2 + 4) ** 1.5 + (1 - NU**2) / (a**2 + 4) ** 0.5
    return a**2 - hertz_force(a) * far / np.pi


def below(x):
    return (np.linalg.norm(x, axis=0) > 0.999) & (np.hypot(x[0], x[1]) < 2 * A)


plane = RigidPlane((0, 0, -1), (0, 0, 1))
plate = RigidContact(plane, below, stiffness=5e3, name="plate")
sides = {(lambda x, i=i: np.abs(x[i]) < 1e-9): "xy"[i] for i in range(2)}
lowered = {lambda x: np.abs(x[2]) < 1e-9: {"z": -approach(A)}}
results, forces = {}, {}
for law in (LinearElastic, NeoHookean, StVK):
    ball = System(mesh, [law(young=1.0, poisson=NU), plate], sides, lowered)
    results[law.__name__] = result = solve_static(ball, steps=3, quiet=True)
    force = [4 * ball.contact_force(step.u)[2::3].sum() for step in result.history]
    forces[law.__name__] = force
ratios = {name: force[-1] / hertz_force(A) for name, force in forces.items()}

if __name__ == "__main__":
    import matplotlib.pyplot as plt

    plt.style.use("skfem_stvk.gallery")
    figure, axes = plt.subplots(figsize=(5, 3.4))
    a = np.linspace(0, A, 50)
    axes.plot(approach(a), hertz_force(a), "k-", label="Hertz, Tatara")
    for (name, result), mark in zip(results.items(), "o^s"):
        axes.plot(approach(A) * result.history.t, forces[name], mark, label=name)
    axes.set(xlabel="approach / R", ylabel="force / (E R²)")
    axes.legend()
    print("force / Hertz's:", ", ".join(f"{n} {r:.4f}" for n, r in ratios.items()))
    plt.show()
