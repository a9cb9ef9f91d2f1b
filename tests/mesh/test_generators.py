"""Generated meshes have the right volumes, sides and elements."""

import numpy as np
import pytest
import skfem

from skfem_stvk import ElementMesh, Isotropic, MeshError, StVK, System
from skfem_stvk.mesh import bar, box, cylinder
from skfem_stvk.mesh.diagnostics import check_mesh
from skfem_stvk.mesh.points import rule_of

SIZE, ORIGIN = (2.0, 0.5, 0.25), (1.0, -1.0, 0.5)
BOXES = {
    "segments": 1,
    "triangles": 2,
    "quadrilaterals": 2,
    "tetrahedra": 3,
    "hexahedra": 3,
}
CYLINDERS = {"solid": 0.0, "tube": 0.3}


def volume(mesh):
    body = System(mesh, StVK(Isotropic(1.0, 0.25, density=1.0)))
    return body.mass().total


def areas(mesh, name):
    x = mesh.p[:, mesh.boundaries[name]]
    if len(x) == 1:
        return np.ones(x.shape[2])
    edges = x[:, 1:] - x[:, :1]
    if len(x) == 2:
        return np.linalg.norm(edges[:, 0], axis=0)
    half = np.linalg.norm(np.cross(edges[:, 0].T, edges[:, 1].T), axis=1) / 2
    return half if x.shape[1] == 3 else 2 * half  # parallelograms


def all_positive(mesh):
    p, t = mesh.p, mesh.t
    points = mesh.element.derivatives(rule_of(mesh.element, "mass").points)
    jacobians = np.einsum("dnt,qnk->tqdk", p[:, t], points)
    return bool((np.linalg.det(jacobians) > 0).all())


@pytest.mark.parametrize("kind", BOXES)
def test_a_box_has_the_right_volume_sides_and_positive_elements(kind):
    d = BOXES[kind]
    mesh = box(SIZE[:d], (4, 3, 2)[:d], kind, ORIGIN[:d])
    check_mesh(mesh)
    assert mesh.kind == f"{kind} in {d}D" and all_positive(mesh)
    assert np.isclose(volume(mesh), np.prod(SIZE[:d]))
    assert np.allclose(mesh.p.min(axis=1), ORIGIN[:d]) and np.allclose(mesh.p.max(axis=1), np.add(ORIGIN, SIZE)[:d])
    for axis, names in enumerate((("left", "right"), ("bottom", "top"), ("front", "back"))[:d]):
        for name, end in zip(names, (mesh.p[axis].min(), mesh.p[axis].max()), strict=True):
            assert (mesh.p[axis][mesh.boundaries[name]] == end).all()
            assert np.isclose(areas(mesh, name).sum(), np.prod(SIZE[:d]) / SIZE[axis])
    assert sum(facets.shape[1] for facets in mesh.boundaries.values()) == mesh.surface.shape[1]


@pytest.mark.parametrize("kind", list(BOXES)[1:])  # scikit-fem's segments have no default names
def test_the_sides_of_a_box_are_named_as_scikit_fem_names_them(kind):
    d = BOXES[kind]
    mesh = box(SIZE[:d], (4, 3, 2)[:d], kind)
    flat = {"triangles": skfem.MeshTri, "quadrilaterals": skfem.MeshQuad}
    theirs = (flat | {"tetrahedra": skfem.MeshTet, "hexahedra": skfem.MeshHex})[kind](mesh.p, mesh.t).with_defaults()
    theirs = ElementMesh.of(theirs).boundaries
    as_sets = [
        {name: {tuple(sorted(facet)) for facet in np.asarray(of[name]).T.tolist()} for name in of}
        for of in (mesh.boundaries, theirs)
    ]
    assert as_sets[0] == as_sets[1]


def test_a_box_has_simplices_and_starts_at_the_origin_by_default():
    assert [box((1.0,) * d, 2).element.name for d in (1, 2, 3)] == ["segments", "triangles", "tetrahedra"]
    assert not box((1.0, 2.0), 2).p.min(axis=1).any() and box(3.0, 2).p.tolist() == [[0.0, 1.5, 3.0]]


@pytest.mark.parametrize("kind", ["tetrahedra", "hexahedra"])
def test_a_bar_is_centred_on_the_x_axis(kind):
    mesh = bar(2.0, 0.5, (8, 2), kind)
    assert mesh.p.min(axis=1).tolist() == [0, -0.25, -0.25] and mesh.p.max(axis=1).tolist() == [2, 0.25, 0.25]
    assert np.isclose(volume(mesh), 0.5) and set(mesh.boundaries) == {"left", "right", "bottom", "top", "front", "back"}
    assert mesh.nt == (6 if kind == "tetrahedra" else 1) * 8 * 4 and all_positive(mesh)


