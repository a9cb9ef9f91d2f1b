"""A specification does not change if the arrays, lists and dicts from which it was made change afterwards."""

import dataclasses

import numpy as np
import pytest
import skfem
from bodies import box, state

import skfem_stvk
from skfem_stvk import (
    Anisotropic,
    BodyForce,
    Corotated,
    EdgeNetwork,
    ElasticFoundation,
    ElementMesh,
    Friction,
    Gravity,
    InvertibleStVK,
    Isotropic,
    LinearElastic,
    MeshContact,
    NeoHookean,
    NodalLoad,
    Orthotropic,
    Pressure,
    PrincipalStressLimit,
    Ramp,
    RigidBox,
    RigidContact,
    RigidCylinder,
    RigidMesh,
    RigidPlane,
    RigidSphere,
    Sine,
    SpringNetwork,
    Stop,
    StVK,
    System,
    Table,
    Traction,
    TransverselyIsotropic,
    VolumePenalty,
    solve_static,
)
from skfem_stvk.results import Fields

MESH = box()
WALL, TIP = np.flatnonzero(MESH.p[0] < 0.2), np.flatnonzero(MESH.p[0] > 0.8)
ELASTIC = StVK(young=2.0, poisson=0.3, density=1.5)
ROTATION = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
VOIGT = np.diag([3.0, 4.0, 5.0, 1.0, 1.5, 2.0])
POISSON, SHEAR = (0.1, 0.2, 0.1), (1.0, 1.1, 1.2)
BASIS = skfem.Basis(skfem.MeshTet(MESH.p, MESH.t), skfem.ElementVector(skfem.ElementTetP1()))
HALF = np.arange(MESH.nt // 2)
NETWORK = EdgeNetwork.of(MESH, StVK(young=2.0, poisson=0.3))
STIFF = np.linspace(1, 2, MESH.nt)
SPRINGS = np.linspace(1, 2, NETWORK.edges.shape[1])


def with_material(material):
    return [StVK(material)]


def with_load(load):
    return [ELASTIC, load]


def with_region(term):
    return [StVK(young=2.0, poisson=0.3), term]


LAWS = (Corotated, InvertibleStVK, LinearElastic, NeoHookean, SpringNetwork, StVK)
#: Each case: a function that makes terms, and the array that it takes, which the test changes afterwards.
ARRAYS = {
    "Gravity": (lambda g: with_load(Gravity(g)), np.array([1.0, 2.0, 3.0])),
    "Ramp": (lambda g: with_load(Gravity(Ramp(g, until=1.0))), np.array([1.0, 2.0, 3.0])),
    "Sine": (lambda g: with_load(Gravity(Sine(g, frequency=0.3))), np.array([1.0, 2.0, 3.0])),
    "Table": (lambda f: with_load(Gravity(Table((1.0, 2.0, 3.0), (0.0, 1.0), f))), np.array([0.5, 1.0])),
    "BodyForce": (lambda b: with_load(BodyForce(b)), np.array([1.0, 2.0, 3.0])),
    "BodyForce, region": (lambda ids: with_load(BodyForce((1.0, 2.0, 3.0), ids)), HALF),
    "NodalLoad": (lambda f: with_load(NodalLoad([1, 2], f)), np.arange(6.0).reshape(3, 2)),
    "NodalLoad, where": (lambda ids: with_load(NodalLoad(ids, (1.0, 2.0, 3.0))), WALL),
    "NodalLoad, mask": (lambda mask: with_load(NodalLoad(mask, (1.0, 2.0, 3.0))), MESH.p[0] < 0.2),
    "NodalLoad, components": (lambda f: with_load(NodalLoad(WALL, (f, 0 * f, 2))), np.arange(1.0, len(WALL) + 1)),
    "Traction": (lambda T: with_load(Traction(TIP, T)), np.array([1.0, 2.0, 3.0])),
    "Traction, where": (lambda ids: with_load(Traction(ids, (1.0, 2.0, 3.0))), WALL),
    "Pressure": (lambda p: with_load(Pressure(TIP, p)), np.linspace(1, 2, len(TIP))),
    "Pressure, where": (lambda ids: with_load(Pressure(ids, 2.0)), WALL),
    "ElasticFoundation": (lambda k: with_load(ElasticFoundation(WALL, k)), np.array([1.0, 2.0, 3.0])),
    "RigidSphere": (
        lambda c: with_load(RigidContact(RigidSphere(c, 0.6), stiffness=3.0, friction=Friction(0.1, slip_length=1.0))),
        np.array([0.1, 0.2, 0.3]),
    ),
    "RigidPlane": (lambda x: with_load(RigidContact(RigidPlane(x, (0, 0, 1)), stiffness=3.0)), np.array([0.1, 0.2, 0.3])),
    "RigidContact, where": (lambda ids: with_load(RigidContact(RigidPlane((0, 0, 0.5), (0, 0, 1)), ids, 3.0)), WALL),
    "RigidContact, motion": (
        lambda m: with_load(RigidContact(RigidPlane((0, 0, 0.5), (0, 0, 1)), stiffness=3.0, motion=m)),
        np.array([0.0, 0.0, 0.2]),
    ),
    "RigidBox": (lambda low: with_load(RigidContact(RigidBox(low, (2.0, 2.0, 2.0)), stiffness=3.0)), np.array([0.3, 0.2, 0.1])),
    "RigidCylinder": (
        lambda point: with_load(RigidContact(RigidCylinder(point, (0, 1, 0), 0.5), stiffness=3.0)),
        np.array([0.1, 0.2, 0.3]),
    ),
    "MeshContact, first, mask": (lambda mask: with_load(MeshContact(mask, distance=0.2, stiffness=100.0)), MESH.p[0] < 0.8),
    "RigidMesh": (
        lambda p: with_load(MeshContact(None, RigidMesh((p, MESH.surface)), distance=0.2, stiffness=100.0)),
        MESH.p - np.array([[0.0], [0.0], [1.1]]),
    ),
    "ElasticFoundation, where": (lambda ids: with_load(ElasticFoundation(ids, 3.0)), WALL),
    "EdgeNetwork": (lambda edges: [EdgeNetwork(edges, NETWORK.L)], NETWORK.edges),
    "SpringNetwork": (lambda k: [SpringNetwork(stiffness=k)], SPRINGS),
    **{f"{law.__name__}, young": (lambda E, law=law: [law(young=E, poisson=0.3)], STIFF) for law in LAWS},
    **{
        f"{law.__name__}, region": (lambda ids, law=law: with_region(law(young=5.0, poisson=0.2, region=ids)), HALF) for law in LAWS
    },
    "VolumePenalty": (lambda k: with_region(VolumePenalty(k, "compression")), STIFF),
    "VolumePenalty, region": (lambda ids: with_region(VolumePenalty(5.0, "quadratic", ids)), HALF),
    "Isotropic": (lambda E: with_material(Isotropic(E, 0.3)), STIFF),
    "Isotropic, poisson": (lambda nu: with_material(Isotropic(2.0, nu)), 0.1 * STIFF),
    "Orthotropic": (lambda E: with_material(Orthotropic((E, 2.0, 1.0), POISSON, SHEAR)), 3 * STIFF),
    "Orthotropic, frame": (lambda Q: with_material(Orthotropic((3.0, 2.0, 1.0), POISSON, SHEAR, frame=Q)), ROTATION),
    "TransverselyIsotropic": (lambda E: with_material(TransverselyIsotropic(E, 2.0, 0.1, 0.2, 1.0)), 3 * STIFF),
    "Anisotropic": (lambda C: with_material(Anisotropic(C)), VOIGT),
}


def answer(terms):
    """Return the residual at a fixed state; it depends on all data of the terms."""
    system = System(MESH, terms)
    return system.residual(0.2 * state(MESH), 0.7)


def change_in_place(array):
    """Change the array to different valid data, in place."""
    if array.dtype == bool:
        array[:] = np.roll(array, 5)
    elif array.dtype.kind == "i":
        array[:] = array[::-1].copy() if len(array) == 0 else (array + 1) % (MESH.nv if array.max() < MESH.nv else MESH.nt)
    elif array.shape == (3, 3):
        array[:] = np.roll(array, 1, axis=1)
    else:
        array *= 1.3


def test_a_specification_does_not_change_with_its_source_array():
    for name, (make, original) in ARRAYS.items():
        given = original.copy()
        terms, expected = make(given), answer(make(original.copy()))
        change_in_place(given)
        changed = answer(make(given.copy()))
        assert np.abs(changed - expected).max() > 1e-6 * np.abs(expected).max(), name
        assert np.array_equal(answer(terms), expected), name


def test_lists_are_copied_too():
    lists = [name for name, (_, array) in ARRAYS.items() if "mask" not in name and array.ndim == 1 and "components" not in name]
    for name in lists:
        make, original = ARRAYS[name]
        given = original.tolist()
        terms, expected = make(given), answer(make(original.copy()))
        given.pop()
        assert answer(terms) == pytest.approx(expected), name
    assert len(lists) > 30


class Series:
    """Object that NumPy converts to an array, as it converts a pandas series."""

    def __init__(self, values):
        self.values = values

    def __array__(self, dtype=None, copy=None):
        return self.values if dtype is None else self.values.astype(dtype)


def test_objects_that_numpy_converts_to_arrays_are_copied_too():
    ids, forces = WALL.copy(), np.ones((3, len(WALL)))
    terms = with_load(NodalLoad(Series(ids), Series(forces)))
    expected = answer(with_load(NodalLoad(WALL, np.ones((3, len(WALL))))))
    ids[:] = ids[::-1].copy() + 1
    forces *= 2
    assert np.array_equal(answer(terms), expected)


def test_every_public_specification_is_in_the_table():
    plain = {"BackwardEuler", "EdgeDamping", "EnergyMomentum", "ForwardEuler", "GeneralizedAlpha", "LinearBackwardEuler", "Newmark"}
    plain |= {"Rayleigh", "VelocityVerlet"}  # numbers and names only, which cannot change
    plain |= {"Box", "NearestNode", "Plane", "Friction"}  # tuples of numbers, and numbers
    results = {"MeshQuality", "Report", "Run", "StaticResult"}
    known = {name.split(",")[0] for name in ARRAYS} | {"ElementMesh", "Stop", "PrincipalStressLimit"}
    public = {name for name in skfem_stvk.__all__ if dataclasses.is_dataclass(getattr(skfem_stvk, name))}
    assert public == plain | results | known


def test_stored_arrays_are_read_only():
    load = NodalLoad(WALL.copy(), np.ones((3, len(WALL))))
    for array in (load.where, load.force, StVK(young=1.0, poisson=0.3, region=HALF.copy()).region):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_scikit_fems_degrees_of_freedom_are_copied():
    view = BASIS.get_dofs(nodes=WALL.copy())
    load, expected = NodalLoad(view, (1.0, 2.0, 3.0)), answer(with_load(NodalLoad(WALL, (1.0, 2.0, 3.0))))
    view.nodal_ix[:] = np.roll(TIP, 1)[0]
    assert np.array_equal(answer(with_load(load)), expected)


def test_a_mesh_copies_its_arrays_and_named_groups():
    p, t, ids = MESH.p.copy(), MESH.t.copy(), WALL.copy()
    facets, half = MESH.surface[:, :4].copy(), HALF.copy()
    sets = {"wall": ids}
    mesh = ElementMesh(p, t, {"half": half}, {"some": facets}, sets)
    for array in (t, ids, facets, half):
        array[:] = 0
    p[:] = 0
    sets["more"] = ids
    assert np.array_equal(mesh.p, MESH.p) and np.array_equal(mesh.t, MESH.t) and list(mesh.node_sets) == ["wall"]
    assert np.array_equal(mesh.node_sets["wall"], WALL) and np.array_equal(mesh.elements("half"), HALF)
    assert np.array_equal(mesh.boundaries["some"], MESH.surface[:, :4])


def test_a_mesh_of_scikit_fem_may_change_afterwards():
    given = (
        skfem.MeshTet().refined(1).with_boundaries({"wall": lambda x: x[0] == 0}).with_subdomains({"half": lambda x: x[0] < 0.5})
    )
    mesh, wall, half = ElementMesh.of(given), given.boundaries["wall"], given.subdomains["half"]
    expected, elements = given.facets[:, wall], half.copy()
    wall[:], half[:] = 0, 0
    assert np.array_equal(mesh.boundaries["wall"], expected) and np.array_equal(mesh.elements("half"), elements)


def test_supports_copy_ids_and_values():
    ids, tip, values, prescribed_values = WALL.copy(), TIP.copy(), np.linspace(1, 2, len(TIP)), {"x": 0.5}
    prescribed_values["y"] = values
    fixed, prescribed = [(ids, "xyz")], [(tip, prescribed_values)]
    system = System(MESH, ELASTIC, fixed=fixed, prescribed=prescribed)
    expected = System(
        MESH, ELASTIC, fixed=[(WALL, "xyz")], prescribed=[(TIP, {"x": 0.5, "y": np.linspace(1, 2, len(TIP))})]
    ).supports
    ids[:], tip[:] = 0, 0
    values *= 9
    prescribed_values["z"] = 3.0
    fixed.clear()
    prescribed.clear()
    assert np.array_equal(system.supports.fixed, expected.fixed) and np.array_equal(
        system.supports.values(0.4), expected.values(0.4)
    )


def test_a_stop_copies_its_location():
    ids, given = TIP.copy(), []
    given += [ids, "z", -0.01]
    stop = Stop(displacement=given)
    ids[:], given[2] = WALL[0], 5.0
    system = System(MESH, [ELASTIC, Traction(TIP, (0.0, 0.0, -0.02))], fixed=[(WALL, "xyz")])
    result = solve_static(system, steps=4, method="arc-length", stop=stop, quiet=True)
    assert result.u.reshape(-1, 3)[TIP, 2].mean() == pytest.approx(-0.01, rel=1e-8)


def test_a_state_copies_its_displacements():
    u, v = 0.1 * state(MESH), state(MESH, seed=3)
    expected = Fields(MESH, [ELASTIC]).at(u.copy(), v.copy())
    now = Fields(MESH, [ELASTIC]).at(u, v)
    u[:], v[:] = 0, 0
    assert np.array_equal(now["cauchy_stress"], expected["cauchy_stress"]) and now["cauchy_stress"].any()
    assert np.array_equal(now.u, expected.u) and np.array_equal(now.v, expected.v)


def test_an_operator_and_a_product_copy_their_displacements():
    system, u, v = System(MESH, ELASTIC), 0.1 * state(MESH), state(MESH, seed=3)
    K, expected = system.linear_operator(u), system.product(u, v)
    u *= 2
    assert np.array_equal(K @ v, expected) and np.abs(system.product(u, v) - expected).max() > 1e-3 * np.abs(expected).max()


def test_a_stress_limit_copies_its_values():
    given = np.array([1.0, 2.0])
    limit = PrincipalStressLimit(given)
    given[:] = 9
    assert np.array_equal(limit.limit, [1.0, 2.0]) and not limit.limit.flags.writeable
