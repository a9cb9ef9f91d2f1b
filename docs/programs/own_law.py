"""A user-defined law in forty lines: tension-only fibres in a strip that is stiffer when it bends down than when it bends up.

A law defines the pairs of vertices that it couples, energy and force, and the blocks of its stiffness. It needs no elements or
edges. Here each pair is a piece of a fibre. With `zeta = |p|^2 - |P|^2` and `E = zeta / (2 |P|^2)`, Green's strain along the fibre,

    W = 1/2 EA |P| E^2  if E > 0, else 0

The package treats the law like its own laws: K, its product, all solvers, motion, energies by term. Fibres in all rows make the
strip stiffer in tension, in agreement with a closed form, but not in compression. Fibres in the upper half resist bending down and
are slack in bending up.
"""

from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import skfem

from skfem_stvk import StVK, System, Traction, solve_static
from skfem_stvk.edges import ALL


@dataclass(frozen=True, eq=False)
class Fibres:
    """Fibres between pairs of vertices (2, n) with axial stiffness `EA` (n,) [N]."""

    pairs: np.ndarray
    EA: np.ndarray

    def bind(self, body, dtype=np.float64):
        """Return the fibres on a mesh."""
        return BoundFibres(body.mesh.p.T, np.sort(self.pairs, axis=0), self.EA)


class BoundFibres:
    """Fibres on a mesh, with the methods and attributes that a system needs."""

    symmetric = balanced = has_energy = True

    def __init__(self, X, pairs, EA):
        self.nodes_paired = pairs
        self.P = X[pairs[0]] - X[pairs[1]]
        length = np.linalg.norm(self.P, axis=1)
        self.L = EA / (2 * length**3)  # W = L zeta^2 / 4, as for a segment of St. Venant-Kirchhoff's law

    def state(self, u):
        """Return the deformed pieces `p` and their `zeta`, which is zero for slack pieces."""
        a, b = self.nodes_paired
        U = u[a] - u[b]
        return self.P + U, np.maximum(((2 * self.P + U) * U).sum(axis=1), 0)

    def energy_and_force(self, u, force=None):
        """Return the energy [J] at displacements `u` (nv, d); add the force [N] to `force` (nv, d)."""
        p, zeta = self.state(u)
        if force is not None:
            pull = (self.L * zeta)[:, None] * p
            np.add.at(force, self.nodes_paired[0], pull)
            np.subtract.at(force, self.nodes_paired[1], pull)
        return float((self.L * zeta**2).sum() / 4)

    def add_blocks(self, u, blocks, kept=ALL):
        """Add the blocks `K_ab = -(t I + 2 L p p')` [N/m] of the pairs; slack pieces have no stiffness."""
        p, zeta = self.state(u)
        blocks.pairs -= (kept.positive * self.L * zeta)[:, None, None] * np.eye(p.shape[1])
        blocks.pairs -= (2 * self.L * (zeta > 0))[:, None, None] * p[:, :, None] * p[:, None, :]


LENGTH, HEIGHT, YOUNG, STIFFER = 0.2, 0.02, 1e6, 3.0  # the fibres together have three times the stiffness of the rubber
columns, rows = 80, 8
mesh = skfem.MeshTri.init_tensor(np.linspace(0, LENGTH, columns + 1), np.linspace(0, HEIGHT, rows + 1)).with_boundaries(
    {"left": lambda x: x[0] == 0, "right": lambda x: np.isclose(x[0], LENGTH), "corner": lambda x: (x[0] == 0) & (x[1] == 0)}
)
order = np.lexsort(mesh.p).reshape(rows + 1, columns + 1)  # row by row, from left to right
shares = np.full(rows + 1, HEIGHT / rows)
shares[[0, -1]] /= 2
rubber = StVK(young=YOUNG, poisson=0.45, plane="stress")


def fibres(chosen):
    """Return fibres along the chosen rows of vertices. Each row has the stiffness of its share of the height, 1 m thick."""
    pairs = [np.stack([order[row, :-1], order[row, 1:]]) for row in chosen]
    EA = [np.full(columns, STIFFER * YOUNG * shares[row]) for row in chosen]
    return Fibres(np.concatenate(pairs, axis=1), np.concatenate(EA))


def pulled(stretch, *terms):
    """Return the strip stretched to a multiple of its length, between ends that slide vertically."""
    node = np.flatnonzero((mesh.p == 0).all(axis=0))
    system = System(
        mesh,
        [rubber, *terms],
        fixed=[("left", "x"), (node, "y")],
        prescribed=[("right", {"x": (stretch - 1) * LENGTH})],
    )
    return solve_static(system, steps=2, solver="superlu", quiet=True)


def closed_form(stretch, young):
    """Return the force [N] of a strip under uniaxial stress: the nominal stress `s Y E` times the height."""
    return stretch * young * (stretch**2 - 1) / 2 * HEIGHT


every = fibres(range(rows + 1))
stretches = 0.993, 1.15  # under more compression the strip buckles, and the solve reports it
forces = {s: float(pulled(s, every).reaction("right").resultant[0]) for s in stretches}
expected = {s: closed_form(s, YOUNG * (1 + STIFFER * (s > 1))) for s in stretches}
error = max(abs(forces[s] / expected[s] - 1) for s in stretches)


def bent(force):
    """Return the strip with fibres in its upper half, clamped at its left end, under a vertical force [N] at its right end."""
    upper = fibres(range(rows // 2 + 1, rows + 1))
    system = System(mesh, [rubber, upper, Traction("right", (0, force / HEIGHT))], fixed={"left": "xy"})
    return solve_static(system, steps=5, solver="superlu", quiet=True)


FORCE = 15.0
tip = 2 * order[rows // 2, -1] + 1
sags = {force: float(bent(force).u[tip]) for force in (FORCE, -FORCE)}


def picture():
    """Draw the force against stretch with and without fibres, and the strip bent up and down by the same force."""
    figure, (curve, shape) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    s = np.linspace(0.98, 1.2, 111)
    curve.plot(s, closed_form(s, YOUNG), color="tab:grey", label="rubber")
    curve.plot(s, closed_form(s, np.where(s > 1, 1 + STIFFER, 1) * YOUNG), color="tab:blue", label="with fibres, closed form")
    curve.plot(list(forces), list(forces.values()), "o", color="tab:orange", label="with fibres, computed")
    curve.set(xlabel="stretch", ylabel="force [N] per metre of thickness")
    curve.legend()
    shape.triplot(*mesh.p, mesh.t.T, color="0.8", linewidth=0.4)
    for force in sags:
        p = mesh.p + bent(force).u.reshape(-1, 2).T
        shape.tripcolor(*p, mesh.t.T, facecolors=np.full(mesh.nelements, 0.4), cmap="Blues", vmin=0, vmax=1)
        for row in range(rows // 2 + 1, rows + 1):
            shape.plot(*p[:, order[row]], color="tab:orange", linewidth=1)
    shape.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    return figure


if __name__ == "__main__":
    for s in stretches:
        print(f"stretch {s}: {forces[s]:.6g} N, closed form {expected[s]:.6g} N")
    print(f"A force of {FORCE} N lifts the tip by {sags[FORCE]:.4f} m, and lowers it by {-sags[-FORCE]:.4f} m.")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=110)
