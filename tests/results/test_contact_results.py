"""Results of contacts: moments, fields in files, rigid shapes in pictures and films, and findings. Pictures were checked by eye."""

import re
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import skfem
from matplotlib.backends.backend_agg import FigureCanvasAgg
from meshio import read
from scipy.spatial.transform import Rotation

from skfem_stvk import (
    BackwardEuler,
    EdgeDamping,
    ElasticFoundation,
    EnergyMomentum,
    ForwardEuler,
    Friction,
    GeneralizedAlpha,
    Gravity,
    LinearBackwardEuler,
    MeshContact,
    NeoHookean,
    Newmark,
    Rayleigh,
    RigidBox,
    RigidContact,
    RigidCylinder,
    RigidMesh,
    RigidPlane,
    RigidSphere,
    Simulation,
    StVK,
    StvkError,
    StvkWarning,
    System,
    Traction,
    VelocityVerlet,
    simulate,
    solve_static,
)
from skfem_stvk.kernels import contact_penalty as kernels
from skfem_stvk.mesh import ElementMesh, box
from skfem_stvk.results import Fields, animate, plot, plotting, write_vtu
from skfem_stvk.results import table as names
from skfem_stvk.results.contact_forces import contact_state, contact_states
from skfem_stvk.results.penetration import contact_findings
from skfem_stvk.results.picture import View, picture_of
from skfem_stvk.results.series import listed_states
from skfem_stvk.results.shapes import MARGIN, surface_of, surroundings
from skfem_stvk.scenes import scene_report as report
from skfem_stvk.solvers.newton.newton import End
from skfem_stvk.solvers.runs.ledger import Ledger
from skfem_stvk.solvers.state_files import read_state

LAW = NeoHookean(young=3e4, poisson=0.3, density=1000.0)
CUBE = box((0.1, 0.1, 0.1), (2, 2, 2))
SHAPES = {
    "plane": RigidPlane((0, 0, -0.01), (0.2, 0.1, 1)),
    "sphere": RigidSphere((0.05, 0.05, -0.1), 0.1),
    "large sphere": RigidSphere((0.05, 0.05, -10), 10.0),
    "inside a sphere": RigidSphere((0.05, 0.05, 0.05), 0.095, inside=True),
    "cylinder": RigidCylinder((0.05, 0.05, -0.1), (0.3, 1, 0.2), 0.1),
    "inside a cylinder": RigidCylinder((0.05, 0.05, 0.05), (0.3, 1, 0.2), 0.08, inside=True),
    "box": RigidBox((-1, -1, -1), (0.05, 0.06, 0)),
    "rounded box": RigidBox((0.02, 0.02, 0.1), (0.08, 0.07, 0.3), radius=0.02),
    "line": RigidPlane((0, -0.01), (0.2, 1)),
    "disc": RigidSphere((0.05, -0.1), 0.1),
    "inside a disc": RigidSphere((0.05, 0.05), 0.095, inside=True),
    "rectangle": RigidBox((-1, -1), (0.05, 0), radius=0.02),
}


def pressed(mesh, normal, point, u, where=None, k=1e6):
    """Return the state of a contact with a plane at displacements `u` of all nodes."""
    body = System(mesh, [StVK(young=1.0, poisson=0.3), RigidContact(RigidPlane(point, normal), where, stiffness=k, name="lid")])
    return contact_state(body, "lid", np.tile(u, mesh.nv), 1.0)


@pytest.mark.parametrize("degree", [1, 2])
def test_the_moment_of_an_eccentric_press_is_that_of_its_resultant_at_the_centre_of_the_area(degree):
    """The upper half of a face of a turned block is 1 cm deep in a plane."""
    turn, shift = Rotation.from_euler("xyz", (0.3, 0.5, 0.7)).as_matrix(), np.array([0.3, -0.2, 0.1])
    flat = box((0.2, 0.1, 0.1), (4, 2, 2)).with_degree(degree)
    mesh, n = ElementMesh(turn @ flat.p + shift[:, None], flat.t, element=flat.element), turn @ [1.0, 0, 0]

    def where(x):
        local = turn.T @ (x - shift[:, None])
        return (local[0] < 1e-9) & (local[2] > 0.05 - 1e-9)

    state = pressed(mesh, n, shift, -0.01 * n, where)
    force = 1e6 * 0.01 * 0.1 * 0.05 * n
    centre = turn @ [0, 0.05, 0.075] + shift - 0.01 * n
    np.testing.assert_allclose(state.resultant, force, rtol=1e-11)
    np.testing.assert_allclose(state.moment, np.cross(centre, force), rtol=1e-11)


def test_the_moment_in_the_plane_is_a_number_and_on_a_line_zero():
    state = pressed(box((0.2, 0.1), (4, 2)), (0, 1), (0, 0), (0.003, -0.01), lambda x: (x[1] == 0) & (x[0] > 0.1 - 1e-9))
    assert state.moment == pytest.approx((0.15 + 0.003) * 1e6 * 0.01 * 0.1, rel=1e-11)
    assert pressed(box((0.2,), (4,)), (1,), (0,), (-0.01,), lambda x: x[0] == 0).moment == 0


