import pickle

import hypothesis.strategies as st
import numpy as np
import pytest
from bodies import BODIES, MESHES, reference_of, state
from hypothesis import given, settings

from skfem_stvk import (
    Corotated,
    EdgeNetwork,
    ElasticFoundation,
    InvertibleStVK,
    LinearElastic,
    MeshError,
    NeoHookean,
    SpringNetwork,
    StateError,
    StVK,
    StvkError,
    StvkWarning,
    System,
    VolumePenalty,
    arguments,
)

TERM = StVK(young=2.0, poisson=0.3)
SOLID = System(MESHES["tetrahedra"], TERM)


@pytest.mark.parametrize("name", BODIES)
def test_W_F_and_K_are_scikit_fems(name):
    mesh, terms = BODIES[name]
    body, reference, u = System(mesh, terms), reference_of(mesh, terms), state(mesh)
    F, K = reference.internal_force(u), reference.tangent(u)
    assert np.abs(F).max() > 1e-3  # not the trivial state
    assert body.energy(u) == pytest.approx(reference.energy(u), rel=1e-12)
    assert np.abs(body.internal_force(u) - F).max() < 1e-13 * np.abs(F).max()
    assert abs(body.tangent(u) - K).max() < 1e-13 * abs(K).max()


@settings(max_examples=40)
@given(poisson=st.floats(-0.9, 0.49), amount=st.floats(1e-6, 3.0), seed=st.integers(0, 10**6), name=st.sampled_from(sorted(MESHES)))
def test_any_poisson_and_any_state_agrees_with_scikit_fem(poisson, amount, seed, name):
    mesh = MESHES[name]
    terms = [StVK(young=1.0, poisson=poisson)]
    body, reference, u = System(mesh, terms), reference_of(mesh, terms), state(mesh, amount, seed)
    K = reference.tangent(u)
    scale = abs(K).max()
    assert abs(body.tangent(u) - K).max() < 1e-12 * scale
    assert np.abs(body.internal_force(u) - reference.internal_force(u)).max() < 1e-12 * scale * max(1.0, np.abs(u).max())


def test_forces_are_the_same_far_from_the_origin():
    """Forces are bitwise the same far from the origin, on a mesh whose coordinates the offset does not round."""
    mesh, u = MESHES["tetrahedra"], state(MESHES["tetrahedra"], 1e-9)
    p = np.round(mesh.p * 2**20) / 2**20
    here, there = System((p, mesh.t), TERM), System((p + 2.0**20, mesh.t), TERM)
    assert np.array_equal(here.internal_force(u), there.internal_force(u))


def test_a_rigid_rotation_has_no_energy_and_no_force():
    from scipy.spatial.transform import Rotation

    X = SOLID.mesh.p.T
    u = (X @ Rotation.from_rotvec([0.3, -2.0, 1.1]).as_matrix().T - X + [1.0, 2.0, 3.0]).ravel()
    scale = abs(SOLID.tangent(u)).max()
    assert abs(SOLID.energy(u)) < 1e-28 * scale * 1e3
    assert np.abs(SOLID.internal_force(u)).max() < 1e-14 * scale


def test_two_tangents_never_differ_in_pattern():
    rest, crumpled = SOLID.tangent(np.zeros(SOLID.ndofs)), SOLID.tangent(state(SOLID.mesh, 3.0))
    assert np.array_equal(rest.indptr, crumpled.indptr) and np.array_equal(rest.indices, crumpled.indices)
    assert rest.indices.dtype == rest.indptr.dtype == np.int32
    assert rest.has_sorted_indices and rest.has_canonical_format
    full = np.zeros((SOLID.mesh.nv,) * 2, dtype=bool)
    full[SOLID.mesh.t[:, None], SOLID.mesh.t[None]] = True
    assert rest.nnz == 9 * full.sum() == SOLID.pattern.nnz
    assert np.array_equal(SOLID.pattern.indices, rest.indices) and SOLID.pattern.shape == rest.shape


