"""Data are created only when needed, and `memory()` returns their bytes."""

import gc
import types

import numba
import numpy as np
import pytest
import skfem
from bodies import box, random_frames, some_voigt, state
from scipy.spatial import Delaunay

from skfem_stvk import Anisotropic, ElementMesh, StVK, System
from skfem_stvk.edges import TENSILE

TERM = StVK(young=2.0, poisson=0.3)
RNG = np.random.default_rng(0)
MESH = box(9)  # 4374 tetrahedra
MORE = {"own edges", "blocks of edges", "rows of K", "pattern of K", "product"}


def unstructured(n=900):
    """Return tetrahedra between random points, without slivers."""
    p = np.random.default_rng(0).random((3, n))
    mesh = ElementMesh(p, Delaunay(p.T).simplices.T)
    vectors = mesh.p[:, mesh.t[1:]] - mesh.p[:, mesh.t[:1]]
    volume = np.abs(np.linalg.det(vectors.transpose(2, 0, 1)))
    t = mesh.t[:, volume > 1e-2 * volume.mean()]
    used, t = np.unique(t, return_inverse=True)
    return ElementMesh(p[:, used], t.reshape(4, -1))


@pytest.fixture(autouse=True)
def one_thread():
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)


def real_bytes(*roots):
    """Return the bytes of all arrays that can be reached from these objects. A view counts with its base array."""
    seen, found, todo = set(), {}, list(roots)
    while todo:
        item = todo.pop()
        if id(item) in seen or isinstance(item, type | types.ModuleType | types.FunctionType | types.MethodType):
            continue
        seen.add(id(item))
        if isinstance(item, np.ndarray):
            while isinstance(item.base, np.ndarray):
                item = item.base
            found[id(item)] = item.nbytes
        else:
            todo += gc.get_referents(item)
    return sum(found.values())


def stages(body, u):
    """Yield the name of the next step before each step."""
    yield "made"
    body.energy_and_force(u)
    yield "force"
    body.product(u, u)
    yield "product"
    body.tangent(u)
    yield "tangent"


@pytest.mark.filterwarnings("ignore:.*flatter than 1")
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("mesh", [MESH, unstructured()], ids=["box", "unstructured"])
def test_memory_is_that_of_all_arrays(mesh, dtype):
    body = System(mesh, TERM, dtype=dtype)
    for stage in stages(body, state(mesh)):
        reported, real = sum(body.memory().values()), real_bytes(body)
        assert 0.85 * real < reported <= real, (stage, reported / real)


def test_memory_of_general_stiffness_is_that_of_all_arrays():
    body = System(MESH, StVK(Anisotropic(some_voigt(RNG), frame=random_frames(1, RNG)[0])))
    reported, real = sum(body.memory().values()), real_bytes(body)
    assert 0.85 * real < reported and real < 400 * MESH.nt


@pytest.mark.parametrize("call", ["energy", "internal_force", "energy_and_force"])
@pytest.mark.parametrize("term", [TERM, StVK(Anisotropic(some_voigt(RNG)))], ids=["isotropic", "general"])
def test_energy_and_force_need_no_pattern_and_no_pairs(call, term):
    body = System(box(3), term)
    getattr(body, call)(state(body.mesh))
    memory = body.memory()
    assert {name for name in MORE if memory[name]} == set()
    assert body._pattern is None and body._row_cache is None
    (assembly,) = body.bound_terms
    assert not {"edges", "lexicographic"} & set(vars(assembly.elements))
    assert not {"L", "P", "t2e", "pairs", "adjacent"} & set(vars(assembly.form))


def test_a_product_needs_no_pattern_and_the_tangent_no_product():
    mesh = box(3)
    one, other = System(mesh, TERM), System(mesh, TERM)
    one.product(state(mesh), state(mesh))
    other.tangent(state(mesh))
    assert {name for name in MORE if one.memory()[name]} == {"own edges", "product"}
    assert {name for name in MORE if other.memory()[name]} == MORE - {"product", "blocks of edges"}
    for body in (one, other):
        (assembly,) = body.bound_terms
        assert not {"L", "P", "pairs", "adjacent"} & set(vars(assembly.form))


@pytest.mark.parametrize("mesh", [MESH, unstructured()], ids=["box", "unstructured"])
def test_bytes_of_a_tetrahedron(mesh):
    body, u = System(mesh, TERM), state(mesh)
    body.energy_and_force(u)
    assert 4000 < mesh.nt < 7000 and real_bytes(body) < 400 * mesh.nt
    body.tangent(u)
    assert real_bytes(body) - real_bytes(body.pattern) < 700 * mesh.nt
    assert sum(body.memory().values()) - body.pattern.memory() < 700 * mesh.nt


def test_memory_grows_with_the_mesh_and_no_faster():
    reported = []
    for n in (6, 12):
        mesh = box(n)
        body = System(mesh, TERM)
        for _ in stages(body, state(mesh)):
            pass
        reported.append(sum(body.memory().values()) / mesh.nt)
    assert 0.85 * reported[0] < reported[1] < 1.05 * reported[0]


def test_memory_does_not_grow_with_use():
    mesh = box(4)
    body, u = System(mesh, TERM), state(mesh)
    for _ in stages(body, u):
        pass
    before = real_bytes(body)
    for amount in (1.0, -2.0, 0.5):
        for _ in stages(body, amount * u):
            body.linearize(amount * u)
    assert real_bytes(body) == before


def test_the_parts_of_memory_are_bytes_of_their_arrays():
    mesh = skfem.MeshTet().refined(2)
    body = System(mesh, TERM)
    K = body.tangent(np.zeros(body.ndofs))
    memory = body.memory()
    assert memory["mesh"] == body.mesh.p.nbytes + body.mesh.t.nbytes
    assert memory["edges of the mesh"] == body.bound_terms[0].nodes_paired.nbytes == 8 * mesh.edges.shape[1]
    assert memory["blocks of edges"] == 0 < memory["rows of K"]
    assert memory["pattern of K"] == real_bytes(body.pattern) > K.indices.nbytes + K.indptr.nbytes
    assert memory["shares of threads"] == memory["product"] == 0
    body.jacobian(np.zeros(body.ndofs), 1.0, kept=TENSILE)  # the clamped tangent uses the signs of tensions of whole edges
    assert body.memory()["blocks of edges"] == 72 * mesh.edges.shape[1]
    body.product(np.zeros(body.ndofs), np.zeros(body.ndofs))
    assert body.memory()["product"] == 72 * mesh.edges.shape[1] + 8 * body.ndofs
