"""The mass matrix has the mass, the momenta and the kinetic energy of the body, and equals scikit-fem's."""

import pickle

import numpy as np
import pytest
import skfem
from bodies import BODIES, MESHES, box, sheet
from skfem.helpers import dot

from skfem_stvk import (
    EdgeNetwork,
    ElasticFoundation,
    ElementMesh,
    MaterialError,
    NeoHookean,
    StVK,
    StvkError,
    System,
    VolumePenalty,
)
from skfem_stvk.edges.materials import Orthotropic
from skfem_stvk.system.mass import KINDS

RNG = np.random.default_rng(0)
SECTION = {1: "area", 2: "thickness"}


def material(mesh, density=3.0, region=None):
    """Return a law whose section and density vary from element to element where possible."""
    n = len(mesh.elements(region))
    section = {SECTION[mesh.k]: RNG.uniform(0.5, 2, n)} if mesh.k < 3 else {}
    return StVK(young=2.0, poisson=0.3, density=density * RNG.uniform(0.5, 2, n), region=region, **section)


BODIES_WITH_MASS = {name: System(mesh, material(mesh)) for name, mesh in MESHES.items()}


def volumes(mesh):
    """Return the sizes of elements by Gram determinants, independently of the package."""
    vectors = (mesh.p[:, mesh.t[1:]] - mesh.p[:, mesh.t[:1]]).transpose(2, 1, 0)
    return np.sqrt(np.linalg.det(vectors @ vectors.transpose(0, 2, 1))) / [1, 1, 2, 6][mesh.k]


def masses(system):
    (term,) = system.terms
    section = getattr(term, SECTION.get(system.mesh.k, ""), 1.0)
    return volumes(system.mesh) * section * term.material.density


@pytest.mark.few
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", MESHES)
def test_the_total_is_density_times_volume(name, kind):
    system = BODIES_WITH_MASS[name]
    mass, total, d = system.mass(kind), masses(system).sum(), system.mesh.d
    assert mass.total == pytest.approx(total, rel=1e-14)
    velocity = np.tile(np.arange(1.0, d + 1), system.mesh.nv)  # velocities of a translation
    momentum = mass.multiply(velocity)
    assert momentum.reshape(-1, d).sum(axis=0) == pytest.approx(total * np.arange(1.0, d + 1), rel=1e-13)
    assert velocity @ momentum / 2 == pytest.approx(total * (np.arange(1.0, d + 1) ** 2).sum() / 2, rel=1e-13)


@pytest.mark.few
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", MESHES)
def test_all_ways_to_multiply_are_the_matrix(name, kind):
    system = BODIES_WITH_MASS[name]
    mass, v = system.mass(kind), RNG.standard_normal(system.ndofs)
    dense = mass.matrix.toarray()
    assert np.array_equal(dense, dense.T) and np.linalg.eigvalsh(dense).min() > 0
    assert np.abs(mass.multiply(v) - dense @ v).max() < 1e-13 * np.abs(dense).max()
    assert dense.sum(axis=1) == pytest.approx(np.repeat(mass.vertex, system.mesh.d), rel=1e-13)
    out = v.copy()
    assert mass.multiply(out, out=out) is out and np.array_equal(out, mass.multiply(v))
    assert np.abs(mass.solve(mass.multiply(v)) - v).max() < 1e-12 * np.abs(v).max()


@pytest.mark.parametrize(("name", "element"), [("tetrahedra", skfem.ElementTetP1()), ("triangles", skfem.ElementTriP1())])
def test_the_consistent_matrix_is_scikit_fems(name, element):
    system = BODIES_WITH_MASS[name]
    mesh = skfem.MeshTet(system.mesh.p, system.mesh.t) if system.mesh.k == 3 else skfem.MeshTri(system.mesh.p, system.mesh.t)
    basis = skfem.Basis(mesh, skfem.ElementVector(element), intorder=2)
    heavy = (masses(system) / volumes(system.mesh))[:, None]
    reference = skfem.BilinearForm(lambda u, v, w: heavy * dot(u, v)).assemble(basis).toarray()
    M = system.mass("consistent").matrix
    assert np.abs(M.toarray() - reference).max() < 1e-14 * np.abs(reference).max()
    lumped = np.asarray(reference.sum(axis=1))
    assert np.abs(system.mass().matrix.diagonal() - lumped).max() < 1e-14 * np.abs(lumped).max()


@pytest.mark.few
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("name", MESHES)
def test_a_multiple_is_added_to_K_in_place(name, dtype, kind):
    mesh = MESHES[name]
    system = System(mesh, material(mesh), dtype=dtype)
    K, mass = system.tangent(np.zeros(system.ndofs)), system.mass(kind)
    wanted = K.toarray() - 0.7 * mass.matrix.toarray()
    data = K.data
    mass.add_to(K, -0.7)
    assert K.data is data and K.dtype == dtype
    assert np.abs(K.toarray() - wanted).max() < 4 * np.finfo(dtype).eps * np.abs(wanted).max()
    assert kind == "lumped" or system.pattern.fits(mass.matrix, np.float64)