def test_the_tangent_is_symmetric_with_only_rigid_zero_modes():
    K = SOLID.tangent(np.zeros(SOLID.ndofs)).toarray()
    assert np.abs(K - K.T).max() < 1e-15 * np.abs(K).max()
    values = np.linalg.eigvalsh(K)
    assert (np.abs(values[:6]) < 1e-13 * values[-1]).all() and values[6] > 1e-4 * values[-1]
    stressed = SOLID.tangent(state(SOLID.mesh, 0.3)).toarray()
    values = np.abs(np.linalg.eigvalsh(stressed))
    assert (np.sort(values)[:3] < 1e-13 * values.max()).all() and np.sort(values)[3] > 1e-8 * values.max()


def test_out_is_overwritten_in_place():
    u = state(SOLID.mesh)
    K = SOLID.tangent(0 * u)
    data = K.data
    again = SOLID.tangent(u, out=K)
    assert again is K and again.data is data
    assert abs(K - SOLID.tangent(u)).max() == 0


def moved_column(K):
    K.indices[0] += 1
    return K


def moved_row(K):
    K.indptr[1] -= 1
    return K


@pytest.mark.parametrize(
    "damage",
    [
        lambda K: K[:, :-1],
        moved_column,
        moved_row,
        lambda K: type(K)((K.data, K.indices, K.indptr), shape=(K.shape[0], K.shape[1] + 3)),
        lambda K: K.toarray(),
        lambda K: K.tocsc(),
        lambda K: K.astype(np.float32),
        lambda K: type(K)((K.data[:0], K.indices[:0], 0 * K.indptr), shape=K.shape),
    ],
)
def test_out_of_another_pattern_or_type_is_refused(damage):
    K = SOLID.tangent(np.zeros(SOLID.ndofs))
    with pytest.raises(StvkError, match="does not have the pattern and type of this system's K"):
        SOLID.tangent(np.zeros(SOLID.ndofs), out=damage(K))


def shortened(K):
    K.data = np.zeros(10)


def locked(K):
    K.data.flags.writeable = False


def other_rows(K):
    K.indptr = K.indptr.copy()
    K.indptr[1:-1] -= 1


@pytest.mark.parametrize("damage", [shortened, locked, other_rows])
def test_out_that_was_changed_after_its_first_use_is_refused(damage):
    """A matrix that was changed after its first use as `out` is refused; the first change would write out of bounds."""
    u = state(SOLID.mesh)
    K = SOLID.tangent(u, out=SOLID.tangent(u))
    damage(K)
    with pytest.raises(StvkError, match="does not have the pattern and type of this system's K"):
        SOLID.tangent(u, out=K)


def test_changes_of_a_tangent_do_not_affect_the_system():
    u = state(SOLID.mesh)
    before = SOLID.tangent(u)
    spoiled = SOLID.tangent(u)
    spoiled.data[::2] = 0
    spoiled.eliminate_zeros()
    assert abs(SOLID.tangent(u) - before).max() == 0
    with pytest.raises(ValueError, match="read-only"):
        SOLID.pattern.indices[0] = 5


def test_a_block_outside_of_the_pattern_is_an_error():
    bar = System(MESHES["cable"], StVK(young=1.0))
    with pytest.raises(StvkError, match=r"1 block \(1\): not in the pattern of K, vertices \[\(0, 5\)\]"):
        bar.pattern.block_indices(np.array([0, 0]), np.array([1, 5]))


@pytest.mark.parametrize("call", [SOLID.energy, SOLID.internal_force, SOLID.tangent])
@pytest.mark.parametrize(
    ("u", "message"),
    [
        (np.zeros(5), r"u has shape \(5,\); expected \(192,\), one number for each degree of freedom d \* vertex \+ component"),
        (np.zeros(192, dtype=complex), r"u has dtype complex128; expected \(192,\) real numbers"),
        ("abc", r"u = 'abc'; expected \(192,\) real numbers"),
        ([[0.0], [0.0, 1.0]], r"u = \[\[0\.0\], \[0\.0, 1\.0\]\]; expected \(192,\) real numbers"),
        (
            np.ma.masked_equal(np.arange(192.0), 3.0),
            "u = an array of shape .*; expected .* real numbers, .*, without masked entries",
        ),
        (np.zeros((64, 3)), r"u has shape \(64, 3\)"),
        (np.where(np.arange(192) == 17, np.nan, 0.0), r"u is not finite in 1 entry \(17\)"),
        (np.where(np.arange(192) > 180, np.inf, 0.0), r"u is not finite in 11 entries \(181, 182, 183, 184, 185, ...\)"),
    ],
)
def test_a_bad_state_is_refused(call, u, message):
    with pytest.raises(StateError, match=message):
        call(u)


