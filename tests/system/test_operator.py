"""K v without K."""

import numpy as np
import pytest
import scipy.sparse.linalg
from bodies import BODIES, MESHES, state

from skfem_stvk import StateError, StVK, System
from skfem_stvk.system import TangentOperator

TERM = StVK(young=2.0, poisson=0.3)
SOLID = System(MESHES["tetrahedra"], TERM)
N = SOLID.ndofs


@pytest.mark.parametrize("name", BODIES)
def test_the_operator_is_the_tangent(name):
    mesh, terms = BODIES[name]
    body, u, v = System(mesh, terms), state(mesh), state(mesh, seed=9)
    K = body.tangent(u)
    limit = 1e-14 * abs(K).max() * np.abs(v).max() * 10
    assert np.abs(K @ v).max() > 1e-2
    assert np.abs(body.linear_operator(u) @ v - K @ v).max() < limit
    assert np.abs(body.product(u, v) - K @ v).max() < limit


def test_every_column_is_that_of_K():
    u = state(SOLID.mesh)
    K = SOLID.tangent(u).toarray()
    columns = SOLID.linear_operator(u) @ np.eye(N)
    assert columns.shape == (N, N) and np.abs(columns - K).max() < 1e-14 * np.abs(K).max()
    assert np.abs(columns - columns.T).max() < 1e-14 * np.abs(K).max()


def test_it_is_its_own_adjoint():
    A = SOLID.linear_operator(state(SOLID.mesh))
    v = state(SOLID.mesh, seed=9)
    assert A.H is A and np.array_equal(A.rmatvec(v), A @ v)
    assert np.array_equal(A.rmatmat(v[:, None]), (A @ v)[:, None])


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_scipy_sees_shape_and_type(dtype):
    A = System(SOLID.mesh, TERM, dtype=dtype).linear_operator(np.zeros(N))
    assert isinstance(A, scipy.sparse.linalg.LinearOperator) and isinstance(A, TangentOperator)
    assert A.shape == (N, N) and A.dtype == dtype
    assert (A @ np.ones(N)).dtype == (A @ np.ones((N, 1))).dtype == dtype
    assert (A @ np.ones((N, 1))).shape == (N, 1)
    assert (A @ np.ones((N, 2))).shape == (N, 2)
    assert ((2 * A + A) @ np.arange(N)).shape == (N,)


def test_a_held_body_is_solved_by_conjugate_gradients():
    held = SOLID.free_dofs(np.flatnonzero(np.repeat(SOLID.mesh.p[2] < 0.2, 3)))
    u = 0.1 * state(SOLID.mesh)
    A, f = SOLID.linear_operator(u), np.cos(np.arange(len(held.free)))
    n = len(held.free)
    Aff = scipy.sparse.linalg.LinearOperator((n, n), lambda v: (A @ held.vector(v.ravel()))[held.free], dtype=A.dtype)
    x, info = scipy.sparse.linalg.cg(Aff, f, rtol=1e-12, maxiter=5000)
    exact = scipy.sparse.linalg.spsolve(held.matrix(SOLID.tangent(u)).tocsc(), f)
    assert info == 0 and np.abs(x - exact).max() < 1e-8 * np.abs(exact).max()


def test_a_product_is_never_stale():
    u, v = state(SOLID.mesh), state(SOLID.mesh, seed=9)
    for amount in (1.0, -2.0, 1.0, 1.0, 0.0, 1.0, 1.0 + 2**-52, -0.0):
        fresh = System(SOLID.mesh, TERM)
        assert np.array_equal(SOLID.product(amount * u, v), fresh.product(amount * u, v)), amount


def test_a_state_that_is_changed_in_place_is_another_state():
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


@pytest.mark.parametrize("call", [lambda u: SOLID.product(u, u), SOLID.linear_operator])
def test_a_bad_state_is_refused(call):
    with pytest.raises(StateError, match=r"u has shape \(5,\)"):
        call(np.zeros(5))
    with pytest.raises(StateError, match=rf"u is not finite in {N} entries"):
        call(np.full(N, np.nan))


def test_what_overflows_is_an_error_and_no_nan():
    u = state(SOLID.mesh)
    with pytest.raises(StateError, match="K overflows at displacements of up to"):
        SOLID.linear_operator(1e160 * u)
    with pytest.raises(StateError, match="K overflows at displacements of up to"):
        SOLID.product(1e160 * u, u)
    with pytest.raises(StateError, match="K v overflows"):
        SOLID.product(u, 1e308 * np.sign(u))
    assert np.isfinite(SOLID.product(u, u)).all()  # and the next one is right again
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


def test_an_operator_whose_preparation_was_cut_off_says_so_and_a_product_is_never_stale(monkeypatch):
    """Two terms; Ctrl-C between them."""
    mesh = MESHES["tetrahedra"]
    half = np.arange(mesh.nt // 2)
    body = System(mesh, [StVK(young=2.0, poisson=0.3, region=half), StVK(young=1.0, poisson=0.1, region=half + len(half))])
    u, v = state(mesh), state(mesh, seed=9)
    right, operator = body.tangent(0.5 * u) @ v, body.linear_operator(u)
    body.product(u, v)

    def cut_off(*arguments, **named):
        raise KeyboardInterrupt

    with monkeypatch.context() as during:
        during.setattr(body._bound[1], "edge_blocks", cut_off, raising=False)
        for call in (lambda: body.product(0.5 * u, v), lambda: operator.prepare(0.5 * u)):
            with pytest.raises(KeyboardInterrupt):
                call()
    with pytest.raises(StateError, match="is not prepared"):
        operator @ v
    assert np.abs(body.product(0.5 * u, v) - right).max() < 1e-13 * np.abs(right).max()


def test_a_preparation_that_overflows_leaves_no_nan():
    mesh = MESHES["tetrahedra"]
    operator = System(mesh, StVK(young=2.0, poisson=0.3)).linear_operator(state(mesh))
    with pytest.raises(StateError, match="K overflows"):
        operator.prepare(1e160 * state(mesh))
    with pytest.raises(StateError, match="is not prepared"):
        operator @ state(mesh)


def test_a_complex_vector_is_two_products():
    mesh = MESHES["tetrahedra"]
    operator, v = System(mesh, StVK(young=2.0, poisson=0.3)).linear_operator(state(mesh)), state(mesh, seed=9)
    assert np.array_equal(operator @ (v + 2j * v), operator @ v + 1j * (operator @ (2 * v)))


def test_prepare_refuses_what_is_no_state():
    mesh = MESHES["tetrahedra"]
    operator = System(mesh, StVK(young=2.0, poisson=0.3)).linear_operator(state(mesh))
    with pytest.raises(StateError, match="u has shape"):
        operator.prepare(np.zeros((3, 3)))
