import numpy as np
import pytest
from bodies import box, state

from skfem_stvk import Isotropic, StVK, System
from validation import operations
from validation.operations.algorithms import ALGORITHMS, LINEAR, algorithm, count
from validation.operations.body import Body
from validation.operations.claims import CLAIMS, ratio, verdicts
from validation.operations.costs import LAM, MU, costs
from validation.operations.counting import Counted, Tally, counted, plain
from validation.operations.meshes import meshes

MESH = box(2)  # unequal edges, both orientations
LAME = 1.1538461538461537, 0.7692307692307693  # young = 2, poisson = 0.3

EVERY = pytest.mark.parametrize("chosen", ALGORITHMS, ids=lambda a: f"{a.quantity}, {a.name}")


@pytest.fixture(scope="module")
def found():
    return {(a.quantity, a.name): costs(a) for a in (*ALGORITHMS, LINEAR)}


@pytest.fixture(scope="module")
def truth():
    """Return F (nv, 3) and the dense K of the package in a state with large strains."""
    system, u = System(MESH, StVK(Isotropic.from_lame(*LAME))), state(MESH, amount=0.5)
    return u.reshape(-1, 3), system.internal_force(u).reshape(-1, 3), system.tangent(u).toarray()


def dense(body, blocks, diagonal):
    K = np.zeros((body.nv, 3, body.nv, 3))
    a, b = body.edges
    K[a, :, b], K[b, :, a] = blocks, blocks.swapaxes(1, 2)
    K[range(body.nv), :, range(body.nv)] = diagonal
    return K.reshape(3 * body.nv, -1)


@pytest.mark.few
@EVERY
def test_the_counted_run_gives_the_right_result(chosen, truth):
    u, F, K = truth
    body = Body(MESH, *LAME)
    tally, out = count(chosen, body, u)
    computed, right = (out[0], F) if chosen.quantity == "F" else (dense(body, *out), K)
    assert abs(F).max() > 0.1 and abs(computed - right).max() <= 1e-12 * abs(right).max()
    assert tally.additions > 0 and tally.multiplications > 0 and tally.divisions == 0


@pytest.mark.few
@EVERY
def test_operations_are_a_sum_over_vertices_edges_faces_and_tetrahedra(chosen, truth, found):
    body = Body(MESH, *LAME)  # not one of the meshes from which the sum was determined
    assert count(chosen, body, truth[0])[0].operations == found[chosen.quantity, chosen.name] @ body.entities


def test_each_operation_is_counted():
    tally = Tally()
    x = counted([3.0, 4.0], tally)
    assert plain(np.array([-x[0] + 2.0 * x[1] - 1.0 + 0]))[0] == 4.0  # a change of sign is free
    assert (tally.additions, tally.multiplications, tally.divisions) == (3, 1, 0)
    x[0] += 1 / x[1] / 2
    x[1] -= np.float64(1.0) - x[0] * x[0]
    assert (tally.additions, tally.multiplications, tally.divisions, tally.operations) == (6, 2, 2, 10)
    assert isinstance(np.float64(2.0) * x[0], Counted)
    assert counted(np.arange(3), tally).dtype.kind == "i"


def test_the_force_by_edges_takes_19_operations_per_edge_and_4_per_tsep(found):
    for mesh in meshes(quick=True).values():
        body = Body(mesh, LAM, MU)
        edges = body.edges.shape[1]
        assert found["F", "edges"] @ body.entities == 19 * edges + 4 * body.pairs
        assert found["F", "edges, from displacements"] @ body.entities == 24 * edges + 4 * body.pairs


def test_there_are_three_tseps_per_face_and_three_per_tetrahedron():
    for mesh in meshes(quick=True).values():
        body = Body(mesh, LAM, MU)
        rest = algorithm("F", "edges").prepare(body)
        assert len(rest.pair_L) == len(rest.double_L) == body.pairs


def test_the_claims_hold_against_the_textbooks_element_and_not_against_a_better_one(found):
    holds = {
        (v.claim.quantity, v.claim.against): set(v.holds)
        for v in verdicts(found, {name: Body(mesh, LAM, MU).entities for name, mesh in meshes(quick=True).items()})
    }
    for quantity in "FK":  # 15 - 27 % and 27 - 38 %
        assert holds[quantity, "Total Lagrangian, matrix B"] == {"box 2^3", "box 4^3", "bracket"}
        assert not holds[quantity, "Total Lagrangian"]
    assert holds["F", "O'Brien-Hodgins"] == {"box 4^3", "bracket"}  # about 70 % fewer
    assert not holds["F", "Picinbono"]  # about 80 % fewer
    assert holds["F", "linear elements"] == {"box 2^3", "box 4^3", "bracket"}  # Picinbono's polynomial: about five times


def test_linear_elements_have_the_force_of_the_tangent_at_rest():
    body, u = Body(MESH, *LAME), state(MESH, amount=0.5)
    right = System(MESH, StVK(Isotropic.from_lame(*LAME))).tangent(0 * u) @ u
    assert abs(count(LINEAR, body, u.reshape(-1, 3))[1][0].ravel() - right).max() <= 1e-12 * abs(right).max()


def test_deep_inside_a_mesh_the_ratios_approach_their_limits(found):
    inside = np.array([1, 7, 12, 6])  # a box of very many cubes has these numbers for each cube
    limits = [round(ratio(found, claim, inside), 2) for claim in CLAIMS]
    assert limits == [0.28, 0.18, 0.48, 0.29, 0.26, 0.09, 0.22, 5.8]


def test_on_one_tetrahedron_the_edge_form_needs_more_operations_for_the_tangent(found):
    alone = np.array([4, 6, 4, 1])
    assert found["K", "edges"] @ alone > found["K", "Total Lagrangian"] @ alone


@pytest.mark.slow
def test_the_quick_study_prints_its_tables(capsys):
    """The tables include the package's own kernels, which check their results while they count."""
    assert operations.main(quick=True) == 0
    out = capsys.readouterr().out
    assert "Picinbono" in out and "bracket" in out and "the same numbers" in out
    own = {words[0]: words[1:] for line in out.splitlines() if len(words := line.rsplit(maxsplit=2)) == 3}
    F, K = map(int, own[" tetrahedra"])
    assert 207 < F < 1.5 * 207 and 604 < K < 1.5 * 604  # of the best Total Lagrangian element, from positions and without W
    assert int(own[" quadratic tetrahedra"][0]) < int(own[" quadratic tetrahedra, curved"][0]) < 14 * F