@pytest.mark.parametrize("inner", CYLINDERS.values(), ids=CYLINDERS)
@pytest.mark.parametrize("cells", [(1, 1), (3, 2), (2, 3)])
def test_a_cylinder_has_the_right_volume_sides_and_positive_elements(inner, cells):
    mesh = cylinder(0.5, 2.0, cells, inner_radius=inner)
    check_mesh(mesh)
    assert all_positive(mesh) and set(mesh.boundaries) == {"left", "right", "side"} | ({"inside"} if inner else set())
    r = np.linalg.norm(mesh.p[1:], axis=0)
    assert np.allclose(r[mesh.boundaries["side"]], 0.5) and np.allclose(r[mesh.boundaries.get("inside", [])], inner)
    assert (mesh.p[0][mesh.boundaries["left"]] == 0).all() and (mesh.p[0][mesh.boundaries["right"]] == 2).all()
    n = len(np.unique(mesh.boundaries["side"])) // (cells[0] + 1)
    cut = n / 2 * np.sin(2 * np.pi / n) * (0.5**2 - inner**2)
    assert np.isclose(volume(mesh), 2.0 * cut)
    assert np.isclose(areas(mesh, "left").sum(), cut) and np.isclose(areas(mesh, "right").sum(), cut)
    assert np.isclose(areas(mesh, "side").sum(), 2.0 * n * 2 * 0.5 * np.sin(np.pi / n))
    assert sum(facets.shape[1] for facets in mesh.boundaries.values()) == mesh.surface.shape[1]  # neighbours share whole faces


def test_the_volume_of_a_cylinder_converges_at_second_order():
    errors = [1 - volume(cylinder(0.5, 2.0, (2, n))) / (np.pi * 0.5) for n in (2, 4)]
    assert 0 < errors[1] < errors[0] / 3.8


@pytest.mark.parametrize("inner", CYLINDERS.values(), ids=CYLINDERS)
def test_the_elements_of_a_cylinder_are_of_good_shape(inner):
    """Cells as long as wide have a ratio of inner to outer radius within 1 : 9; a regular tetrahedron has 1 : 3.

    The test requires volumes above 0.02 of the cubed longest edge.
    """
    mesh = cylinder(0.5, 1.0, (6, 3), inner_radius=inner) if inner == 0 else cylinder(0.5, 1.0, (10, 2), inner_radius=inner)
    x = mesh.p[:, mesh.t].transpose(2, 1, 0)
    edges = np.array([x[:, a] - x[:, b] for a, b in mesh.element.edges])
    volumes = np.linalg.det(x[:, 1:] - x[:, :1]) / 6
    assert (volumes / (np.sqrt((edges**2).sum(axis=2)).max(axis=0) ** 3) > 0.02).all()  # a regular one has 0.118


@pytest.mark.parametrize("mesh", [box((1.0, 1.0), 2), cylinder(1.0, 1.0, (1, 1))], ids=["box", "cylinder"])
def test_generated_meshes_of_simplices_can_be_quadratic(mesh):
    quadratic = mesh.with_degree(2)
    assert np.isclose(volume(quadratic), volume(mesh)) and set(quadratic.boundaries) == set(mesh.boundaries)


def test_a_mesh_is_scaled_with_all_its_names():
    mesh = box((1.0, 2.0), 2)
    small = mesh.scaled(1e-3)
    assert np.array_equal(small.p, 1e-3 * mesh.p) and small.t is not None and set(small.boundaries) == set(mesh.boundaries)
    for bad in (0, -1.0, np.nan, "mm"):
        with pytest.raises(MeshError, match=r"factor = .*; expected a positive number, such as 1e-3 from mm to m"):
            mesh.scaled(bad)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: box((1, 1, 1, 1), 2), r"size = \(1, 1, 1, 1\); expected one to three positive lengths"),
        (lambda: box((1, 0), 2), r"size = \(1, 0\); expected one to three positive lengths"),
        (lambda: box((1, np.nan), 2), r"size is not finite in 1 entry \(1\)"),
        (lambda: box((1, 1), (2, 2, 2)), r"cells = \(2, 2, 2\); expected 2 whole numbers of cells from 1 on, along each axis"),
        (lambda: box((1, 1), (2, 0)), r"cells = 0; expected 2 whole numbers of cells"),
        (lambda: box((1, 1), 2.5), r"cells = 2\.5; expected 2 whole numbers of cells"),
        (lambda: box((1, 1), 2, "tetrahedra"), r"element = 'tetrahedra'; known: 'quadrilaterals', 'triangles'"),
        (lambda: box((1, 1), 2, origin=(0, 0, 0)), r"origin has shape \(3,\); expected \(2,\) coordinates of the corner"),
        (lambda: box((1, 1, 1), 2000), r"8012006001 vertices are more than 32-bit indices can count"),
        (lambda: bar(1.0, -1.0, (2, 2)), r"width = -1\.0; expected a positive length"),
        (
            lambda: bar(1.0, 1.0, (2, 2, 2)),
            r"cells = \(2, 2, 2\); expected 2 whole numbers of cells from 1 on, along x, and across",
        ),
        (lambda: bar(1.0, 1.0, 2, "triangles"), r"element = 'triangles'; known: 'hexahedra', 'tetrahedra'"),
        (lambda: cylinder(0, 1.0, 2), r"radius = 0; expected a positive length"),
        (lambda: cylinder(1.0, 1.0, 2, 1.0), r"inner_radius = 1\.0; expected a number from 0 to less than radius = 1"),
        (lambda: cylinder(1.0, 1.0, 2, -0.5), r"inner_radius = -0\.5; expected a number from 0"),
        (lambda: cylinder(1.0, 1.0, "many"), r"cells = 'many'; expected 2 whole numbers"),
    ],
)
def test_invalid_arguments_of_generators_are_refused(make, message):
    with pytest.raises(MeshError, match=message):
        make()
