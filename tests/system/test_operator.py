"""Products K v without the matrix K."""

import numpy as np
import pytest
import scipy.sparse.linalg
import skfem
from bodies import BODIES, MESHES, state

from skfem_stvk import ElasticFoundation, RigidContact, RigidPlane, StateError, StVK, System
from skfem_stvk.edges import ALL, NONE, TENSILE
from skfem_stvk.edges.bound_term import bound
from skfem_stvk.errors import StvkError
from skfem_stvk.mesh import ElementMesh
from skfem_stvk.system import FreeOperator, TangentOperator
from skfem_stvk.system.operator import at_all_times

TERM = StVK(young=2.0, poisson=0.3)
SOLID = System(MESHES["tetrahedra"], TERM)
N = SOLID.ndofs


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_the_operator_is_the_tangent(name):
    mesh, terms = BODIES[name]
    body, u, v = System(mesh, terms), state(mesh), state(mesh, seed=9)
    K = body.tangent(u)
    limit = 1e-14 * abs(K).max() * np.abs(v).max() * 10
    assert np.abs(K @ v).max() > 1e-2
    assert np.abs(body.linear_operator(u) @ v - K @ v).max() < limit
    assert np.abs(body.product(u, v) - K @ v).max() < limit


def test_the_operator_is_its_own_adjoint():
    A = SOLID.linear_operator(state(SOLID.mesh))
    v = state(SOLID.mesh, seed=9)
    assert A.H is A and np.array_equal(A.rmatvec(v), A @ v)
    assert np.array_equal(A.rmatmat(v[:, None]), (A @ v)[:, None])


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_the_operator_has_shape_and_type(dtype):
    A = System(SOLID.mesh, TERM, dtype=dtype).linear_operator(np.zeros(N))
    assert isinstance(A, scipy.sparse.linalg.LinearOperator) and isinstance(A, TangentOperator)
    assert A.shape == (N, N) and A.dtype == dtype
    assert (A @ np.ones(N)).dtype == (A @ np.ones((N, 1))).dtype == dtype
    assert (A @ np.ones((N, 1))).shape == (N, 1)
    assert (A @ np.ones((N, 2))).shape == (N, 2)
    assert ((2 * A + A) @ np.arange(N)).shape == (N,)


def test_a_product_is_never_stale():
    u, v = state(SOLID.mesh), state(SOLID.mesh, seed=9)
    for amount in (1.0, -2.0, 1.0, 1.0, 0.0, 1.0, 1.0 + 2**-52, -0.0):
        fresh = System(SOLID.mesh, TERM)
        assert np.array_equal(SOLID.product(amount * u, v), fresh.product(amount * u, v)), amount


def test_a_state_changed_in_place_is_another_state():
    u, v = state(SOLID.mesh), state(SOLID.mesh, seed=9)
    before = SOLID.product(u, v)
    u *= 2
    after = SOLID.product(u, v)
    assert np.abs(after - before).max() > 1e-2
    assert np.abs(after - SOLID.tangent(u) @ v).max() < 1e-13 * np.abs(after).max()


def test_operators_of_one_body_are_independent():
    u, v = state(SOLID.mesh), state(SOLID.mesh, seed=9)
    one, K = SOLID.linear_operator(u), SOLID.tangent(u)
    other = SOLID.linear_operator(3 * u)
    SOLID.product(-u, v)
    SOLID.tangent(5 * u)
    u *= 7
    assert np.abs(one @ v - K @ v).max() < 1e-13 * np.abs(K @ v).max()
    assert np.abs(other @ v - one @ v).max() > 1e-2


def test_preparing_at_another_state_is_a_new_operator_in_the_same_memory():
    u, v = state(SOLID.mesh), state(SOLID.mesh, seed=9)
    A = SOLID.linear_operator(u)
    memory = A.memory()
    A.prepare(2 * u)
    assert A.is_at(2 * u.reshape(-1, 3)) and not A.is_at(u.reshape(-1, 3))
    assert np.array_equal(A @ v, SOLID.linear_operator(2 * u) @ v) and A.memory() == memory


