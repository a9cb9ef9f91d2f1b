"""The compiled kernels agree with the readable twins, in systems that run on either."""

from importlib import import_module
from pkgutil import iter_modules

import numpy as np
import pytest
from bodies import BODIES, CURVED, MESHES, box, random_frames, some_voigt, state
from kernels import readable, readable_networks, readable_reduced
from kernels.parts import in_parts, on_twins
from kernels.test_readable import LAWS, quadrature, rules
from kernels.test_readable import MESHES as EVERY_MESH
from numba.core.dispatcher import Dispatcher
from slow import slow

from skfem_stvk import Anisotropic, EdgeNetwork, LinearElastic, SpringNetwork, StVK, System, VolumePenalty
from skfem_stvk import kernels as compiled_kernels
from skfem_stvk.edges import Tensions
from skfem_stvk.kernels import networks, reduced
from skfem_stvk.kernels.lanes import LANES
from skfem_stvk.terms import Body, BoundElements
from skfem_stvk.terms.laws.volume_penalty import ENERGIES


def results(mesh, terms, dtype=np.float64, amount=0.3, kind="usual"):
    """Return all results of the kernels, by name."""
    body = System(mesh, terms, quadrature=None if kind == "usual" else kind, dtype=dtype)
    u, v = state(mesh, amount), state(mesh, seed=9)
    W, F = body.energy_and_force(u)
    again, too, K = body.linearize(u)
    return of_terms(mesh, terms, dtype, amount, kind) | {
        "W": W,
        "F": F,
        "W of linearize": again,
        "F of linearize": too,
        "K": body.tangent(u).data,
        "K of linearize": K.data,
        "K without the first vertex": body.free_dofs(np.arange(mesh.d)).matrix(K).data,
        "K v": body.product(u, v),
        "indices": K.indices,
        "indptr": K.indptr,
    }


def of_terms(mesh, terms, dtype, amount, kind):
    """Return results of the terms that a system does not return term by term.

    The bodies are compressed, so that tensions are negative.
    """
    found = {}
    for i, term in enumerate(terms if isinstance(terms, list) else [terms]):
        assembly, v = term.bind(Body(mesh, [], quadrature(mesh, kind)), dtype), state(mesh, seed=9).reshape(-1, mesh.d)
        u = state(mesh, amount).reshape(-1, mesh.d) - 0.3 * mesh.p.T
        sizes, diagonal, product = np.zeros_like(u), np.zeros((*u.shape, mesh.d)), np.zeros_like(u)
        assembly.add_round_off(u, sizes)
        _, blocks = assembly.blocks(u, kept=Tensions(0.9, 0.2))
        assembly.pairs.add_diagonal(blocks, diagonal)
        assembly.pairs.add_product(blocks, v, product)
        assembly.pairs.add_norms(blocks, np.arange(1.0, mesh.nv + 1), norms := np.zeros(mesh.nv))
        if assembly.damped:
            mean, damping = np.zeros_like(u), np.zeros_like(u)
            found |= {
                f"energy of the change of {i}": assembly.mean_force(u, u + v, (0.2, 0.7), 0.3, mean),
                f"mean force of {i}": mean,
                f"half the power of the damping of {i}": assembly.damping_force(u, v, damping),
                f"damping of {i}": damping,
            }
        if assembly.quartic:
            found[f"energy of {i} along a line"] = assembly.along(u, v)[:3]
        if isinstance(term, StVK) and mesh.element.is_linear_simplex:
            found |= {
                f"tensions of {i}": assembly.tensions(u),
                f"stretches of {i}": assembly.smallest_stretches(0.1 * u),
                f"smallest stretch of {i}": assembly.smallest_stretch(0.1 * u),
            }
        found |= {
            f"round-off of {i}": sizes,
            f"weighed diagonal of {i}": diagonal,
            f"weighed product of {i}": product,
            f"clamped norms of {i}": norms,
        }
        if mesh.element.is_linear_simplex and isinstance(assembly, BoundElements):
            found |= {
                f"ratios of volumes of {i}": assembly.volume_ratios(u),
                f"smallest ratio of {i}": assembly.smallest_volume_ratio(u),
            }
    return found


def assert_same(one, other, limit):
    for name, value in one.items():
        assert np.abs(value).max() > 1e-3, name
        difference = np.abs(value - np.asarray(other[name], dtype=np.float64)).max()
        assert difference <= limit * np.abs(value).max(), f"{name}: {difference / np.abs(value).max():.1e}"


