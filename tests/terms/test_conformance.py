"""Suite of requirements for all elastic terms."""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest
from bodies import CURVED, MESHES, random_frames, some_voigt, state, turned_round
from kernels.parts import in_parts
from scipy.sparse import identity, random
from terms.toys import Anchors, Areas, Springs, Wind

from skfem_stvk import (
    Anisotropic,
    Corotated,
    EdgeNetwork,
    ElasticFoundation,
    ElementMesh,
    InvertibleStVK,
    LinearElastic,
    MeshContact,
    NeoHookean,
    RigidContact,
    SpringNetwork,
    StVK,
    StvkError,
    System,
    VolumePenalty,
)
from skfem_stvk.edges import ALL, NONE, TENSILE, Tensions, bound_term
from skfem_stvk.edges.bound_term import BoundElements
from skfem_stvk.system import Pattern
from skfem_stvk.terms import TERMS, Body, is_load
from skfem_stvk.terms.laws.volume_penalty import ENERGIES

RNG = np.random.default_rng(12)
SOLID = ("tetrahedra", "triangles", "segments")


class Case(NamedTuple):
    """Term on a mesh, and its expected properties.

    Attributes
    ----------
    limit
        Largest error of derivatives by differences over steps of `step`: exact for polynomials of degree six, along lines.
    inverts
        Whether the term has an energy where elements are inverted.
    grounded
        Whether rigid motions change the energy.
    toy
        Whether the term is one of the minimal terms in `toys.py`.
    can
        What the term declares that it can do, and "volumes" if it has elements.
    definite
        Whether its clamped tangent is positive semi-definite.
    renumbered
        The term on the same mesh with its elements in another `order` and its vertices renumbered; None if there is no such twin.
    slackens
        Whether the term bears no compression, so that its test states are compressed less.
    energy
        Whether the term has an energy.
    """

    mesh: ElementMesh
    term: Any
    limit: float = 1e-11
    step: float = 0.1
    inverts: bool = True
    grounded: bool = False
    toy: bool = False
    can: tuple[Any, ...] = ()
    definite: bool = True
    renumbered: Any = None
    slackens: bool = False
    energy: bool = True


#: What terms on edges declare, with or without elements around them.
OF_EDGES = ("quartic", "has_mean_force", "damped")
OF_SPRINGS = OF_EDGES[1:]
#: Limit and step for derivatives of energies that are not polynomials.
SMOOTH = 1e-7, 1e-3


def reordered(law, order, **others):
    """Return a law with constants by element, for elements in another order."""
    m = law.material
    return type(law)(young=m.young[order], poisson=m.poisson[order], **others)


def reordered_penalty(term, mesh, order):
    region = np.arange(mesh.nt) if term.region is None else term.region
    return VolumePenalty(term.stiffness, term.kind, np.argsort(order)[region])


def neo_hookean():
    found, rng = {}, np.random.default_rng(15)
    for name, more in (("tetrahedra", {}), ("triangles", {}), ("triangles", {"plane": "stress"}), ("membrane", {})):
        mesh = MESHES[name]
        law = NeoHookean(young=rng.uniform(1, 9, mesh.nt), poisson=rng.uniform(0, 0.45, mesh.nt), **more)
        again = partial(lambda law, more, other, order: reordered(law, order, **more), law, more)
        name = ", ".join(["NeoHookean", name, *map(" ".join, more.items())])
        found[name] = Case(mesh, law, 1e-9, 1e-3, inverts=False, can=("has_mean_force", "volumes"), renumbered=again)
    return found


def wrinkling():
    """Return cases of laws without compression. K jumps where an element begins to wrinkle; small steps stay clear of the jump."""
    found, rng = {}, np.random.default_rng(25)
    for name, more in (("triangles", {"plane": "stress"}), ("membrane", {}), ("segments", {}), ("cable", {})):
        mesh = MESHES[name]
        law = StVK(young=rng.uniform(1, 9, mesh.nt), poisson=rng.uniform(-0.3, 0.45, mesh.nt), wrinkling=True, **more)
        again = partial(lambda law, more, other, order: reordered(law, order, wrinkling=True, **more), law, more)
        found[f"StVK, {name}, wrinkling"] = Case(
            mesh, law, 1e-7, 1e-5, can=("has_mean_force", "volumes"), renumbered=again, slackens=True
        )
    return found


