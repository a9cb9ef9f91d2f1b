"""Restriction to the free degrees of freedom equals slicing, at a lower cost."""

import hypothesis.strategies as st
import numba
import numpy as np
import pytest
import skfem
from bodies import BODIES, MESHES, state
from hypothesis import given, settings

from skfem_stvk import ElementMesh, Pressure, StVK, StvkError, System, VolumePenalty
from skfem_stvk.edges import ALL, NONE, TENSILE
from skfem_stvk.edges.streaming import PAST_CACHES

SOLID = System(MESHES["tetrahedra"], StVK(young=2.0, poisson=0.3))
N = SOLID.ndofs
HELD = SOLID.free_dofs(np.arange(0, N, 5))


def is_slice(restricted, K, free):
    """Return whether the restricted matrix is the bitwise identical slice of K.

    Shape and pattern, with explicit zeros and the order of columns, are asserted.
    """
    wanted = K[free][:, free]
    assert restricted.shape == (len(free),) * 2 and restricted.has_sorted_indices
    assert np.array_equal(restricted.indptr, wanted.indptr) and np.array_equal(restricted.indices, wanted.indices)
    return np.array_equal(restricted.data, wanted.data) and restricted.indices.dtype == restricted.indptr.dtype == np.int32


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_the_restricted_matrix_is_the_slice(name):
    mesh, terms = BODIES[name]
    body = System(mesh, terms)
    held = body.free_dofs(np.random.default_rng(0).choice(body.ndofs, body.ndofs // 3, replace=False))
    K = body.tangent(state(mesh))
    assert is_slice(held.matrix(K), K, held.free)
    assert sorted([*held.free, *held.fixed]) == list(range(body.ndofs))


@pytest.mark.few(8)
@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("kept", [ALL, TENSILE, NONE], ids=["all", "tensile", "none"])
def test_a_matrix_written_in_restricted_form_is_the_slice(name, kept):
    mesh, terms = BODIES[name]
    body = System(mesh, terms)
    K, rng = body.jacobian(state(mesh), kept=kept), np.random.default_rng(1)
    some = rng.choice(body.ndofs, body.ndofs // 4, replace=False)
    for fixed in (
        some,
        [0],
        np.arange(body.ndofs // 3),
        np.arange(0, body.ndofs, max(body.mesh.d, 2)),
        np.delete(np.arange(body.ndofs), some),
    ):
        held = body.free_dofs(fixed)
        straight = body.jacobian(state(mesh), kept=kept, free=held)
        assert is_slice(straight, K, held.free)
        assert body.jacobian(2 * state(mesh), kept=kept, free=held, out=straight) is straight
        assert is_slice(straight, body.jacobian(2 * state(mesh), kept=kept), held.free)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("terms", [[StVK(young=2.0, poisson=0.3)], [StVK(young=2.0, poisson=0.3), VolumePenalty(3.0)]])
def test_large_matrices_are_written_in_restricted_form_by_all_threads(count, terms):
    """Large restricted matrices, which are written past the caches, equal the slice with any number of threads."""
    mesh, rng = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 14)] * 3), np.random.default_rng(2)
    body = System((mesh.p + 0.01 * rng.uniform(-1, 1, mesh.p.shape), mesh.t), terms)
    u = 0.002 * rng.standard_normal(body.ndofs)
    before = numba.get_num_threads()
    numba.set_num_threads(min(count, before))
    try:
        K = body.tangent(u)
        assert K.data.nbytes > PAST_CACHES
        for fixed in (rng.choice(body.ndofs, 900, replace=False), np.flatnonzero(mesh.p.T.ravel() == 0)):
            held = body.free_dofs(fixed)
            assert is_slice(body.tangent(u, free=held), K, held.free)
    finally:
        numba.set_num_threads(before)


def test_the_restricted_jacobian_includes_follower_loads():
    mesh = MESHES["tetrahedra"]
    body = System(mesh, [StVK(young=2.0, poisson=0.3), Pressure(lambda x: x[0] > -1, 1.5)])
    held = body.free_dofs(np.arange(0, body.ndofs, 7))
    K = body.jacobian(state(mesh), 0.7)
    assert is_slice(body.jacobian(state(mesh), 0.7, free=held), K, held.free)
    assert abs(body.tangent(state(mesh), free=held) - body.jacobian(state(mesh), 0.7, free=held)).max() > 0


def test_the_restricted_tangent_of_elements_needs_no_whole_matrix():
    """The restricted tangent of elements is written without the matrix of all degrees of freedom."""
    body = System(MESHES["tetrahedra"], StVK(young=2.0, poisson=0.3))
    held = body.free_dofs([0, 5])
    body.tangent(state(body.mesh), free=held)
    assert body._whole is None
    body.jacobian(state(body.mesh), kept=TENSILE, free=held)  # the signs of tensions are known only after all elements are added
    assert body._whole is not None


@settings(max_examples=40)
@given(fixed=st.sets(st.integers(0, N - 1), max_size=N - 1))
def test_any_choice_of_degrees_of_freedom_is_a_slice(fixed):
    held = SOLID.free_dofs(sorted(fixed))
    K = SOLID.tangent(state(SOLID.mesh))
    assert is_slice(held.matrix(K), K, np.setdiff1d(np.arange(N), sorted(fixed)))


def test_one_matrix_can_be_filled_repeatedly():
    K, Kff = None, None
    for amount in (0.0, 1.0, -2.0, 0.5):
        K = SOLID.tangent(amount * state(SOLID.mesh), out=K)
        before = Kff
        Kff = HELD.matrix(K, out=Kff)
        if before is not None:
            assert Kff is before
        assert is_slice(Kff, K, HELD.free)


def test_changes_of_a_restricted_matrix_do_not_affect_the_next():
    K = SOLID.tangent(state(SOLID.mesh))
    spoiled = HELD.matrix(K)
    spoiled.data[::2] = 0
    spoiled.eliminate_zeros()
    with pytest.raises(StvkError, match="expected a matrix that"):
        HELD.matrix(K, out=spoiled)
    assert is_slice(HELD.matrix(K), K, HELD.free)


def test_degrees_of_freedom_of_scikit_fem_are_accepted():
    mesh = skfem.MeshTet().refined(2).with_boundaries({"floor": lambda x: x[2] == 0})
    body, basis = System(mesh, StVK(young=2.0, poisson=0.3)), skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTetP1()))
    view = basis.get_dofs("floor")
    from_view, from_ids = body.free_dofs(view), body.free_dofs(view.all())
    assert np.array_equal(from_view.fixed, np.sort(view.all())) and np.array_equal(from_view.free, basis.complement_dofs(view))
    assert np.array_equal(from_view.free, from_ids.free)
    only_z = body.free_dofs(view.all("u^3"))
    assert (only_z.fixed % 3 == 2).all() and len(only_z.fixed) == len(view.all()) // 3
    f = np.cos(np.arange(body.ndofs))
    K = body.tangent(np.zeros(body.ndofs))
    by_skfem = skfem.solve(*skfem.condense(K, f, D=view))
    x = from_view.vector(skfem.solve(from_view.matrix(K), f[from_view.free]))
    assert np.abs(x - by_skfem).max() < 1e-12 * np.abs(x).max()