@pytest.mark.parametrize(
    ("v", "message"),
    [
        (np.zeros(N - 1), rf"v has shape \({N - 1},\); expected \({N},\)"),
        (np.zeros((N, 1)), rf"v has shape \({N}, 1\)"),
        (np.where(np.arange(N) == 17, np.nan, 0.0), r"v is not finite in 1 entry \(17\)"),
        (np.zeros(N, dtype=complex), "v has dtype complex128"),
    ],
)
def test_a_bad_vector_is_refused(v, message):
    with pytest.raises(StateError, match=message):
        SOLID.product(np.zeros(N), v)


@pytest.mark.parametrize("call", [lambda u: SOLID.product(u, u), SOLID.linear_operator, SOLID.linear_operator(np.zeros(N)).prepare])
def test_a_bad_state_is_refused(call):
    with pytest.raises(StateError, match=r"u has shape \(5,\)"):
        call(np.zeros(5))
    with pytest.raises(StateError, match=rf"u is not finite in {N} entries"):
        call(np.full(N, np.nan))


def test_overflow_is_an_error_and_not_nan():
    u = state(SOLID.mesh)
    with pytest.raises(StateError, match="K overflows at displacements of up to"):
        SOLID.linear_operator(1e160 * u)
    with pytest.raises(StateError, match="K overflows at displacements of up to"):
        SOLID.product(1e160 * u, u)
    with pytest.raises(StateError, match="K v overflows"):
        SOLID.product(u, 1e308 * np.sign(u))
    assert np.isfinite(SOLID.product(u, u)).all()  # later products are right
    assert np.array_equal(SOLID.product(u, u), System(SOLID.mesh, TERM).product(u, u))


def test_a_vertex_without_a_term_gets_no_force():
    mesh = MESHES["tetrahedra"]
    with pytest.warns(match="in no term"):
        body = System(mesh, StVK(young=2.0, poisson=0.3, region=np.arange(20)))
    bare = np.setdiff1d(np.arange(mesh.nv), mesh.t[:, :20])
    u, v = state(mesh), state(mesh, seed=9)
    product, K = body.product(u, v), body.tangent(u)
    assert len(bare) and not product.reshape(-1, 3)[bare].any() and np.abs(product).max() > 1e-2
    assert np.abs(product - K @ v).max() < 1e-13 * np.abs(product).max()