def cases():
    found = {}
    for name, mesh in MESHES.items():
        n = mesh.nt
        law = StVK(young=RNG.uniform(1, 9, n), poisson=RNG.uniform(-0.3, 0.45, n))
        can = *OF_EDGES, "volumes"
        again = partial(lambda law, other, order: reordered(law, order), law)
        found[f"StVK, {name}"] = Case(mesh, law, can=can, renumbered=again)
        found[f"StVK, {name}, anisotropic"] = Case(
            mesh, StVK(Anisotropic(some_voigt(RNG), frame=random_frames(1, RNG)[0])), can=can
        )
        linear = LinearElastic(law.material)  # linear elasticity has strain under rotations
        found[f"linear, {name}"] = Case(mesh, linear, grounded=True, can=can)
        linear = LinearElastic(Anisotropic(some_voigt(np.random.default_rng(7))))
        found[f"linear, {name}, anisotropic"] = Case(mesh, linear, grounded=True, can=can)
        bed = ElasticFoundation(lambda x: x[0] < x[0].min() + 0.4, [3.0] if mesh.d == 1 else (2.0, 0.0, 5.0)[: mesh.d])
        found[f"foundation, {name}"] = Case(mesh, bed, grounded=True, can=("quartic",))
        network = EdgeNetwork.of(mesh, law)
        again = partial(lambda law, other, order: EdgeNetwork.of(other, reordered(law, order)), law)
        found[f"network, {name}"] = Case(mesh, network, can=OF_EDGES, renumbered=again)
        found[f"network, {name}, springs alone"] = Case(mesh, network.diagonal(), can=OF_EDGES)
        springs = SpringNetwork(law.material)
        again = partial(lambda law, other, order: SpringNetwork(reordered(law, order).material), law)
        found[f"springs, {name}"] = Case(mesh, springs, *SMOOTH, can=OF_SPRINGS, renumbered=again)
        if mesh.k == 2:
            found[f"springs, {name}, triangular"] = Case(
                mesh, SpringNetwork(young=3.0, poisson=0.2, rule="triangular"), *SMOOTH, can=OF_SPRINGS
            )
    found |= neo_hookean() | wrinkling()
    solid = MESHES["tetrahedra"]
    network = EdgeNetwork.of(solid, StVK(young=9.0, poisson=0.4))
    found["network without opposite pairs"] = Case(solid, network.without("opposite"), can=OF_EDGES, definite=False)
    found["network of any edges"] = Case(solid, any_network(solid.nv), can=OF_EDGES)
    for name in SOLID:
        mesh = MESHES[name]
        half = RNG.permutation(mesh.nt)[: mesh.nt // 2 + 1]
        for kind, energy in ENERGIES.items():
            # two continuous derivatives, and a third that jumps where J = 1: small steps
            rest = (1e-11, 0.1) if kind == "quadratic" else (1e-7, 1e-3)
            k = RNG.uniform(1, 9, mesh.nt)
            for suffix, term in (("", VolumePenalty(k, kind)), (", region", VolumePenalty(k[half], kind, half))):
                again = partial(lambda term, mesh, other, order: reordered_penalty(term, mesh, order), term, mesh)
                found[f"{kind}, {name}{suffix}"] = Case(
                    mesh, term, *rest, not energy.infinite_energy, can=("volumes",), renumbered=again
                )
    found |= of_stretches()
    pairs = np.unique(np.sort(RNG.integers(0, solid.nv, (2, 40)), axis=0), axis=1)
    pairs = RNG.permutation(pairs[:, pairs[0] < pairs[1]], axis=1)
    found["springs between any vertices"] = Case(solid, Springs(pairs, 3.0), toy=True)
    found["areas of any three vertices"] = Case(
        solid, Areas(np.argsort(RNG.random((15, solid.nv)), axis=1)[:, :3].T, 50.0), toy=True
    )
    found["anchors"] = Case(solid, Anchors([5, 2, 7], 3.0), grounded=True, toy=True)
    found["wind"] = Case(solid, Wind(pairs, 3.0), grounded=True, toy=True, energy=False)
    return found


def of_stretches():
    """Return cases of laws of principal stretches.

    Their energies are not polynomials, so the steps are small. Their constants have a separate random generator.
    """
    found, rng = {}, np.random.default_rng(21)
    for name, mesh in MESHES.items():
        for kind in (Corotated, InvertibleStVK):
            law = kind(young=rng.uniform(1, 9, mesh.nt), poisson=rng.uniform(-0.3, 0.45, mesh.nt))
            again = partial(lambda law, other, order: reordered(law, order), law)
            found[f"{kind.__name__}, {name}"] = Case(mesh, law, 1e-7, 1e-5, can=("volumes",), renumbered=again)
    for name in ("tetrahedra", "triangles"):
        mesh = MESHES[name]
        law = Corotated(young=rng.uniform(1, 9, mesh.nt), poisson=0.3, rotation="vertex")
        found[f"Corotated by vertex, {name}"] = Case(mesh, law, 1e-7, 1e-5, grounded=True, can=("volumes",), energy=False)
        law = InvertibleStVK(young=rng.uniform(1, 9, mesh.nt), poisson=0.3, threshold=0.85, extend="stress")
        found[f"InvertibleStVK without energy, {name}"] = Case(mesh, law, 1e-7, 1e-5, grounded=True, can=("volumes",), energy=False)
    mesh = MESHES["tetrahedra"]
    R = random_frames(mesh.nt, rng)
    R *= np.sign(np.linalg.det(R))[:, None, None]
    found["Corotated in given frames"] = Case(
        mesh, Corotated(young=3.0, poisson=0.3, rotation=lambda t: R), grounded=True, can=("volumes",), energy=False
    )
    return found


def any_network(nv):
    """Return a network of edges between any vertices, and pairs of edges that need not meet, with a positive definite L."""
    edges = np.unique(np.sort(RNG.integers(0, nv, (2, 50)), axis=0), axis=1)
    edges = edges[:, edges[0] < edges[1]]
    root = random(edges.shape[1], edges.shape[1], density=0.05, random_state=3)
    return EdgeNetwork(RNG.permutation(edges, axis=1), root @ root.T + 0.1 * identity(edges.shape[1]))


CASES = cases()
WITH_ENERGY = [name for name, case in CASES.items() if case.energy]
DEFINITE = [name for name in WITH_ENERGY if CASES[name].definite]
OURS = [name for name, case in CASES.items() if not case.toy]
FREE = [name for name, case in CASES.items() if not case.grounded]


def test_every_elastic_term_has_a_case():
    """Contacts have suites of their own, because they need surfaces that meet."""
    elastic = {term for term in TERMS.values() if not is_load(term)} - {RigidContact, MeshContact}
    missing = elastic - {type(case.term) for case in CASES.values()}
    assert not missing, "add cases to cases() in tests/terms/test_conformance.py"


def bound(case, dtype=np.float64, mesh=None):
    return bound_term.bound(case.term.bind(Body(case.mesh if mesh is None else mesh, []), dtype))


def with_its_blocks(case, term, dtype=np.float64):
    return bound_term.bound(term).with_blocks(case.mesh.nv, case.mesh.d, dtype)


def states(case):
    """Yield states (nv, d) by name: finite, compressed, and with inverted elements where the term has an energy there."""
    mesh = case.mesh
    noise, x = state(mesh).reshape(-1, mesh.d), mesh.p.T
    yield "moderate", 0.4 * noise
    yield "compressed", 0.8 * noise - 0.1 * x if case.slackens else 0.25 * noise - 0.4 * x
    if case.inverts:
        yield "inside out", 2 * noise - x * ([2.4 if case.slackens else 1.6] + [0] * (mesh.d - 1))


def pattern_of(case, *terms):
    return Pattern(case.mesh.nv, case.mesh.d, [term.nodes_paired for term in terms])


def dense(case, term, u, kept=ALL):
    """Return K, F, and the result of `fill` with the energy."""
    pattern, force = pattern_of(case, term), np.zeros(u.shape)
    data = np.full(pattern.nnz, np.nan)
    paired = with_its_blocks(case, term)
    linearized = paired.fill(u, paired.rows(pattern), data, False, force, kept)
    return np.nan_to_num(pattern.matrix(data).toarray()), force, linearized  # entries of vertices outside the term stay NaN


def force_of(term, u, dtype=np.float64):
    force = np.zeros(u.shape, dtype)
    term.energy_and_force(u, force)
    return force


def derivative(f, h):
    """Return the derivative of `f` at 0 by a seven-point stencil: exact for polynomials up to degree six."""
    weights = {1: 45, 2: -9, 3: 1}
    return sum(w * (f(n * h) - f(-n * h)) for n, w in weights.items()) / (60 * h)


def clearly_not_zero(*arrays):
    return all(np.abs(array).max() > 1e-3 for array in arrays)


@pytest.mark.few(24)
@pytest.mark.parametrize("name", CASES)
def test_force_and_tangent_are_derivatives(name):
    case = CASES[name]
    term, v = bound(case), state(case.mesh, seed=9).reshape(-1, case.mesh.d)
    for _, u in states(case):
        K, F, linearized = dense(case, term, u)
        Kv = (K @ v.ravel()).reshape(v.shape)
        assert clearly_not_zero(F, K, Kv)
        assert np.isfinite(linearized.total)
        assert (
            linearized.energy == pytest.approx(term.energy_and_force(u), rel=1e-13) and (linearized.energy != 0) == term.has_energy
        )
        assert force_of(term, u) == pytest.approx(F, abs=1e-13 * np.abs(F).max())
        slope = derivative(lambda s, u=u: term.energy_and_force(u + s * v), case.step)
        force = derivative(lambda s, u=u: force_of(term, u + s * v), case.step)
        if term.has_energy:
            assert slope == pytest.approx(np.vdot(F, v), abs=case.limit * np.abs(F).ravel() @ np.abs(v).ravel())
        assert np.abs(force - Kv).max() < case.limit * np.abs(Kv).max()
        assert (np.abs(K - K.T).max() <= 1e-14 * np.abs(K).max()) == term.symmetric


@pytest.mark.parametrize("name", sorted(CASES.keys() - WITH_ENERGY))
def test_a_system_names_the_term_that_has_no_energy(name):
    """The bound term returns 0 as energy. The system refuses to return its energy and lists NaN."""
    case = CASES[name]
    term, others = bound(case), StVK(young=2.0, poisson=0.3).bind(case.mesh)
    system, own = System(case.mesh, [case.term, StVK(young=2.0, poisson=0.3)]), f"{type(case.term).__name__} 0"
    for _, x in states(case):
        u = x.ravel()
        assert not term.has_energy and term.energy_and_force(x) == 0 and others.energy_and_force(x) > 1e-3
        F = (force_of(term, x) + force_of(others, x)).ravel()
        assert system.internal_force(u) == pytest.approx(F, abs=1e-12 * np.abs(F).max())
        assert system.energies(u) == pytest.approx({own: np.nan, "StVK 1": others.energy_and_force(x)}, nan_ok=True)
        for one in (system.energy, system.energy_and_force, system.linearize, system.potential):
            with pytest.raises(StvkError, match=rf"^{own} has no energy; .*internal_force\(u\) and tangent\(u\)"):
                one(u)


@pytest.mark.few(16)
@pytest.mark.parametrize("name", CASES)
def test_products_diagonals_and_edge_blocks_are_those_of_the_tangent(name):
    case = CASES[name]
    term, v = bound(case), state(case.mesh, seed=9).reshape(-1, case.mesh.d)
    (nv, d), paired = v.shape, with_its_blocks(case, term)
    for _, u in states(case):
        for kept in (ALL, TENSILE, NONE, Tensions(0.3, 0.8)):
            K, F, _ = dense(case, term, u, kept)
            force, product, diagonal, norms = np.zeros((nv, d)), np.zeros((nv, d)), np.zeros((nv, d, d)), np.zeros(nv)
            energy, blocks = paired.blocks(u, force, None, kept)
            paired.pairs.add_product(blocks, v, product)
            paired.pairs.add_diagonal(blocks, diagonal)
            paired.pairs.add_norms(blocks, x := np.arange(1.0, nv + 1), norms)
            assert energy == pytest.approx(term.energy_and_force(u), rel=1e-13)
            assert np.abs(force - F).max() <= 1e-13 * np.abs(F).max()
            assert product.ravel() == pytest.approx(K @ v.ravel(), abs=1e-13 * np.abs(K).max())
            assert diagonal == pytest.approx(
                np.stack([K[d * a :, d * a :][:d, :d] for a in range(nv)]), abs=1e-13 * np.abs(K).max()
            )
            others = np.linalg.norm(K.reshape(nv, d, nv, d), axis=(1, 3)) * (1 - np.eye(nv))
            assert norms == pytest.approx(others @ x, rel=1e-12, abs=1e-13 * np.abs(K).max() * x.sum())


@pytest.mark.few
@pytest.mark.parametrize("name", DEFINITE)
def test_the_clamped_tangent_is_positive_semi_definite(name):
    case = CASES[name]
    term = bound(case)
    for pushed, u in states(case):
        exact, clamped = dense(case, term, u)[0], dense(case, term, u, TENSILE)[0]
        lowest, highest = np.linalg.eigvalsh(clamped)[[0, -1]]
        assert lowest >= -1e-13 * highest and highest > 1e-3
        assert np.abs(clamped - clamped.T).max() <= 1e-14 * highest
        # an indefinite exact tangent must be changed; a positive semi-definite one need not be
        indefinite = np.linalg.eigvalsh(exact)[0] < -1e-10 * highest
        assert not indefinite or np.abs(exact - clamped).max() > 1e-3 * highest
        gives_way = isinstance(case.term, StVK) and not case.term.wrinkling
        assert indefinite or not (gives_way and pushed == "compressed")


@pytest.mark.few(12)
@pytest.mark.parametrize("name", FREE)
def test_rigid_motions_change_nothing_and_forces_balance(name):
    case = CASES[name]
    mesh, term = case.mesh, bound(case)
    rotation = np.eye(mesh.d)
    if mesh.d > 1:
        rotation = np.linalg.qr(np.random.default_rng(3).standard_normal((mesh.d, mesh.d)))[0]
        rotation *= np.sign(np.linalg.det(rotation))  # not a mirror
        if mesh.d == 2 and np.linalg.det(rotation) < 0:
            rotation[:, 0] *= -1
    assert np.linalg.det(rotation) == pytest.approx(1)
    x = mesh.p.T
    for _, u in states(case):
        W, F, K = term.energy_and_force(u), force_of(term, u), dense(case, term, u)[0]
        size = np.abs(F).max()
        assert W > 1e-3 and size > 1e-3
        moved = (x + u) @ rotation.T + 3.0 - x
        assert term.energy_and_force(moved) == pytest.approx(W, rel=1e-11)
        assert np.abs(force_of(term, moved) - F @ rotation.T).max() < 1e-11 * size
        assert np.abs(F.sum(axis=0)).max() < 1e-12 * size
        arms = x + u
        torque = np.einsum("ni,nj->ij", arms, F)
        assert np.abs(torque - torque.T).max() < 1e-11 * size
        assert np.abs(K @ np.tile(np.eye(mesh.d), (mesh.nv, 1))).max() < 1e-12 * np.abs(K).max()


@pytest.mark.few
@pytest.mark.parametrize("name", CASES)
def test_fill_adds_to_earlier_values_on_a_larger_pattern(name):
    case = CASES[name]
    term, other = bound(case), StVK(young=1.0, poisson=0.3).bind(case.mesh)
    for _, u in states(case):
        pattern = pattern_of(case, other, term)
        data, force = np.ones(pattern.nnz), np.ones(u.shape)
        paired = with_its_blocks(case, term)
        paired.fill(u, paired.rows(pattern), data, True, force)
        K, F, _ = dense(case, term, u)
        assert pattern.matrix(data - 1).toarray() == pytest.approx(K, abs=1e-13 * max(1, np.abs(K).max()))
        assert force - 1 == pytest.approx(F, abs=1e-13 * max(1, np.abs(F).max()))


@pytest.mark.few
@pytest.mark.parametrize("parts", [2, 5])
@pytest.mark.parametrize("name", CASES)
def test_shared_by_threads_the_results_are_the_same(name, parts, monkeypatch):
    case = CASES[name]
    wanted = [(term := bound(case)).energy_and_force(u) for _, u in states(case)], [dense(case, term, u) for _, u in states(case)]
    in_parts(monkeypatch, parts)
    term = bound(case)
    for (_, u), W, (K, F, _) in zip(states(case), *wanted, strict=True):
        found = dense(case, term, u)
        assert term.energy_and_force(u) == pytest.approx(W, rel=1e-13)
        assert np.abs(found[0] - K).max() < 1e-13 * np.abs(K).max() and np.abs(found[1] - F).max() < 1e-13 * np.abs(F).max()
        again = dense(case, term, u)
        assert np.array_equal(found[0], again[0]) and np.array_equal(found[1], again[1])


@pytest.mark.few
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.renumbered])
def test_numbering_and_orientation_do_not_matter(name):
    case = CASES[name]
    mesh, rng = case.mesh, np.random.default_rng(8)
    to, order = rng.permutation(mesh.nv), rng.permutation(mesh.nt)
    p = np.empty_like(mesh.p)
    p[:, to] = mesh.p
    other = ElementMesh(p, turned_round(to[mesh.t[:, order]], rng))
    term = case.renumbered(other, order)
    one, two = bound(case), bound(case._replace(term=term), mesh=other)
    for _, u in states(case):
        v = np.empty_like(u)
        v[to] = u
        assert two.energy_and_force(v) == pytest.approx(one.energy_and_force(u), rel=1e-12)
        F = force_of(one, u)
        assert np.abs(force_of(two, v)[to] - F).max() < 1e-11 * np.abs(F).max()


