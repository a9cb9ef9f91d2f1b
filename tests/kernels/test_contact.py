"""Gaps, normals and energies of contact with rigid shapes agree with formulas for all points at once.

Forces, stiffnesses, mean forces and friction follow from these energies, see `tests/terms/test_rigid_contact.py`.
"""

import numpy as np
import pytest
from terms.test_rigid_contact import MESHES, SHAPES

from skfem_stvk import RigidContact, RigidPlane, RigidSphere, StVK, System
from skfem_stvk.kernels import contact_penalty as kernels
from skfem_stvk.kernels.contact_penalty import BOX, CYLINDER, DIRECTION, PLANE, RADIUS, SIGN
from skfem_stvk.mesh import ElementMesh

FLAT = ElementMesh(np.array([[0.0, 1.0, 0.1, 1.2], [0.0, 0.1, 1.0, 1.1]]), np.array([[0, 1], [1, 2], [2, 3]]))
CASES = [(MESHES[mesh], shape) for mesh in ("tetrahedra", "quadratic tetrahedra", "hexahedra") for shape in SHAPES.values()]
CASES += [(FLAT, RigidPlane((0, 0.2), (0.3, 1))), (FLAT.with_degree(2), RigidSphere((0.5, -0.4), 0.7))]


def gaps_and_normals(shape, x):
    """Return gaps (...) and normals (..., 3) of points (..., 3)."""
    kind, numbers = shape
    along = numbers[DIRECTION : DIRECTION + 3]
    if kind == PLANE:
        return x @ along, np.broadcast_to(along, x.shape)
    if kind == BOX:
        q = np.abs(x) - along + numbers[RADIUS]
        outside = np.maximum(q, 0)
        length = np.linalg.norm(outside, axis=-1, keepdims=True)
        nearest = np.arange(3) == q.argmax(axis=-1)[..., None]
        normals = np.copysign(1, x) * np.where(length > 0, outside / np.where(length > 0, length, 1), nearest)
        return length[..., 0] + np.minimum(q.max(axis=-1), 0) - numbers[RADIUS], normals
    arms = x - (x @ along)[..., None] * along if kind == CYLINDER else x
    lengths = np.linalg.norm(arms, axis=-1)
    return numbers[SIGN] * (lengths - numbers[RADIUS]), numbers[SIGN] * arms / lengths[..., None]


def penalty(p, e):
    """Return `psi` and `psi'` for k = 1 at depths `p >= 0`."""
    if not e:
        return p**2 / 2, p
    return np.where(p < e, p**3 / (6 * e), p**2 / 2 - e * p / 2 + e**2 / 6), np.where(p < e, p**2 / (2 * e), p - e / 2)


def close(one, other):
    return np.abs(one - other).max() <= 1e-12 * np.abs(other).max()


@pytest.mark.few(8)
@pytest.mark.parametrize("onset", [0.0, 0.07])
@pytest.mark.parametrize("case", range(len(CASES)))
def test_gaps_normals_pressures_and_energies_are_those_of_the_formulas(case, onset):
    mesh, shape = CASES[case]
    term = System(mesh, [StVK(young=1.0, poisson=0.3), RigidContact(shape, stiffness=1e3, onset=onset)]).bound_terms[1]
    surface, weights, numbers, rng = term._own_surface, term._weights, term._shape, np.random.default_rng(case)
    d, shift, at_nodes = surface.X.shape[1], np.zeros(3), np.zeros((len(surface.X), 3))
    u = 0.05 * rng.standard_normal(surface.X.shape)
    shift[:d], at_nodes[:, :d] = 0.03 * rng.standard_normal(d), surface.X + u
    x = np.einsum("qa,nac->nqc", surface.N, at_nodes[surface.t]) - numbers.numbers[:3] - shift
    wanted, normals_there = gaps_and_normals(numbers, x)
    psi, slope = penalty(np.maximum(-wanted, 0), onset)
    gaps, forces, normals = np.zeros_like(weights), np.zeros_like(weights), np.zeros((*weights.shape, d))
    kernels.find_gaps(surface, weights, numbers, shift, onset, u, gaps, forces, normals)
    assert close(gaps, wanted) and close(normals, normals_there[..., :d]) and close(forces, weights * slope)
    assert kernels.smallest_gap(surface, numbers, shift, u) == gaps.min() < 0
    W = kernels.energy_and_force(surface, weights, numbers, shift, onset, u, np.zeros_like(u))
    assert pytest.approx((weights * psi).sum(), rel=1e-12) == W