def test_the_matrix_of_another_pattern_is_refused():
    system = BODIES_WITH_MASS["tetrahedra"]
    K = system.tangent(np.zeros(system.ndofs))
    for other in (K.tocsc(), K[:-1], BODIES_WITH_MASS["triangles"].tangent(np.zeros(50)), K.toarray()):
        with pytest.raises(StvkError, match="does not have the pattern of this system's K"):
            system.mass().add_to(other, 1.0)


@pytest.mark.parametrize("d", [2, 3])
def test_rotation_has_the_energy_of_the_rigid_body(d):
    """A rotating brick has the kinetic energy 1/2 w'Iw about its centre.

    Lumped masses have a larger moment of inertia, with a difference that decreases on finer meshes.
    """
    sides, rho, w = np.array([1.0, 2.0, 0.5])[:d], 3.0, np.array([0.3, -0.7, 1.1])
    w = w if d == 3 else np.array([0.0, 0.0, 1.1])
    closed = {}
    for n in (3, 6):
        unit = box(n) if d == 3 else sheet(n)
        inner = (unit.p > 0) & (unit.p < 1)
        flat = (skfem.MeshTet if d == 3 else skfem.MeshTri).init_tensor(*[np.linspace(0, 1, n + 1)] * d).p
        p = np.where((flat > 0) & (flat < 1) & inner, unit.p, flat) * sides[:, None]  # irregular vertices within a brick
        system = System(ElementMesh(p, unit.t), StVK(young=2.0, poisson=0.3, density=rho))
        arm = np.zeros((3, p.shape[1]))
        arm[:d] = p - sides[:, None] / 2
        velocity = np.cross(w, arm.T)[:, :d].ravel()
        total = rho * sides.prod()
        squares = np.append(sides**2, [0.0] * (3 - d)) / 12
        exact = total * (squares.sum() * (w @ w) - (w**2 * squares).sum()) / 2
        energies = {kind: velocity @ system.mass(kind).multiply(velocity) / 2 for kind in KINDS}
        assert energies["consistent"] == pytest.approx(exact, rel=1e-13)
        closed[n] = energies["lumped"] / exact - 1
    assert closed[3] / 5 < closed[6] < closed[3] / 3