@pytest.mark.few
@pytest.mark.parametrize("name", CASES)
def test_single_precision_has_errors_of_single_precision(name):
    case = CASES[name]
    single, double = bound(case, np.float32), bound(case)
    for _, u in states(case):
        K, F, _ = dense(case, double, u)
        paired = with_its_blocks(case, single, np.float32)
        blocks = paired.blocks(u)[1]
        assert blocks.dtype == np.float32
        pattern = pattern_of(case, single)
        data, force = np.zeros(pattern.nnz, np.float32), np.zeros(u.shape, np.float32)
        linearized = paired.fill(u, paired.rows(pattern), data, False, force)
        assert linearized.energy == pytest.approx(double.energy_and_force(u), rel=4e-6)
        assert 0 < np.abs(force - F).max() < 8e-6 * np.abs(F).max()
        assert np.abs(pattern.matrix(data.astype(float)).toarray() - K).max() < 8e-6 * np.abs(K).max()


@pytest.mark.few(12)
@pytest.mark.parametrize("name", CASES)
def test_the_round_off_of_the_force_is_neither_below_its_error_nor_far_above(name):
    """The bound on round-off is above the error in single precision, including the rounding of the state, and not far above.

    The force in double precision is the reference.
    """
    case = CASES[name]
    single, double = bound(case, np.float32), bound(case)
    for _, u in states(case):
        sizes = np.zeros(u.shape)
        double.add_round_off(u, sizes)
        assert (sizes >= (1 - 1e-12) * np.abs(force_of(double, u))).all()
        stored = u.astype(np.float32).astype(np.float64)
        error = np.linalg.norm(force_of(single, stored, np.float32) - force_of(double, u))
        assert 1e-4 < error / (np.finfo(np.float32).eps * np.linalg.norm(sizes)) < (2 if case.mesh.k == 1 else 0.5)