def test_two_surfaces_have_opposite_resultants_and_moments():
    pytest.importorskip("ipctk")
    cubes = skfem.MeshTet() + skfem.MeshTet().translated((0.2, 0.1, 1.05))
    cubes = cubes.with_subdomains({"lower": lambda x: x[2] < 1, "upper": lambda x: x[2] > 1})
    names = ("lower", "upper")
    pair = [MeshContact(*order, distance=0.1, name=order[0]) for order in (names, names[::-1])]
    body, u = System(cubes, [StVK(young=1e5, poisson=0.3), *pair]), 0.01 * np.random.default_rng(0).normal(size=48)
    one, other = (contact_state(body, name, u, 1.0) for name in names)
    together = contact_state(System(cubes, [StVK(young=1e5, poisson=0.3), pair[0]]), "lower", u, 1.0)
    size = np.abs(together.moment).max()
    everywhere = np.cross(together.positions, together.force).sum(axis=0)
    assert size > 1 and np.abs(everywhere).max() < 1e-11 * size, "forces on both surfaces balance"
    for x, y in ((one.resultant, other.resultant), (one.moment, other.moment)):
        assert np.abs(x + y).max() < 1e-10 * np.abs(x).max()
    assert one.shape is None


def dropped(**options):
    floor = RigidContact(SHAPES["plane"], friction=Friction(0.4, slip_speed=0.1), name="floor")
    wall = RigidContact(RigidPlane((0.1, 0, 0), (-1, 0, 0)), motion=lambda t: (-0.1 * t, 0, 0), name="wall")
    body = System(CUBE, [LAW, Gravity((0, 0, -9.81)), floor, wall])
    v0 = np.tile([0.3, 0, -1.0], CUBE.nv)
    return simulate(body, EnergyMomentum(dt=1e-3), until=0.03, v0=v0, quiet=True, **options)


def test_files_of_a_motion_have_the_contacts_combined(tmp_path):
    """Writing them changes no bit of the motion."""
    run, without = dropped(save=tmp_path / "run.pvd", every=10), dropped()
    np.testing.assert_array_equal(run.ledger.rows(), without.ledger.rows())
    data = read(tmp_path / "run_0003.vtu").point_data
    floor, wall = run.contact("floor"), run.contact("wall")
    assert floor.area > 0 < wall.area and np.abs(floor.force[:, 0]).max() > 0, "friction"
    np.testing.assert_array_equal(data["contact_force"], floor.force + wall.force)
    np.testing.assert_array_equal(data["contact_pressure"], np.maximum(floor.pressure, wall.pressure))
    known = np.isfinite(floor.gap)
    np.testing.assert_array_equal(data["gap"], np.where(known, np.minimum(floor.gap, wall.gap), 0))
    np.testing.assert_array_equal(data["gap_missing"], ~known)
    assert 0 < known.sum() < CUBE.nv
    again = read(run.save(tmp_path / "last.vtu")).point_data
    assert all(np.array_equal(values, again[name]) for name, values in data.items())
    np.testing.assert_array_equal(read_state(tmp_path / "run.pvd", CUBE)[0], run.u)
    for axis, column in zip(np.vstack([floor.resultant, wall.resultant]).T, "xyz", strict=True):
        assert [run.ledger[f"contact {name} {column}"][-1] for name in ("floor", "wall")] == pytest.approx(axis, rel=1e-12)
    assert run.ledger["contact wall gap"][-1] == wall.gap.min() < 0


def test_contacts_that_share_nodes_are_combined():
    """Forces are added; the pressure is the largest, and the gap the smallest."""
    shallow, deep = (RigidContact(RigidPlane((0, 0, z), (0, 0, 1)), name=str(z)) for z in (0.001, 0.002))
    body = System(CUBE, [LAW, shallow, deep])
    u = np.zeros(body.ndofs)
    one, other = contacts = contact_states(body, u, 1.0)
    nodal = Fields.of(body).at(u, contacts=contacts).nodal
    touched = CUBE.p[2] == 0
    assert np.array_equal(nodal["contact_pressure"], other.pressure) and (one.pressure[touched] > 0).all()
    assert np.array_equal(nodal["contact_force"], one.force + other.force) and (nodal["gap"][touched] == -0.002).all()


def statics(**options):
    lid = RigidContact(RigidPlane((0, 0, 0.1), (0, 0, -1)), lambda x: x[2] == 0.1, motion=(0.002, 0, -0.01), name="lid", **options)
    return System(CUBE, [LAW, lid], fixed={lambda x: x[2] == 0: "xyz"})


def test_files_of_a_path_have_the_contacts_of_each_state(tmp_path):
    result = solve_static(statics(), steps=4, save=tmp_path / "saved.pvd", quiet=True)
    result.save(tmp_path / "after.pvd")
    largest = []
    for number, step in enumerate(result.history):
        one, other = (read(tmp_path / f"{name}_{number:04d}.vtu").point_data for name in ("saved", "after"))
        assert all(np.array_equal(values, other[name]) for name, values in one.items())
        largest.append(one["contact_pressure"].max())
        assert largest[-1] == contact_state(result.system, "lid", step.u, step.t).pressure.max()
    assert (np.diff(largest) > 0).all() and len(largest) > 2