def test_terms_on_the_same_elements_add_their_mass():
    mesh = MESHES["tetrahedra"]
    one = StVK(young=2.0, poisson=0.3, density=3.0)
    other = StVK(young=1.0, poisson=0.1, density=RNG.uniform(1, 2, mesh.nt // 2), region=np.arange(0, 2 * (mesh.nt // 2), 2))
    alone = [System(mesh, one).mass("consistent").matrix, System(mesh, [one, other]).mass("consistent").matrix]
    elements = volumes(mesh)[other.region] * other.material.density
    assert alone[1].sum() - alone[0].sum() == pytest.approx(3 * elements.sum(), rel=1e-12)


def test_regions_have_their_own_density():
    mesh = MESHES["triangles"]
    half = mesh.nt // 2
    regions = np.arange(half), np.arange(half, mesh.nt)
    system = System(mesh, [material(mesh, 3.0, regions[0]), material(mesh, 500.0, regions[1])])
    by_hand = np.zeros(mesh.nv)
    for region, term in zip(regions, system.terms, strict=True):
        each = volumes(mesh)[region] * term.thickness * term.material.density / 3
        for corner in mesh.t[:, region]:
            by_hand += np.bincount(corner, weights=each, minlength=mesh.nv)
    assert system.mass().vertex == pytest.approx(by_hand, rel=1e-13)


@pytest.mark.few
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", MESHES)
def test_constrained_degrees_of_freedom_do_not_accelerate(name, kind):
    """Constrained degrees of freedom have no acceleration.

    The inverse of M over the free degrees of freedom differs from that of M: components of one vertex may be constrained
    separately.
    """
    mesh = MESHES[name]
    letters = "xyz"[: mesh.d]
    fixed = {(0,): letters, (mesh.nv - 1,): letters[-1]}
    free = System(mesh, material(mesh, 1.0))
    system = System(mesh, free.terms, fixed=fixed)
    held = system.supports.held
    inner = np.setdiff1d(np.arange(system.ndofs), held)
    f, M = RNG.standard_normal(system.ndofs), system.mass(kind).matrix.toarray()
    accelerations = system.mass(kind).solve(f)
    assert not accelerations[held].any()
    wanted = np.linalg.solve(M[np.ix_(inner, inner)], f[inner])
    assert np.abs(accelerations[inner] - wanted).max() < 1e-13 * np.abs(wanted).max()
    if kind == "consistent":
        assert np.abs(free.mass(kind).solve(f)[inner] - wanted).max() > 1e-3 * np.abs(wanted).max()


def test_a_mass_is_created_once_and_without_the_pattern():
    mesh = MESHES["tetrahedra"]
    system = System(mesh, material(mesh))
    assert system.mass() is system.mass("lumped") and system.mass("consistent") is not system.mass()
    system.mass("consistent").solve(system.mass().multiply(np.ones(system.ndofs)))
    assert "pattern" not in vars(system)
    assert system.memory()["mass"] == sum(system.mass(kind).memory() for kind in KINDS) > 0
    assert repr(system.mass()) == f"Mass: {masses(system).sum():g} kg at {mesh.nv} vertices, lumped"


@pytest.mark.parametrize("kind", KINDS)
def test_a_system_is_pickled_with_its_mass(kind):
    system = BODIES_WITH_MASS["triangles"]
    f = RNG.standard_normal(system.ndofs)
    wanted = system.mass(kind).solve(f)
    assert np.array_equal(pickle.loads(pickle.dumps(system)).mass(kind).solve(f), wanted)


def test_without_density_there_is_no_mass():
    with pytest.raises(MaterialError, match=r"has no density. Give it one: StVK\(..., density=...\)"):
        System(*BODIES["tetrahedra, isotropic"]).mass()
    with pytest.raises(MaterialError, match="No term has a density"):
        System(MESHES["tetrahedra"], VolumePenalty(1.0)).mass()
    wood = Orthotropic((11.0, 0.9, 0.5), (0.6, 0.45, 0.37), (0.04, 0.7, 0.75))
    for law, words in ((NeoHookean(young=1.0, poisson=0.3), "NeoHookean"), (StVK(wood), "Orthotropic")):
        with pytest.raises(MaterialError, match=rf"Give it one: {words}\(\.\.\., density=\.\.\.\)"):
            System(MESHES["tetrahedra"], law).mass()


def test_a_network_without_laws_names_how_to_give_it_mass():
    """A law with a density, which is the remedy for other bodies, would add its stiffness."""
    mesh = MESHES["triangles"]
    made = EdgeNetwork.of(mesh, StVK(young=2.0, poisson=0.3, density=3.0))
    with pytest.raises(
        MaterialError, match=r"no mass, because an EdgeNetwork\(edges, L\) has no elements.*EdgeNetwork\.of\(mesh, StVK"
    ):
        System(mesh, EdgeNetwork(made.edges, made.L)).mass()
    assert System(mesh, made).mass().total == pytest.approx(3.0 * volumes(mesh).sum())


@pytest.mark.parametrize("kind", ["diagonal", None, ["lumped"]])
def test_another_kind_is_refused(kind):
    with pytest.raises(StvkError, match="known: 'consistent', 'lumped'"):
        BODIES_WITH_MASS["tetrahedra"].mass(kind)


@pytest.mark.parametrize("kind", KINDS)
def test_vertices_without_mass_are_named_unless_constrained(kind):
    """Vertices without mass are named unless they are constrained.

    These vertices belong to elements with a volume penalty only, next to elements with a material.
    """
    mesh = MESHES["triangles"]
    solid = np.flatnonzero((mesh.t != 0).all(axis=0))
    terms = [StVK(young=2.0, poisson=0.3, density=3.0, region=solid), VolumePenalty(1.0)]
    loose = tuple(np.setdiff1d(mesh.t, mesh.t[:, solid]).tolist())
    bare, half, held = (System(mesh, terms, fixed=fixed) for fixed in (None, {loose: "x"}, {loose: "xy"}))
    for system in (bare, half):
        with pytest.raises(MaterialError, match=rf"{len(loose)} vert.* \({loose[0]}.*\) of {mesh.nv}: can move, but have no mass"):
            system.mass(kind)
    mass, f = held.mass(kind), RNG.standard_normal(held.ndofs)
    assert mass.total == pytest.approx(3.0 * volumes(mesh)[solid].sum()) and np.isfinite(mass.solve(f)).all()
    inner = np.setdiff1d(np.arange(held.ndofs), held.supports.held)
    assert np.abs((mass.multiply(mass.solve(f)) - f)[inner]).max() < 1e-13
    K = held.tangent(0 * f)
    before = K.toarray()
    mass.add_to(K, 2.0)
    assert np.abs(K.toarray() - before - 2 * mass.matrix.toarray()).max() < 1e-14 * np.abs(before).max()


def test_a_foundation_has_no_mass():
    mesh = ElementMesh.of(skfem.MeshTri().refined(2).with_boundaries({"floor": lambda x: x[1] == 0}))
    term = StVK(young=2.0, poisson=0.3, density=3.0)
    on_springs = System(mesh, [term, ElasticFoundation("floor", stiffness=5.0)])
    assert np.array_equal(on_springs.mass().vertex, System(mesh, term).mass().vertex)
