"""Arrays, patterns and masses of a body are those of its terms and analyses only.

`tests/test_imports.py` checks in new processes which packages and modules each use imports.
"""

import tracemalloc

import numpy as np
import pytest
import skfem

from skfem_stvk import (
    BodyForce,
    Corotated,
    EdgeNetwork,
    ElasticFoundation,
    EnergyMomentum,
    Gravity,
    InvertibleStVK,
    LinearElastic,
    MeshContact,
    NeoHookean,
    NodalLoad,
    Pressure,
    RigidContact,
    RigidPlane,
    SpringNetwork,
    StVK,
    System,
    Traction,
    VelocityVerlet,
    VolumePenalty,
    modes,
    simulate,
    solve_static,
    terms,
)
from skfem_stvk.edges import assembly, stiffness
from skfem_stvk.kernels import element_assembly as element_kernels
from skfem_stvk.mesh import ElementMesh
from skfem_stvk.system import pattern

ELASTIC = {"young": 1e5, "poisson": 0.3, "density": 1000.0}
FIXED = {"left": "xyz"}
#: Terms for a region of a mesh, and loads for the facets or nodes "right". A new term needs a row.
ELEMENTS = {
    StVK: lambda mesh, region: StVK(**ELASTIC, region=region),
    LinearElastic: lambda mesh, region: LinearElastic(**ELASTIC, region=region),
    NeoHookean: lambda mesh, region: NeoHookean(**ELASTIC, region=region),
    Corotated: lambda mesh, region: Corotated(**ELASTIC, region=region),
    InvertibleStVK: lambda mesh, region: InvertibleStVK(**ELASTIC, region=region),
    SpringNetwork: lambda mesh, region: SpringNetwork(**ELASTIC, rule="van-gelder", region=region),
    EdgeNetwork: lambda mesh, region: EdgeNetwork.of(mesh, StVK(**ELASTIC, region=region)),
    VolumePenalty: lambda mesh, region: VolumePenalty(1e5, region=region),
}
OTHERS = {
    ElasticFoundation: ElasticFoundation("right", 1e4),
    MeshContact: MeshContact("right", distance=0.01),
    RigidContact: RigidContact(RigidPlane((0.0, 0.0, 0.1), (0.0, 0.0, 1.0)), "right"),
    Gravity: Gravity((0.0, 0.0, -9.81)),
    BodyForce: BodyForce((0.0, 0.0, -1.0)),
    NodalLoad: NodalLoad("right", (0.0, 0.0, -1.0)),
    Pressure: Pressure("right", 100.0),
    Traction: Traction("right", (0.0, 0.0, -1.0)),
}


def bar(n=40, across=2):
    """Return a bar whose last twentieth is the region "end"."""
    ends = np.linspace(0, 1, across + 1)
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, n / 2, n + 1), ends, ends).with_defaults()
    return ElementMesh.of(mesh.with_subdomains({"end": lambda x: x[0] > 0.95 * n / 2}))


def used(body):
    """Return the body after evaluations of W, F, K and its loads."""
    u = 1e-3 * np.sin(np.arange(body.ndofs))
    body.energy(u), body.residual(u), body.jacobian(u)
    return body


def allocated_bytes(make):
    """Return the bytes that Python allocates for the result of `make`, and the result."""
    make()
    tracemalloc.start()
    try:
        made = make()
        return tracemalloc.get_traced_memory()[0], made
    finally:
        tracemalloc.stop()


def refused(*arguments, **named):
    raise AssertionError("this must not be created")


def test_every_term_has_a_row():
    public = [getattr(terms, name) for name in terms.__all__]
    specifications = {one for one in public if hasattr(one, "bind") and one not in (terms.Load, terms.Term)}
    assert specifications == set(ELEMENTS) | set(OTHERS)


def test_a_plain_body_has_the_bytes_of_its_memory():
    """The bytes of a body are those of `memory`: no array of another term, analysis or output exists."""
    mesh = bar(200, 4)
    held, body = allocated_bytes(lambda: used(System(mesh, StVK(**ELASTIC), FIXED)))
    reported = body.memory()
    assert reported["mass"] == reported["product"] == 0
    assert held - (sum(reported.values()) - reported["mesh"]) < 0.8 * body.ndofs * 8


@pytest.mark.parametrize("kind", ELEMENTS, ids=lambda kind: kind.__name__)
def test_a_term_on_a_twentieth_of_the_elements_costs_a_twentieth(kind):
    """A term on a twentieth of the elements has about a twentieth of the bytes of a term on all elements.

    The bytes are those of its arrays for elements or edges. The surface of the region is additional.
    """
    mesh, whole, part = bar(), *(bytes_of_term(kind, region) for region in (None, "end"))
    share = len(mesh.elements("end")) / mesh.nt
    assert share == pytest.approx(0.05) and part < 1.3 * share * whole + 3500