def test_friction_of_earlier_states_is_only_in_files_that_the_solve_writes(tmp_path):
    with pytest.warns(StvkWarning, match="Press first and drag in later steps"):
        result = solve_static(statics(friction=Friction(0.3, slip_length=1e-3)), steps=3, save=tmp_path / "saved.pvd", quiet=True)
    result.save(tmp_path / "after.pvd")
    assert "contact_force" not in read(tmp_path / "after_0001.vtu").point_data
    force = read(tmp_path / "saved_0002.vtu").point_data["contact_force"]
    np.testing.assert_array_equal(force, result.contact("lid").force)
    assert force[:, 0].sum() > 0.02 * -force[:, 2].sum(), "friction"


def test_files_without_contacts_have_no_fields_of_contacts(tmp_path):
    body = System(CUBE, [LAW], fixed={lambda x: x[2] == 0: "xyz"})
    file = write_vtu(tmp_path / "body.vtu", Fields.of(body).at(np.zeros(body.ndofs)), ["von_mises"])
    assert set(read(file).point_data) == {"displacement", "von_mises_stress"}


@pytest.mark.few
@pytest.mark.parametrize("name", SHAPES)
def test_surfaces_of_shapes_are_on_the_shape_in_the_surroundings_and_face_the_body(name):
    shape = SHAPES[name]
    bounds = np.array([[0, 0, 0], [0.1, 0.1, 0.1 * (shape.d == 3)]])
    around, size = surroundings(bounds), 0.1
    cells = surface_of(shape, around)
    assert (cells >= around[0] - 1e-12).all() and (cells <= around[1] + 1e-12).all()
    assert (surroundings(bounds)[0] == bounds[0] - MARGIN * size).all() and cells.shape[1:] == (shape.d, 3) and len(cells)

    def gaps_and_normals(x):
        x = np.ascontiguousarray(x[:, : shape.d])
        n = len(x)
        found = np.zeros((n, 1)), np.zeros((n, 1)), np.zeros((n, 1, shape.d))
        points = kernels.Surface(np.ones((1, 1)), np.arange(n, dtype=np.int32)[:, None], x)
        numbers = kernels.ShapeNumbers(shape.kind, shape.numbers())
        kernels.find_gaps(points, np.zeros((n, 1)), numbers, np.zeros(3), 0.0, np.zeros_like(x), *found)
        return found[0][:, 0], found[2][:, 0]

    gaps, _ = gaps_and_normals(cells.reshape(-1, 3))
    assert np.abs(gaps).max() < 0.01 * size, "chords of curved surfaces"
    if shape.d == 3:
        normals = np.cross(cells[:, 1] - cells[:, 0], cells[:, 2] - cells[:, 0])
        areas = np.linalg.norm(normals, axis=1)
        large = areas > 1e-3 * areas.max()
        assert ((normals * gaps_and_normals(cells.mean(axis=1))[1]).sum(axis=1)[large] > 0.5 * areas[large]).all()


def test_the_surface_of_a_sphere_has_its_area_and_that_of_a_cube_its_own():
    def area(shape):
        cells = surface_of(shape, np.array([[-2.0, -2, -2], [2, 2, 2]]))
        return np.linalg.norm(np.cross(cells[:, 1] - cells[:, 0], cells[:, 2] - cells[:, 0]), axis=1).sum() / 2

    assert area(RigidSphere((0, 0, 0), 1.0)) == pytest.approx(4 * np.pi, rel=1e-2)
    assert area(RigidBox((-1, -1, -1), (1, 1, 1))) == pytest.approx(24, rel=1e-9)
    assert area(RigidPlane((0, 0, 0.5), (0, 0, 1))) == pytest.approx(16, rel=1e-9)
    slope = np.sqrt(1 + 0.3**2)
    assert area(RigidPlane((0, 0, 0), (0.3, 0, 1))) == pytest.approx(16 * slope, rel=1e-9)
    assert area(RigidCylinder((0, 0, 0), (1, 0, 0), 1.0)) == pytest.approx(8 * np.pi, rel=1e-2)


def shown(shape, scale=1.0):
    body = System(CUBE, [LAW, RigidContact(shape, stiffness=1.0)])
    u = np.zeros(body.ndofs)
    return picture_of(Fields.of(body).at(u, contacts=contact_states(body, u, 1.0)), "contact_pressure", scale, None)


def test_shapes_do_not_blow_up_the_view():
    near, far, enlarged = shown(SHAPES["large sphere"]), shown(RigidPlane((0, 0, -1), (0, 0, 1))), shown(SHAPES["plane"], 10.0)
    for picture in (near, far):
        view = View.of([picture])
        np.testing.assert_array_equal(view.box, [[0, 0, 0], [0.1, 0.1, 0.1]])
        assert len(picture.shapes) == 1 and (np.abs(view.frame - view.box) <= MARGIN * 0.1 * (1 + 1e-12)).all()
    assert View.of([near]).frame[0, 2] < -1e-4 and np.array_equal(View.of([far]).frame, View.of([far]).box)
    assert not enlarged.shapes, "they would not be at their place"