def test_an_operator_with_an_interrupted_preparation_refuses_products(monkeypatch):
    """An operator with an interrupted preparation refuses products, and the products of its body are never stale.

    Ctrl-C interrupts between the two terms.
    """
    mesh = MESHES["tetrahedra"]
    half = np.arange(mesh.nt // 2)
    body = System(mesh, [StVK(young=2.0, poisson=0.3, region=half), StVK(young=1.0, poisson=0.1, region=half + len(half))])
    u, v = state(mesh), state(mesh, seed=9)
    right, operator = body.tangent(0.5 * u) @ v, body.linear_operator(u)
    body.product(u, v)

    def cut_off(*arguments, **named):
        raise KeyboardInterrupt

    with monkeypatch.context() as during:
        during.setattr(body.pair_terms[1], "blocks", cut_off, raising=False)
        for call in (lambda: body.product(0.5 * u, v), lambda: operator.prepare(0.5 * u)):
            with pytest.raises(KeyboardInterrupt):
                call()
    with pytest.raises(StateError, match="is not prepared"):
        operator @ v
    assert np.abs(body.product(0.5 * u, v) - right).max() < 1e-13 * np.abs(right).max()


def test_a_complex_vector_is_two_products():
    mesh = MESHES["tetrahedra"]
    operator, v = System(mesh, StVK(young=2.0, poisson=0.3)).linear_operator(state(mesh)), state(mesh, seed=9)
    assert np.array_equal(operator @ (v + 2j * v), operator @ v + 1j * (operator @ (2 * v)))


def constrained_body(name="tetrahedra, two regions"):
    mesh, terms = BODIES[name]
    body = System(mesh, terms)
    return body, body.free_dofs(np.flatnonzero(np.random.default_rng(0).random(body.ndofs) < 0.3))


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_diagonal_blocks_are_those_of_K(name):
    mesh, terms = BODIES[name]
    body, u = System(mesh, terms), state(mesh)
    vertices = np.arange(mesh.nv)
    for kept in (ALL, TENSILE):
        K = body.jacobian(u, kept=kept).toarray().reshape(mesh.nv, mesh.d, mesh.nv, mesh.d)
        blocks = body.linear_operator(u, kept=kept).diagonal_blocks()
        assert blocks.shape == (mesh.nv, mesh.d, mesh.d)
        assert np.abs(blocks - K[vertices, :, vertices]).max() < 1e-13 * np.abs(K).max()


@pytest.mark.parametrize("kept", [ALL, TENSILE])
def test_the_free_operator_is_K_without_constrained_rows_and_columns(kept):
    body, held = constrained_body()
    u, v = -3 * state(body.mesh), state(body.mesh, seed=9)[held.free]
    operator = FreeOperator(body.linear_operator(u, kept=kept), held)
    K = held.matrix(body.jacobian(u, kept=kept))
    assert operator.shape == K.shape and operator.dtype == np.float64 and operator.H is operator
    limit = 1e-13 * np.abs(K @ v).max()
    for w in (v, v[:, None], np.stack([v, -2 * v], axis=1), v * (1 + 2j)):
        assert (operator @ w).shape == (K @ w).shape and np.abs(operator @ w - K @ w).max() < 3 * limit
    again = operator @ v
    operator @ (7 * v)
    assert np.array_equal(operator @ v, again)


def test_a_free_operator_follows_its_tangent():
    body, held = constrained_body()
    u, v = state(body.mesh), state(body.mesh, seed=9)[held.free]
    tangent = body.linear_operator(u)
    operator = FreeOperator(tangent, held)
    before = operator @ v
    tangent.prepare(-2 * u, kept=TENSILE)
    K = held.matrix(body.jacobian(-2 * u, kept=TENSILE))
    assert np.abs(operator @ v - K @ v).max() < 1e-13 * np.abs(K @ v).max() < np.abs(operator @ v - before).max()


def test_diagonal_blocks_of_constrained_degrees_of_freedom_are_the_identity():
    """Diagonal blocks are the identity at constrained degrees of freedom.

    Each block can be inverted, and the restricted inverse is that of the free block.
    """
    body, held = constrained_body()
    u = state(body.mesh)
    blocks = FreeOperator(body.linear_operator(u), held).diagonal_blocks()
    K = body.tangent(u).toarray()
    K[held.fixed] = 0
    K[:, held.fixed] = 0
    K[held.fixed, held.fixed] = 1
    vertices = np.arange(body.mesh.nv)
    wanted = K.reshape(body.mesh.nv, 3, body.mesh.nv, 3)[vertices, :, vertices]
    assert np.abs(blocks - wanted).max() < 1e-13 * np.abs(wanted).max()
    assert (blocks.reshape(body.ndofs, 3)[held.fixed].sum(axis=1) == 1).all()


def test_a_constrained_body_is_solved_with_its_diagonal_blocks_as_preconditioner():
    body, held = constrained_body()
    u, f = 0.1 * state(body.mesh), np.cos(np.arange(len(held.free)))
    operator = FreeOperator(body.linear_operator(u), held)
    inverse = np.linalg.inv(operator.diagonal_blocks())

    def precondition(r):
        return np.einsum("aij,aj->ai", inverse, held.vector(r.ravel()).reshape(-1, 3)).ravel()[held.free]

    M = scipy.sparse.linalg.LinearOperator(operator.shape, precondition, dtype=float)
    x, info = scipy.sparse.linalg.cg(operator, f, rtol=1e-12, maxiter=5000, M=M)
    assert info == 0 and np.abs(held.matrix(body.tangent(u)) @ x - f).max() < 1e-9


def test_products_of_a_free_operator_reuse_their_vectors():
    body, held = constrained_body()
    operator, v = FreeOperator(body.linear_operator(state(body.mesh)), held), np.ones(len(held.free))
    arrays = operator._all, operator._out
    operator @ v
    assert operator._all is arrays[0] and operator._out is arrays[1]
    assert not operator._all.ravel()[held.fixed].any()


def test_a_free_operator_with_an_unprepared_tangent_is_refused():
    body, held = constrained_body()
    tangent = body.linear_operator(state(body.mesh))
    operator = FreeOperator(tangent, held)
    with pytest.raises(StateError, match="K overflows"):
        tangent.prepare(1e160 * state(body.mesh))
    for call in (lambda: operator @ np.ones(len(held.free)), operator.diagonal_blocks, tangent.diagonal_blocks):
        with pytest.raises(StateError, match="is not prepared"):
            call()


def test_a_clamped_operator_is_not_mistaken_for_the_tangent():
    u = state(SOLID.mesh).reshape(-1, 3)
    operator = SOLID.linear_operator(u.ravel(), kept=TENSILE)
    assert not operator.is_at(u)
    operator.prepare(u.ravel())
    assert operator.is_at(u)


class Anchors:
    """Term that is not an assembly: springs `c` from some vertices to their rest positions."""

    symmetric, balanced, has_energy = True, False, True
    nodes_paired = np.empty((2, 0), dtype=np.int32)

    def __init__(self, c):
        self.c, self.nodes = c, np.arange(len(c))

    def energy_and_force(self, u, force=None):
        if force is not None:
            force += self.c[:, None] * u
        return float((self.c[:, None] * u**2).sum() / 2)

    def add_blocks(self, u, blocks, kept=ALL):
        blocks.own += np.multiply.outer(self.c, np.eye(u.shape[1]))


def test_terms_that_are_not_assemblies_have_operators():
    mesh = SOLID.mesh
    u, v, c = state(mesh), state(mesh, seed=9), np.arange(mesh.nv) % 5.0
    operator = TangentOperator(
        mesh, at_all_times([TERM.bind(mesh), bound(Anchors(c)).with_blocks(mesh.nv, 3, np.float64)]), u, np.float64
    )
    operator.prepare(u)
    wanted = SOLID.tangent(u) @ v + np.repeat(c, 3) * v
    assert np.abs(operator @ v - wanted).max() < 1e-13 * np.abs(wanted).max()
    with_anchors, without = operator.diagonal_blocks(), SOLID.linear_operator(u).diagonal_blocks()
    assert np.abs(with_anchors - without - c[:, None, None] * np.eye(3)).max() < 1e-13 * np.abs(with_anchors).max()


@pytest.mark.parametrize("kept", [ALL, TENSILE, NONE])
def test_a_preparation_gives_energy_and_force_of_the_same_pass(kept):
    mesh, terms = BODIES["tetrahedra, two regions"]
    body, u = System(mesh, terms), state(mesh)
    operator, force = body.linear_operator(0 * u), np.ones((mesh.nv, mesh.d))
    energy = operator.prepare(u, kept=kept, force=force)
    W, F = body.energy_and_force(u)
    assert energy == pytest.approx(W, rel=1e-13) and np.abs(force.ravel() - 1 - F).max() < 1e-13 * np.abs(F).max()


def test_sums_of_operators_are_those_of_their_matrices():
    """Sums of operators equal the sums of their matrices, with a term that has constant blocks."""
    mesh = SOLID.mesh
    body = System(mesh, [TERM, ElasticFoundation(lambda x: x[0] > -9, (3.0, 2.0, 1.0))])
    u, v = state(mesh), state(mesh, seed=9)
    rest, clamped, operator = body.linear_operator(0 * u), body.linear_operator(2 * u, kept=TENSILE), body.linear_operator(u)
    wanted = 1.5 * (body.tangent(u) @ v) - 0.5 * (body.tangent(0 * u) @ v) + 0.25 * (body.jacobian(2 * u, kept=TENSILE) @ v)
    operator.scale_and_add(1.5, [(-0.5, rest), (0.25, clamped)])
    assert np.abs(operator @ v - wanted).max() < 1e-13 * np.abs(wanted).max()
    assert np.array_equal(rest @ v, body.linear_operator(0 * u) @ v) and not operator.is_at(u.reshape(-1, 3))
    operator.scale_and_add(2.0)
    assert np.abs(operator @ v - 2 * wanted).max() < 1e-13 * np.abs(wanted).max()
    operator.prepare(u)
    assert np.array_equal(operator @ v, body.linear_operator(u) @ v)


def test_operators_of_other_terms_or_unprepared_are_not_added():
    u, other = state(SOLID.mesh), System(SOLID.mesh, TERM)
    operator, broken = SOLID.linear_operator(u), SOLID.linear_operator(u)
    with pytest.raises(StvkError, match="other terms"):
        operator.scale_and_add(1.0, [(1.0, other.linear_operator(u))])
    with pytest.raises(StateError, match="overflows"):
        broken.prepare(1e160 * u)
    for call in (lambda: operator.scale_and_add(1.0, [(1.0, broken)]), lambda: broken.scale_and_add(1.0)):
        with pytest.raises(StateError, match="is not prepared"):
            call()
    assert operator.is_at(u.reshape(-1, 3))


def test_a_changed_shift_takes_effect_in_the_next_product():
    body, held = constrained_body()
    u, v, shift = state(body.mesh), state(body.mesh, seed=9)[held.free], np.zeros(len(held.free))
    operator = FreeOperator(body.linear_operator(u), held, shift)
    before, diagonal = operator @ v, operator.diagonal_blocks().copy()
    shift += np.linspace(1, 2, len(shift))
    assert np.abs(operator @ v - before - shift * v).max() < 1e-13 * np.abs(before).max()
    added = np.einsum("vcc->vc", operator.diagonal_blocks() - diagonal).ravel()
    assert np.abs(added[held.free] - shift).max() < 1e-13 * np.abs(diagonal).max() and not added[held.fixed].any()


def product_of(K, v):
    """Return the product (rows, 3) of `EdgeBlocks` without their shift."""
    x, product = v.reshape(-1, 3)[K.vertices], np.zeros((len(K.vertices), 3))
    for (a, b), block in zip(K.edges, K.blocks.reshape(-1, 3, 3), strict=True):
        product[a] += block @ (x[b] - x[a])
        product[b] += block.T @ (x[a] - x[b])
    for a, block in zip(K.grounded, K.ground.reshape(-1, 3, 3), strict=True):
        product[a] += block @ x[a]
    return product


@pytest.mark.parametrize("touching", [False, True])
def test_the_blocks_by_edges_are_the_same_matrix(touching):
    """Terms of single vertices, such as contact, are blocks against the ground."""
    middle = SOLID.mesh.p.mean(axis=1)
    terms = [
        TERM,
        *[RigidContact(RigidPlane(middle, normal), stiffness=1e3, name=str(normal)) for normal in ((1, 2, 3), (3, 2, -1))]
        * touching,
    ]
    body, held = System(SOLID.mesh, terms), SOLID.free_dofs(np.arange(7))
    u, shift = state(SOLID.mesh), np.linspace(1, 2, SOLID.ndofs - 7)
    operator = FreeOperator(body.linear_operator(u), held, shift)
    K = operator.by_edges()
    assert K.shift is shift and (len(np.unique(K.grounded)) > 5) == touching
    v = state(SOLID.mesh, seed=9)
    v[held.fixed] = 0
    found = np.zeros((SOLID.mesh.nv, 3))
    found[K.vertices] = product_of(K, v)
    wanted = operator @ v[held.free]
    assert np.abs(found.ravel()[held.free] + shift * v[held.free] - wanted).max() < 1e-13 * np.abs(wanted).max()


@pytest.mark.parametrize(
    "mesh", [SOLID.mesh.with_degree(2), ElementMesh.of(skfem.MeshHex().refined(1))], ids=["quadratic tetrahedra", "hexahedra"]
)
def test_pairs_that_the_first_term_has_are_added_to_its_blocks(mesh):
    """Contact and foundations on facets with points between their nodes couple pairs of the body."""
    middle = mesh.p.mean(axis=1)
    law, contact = StVK(young=2.0, poisson=0.3), RigidContact(RigidPlane(middle, (1, 2, 3)), stiffness=30.0)
    body = System(mesh, [law, contact, ElasticFoundation(np.unique(mesh.surface), 5.0)])
    u, v = 0.02 * np.random.default_rng(0).normal(size=(2, body.ndofs))
    K, operator = body.tangent(u), body.linear_operator(u)
    assert np.abs(operator @ v - K @ v).max() < 1e-14 * np.abs(K @ v).max() + 1e-15
    first = 3 * np.arange(len(u) // 3)[:, None] + np.arange(3)
    diagonal = np.array([K[rows][:, rows].toarray() for rows in first])
    assert np.abs(operator.diagonal_blocks() - diagonal).max() < 1e-14 * np.abs(diagonal).max()
    by_edges = operator.by_edges()
    assert np.abs(product_of(by_edges, v) - (K @ v).reshape(-1, 3)[by_edges.vertices]).max() < 1e-13 * np.abs(K @ v).max()
    operator.prepare(u)
    assert np.abs(operator @ v - K @ v).max() < 1e-14 * np.abs(K @ v).max() + 1e-15  # nothing is added twice


def test_several_terms_have_no_common_edges():
    body, held = constrained_body()
    assert len(body.terms) > 1 and FreeOperator(body.linear_operator(state(body.mesh)), held).by_edges() is None