def test_additional_elements_cost_their_own_bytes_only():
    """A skin on a twentieth of the surface costs a twentieth of the bytes of a skin on the whole surface.

    The bytes of the rest of the body do not change.
    """
    mesh = bar()
    skin = mesh.surface[:, mesh.p[0, mesh.surface].mean(axis=0) > 0.95 * mesh.p[0].max()]

    def bytes_of(*more):
        bound = System(mesh, [StVK(**ELASTIC), *more], FIXED)
        return sum(bound.pair_terms[-1].memory().values()), sum(used(bound).memory().values())

    _, plain = bytes_of()
    whole, _ = bytes_of(StVK(**ELASTIC, simplices=mesh.surface))
    part, both = bytes_of(StVK(**ELASTIC, simplices=skin))
    share = skin.shape[1] / mesh.surface.shape[1]
    assert share < 0.08 and part < 1.3 * share * whole + 3500
    assert both - plain < 3 * part + skin.nbytes + 1000  # the indices of its blocks in the rows of K are additional
    assert bytes_of() == bytes_of() and bytes_of()[1] == plain


def bytes_of_term(kind, region):
    mesh = bar()
    bound = System(mesh, [StVK(**ELASTIC), ELEMENTS[kind](mesh, region)], FIXED)
    used(bound)
    return sum(bound.bound_terms[1].memory().values())


@pytest.mark.parametrize("kind", OTHERS, ids=lambda kind: kind.__name__)
def test_a_load_creates_no_blocks_of_the_body(kind):
    mesh = bar(10)
    plain = used(System(mesh, StVK(**ELASTIC), FIXED)).memory()
    loaded = used(System(mesh, [StVK(**ELASTIC), OTHERS[kind]], FIXED)).memory()
    assert {part: loaded[part] for part in ("elements", "pattern of K", "mass")} == {
        part: plain[part] for part in ("elements", "pattern of K", "mass")
    }


def test_springs_alone_need_no_data_of_simplices(monkeypatch):
    """Springs of given stiffness need no coefficients L of elements, no frames, and no kernel on elements."""
    mesh = bar(10)
    edges = skfem.MeshTet(mesh.p, mesh.t).edges.shape[1]
    for name in ("kernel_order", "KernelElements"):
        monkeypatch.setattr(assembly, name, refused)
    monkeypatch.setattr(stiffness, "frames_at", refused)
    monkeypatch.setattr(StVK, "coefficients", refused)
    body = used(System(mesh, SpringNetwork(stiffness=np.full(edges, 9.0)), FIXED))
    assert "elements" not in body.memory()


@pytest.mark.parametrize("method", ["load-steps", "arc-length"])
def test_statics_creates_no_mass(method, monkeypatch):
    body = System(bar(4), [StVK(**ELASTIC), Traction("right", (0.0, 0.0, -10.0))], FIXED)
    monkeypatch.setattr(System, "mass", refused)
    assert solve_static(body, 2, method=method, quiet=True).success and body.memory()["mass"] == 0


@pytest.mark.parametrize("step, until", [(None, 3.0), (1e-3, 0.2)], ids=["found", "given"])
def test_an_explicit_motion_creates_no_matrix_and_uses_the_stiffness_only_for_its_step(step, until, monkeypatch):
    body = System(bar(4), [StVK(**ELASTIC), Traction("right", (0.0, 0.0, -10.0))], FIXED)
    for name in ("tangent", "jacobian"):
        monkeypatch.setattr(System, name, refused)
    monkeypatch.setattr(pattern.Pattern, "__init__", refused)
    linearize, looks = element_kernels.linearize, []

    def counted(*arguments):
        looks.append(None)
        return linearize(*arguments)

    monkeypatch.setattr(element_kernels, "linearize", counted)
    run = simulate(body, VelocityVerlet() if step is None else VelocityVerlet(dt=step), until=until, quiet=True)
    assert run.success and body.memory()["pattern of K"] == body.memory()["rows of K"] == 0
    assert 0 < len(looks) < run.ledger.steps / 8


def test_an_implicit_motion_and_modes_create_one_kind_of_mass():
    for analysis in (lambda body: simulate(body, EnergyMomentum(dt=1e-2), until=2e-2, quiet=True), lambda body: modes(body, 2)):
        body = System(bar(4), [StVK(**ELASTIC), Gravity((0.0, 0.0, -1.0))], FIXED)
        analysis(body)
        assert len(body._masses) == 1