def test_films_draw_the_shapes_at_their_place_at_that_time(tmp_path):
    run = dropped(save=tmp_path / "run.pvd", every=10)
    film = plotting._of_files(tmp_path / "run.pvd", "contact_pressure", 1.0, None, run._shapes)
    view, pictures = film.view_and_pictures()
    for (_, picture), t in zip(pictures, film.times, strict=True):
        floor, wall = picture.shapes
        assert floor == SHAPES["plane"] and wall.point == pytest.approx((0.1 - 0.1 * t, 0, 0)) and picture.label.endswith("Pa]")
    states = [(run.t, run.state)]
    assert plotting._of_states(states, "gap", 1.0, None).picture(0).shapes == (floor, wall)
    assert (view.frame[0] < view.box[0]).any()
    assert run.animate(tmp_path / "run.gif").stat().st_size > 1000 and animate(states, tmp_path / "one.gif", "contact_force")
    run.plot("gap", path=tmp_path / "gap.png")


def pixels_of(figure):
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].astype(int)


@pytest.mark.few
@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_is_drawn_in_grey(tmp_path, name):
    """A picture with the shape differs from the same picture without it."""
    shape = SHAPES[name]
    mesh = CUBE if shape.d == 3 else box((0.1, 0.1), (2, 2))
    body, u = System(mesh, [LAW, RigidContact(shape, stiffness=1e-9)]), np.zeros(mesh.p.size)
    state = Fields.of(body).at(u, contacts=contact_states(body, u, 1.0))
    figure = plot(state, "contact_pressure", path=tmp_path / "shape.png")
    pixels = pixels_of(figure)
    grey = (np.ptp(pixels, axis=2) < 6) & (pixels[..., 0] > 120) & (pixels[..., 0] < 250)
    plain = plot(Fields.of(body).at(u), np.zeros(mesh.nt), label="contact pressure [Pa]", path=tmp_path / "plain.png")
    pixels = pixels_of(plain)
    before = (np.ptp(pixels, axis=2) < 6) & (pixels[..., 0] > 120) & (pixels[..., 0] < 250)
    assert grey.sum() > before.sum() + 300


def test_pyvista_draws_shapes():
    pyvista = pytest.importorskip("pyvista")
    body, u = System(CUBE, [LAW, RigidContact(SHAPES["plane"])]), np.zeros(CUBE.p.size)
    state = Fields.of(body).at(u, contacts=contact_states(body, u, 1.0))
    one, other = plot(state, "gap", backend="pyvista"), plot(Fields.of(body).at(u), "displacement", backend="pyvista")
    assert isinstance(one, pyvista.Plotter) and len(one.renderer.actors) == len(other.renderer.actors) + 1


# findings


def oscillator(steps, depth=0.02, integrator=EnergyMomentum, **options):
    """Return the motion of a stiff cube that touches a soft plane for half a period, in units of its edge and of this half."""
    mesh = box((1.0, 1.0, 1.0), (1, 1, 1))
    edge = (2 + np.sqrt(2)) / 3
    plane = RigidContact(RigidPlane((0, 0, -1e-3), (0, 0, 1)), lambda x: x[2] == 0, stiffness=np.pi**2, name="floor")
    body = System(mesh, [StVK(young=1e7, poisson=0.0, density=1.0), plane])
    v0 = np.tile([0, 0, -np.pi * depth * edge], mesh.nv)
    return simulate(body, integrator(1 / steps), v0=v0, quiet=True, **({"until": 3.0} | options))


def found(run):
    return {finding.name: finding for finding in run.findings}


def test_deep_contacts_are_reported_with_depth_time_and_remedy():
    assert not oscillator(50, 0.045).findings
    run = oscillator(50, 0.06)
    finding = found(run)["deep contact"]
    assert finding.extreme == pytest.approx(0.06, rel=2e-3) and not len(finding.elements)
    at = float(re.search(r"at t = ([0-9.]+) s", finding.text)[1])
    assert at == pytest.approx(0.5, abs=0.03) and "contact 'floor'" in finding.text and "larger stiffness" in finding.text
    assert finding.text.rstrip(".") in run.message and run.success
    assert finding.extreme == -run.ledger["contact floor gap"].min() / ((2 + np.sqrt(2)) / 3)


def test_contacts_of_fewer_than_five_steps_are_reported():
    assert not oscillator(6).findings
    finding = found(oscillator(4))["short contact"]
    assert finding.extreme == 4 and "1 of 1 contacts" in finding.text and "smaller dt" in finding.text
    assert not oscillator(4, until=0.6).findings, "the contact has not ended"