@pytest.mark.few(8)
@pytest.mark.parametrize("parts", [1, 2, 5])
@pytest.mark.parametrize("name", BODIES)
def test_compiled_and_readable_kernels_agree(name, parts, monkeypatch):
    in_parts(monkeypatch, parts)
    compiled = results(*BODIES[name])
    on_twins(monkeypatch)
    assert_same(results(*BODIES[name]), compiled, 1e-14)


#: Each element with the isotropic law, and three pairs with the general law.
PAIRS = [(name, "isotropic") for name in (*CURVED, "partly curved tetrahedra", "straight hexahedra")] + [
    ("quadratic tetrahedra", "general"),
    ("hexahedra", "general"),
    ("quadratic membrane", "general"),
]


@pytest.mark.few
@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize(("name", "law"), PAIRS)
def test_compiled_and_readable_kernels_agree_on_elements_with_several_points(name, law, parts, monkeypatch):
    in_parts(monkeypatch, parts)
    mesh, term = EVERY_MESH[name], LAWS[law]
    kinds = rules(mesh)[: 1 if parts == 1 else None]
    compiled = {kind: results(mesh, term, kind=kind) for kind in kinds}
    on_twins(monkeypatch)
    for kind in kinds:
        assert_same(results(mesh, term, kind=kind), compiled[kind], 1e-14)


@pytest.mark.parametrize("name", ["tetrahedra", "membrane", "segments", slow("quadratic tetrahedra"), slow("quadrilaterals")])
def test_kernels_of_linear_elasticity_agree(name, monkeypatch):
    mesh, frames = EVERY_MESH[name], random_frames(1, np.random.default_rng(5))[0]
    terms = LinearElastic(young=2.0, poisson=0.3), LinearElastic(Anisotropic(some_voigt(np.random.default_rng(7)), frame=frames))
    compiled = [results(mesh, term, kind=kind) for term in terms for kind in rules(mesh)]
    on_twins(monkeypatch)
    twins = [results(mesh, term, kind=kind) for term in terms for kind in rules(mesh)]
    for one, other in zip(twins, compiled, strict=True):
        assert_same(one, other, 1e-14)


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("name", ["tetrahedra", "membrane", "segments"])
def test_kernels_of_networks_agree(name, parts, monkeypatch):
    in_parts(monkeypatch, parts)
    mesh = MESHES[name]
    network = EdgeNetwork.of(mesh, StVK(young=2.0, poisson=0.3))
    terms = [[network], [network.diagonal()], [SpringNetwork(young=2.0, poisson=0.3)]]
    compiled = [results(mesh, each) for each in terms]
    on_twins(monkeypatch)
    for each, found in zip(terms, compiled, strict=True):
        assert_same(results(mesh, each), found, 1e-14)