@pytest.mark.parametrize(
    ("fixed", "same"),
    [
        ([3, 1, 2, 3, 3], [1, 2, 3]),
        ((7,), [7]),
        (range(4), [0, 1, 2, 3]),
        (np.array([5, 0], dtype=np.uint8), [0, 5]),
        (np.array([N - 1], dtype=np.int64), [N - 1]),
        ([], []),
        (np.empty(0, dtype=np.int32), []),
    ],
)
def test_duplicates_order_and_type_do_not_matter(fixed, same):
    held = SOLID.free_dofs(fixed)
    assert held.fixed.tolist() == same and len(held.free) == N - len(same)


def test_names_predicates_and_components_by_location_are_accepted():
    mesh = ElementMesh(SOLID.mesh.p, SOLID.mesh.t, node_sets={"left": np.flatnonzero(SOLID.mesh.p[0] < 0.2)})
    body, left = System(mesh, StVK(young=2.0, poisson=0.3)), mesh.node_sets["left"]
    every = (3 * left[:, None] + np.arange(3)).ravel()
    for same in ("left", lambda x: x[0] < 0.2, {"left": "xyz"}, [("left", "x"), (left[::-1], "zy")]):
        assert np.array_equal(body.free_dofs(same).fixed, every)
    assert np.array_equal(body.free_dofs({"left": "y"}).fixed, 3 * left + 1)
    supports = System(mesh, StVK(young=2.0, poisson=0.3), fixed=[(left, "y")]).supports
    assert np.array_equal(supports.fixed, 3 * left + 1) and body.free_dofs(left).fixed.tolist() == left.tolist()


@pytest.mark.parametrize(
    ("fixed", "message"),
    [
        (np.arange(N), f"All {N} degrees of freedom are fixed: there is nothing to solve for"),
        ([3, N, N + 4], rf"fixed names 2 degree.* \({N}, {N + 4}\) outside 0 ... {N - 1}. Do they belong to another mesh"),
        ([-1], r"\(-1\) outside 0"),
        (np.zeros(N, dtype=bool), rf"fixed = an array of shape \({N},\) and dtype bool; expected a list of degrees of freedom"),
        ([1.0, 2.0], r"fixed = \[1\.0, 2\.0\]; expected a list"),
        ([[1, 2]], r"fixed = \[\[1, 2\]\]"),
        (5, "fixed = 5"),
        ({1, 2}, r"fixed = \{1, 2\}"),
        ([[1], [2, 3]], r"fixed = \[\[1\], \[2, 3\]\]"),
        (np.ma.masked_equal([1, 2], 2), "expected a list"),
        ("wall", "fixed: the mesh has no boundary or node set 'wall'"),
        ({"wall": "x"}, "fixed on 'wall': the mesh has no boundary"),
        ([([1], "w")], "fixed on 1 vertex .*: got 'w'; expected components"),
        (lambda x: x[0] > 9, "none of the 64 vertices satisfies"),
    ],
)
def test_invalid_degrees_of_freedom_are_refused(fixed, message):
    with pytest.raises(StvkError, match=message):
        SOLID.free_dofs(fixed)