def test_too_large_a_matrix_is_refused_before_its_creation(monkeypatch):
    body = System(MESHES["tetrahedra"], TERM)
    monkeypatch.setattr(arguments, "LARGEST_INDEX", 1000)
    with pytest.raises(MeshError, match="values of K are more than 32-bit indices can count"):
        body.tangent(np.zeros(body.ndofs))


def test_vertices_without_a_term_give_a_warning():
    with pytest.warns(StvkWarning, match=r"\d+ vertices .*: in no term"):
        System(MESHES["tetrahedra"], StVK(young=1.0, poisson=0.3, region=[0, 1]))


@pytest.mark.parametrize(
    ("terms", "options", "message"),
    [
        ([], {}, "Got no terms"),
        ([TERM, 3.0], {}, "Got a term of type float"),
        (TERM, {"dtype": "banana"}, "dtype = 'banana'; expected float64 or float32"),
        *((TERM, {"dtype": dtype}, r"dtype = .*; expected float64 or float32") for dtype in (int, np.float16, complex, bool)),
    ],
)
def test_invalid_arguments_are_refused(terms, options, message):
    with pytest.raises(StvkError, match=message):
        System(MESHES["tetrahedra"], terms, **options)


def test_terms_on_the_same_elements_add_up():
    mesh, u = MESHES["tetrahedra"], state(MESHES["tetrahedra"])
    half = StVK(young=1.0, poisson=0.3, region=np.arange(50))
    both = System(mesh, [TERM, half])
    reference = reference_of(mesh, [TERM, half])
    F = reference.internal_force(u)
    assert np.abs(both.internal_force(u) - F).max() < 1e-13 * np.abs(F).max()
    assert both.energy(u) > SOLID.energy(u)


@pytest.mark.parametrize(
    "term",
    [
        LinearElastic(young=2.0, poisson=0.3),
        NeoHookean(young=2.0, poisson=0.3),
        Corotated(young=2.0, poisson=0.3),
        Corotated(young=2.0, poisson=0.3, rotation="vertex"),
        InvertibleStVK(young=2.0, poisson=0.3),
        VolumePenalty(1.5),
        SpringNetwork(young=2.0, poisson=0.3),
        EdgeNetwork.of(MESHES["tetrahedra"], TERM),
        ElasticFoundation(np.arange(MESHES["tetrahedra"].nv), 3.0),
    ],
    ids=lambda term: type(term).__name__,
)
def test_a_system_of_any_law_can_be_sent_to_another_process(term):
    body = System(MESHES["tetrahedra"], [TERM, term])
    u, there = state(body.mesh, 0.1), pickle.loads(pickle.dumps(body))
    own = body.internal_force(u) - SOLID.internal_force(u)
    assert np.abs(own).max() > 1e-3 and np.array_equal(there.internal_force(u), body.internal_force(u))


def test_whole_numbers_are_displacements_too():
    assert SOLID.energy(np.zeros(SOLID.ndofs, dtype=int)) == 0.0
    assert SOLID.energy(np.ones(SOLID.ndofs, dtype=int)) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("call", "name"), [(SOLID.energy, "W"), (SOLID.internal_force, "F"), (SOLID.tangent, "K")])
def test_overflow_is_an_error_and_not_nan(call, name):
    with pytest.raises(StateError, match=rf"{name} overflows at displacements of up to .*e\+160"):
        call(1e160 * np.sign(state(SOLID.mesh)))
