"""The compiled kernels of contact agree with their readable twins."""

import numpy as np
import pytest
from kernels import readable_contact as readable
from terms.test_rigid_contact import MESHES, SHAPES

from skfem_stvk import RigidContact, RigidPlane, RigidSphere, StVK, System
from skfem_stvk.edges.pairs import NodeBlocks
from skfem_stvk.kernels import contact_penalty as kernels
from skfem_stvk.mesh import ElementMesh

PLANE = ElementMesh(np.array([[0.0, 1.0, 0.1, 1.2], [0.0, 0.1, 1.0, 1.1]]), np.array([[0, 1], [1, 2], [2, 3]]))
CASES = [(MESHES[mesh], shape) for mesh in ("tetrahedra", "quadratic tetrahedra", "hexahedra") for shape in SHAPES.values()]
CASES += [(PLANE, RigidPlane((0, 0.2), (0.3, 1))), (PLANE.with_degree(2), RigidSphere((0.5, -0.4), 0.7))]


def close(one, other, limit=1e-12):
    return np.abs(one - other).max() <= limit * np.abs(other).max()


@pytest.mark.few(8)
@pytest.mark.parametrize("onset", [0.0, 0.07])
@pytest.mark.parametrize("case", range(len(CASES)))
def test_compiled_and_readable_kernels_agree(case, onset):
    mesh, shape = CASES[case]
    term = System(mesh, [StVK(young=1.0, poisson=0.3), RigidContact(shape, stiffness=1e3, onset=onset)]).bound_terms[1]
    own, weights, numbers, rng = term._own_surface, term._weights, term._shape, np.random.default_rng(case)
    (n, d), m = own.X.shape, own.t.shape[1]
    u0, u1 = 0.05 * rng.standard_normal((2, n, d))
    shift0, shift1 = np.zeros((2, 3))
    shift0[:d], shift1[:d] = 0.03 * rng.standard_normal((2, d))
    start = own, weights, numbers

    def blocks():
        return NodeBlocks(np.zeros((term.nodes_paired.shape[1], d, d)), None, np.zeros((n, d, d)))

    def dense(of):
        K = np.zeros((n, n, d, d))
        K[range(n), range(n)] = of.own
        a, b = np.searchsorted(term.nodes, term.nodes_paired)
        K[a, b], K[b, a] = of.pairs, of.pairs.transpose(0, 2, 1)
        return K.swapaxes(1, 2).reshape(n * d, n * d)

    f, g = np.zeros((2, n, d))
    W = kernels.energy_and_force(*start, shift0, onset, u0, f)
    assert pytest.approx(readable.energy_and_force(*start, shift0, onset, u0, g), rel=1e-13) == W and W > 0 and close(f, g)
    for kept, everywhere in ((1.0, False), (0.0, False), (1.0, True)):
        of = blocks()
        kernels.add_blocks(*start, shift0, onset, u0, kept, everywhere, term._into(of))
        assert close(dense(of), readable.stiffness(*start, shift0, onset, u0, kept, everywhere), 1e-7)
    f, g = np.zeros((2, n, d))
    kernels.add_mean_force(*start, shift0, shift1, onset, u0, u1, 0.7, f)
    readable.mean_force(*start, shift0, shift1, onset, u0, u1, 0.7, g)
    assert close(f, g, 1e-11)
    of = blocks()
    kernels.add_mean_blocks(*start, shift0, shift1, onset, u0, u1, term._into(of))
    assert close(dense(of), readable.mean_stiffness(*start, shift0, shift1, onset, u0, u1), 1e-11)
    x = readable.points(own, numbers, shift0, u0)
    gaps, forces, normals = np.zeros_like(weights), np.zeros_like(weights), np.zeros((*weights.shape, d))
    kernels.find_gaps(*start, shift0, onset, u0, gaps, forces, normals)
    wanted = readable.gaps_and_normals(numbers, x)
    assert close(gaps, wanted[0]) and close(normals, wanted[1][..., :d])
    assert kernels.smallest_gap(own, numbers, shift0, u0) == gaps.min()
    assert close(forces, weights * readable.penalty(-wanted[0], onset)[1])
    past = np.zeros((*weights.shape, 7))
    kernels.remember(*start, shift0, onset, u0, 0.4, past)
    assert close(past, readable.remember(*start, shift0, onset, u0, 0.4))
    width, none = 0.03 if d == 3 else 0.5, np.empty((0, 0))  # in the plane, points that slide have no stiffness
    f, g = np.zeros((2, n, d))
    work = kernels.add_friction(own, shift1, past, width, none, u1, 1.0, f)
    lost, per_slip = readable.friction(own, shift1, past, width, u1, g)
    assert work == pytest.approx(lost, rel=1e-12) and work > 0 and close(f, g)
    secants = np.zeros_like(weights)
    kernels.find_secants(own, shift1, past, width, u1, secants)
    assert close(secants, per_slip)
    v, h = rng.standard_normal((n, d)), 1e-6
    ends = np.zeros((2, n, d))
    for sign, out in zip((1, -1), ends, strict=True):
        readable.friction(own, shift1, past, width, u1 + sign * h * v, out)
    of = blocks()
    kernels.add_friction_blocks(own, shift1, past, width, none, u1, 2.0, term._into(of))
    assert close(dense(of) @ v.ravel(), ((ends[0] - ends[1]) / h).ravel(), 1e-5)
    assert m == (1 if mesh.element.is_linear_simplex else len(term._facets))