def with_an_empty_row(K):
    return type(K)((K.data, K.indices, np.append(K.indptr, K.nnz)), shape=(K.shape[0] + 1, K.shape[1]))


@pytest.mark.parametrize(
    "damage",
    [
        with_an_empty_row,
        lambda K: K[:-3, :-3],
        lambda K: K.tolil(),
        lambda K: K.tocsc()[:, ::-1].tocsr(),
    ],
)
def test_a_matrix_of_another_pattern_is_refused(damage):
    K = SOLID.tangent(state(SOLID.mesh))
    with pytest.raises(StvkError, match=rf"does not have the pattern of this system's K .* {K.nnz} values\)"):
        HELD.matrix(damage(K))


def test_out_of_another_type_or_pattern_is_refused():
    K = SOLID.tangent(state(SOLID.mesh))
    Kff = HELD.matrix(K)
    for out in (SOLID.free_dofs([1]).matrix(K), Kff.astype(np.float32), K, Kff.T, Kff.tolil(), Kff.toarray()):
        with pytest.raises(StvkError, match="does not have the pattern and type of the restricted K"):
            HELD.matrix(K, out=out)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_vector_is_the_inverse_of_slicing(dtype):
    x = np.random.default_rng(0).standard_normal(N).astype(dtype)
    again = HELD.vector(x[HELD.free], x[HELD.fixed])
    assert again.dtype == dtype and np.array_equal(again, x)
    assert not HELD.vector(x[HELD.free])[HELD.fixed].any()
    assert (HELD.vector(x[HELD.free], 0.25)[HELD.fixed] == 0.25).all()
    assert HELD.vector([1] * len(HELD.free)).dtype == np.float64
    assert np.array_equal(HELD.vector((1 + 2j) * x[HELD.free], (1 + 2j) * x[HELD.fixed]), (1 + 2j) * x)
    assert (HELD.vector(x[HELD.free], 3 + 1j)[HELD.fixed] == 3 + 1j).all()


def test_a_vector_of_another_length_is_refused():
    with pytest.raises(StvkError, match=r"free has shape .*, one number for each free degree of freedom"):
        HELD.vector(np.zeros(len(HELD.free) + 1))
    with pytest.raises(StvkError, match="fixed has shape"):
        HELD.vector(np.zeros(len(HELD.free)), np.zeros(3))


def test_single_precision_is_retained():
    body = System(SOLID.mesh, StVK(young=2.0, poisson=0.3), dtype=np.float32)
    held = body.free_dofs([0, 1, 2])
    K = body.tangent(state(SOLID.mesh))
    assert held.matrix(K).dtype == np.float32 and is_slice(held.matrix(K), K, held.free)


def test_repr_has_the_number_of_free_degrees_of_freedom():
    assert repr(HELD) == f"FreeDofs: {len(HELD.free)} free, {len(HELD.fixed)} fixed"


@pytest.mark.parametrize(
    "free", [3, "xyz", np.arange(4), System(MESHES["tetrahedra"], StVK(young=2.0, poisson=0.3)).free_dofs([0])]
)
def test_free_degrees_of_freedom_of_other_systems_are_refused(free):
    with pytest.raises(StvkError, match=r"free = .*; expected a result of free_dofs\(\) of this system"):
        SOLID.tangent(np.zeros(N), free=free)
    with pytest.raises(StvkError, match="free = "):
        SOLID.jacobian(np.zeros(N), free=free)


@pytest.mark.parametrize("kind", ["lumped", "consistent"])
def test_masses_are_added_to_restricted_matrices(kind):
    body = System(MESHES["tetrahedra"], StVK(young=2.0, poisson=0.3, density=3.0))
    mass, u = body.mass(kind), state(body.mesh)
    for fixed in ([0, 4, 5], np.arange(body.ndofs // 2)):
        held = body.free_dofs(fixed)
        K, Kff = body.tangent(u), body.tangent(u, free=held)
        mass.add_to(K, 0.7)
        mass.add_to(Kff, 0.7, held)
        assert is_slice(Kff, K, held.free)
        with pytest.raises(StvkError, match="does not have the pattern"):
            mass.add_to(K, 0.7, held)