def penalties(kind):
    """Yield meshes and terms, with penalties on all and on half of the elements."""
    for name in ("tetrahedra", "triangles", "segments"):
        mesh, rng = MESHES[name], np.random.default_rng(6)
        half = rng.permutation(mesh.nt)[: mesh.nt // 2]
        yield mesh, [StVK(young=1.0, poisson=0.3), VolumePenalty(rng.uniform(1, 5, mesh.nt), kind), VolumePenalty(9.0, kind, half)]


@pytest.mark.parametrize("dtype", [np.float64, slow(np.float32)])
@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("kind", [slow(kind) if kind == "quadratic" else kind for kind in ENERGIES])
def test_kernels_of_penalties_agree_with_the_readable_ones_in_double(kind, parts, dtype, monkeypatch):
    in_parts(monkeypatch, parts)
    bodies = list(penalties(kind))
    compiled = [results(*body, dtype=dtype, amount=0.08) for body in bodies]
    on_twins(monkeypatch)
    for body, found in zip(bodies, compiled, strict=True):
        assert_same(results(*body, amount=0.08), found, 1e-13 if dtype == np.float64 else 1e-5)


@pytest.mark.parametrize("kind", [kind for kind, energy in ENERGIES.items() if not energy.infinite_energy])
def test_kernels_of_penalties_agree_on_inverted_elements(kind, monkeypatch):
    bodies = list(penalties(kind))
    compiled = [results(*body) for body in bodies]
    assert min(found["smallest ratio of 1"] for found in compiled) < 0
    on_twins(monkeypatch)
    for body, found in zip(bodies, compiled, strict=True):
        assert_same(results(*body), found, 1e-13)


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_one_pass_gives_the_results_of_three_calls(name):
    found = results(*BODIES[name])
    for what in ("W", "F", "K"):
        assert np.abs(found[what] - found[f"{what} of linearize"]).max() <= 1e-14 * np.abs(found[what]).max(), what


SINGLE = {name: BODIES[name] for name in ("tetrahedra, two regions", "membrane, anisotropic", "cable, area")}
SINGLE["quadratic tetrahedra"] = CURVED["quadratic tetrahedra"], [LAWS["isotropic"]]


@pytest.mark.few(2)
@pytest.mark.parametrize("name", SINGLE)
def test_kernels_in_single_precision_agree_with_the_readable_ones_in_double(name, monkeypatch):
    in_parts(monkeypatch, 2)
    compiled = results(*SINGLE[name], dtype=np.float32)
    on_twins(monkeypatch)
    assert_same(results(*SINGLE[name]), compiled, 2e-6)


@pytest.mark.parametrize("count", [1, LANES - 1, LANES, LANES + 1])
@pytest.mark.parametrize("general", [False, True])
def test_blocks_of_lanes_may_be_full_or_not(count, general, monkeypatch):
    mesh = box(2)
    p, t = mesh.p, mesh.t[:, :count]
    used, t = np.unique(t, return_inverse=True)
    mesh = (p[:, used], t.reshape(4, -1))
    C = np.diag([3.0, 4, 5, 1, 2, 3]) + 0.5
    term = StVK(Anisotropic(C)) if general else StVK(young=2.0, poisson=0.3)
    mesh = System(mesh, term).mesh
    compiled = results(mesh, term)
    on_twins(monkeypatch)
    assert_same(results(mesh, term), compiled, 1e-14)


def test_on_twins_no_kernel_is_called(monkeypatch):
    """Systems on readable twins call no compiled kernel, so that comparisons are not of kernels with themselves."""

    def refuse(kernel, *_):
        raise AssertionError(kernel)

    mesh, terms = BODIES["triangles, two regions"]
    monkeypatch.setattr("skfem_stvk.system.system.check_mesh", lambda *_, **__: None)
    monkeypatch.setattr(Dispatcher, "__call__", refuse)
    with pytest.raises(AssertionError, match="CPUDispatcher"):
        results(mesh, terms)
    on_twins(monkeypatch)
    results(mesh, terms)


def called_from_python(module):
    """Return the kernels of a module that Python calls, by name: these have annotations."""
    own = {name: value.py_func for name, value in vars(module).items() if hasattr(value, "py_func") and name[0] != "_"}
    return {name: kernel for name, kernel in own.items() if kernel.__module__ == module.__name__ and kernel.__annotations__}


#: Modules of kernels, without `contact`: its twins are formulas for all points at once (`tests/kernels/test_contact.py`).
MODULES = [import_module(f"{compiled_kernels.__name__}.{one.name}") for one in iter_modules(compiled_kernels.__path__)]
MODULES = [module for module in MODULES if called_from_python(module) and module.__name__ != "skfem_stvk.kernels.contact_penalty"]
TWINS = {networks: readable_networks, reduced: readable_reduced}


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__.split(".")[-1])
def test_every_kernel_that_python_calls_has_a_twin_with_its_signature(module):
    for name, kernel in called_from_python(module).items():
        twin = getattr(TWINS.get(module, readable), name, None)
        assert twin is not None, f"add a twin of {name} to tests/kernels/readable.py"
        assert twin.__annotations__ == kernel.__annotations__, name


def test_kernels_of_all_modules_have_twins():
    assert len(MODULES) >= 14


def test_the_readable_tensors_of_both_stored_forms_are_equal():
    """One material, stored in two ways, has one tensor C."""
    mesh = MESHES["tetrahedra"]
    young, poisson = 2.0, 0.3
    mu, lam = young / (2 * (1 + poisson)), young * poisson / ((1 + poisson) * (1 - 2 * poisson))
    C = np.diag([2 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lam
    one, other = StVK(young=young, poisson=poisson).bind(mesh), StVK(Anisotropic(C)).bind(mesh)
    D, E = (readable.elements_of(slice(None), a.elements.t.ravel(), None, a.law).C for a in (one, other))
    assert np.abs(D).max() > 1e-3 and np.abs(D - E).max() < 1e-13 * np.abs(D).max()