def laws_of_several_points():
    """Yield all laws with stretches or rotations on elements with several points, as cases."""
    for name, mesh in CURVED.items():
        for law in (StVK, NeoHookean, Corotated, InvertibleStVK):
            if law is not NeoHookean or mesh.k > 1:
                yield f"{law.__name__}, {name}", Case(mesh, law(young=3.0, poisson=0.3))
        if mesh.k == mesh.d > 1:
            yield f"by vertex, {name}", Case(mesh, Corotated(young=3.0, poisson=0.3, rotation="vertex"))
            yield f"without energy, {name}", Case(mesh, InvertibleStVK(young=3.0, poisson=0.3, extend="stress"))


CLOSE = {name: CASES[name] for name in OURS} | dict(laws_of_several_points())


@pytest.mark.few
@pytest.mark.parametrize("name", CLOSE)
def test_the_round_off_of_the_force_holds_at_rest_and_far_from_the_origin(name):
    """The coordinates are dyadic: a shift of the mesh by 4096 is exact, and changes no force or energy by more than round-off.

    Near rest the force is that of K, except for laws whose K jumps there. User-supplied frames have stress at rest.
    """
    case = CLOSE[name]
    p = np.round(2.0**20 * case.mesh.p) / 2.0**20
    near, far = (bound(case, mesh=replace(case.mesh, p=p + shift)) for shift in (0, 4096))
    noise = state(case.mesh).reshape(-1, case.mesh.d)
    K, at_rest, _ = dense(case, near, 0 * noise)
    jumps = case.slackens or getattr(case.term, "kind", None) in ("compression", "barrier")
    for amount in (0, 1e-20, 1e-8, 0.3):
        u = amount * noise
        sizes, force = np.zeros(u.shape), force_of(near, u)
        near.add_round_off(u, sizes)
        errors, change = [force_of(far, u) - force], far.energy_and_force(u) - near.energy_and_force(u)
        assert abs(change) <= np.finfo(float).eps * np.linalg.norm(sizes) * np.linalg.norm(u)
        if amount <= 1e-20 and not jumps:
            stress_free = not callable(getattr(case.term, "rotation", None))
            errors.append(force - (K @ u.ravel()).reshape(u.shape) - (0 if stress_free else at_rest))
        for error in errors:
            assert np.linalg.norm(error) <= np.finfo(float).eps * np.linalg.norm(sizes)