@pytest.mark.parametrize(
    ("touches", "text"),
    [
        ("..######.", ""),
        ("..####.", "1 of 1 contacts last fewer than 5 steps, the first from t = 2 s on; the shortest has 4"),
        ("..##.#####..#.", "2 of 3 contacts last fewer than 5 steps, the first from t = 2 s on; the shortest has 1"),
        ("#..######.", ""),
        ("##..######.#", ""),
        ("#", ""),
        ("#..##.", "1 of 1 contacts last fewer than 5 steps, the first from t = 3 s on; the shortest has 2"),
    ],
)
def test_contacts_that_end_are_counted(touches, text):
    """Contacts from the start, and those that have not ended, may be longer."""
    body = System(CUBE, [LAW, RigidContact(SHAPES["plane"], name="floor")])
    rows = [[t, -1e-5 if touch == "#" else 0.01] for t, touch in enumerate(touches)]
    findings = list(contact_findings(body, Ledger(["time", "contact floor gap"], rows), np.zeros(body.ndofs), 0.0))
    assert [text in finding.text for finding in findings] == ([True] if text else [])


def names_of(result):
    """Return the names of the findings in each state of a path."""
    return [{finding.name for finding in step.findings} for step in result.history]


def path(shape, motion, law=LAW, stiffness=None, **options):
    """Return the path of a cube on a fixed bottom that a shape moves into."""
    contact = RigidContact(shape, motion=motion, stiffness=stiffness, name="tool")
    body = System(CUBE, [law, contact], fixed={lambda x: x[2] == 0: "xyz"})
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        result = solve_static(body, quiet=True, raise_on_failure=False, **options)
    texts = [str(warning.message) for warning in issued]
    found = {name for names in names_of(result) for name in names}
    assert len(texts) == len(found), "each finding warns once"
    return result, " ".join(texts)


def test_a_squeeze_that_is_too_soft_is_reported_in_statics():
    """At a squeeze by 40 % the penalty loses 7 % of the force of a stiff one; at one by 20 % it loses less, without a finding."""
    lid = RigidPlane((0, 0, 0.1), (0, 0, -1))
    result, text = path(lid, (0, 0, -0.04))
    last = result.history[-1].findings[0]
    edge = (2 + np.sqrt(2)) / 3 * 0.05
    assert last.name == "deep contact" and last.extreme == pytest.approx(-result.contact("tool").gap.min() / edge, rel=1e-9)
    assert "larger stiffness" in text and last.text in result.message and names_of(result)[0] == set()
    stiff = System(CUBE, [LAW, RigidContact(lid, motion=(0, 0, -0.04), stiffness=1e9)], fixed={lambda x: x[2] == 0: "xyz"})
    force = result.contact("tool").resultant[2] / solve_static(stiff, quiet=True).contact("contact").resultant[2]
    assert force < 0.95 and path(lid, (0, 0, -0.02))[1] == ""


@pytest.mark.parametrize("steps", [1, 10])
def test_a_shape_thinner_than_the_facets_is_reported(steps):
    """The ball slips into the body between its nodes and pushes nothing."""
    result, text = path(RigidSphere((0.06, 0.07, 0.106), 0.005), (0, 0, -0.05), steps=steps)
    assert result.success and not result.contact("tool").force.any() and all("thin shape" in names for names in names_of(result))
    assert "Refine the surface" in text
    assert path(RigidSphere((0.05, 0.05, 0.141), 0.04), (0, 0, -0.005))[1] == ""
    v0 = np.tile([0, 0, 0.1], CUBE.nv)
    ball = RigidContact(RigidSphere((0.06, 0.07, 0.106), 0.005), name="ball")
    run = simulate(System(CUBE, [LAW, ball]), EnergyMomentum(dt=1e-3), until=2e-3, v0=v0, quiet=True)
    assert set(found(run)) == {"thin shape"}


def test_a_body_on_the_wrong_side_is_reported_once_no_node_is_outside():
    """The normal points away from most of the body; at the start some nodes are outside, and at the end none."""
    result, text = path(RigidPlane((0, 0, 0.01), (0, 0, -1)), (0, 0, -0.03), stiffness=1e3, steps=4)
    names = names_of(result)
    assert "deep contact" in names[0] and names[-1] & {"wrong side", "deep contact"} == {"wrong side"}
    assert "Reverse the normal" in text and "Reverse the normal" in result.message
    floor = RigidContact(RigidPlane((0, 0, 0.01), (0, 0, -1)), motion=lambda t: (0, 0, -10 * t), stiffness=1e3, name="floor")
    body = System(CUBE, [LAW, floor], fixed={lambda x: x[2] == 0: "xyz"})
    run = simulate(body, EnergyMomentum(dt=1e-4), until=2e-3, quiet=True, raise_on_failure=False)
    assert "wrong side" in found(run) and "deep contact" not in found(run)


def test_contacts_that_begin_and_end_within_few_states_of_a_path_are_reported():
    """A ball that is drawn over an edge of the body touches in some states; a plane that comes and goes cannot pass."""

    def there_and_back(t):
        return (0, 0, -0.004 * max(0.0, 1 - abs(4 * t - 2)))

    result, text = path(RigidSphere((0.05, 0.05, 0.142), 0.04), there_and_back, steps=10)
    gaps = [contact_state(result.system, "tool", step.u, step.t).gap.min() for step in result.history]
    touching = sum(gap < 0 for gap in gaps)
    assert 0 < touching < 5 and gaps[-1] > 0 and gaps[0] > 0
    finding = result.history[-1].findings[0]
    assert finding.name == "short contact" and finding.extreme == touching and "may have passed the shape" in text
    assert path(RigidPlane((0, 0, 0.102), (0, 0, -1)), there_and_back, steps=10)[1] == ""