@pytest.mark.few(24)
@pytest.mark.parametrize("name", OURS)
def test_the_term_can_do_what_its_case_says(name):
    """The term declares exactly the abilities of its case: volumes, the quartic, the mean force, damping."""
    case = CASES[name]
    term = bound(case)
    volumes = ["volumes"] if isinstance(term, BoundElements) else []
    assert {*volumes, *(ability for ability in OF_EDGES if getattr(term, ability))} == set(case.can)
    assert System(case.mesh, [StVK(young=1.0, poisson=0.3), case.term]).quartic == ("quartic" in case.can)
    assert sum(term.memory().values()) > 0


@pytest.mark.few(12)
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if "has_mean_force" in case.can])
def test_the_work_of_the_mean_force_is_the_difference_of_the_energies(name):
    """The work of the mean force is the energy difference plus `(w1 - w0) R`, where R is the dissipation of unequal weights.

    At equal states, the mean force is the sum of the weights times the force.
    """
    case = CASES[name]
    term, v = bound(case), (1 if case.inverts else 0.15) * state(case.mesh, seed=9).reshape(-1, case.mesh.d)
    for _, u in states(case):
        gained, moved = term.energy_and_force(u + v) - term.energy_and_force(u), force_of(term, u + 0.3 * v)
        for w1 in (0.5, 0.9):
            force = np.ones(u.shape)
            R = term.mean_force(u, u + v, (1 - w1, w1), 0.5, force)
            size = (np.abs(force) * np.abs(v)).sum()
            assert np.vdot(force - 1, v) == pytest.approx(gained + (2 * w1 - 1) * R, abs=1e-12 * size) and abs(gained) > 1e-3 * size
        force = np.zeros(u.shape)
        assert term.mean_force(u + 0.3 * v, u + 0.3 * v, (0.5, 1.5), 0.7, force) == 0
        assert np.abs(force - 2 * moved).max() < 1e-13 * np.abs(moved).max()


@pytest.mark.few(8)
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if "quartic" in case.can])
def test_the_quartic_is_the_energy_along_a_line(name):
    case = CASES[name]
    term, v = bound(case), state(case.mesh, seed=9).reshape(-1, case.mesh.d)
    for _, u in states(case):
        c = term.along(u, v)
        for s in (-1.5, 0.0, 0.7):
            powers = c * s ** np.arange(5)
            assert powers.sum() == pytest.approx(term.energy_and_force(u + s * v), abs=1e-12 * np.abs(powers).sum())