def test_no_step_of_a_path_passes_a_moving_shape():
    """A plate that moves farther than its thickness in a step would leave the body between its own faces and push nothing."""
    plate = RigidBox((-1, -1, 0.1005), (1, 1, 0.105))
    result, _ = path(plate, (0, 0, -0.01), steps=1, law=StVK(young=3e4, poisson=0.3))
    assert result.success and result.history.attempts[0].end is End.CONTACT
    one, other = (
        result.contact("tool").resultant[2],
        path(RigidPlane((0, 0, 0.1005), (0, 0, -1)), (0, 0, -0.01), law=StVK(young=3e4, poisson=0.3))[0],
    )
    assert one < 0 and one == pytest.approx(other.contact("tool").resultant[2], rel=0.05)


def dragged(contact, together):
    """Return the path of a cube that a lid presses on a floor and drags, in one ramp or one after the other."""
    down, law, friction = 0.002 if contact == "rigid" else 0.006, StVK(young=3e4, poisson=0.3), Friction(0.4, slip_length=1e-5)

    def way(axis):
        def at(t):
            press, drag = (t, t) if together else (min(1.0, 2 * t), max(0.0, 2 * t - 1))
            return {"x": 0.04 * drag, "y": 0.0, "z": -down * press}[axis]

        return at

    bottom, lid = (lambda x: x[2] == 0), {lambda x: np.isclose(x[2], x[2].max()): {axis: way(axis) for axis in "xyz"}}
    floor = RigidContact(RigidPlane((0, 0, 0), (0, 0, 1)), bottom, friction=friction, stiffness=1e8)
    if contact == "mesh":
        table = box((0.3, 0.2, 0.05), (3, 2, 1))
        floor = MeshContact(
            bottom, RigidMesh((table.p - [[0.08], [0.07], [0.054]], table.surface)), distance=0.005, friction=friction
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        return solve_static(System(CUBE, [law, floor], prescribed=lid), steps=10, quiet=True)


@pytest.mark.parametrize("contact", ["rigid", "mesh"])
def test_friction_that_lags_behind_its_normal_force_is_reported(contact):
    """Pressed and dragged in one ramp, friction has the normal force of the state before; pressed first, it has its own."""
    if contact == "mesh":
        pytest.importorskip("ipctk")
    result, lags = dragged(contact, together=True), []
    normal = [0.0, *(contact_state(result.system, "contact", step.u, step.t).resultant[2] for step in result.history)]
    for before, now, step in zip(normal, normal[1:], result.history, strict=False):
        found = [one.extreme for one in step.findings if one.name == "lagging friction"]
        expected = 1 - before / now if now and step.t else 0.0  # nothing slips at the start
        assert found == pytest.approx([expected] * int(expected > 0.05), abs=0.02)
        lags += found
    assert len(lags) > 3 and lags[0] > 0.3
    force = result.contact("contact").resultant
    assert np.hypot(*force[:2]) / force[2] == pytest.approx(0.4 * normal[-2] / normal[-1], rel=0.02)
    first = dragged(contact, together=False)
    force = first.contact("contact").resultant
    assert np.hypot(*force[:2]) / force[2] == pytest.approx(0.4, rel=0.04)
    assert not any("lagging friction" in names for names in names_of(first))


def test_findings_cover_a_motion_that_is_resumed(tmp_path):
    whole = oscillator(4, 0.06)
    oscillator(4, 0.06, until=2.0, checkpoint=tmp_path / "folder")
    parts = oscillator(4, 0.06, checkpoint=tmp_path / "folder", resume=True)
    assert [repr(one) for one in parts.findings] == [repr(one) for one in whole.findings] and len(found(whole)) == 2


def test_findings_are_in_the_units_of_the_system():
    mesh = box((100.0, 100.0, 100.0), (1, 1, 1))
    floor = RigidContact(RigidPlane((0, 0, 10.0), (0, 0, 1)), lambda x: x[2] == 0, name="floor")
    body = System(mesh, [NeoHookean(young=0.1, poisson=0.3, density=1e-9), floor], units="mm-N-MPa")
    run = simulate(body, VelocityVerlet(), until=1e-3, quiet=True)
    assert "points are up to 10 mm deep" in found(run)["deep contact"].text


def test_states_of_a_simulation_take_contacts(tmp_path):
    """The forces of `Simulation.contact` reach pictures by `Fields.at`."""
    lid = RigidContact(RigidPlane((0, 0, 0.1), (0, 0, -1)), lambda x: x[2] == 0.1, name="lid")
    sim = Simulation(System(CUBE, [LAW, lid], fixed={lambda x: x[2] == 0: "xyz"}), EnergyMomentum(dt=1e-3), moved=["lid"])
    sim.step(lid=(0, 0, -1e-3))
    state = Fields.of(sim.system).at(sim.u, sim.v, [sim.contact("lid")])
    assert state.contacts[0].shape == RigidPlane((0, 0, 0.1 - 1e-3), (0, 0, -1)) and state.nodal["contact_pressure"].max() > 0
    assert plot(state, "contact_force", path=tmp_path / "lid.png")


@pytest.mark.parametrize("method", ["load-steps", "arc-length"])
def test_films_of_scenes_have_the_shapes_of_each_state(tmp_path, monkeypatch, method):
    """Times of a series are load factors, but for arc length the numbers of the states."""
    lid = RigidContact(RigidPlane((0, 0, 0.2), (0, 0, -1)), motion=(0, 0, -0.01))
    body = System(CUBE, [LAW, lid, Traction(lambda x: x[0] == 0.1, (50.0, 0, 0))], fixed={lambda x: x[2] == 0: "xyz"})
    result = solve_static(body, steps=3, method=method, save=tmp_path / "path.pvd", quiet=True)
    output = SimpleNamespace(animation="path.gif", file="path.pvd", fields=None, picture="gap")
    analysis = SimpleNamespace(type=method)
    built = SimpleNamespace(sections=SimpleNamespace(output=output, analysis=analysis), system=result.system, mesh=CUBE)
    heights, problems = [], []

    def animated(series, target, field, *, shapes, **options):
        heights.extend(shapes(t)[0].point[2] for t, _ in listed_states(series))

    monkeypatch.setattr(report, "animate", animated)
    list(report._save_animation(tmp_path, SimpleNamespace(result=result, built=built), problems))
    assert problems == [] and heights == pytest.approx([0.2 - 0.01 * t for t in result.history.t]) and len(heights) > 2


def test_values_at_nodes_are_no_request():
    with pytest.raises(StvkError, match=r"no field 'gap' of elements\. It has values at nodes: files contain it"):
        names.find_all(["gap"])


# forces in motions are those of the steps

MESHES = {"tetrahedra": box((0.1, 0.12, 0.1), (2, 2, 2)), "hexahedra": box((0.1, 0.12, 0.1), (2, 2, 2), "hexahedra")}
EVERY = [
    ForwardEuler(),
    VelocityVerlet(),
    *(make(1e-3, rtol=1e-13) for make in (BackwardEuler, Newmark, GeneralizedAlpha, EnergyMomentum)),
]
TANGENTS = [LinearBackwardEuler(1e-3, tangent=one, rtol=1e-13) for one in ("exact", "clamped", "gauss-newton", "warped")]


SLANTED, BALL = RigidPlane((0, 0, -2e-3), (0.1, 0.05, 1)), RigidSphere((0.04, 0.055, -0.042), 0.04)


def thrown(mesh, *terms, integrator, until=0.08, friction=None, shape=SLANTED, **options):
    """Return the motion of a heterogeneous block that meets a shape on a few nodes, and leaves it again."""
    law = NeoHookean(young=3e4 * (1 + np.arange(mesh.nt) % 3), poisson=0.3, density=1000.0 + 100.0 * (np.arange(mesh.nt) % 2))
    contact = RigidContact(shape, lambda x: x[2] == 0, name="floor", friction=friction, stiffness=3e7)
    system = System(mesh, [law, contact, *terms])
    return simulate(system, integrator, until=until, v0=np.tile([0.1, 0.05, -1.0], mesh.nv), quiet=True, **options)


def momenta(run):
    return np.stack([run.ledger[f"linear_momentum_{axis}"] for axis in "xyz"], axis=1)


def impulse(run, name="contact floor"):
    forces = np.stack([run.ledger[f"{name} {axis}"] for axis in "xyz"], axis=1)
    return (forces[1:] * np.diff(run.ledger["time"])[:, None]).sum(axis=0)


@pytest.mark.few
@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("integrator", [*EVERY, *TANGENTS], ids=str)
def test_the_impulse_of_a_contact_is_the_change_of_momentum(integrator, mesh):
    run = thrown(MESHES[mesh], integrator=integrator)
    change = np.diff(momenta(run)[[0, -1]], axis=0)[0]
    assert change[2] > 1.0 and not run.ledger["contact floor z"][[0, -1]].any() and run.success
    np.testing.assert_allclose(impulse(run), change, rtol=0, atol=1e-8 * change[2])


@pytest.mark.parametrize("mesh", MESHES)
def test_diagonal_blocks_of_a_contact_act_as_the_equation_has_them(mesh):
    """Without the forces of the elements, those of the contact are left at each node."""
    system = thrown(MESHES[mesh], integrator=EVERY[0], until=0.01).system
    law = System(MESHES[mesh], [term for term in system.terms if not isinstance(term, RigidContact)])
    sim = Simulation(system, LinearBackwardEuler(1e-3, tangent="diagonal"), v0=np.tile([0.1, 0.05, -1.0], MESHES[mesh].nv))
    for _ in range(8):
        u, v = sim.u, sim.v
        sim.step()
    w = (sim.u - u).reshape(-1, 3)
    own = law.internal_force(u) + np.einsum("nij,nj->ni", law.linear_operator(u).diagonal_blocks(), w).ravel()
    force = sim.contact("floor").force.ravel()
    assert force.max() > 5.0
    np.testing.assert_allclose(force, law.mass().multiply(sim.v - v) / 1e-3 + own, rtol=0, atol=1e-9 * force.max())


@pytest.mark.few
@pytest.mark.parametrize("rub", [False, True], ids=["smooth", "rough"])
@pytest.mark.parametrize("integrator", [EnergyMomentum(1e-3), *TANGENTS], ids=str)
def test_forces_of_contact_friction_and_foundations_are_the_rate_of_momentum(integrator, rub):
    """In each step, with damping, too."""
    bed = ElasticFoundation(lambda x: x[2] == 0.1, (3e4, 2e4, 1e4))
    options = {"damping": Rayleigh(beta=1e-4), "reactions": {"bed": None}}
    options |= {"friction": Friction(0.3, slip_speed=0.3)} if rub else {"shape": BALL}
    run = thrown(MESHES["tetrahedra"], bed, integrator=integrator, until=0.02, **options)
    rate = np.diff(momenta(run), axis=0) / np.diff(run.ledger["time"])[:, None]
    forces = sum(
        np.stack([run.ledger[f"{name} {axis}"] for axis in "xyz"], axis=1)[1:] for name in ("contact floor", "reaction bed")
    )
    np.testing.assert_allclose(forces, rate, rtol=0, atol=1e-8 * np.abs(rate).max())


def test_the_impulse_between_meshes_is_the_change_of_momentum():
    """A damped block meets a rigid mesh. Steps are cut into parts."""
    floor, mesh = box((2, 2, 0.1), (1, 1, 1), origin=(-1, -1, -0.102)), box((0.1, 0.1, 0.1), (1, 1, 1))
    contact = MeshContact(lambda x: x[2] == 0, RigidMesh((floor.p, floor.surface)), distance=1e-3, name="floor", stiffness=1e6)
    v0 = np.tile([0.1, 0.0, -1.0], mesh.nv)
    run = simulate(System(mesh, [LAW, contact]), EnergyMomentum(2e-3), until=0.03, v0=v0, damping=EdgeDamping(1e-4), quiet=True)
    change = np.diff(momenta(run)[[0, -1]], axis=0)[0]
    assert change[2] > 0.5 and run.cuts and not run.ledger["contact floor z"][[0, -1]].any()
    np.testing.assert_allclose(impulse(run), change, rtol=0, atol=1e-8 * change[2])


@pytest.mark.parametrize(
    "integrator", [EnergyMomentum(1e-3), LinearBackwardEuler(1e-3), VelocityVerlet(1e-4)], ids=["EM", "eq. 9", "Verlet"]
)
def test_a_resumed_run_has_the_forces_of_its_last_step(integrator, tmp_path):
    options = {"integrator": integrator, "until": 0.01}
    friction = Friction(0.3, slip_speed=0.3)
    run = thrown(
        MESHES["tetrahedra"], friction=friction, checkpoint=tmp_path / "folder", save=tmp_path / "run.pvd", every=1, **options
    )
    again = thrown(MESHES["tetrahedra"], friction=friction, checkpoint=tmp_path / "folder", resume=True, **options)
    own = run.contact("floor")
    np.testing.assert_array_equal(again.contact("floor").force, own.force)
    np.testing.assert_array_equal(own.resultant, [run.ledger[f"contact floor {axis}"][-1] for axis in "xyz"])
    assert own.resultant[2] > 10.0
    np.testing.assert_array_equal(read(listed_states(tmp_path / "run.pvd")[-1][1]).point_data["contact_force"], own.force)
    np.testing.assert_array_equal(run.state.nodal["contact_force"], own.force)


def test_a_simulation_reports_and_restores_the_force_of_its_step():
    lid = RigidContact(RigidPlane((0, 0, 0.1), (0, 0, -1)), lambda x: x[2] == 0.1, name="lid", stiffness=1e8)
    body = System(CUBE, [LAW, lid], fixed={lambda x: x[2] == 0: "xyz"})
    sim = Simulation(body, EnergyMomentum(dt=1e-3), moved=["lid"], ledger=True)
    sim.step(lid=(0, 0, -1e-3))
    saved, before, first = sim.copy_state(), sim.v, sim.contact("lid").force
    sim.step(lid=(0, 0, -2e-3))
    rate = body.mass().multiply(sim.v - before).reshape(-1, 3).sum(axis=0) / 1e-3
    floor = np.unique(np.flatnonzero(CUBE.p[2] == 0))
    reaction = sim._record.state.reaction.reshape(-1, 3)[floor].sum(axis=0)
    np.testing.assert_allclose(sim.contact("lid").resultant + reaction, rate, rtol=0, atol=1e-8 * np.abs(rate).max())
    sim.restore(saved)
    np.testing.assert_array_equal(sim.contact("lid").force, first)
