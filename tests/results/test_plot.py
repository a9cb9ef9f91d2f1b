"""Contents of plots. The appearance was checked by eye."""

import re
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
import skfem
from bodies import MESHES, state
from matplotlib.backends.backend_agg import FigureCanvasAgg

from skfem_stvk import ElementMesh, StVK, StvkError, System, embedded_mesh
from skfem_stvk.results import Fields, plot, plotting
from skfem_stvk.results.matplotlib_plot import PictureAxes, new_figure
from skfem_stvk.results.picture import SCREEN, View, outline, picture_of, visible_faces

matplotlib.use("Agg")


def at(mesh, amount=0.03, **term):
    return Fields(mesh, StVK(young=2e6, poisson=0.3, **term)).at(state(mesh, amount))


@pytest.mark.parametrize("name", MESHES)
def test_every_kind_of_mesh_has_a_picture(name, tmp_path):
    path = tmp_path / "body.png"
    assert isinstance(plot(at(MESHES[name]), path=path), matplotlib.figure.Figure)
    pixels = matplotlib.image.imread(path)[..., :3]
    coloured = np.ptp(pixels, axis=2) > 0.2
    assert coloured.mean() > 0.003  # the body and its colour bar
    assert (pixels.min(axis=2) > 0.98).mean() < 0.99


@pytest.mark.parametrize("name", MESHES)
def test_every_kind_of_mesh_has_a_scene_that_can_be_rotated_and_exported(name, tmp_path):
    pytest.importorskip("pyvista")
    scene = plot(at(MESHES[name]), path=tmp_path / "body.png", backend="pyvista")
    scene.export_gltf(tmp_path / "body.gltf")
    assert (tmp_path / "body.gltf").stat().st_size > 1000 and (tmp_path / "body.png").stat().st_size > 1000


def test_a_picture_shows_membranes_and_cables_of_a_body():
    """A membrane on faces of the solid adds no second face there; one within the solid, and a cable, are added."""
    solid = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 3)] * 3).with_defaults()
    nodes = {tuple(x): number for number, x in enumerate(solid.p.T)}
    within = np.array([[nodes[x, y, 0.5] for x, y in ((0, 0), (1, 0), (1, 1))]]).T
    diagonal = np.array([[nodes[0, 0, 0]], [nodes[1, 1, 1]]])

    def picture(*terms, field="displacement"):
        system = System(solid, [StVK(young=1e5, poisson=0.3), *terms])
        u = 0.1 * np.sin(solid.p[[1, 2, 0]]).ravel("F")
        return picture_of(Fields.of(system).at(u), field, 1.0, None)

    def membrane(where):
        return StVK(young=1e6, poisson=0.3, thickness=1e-3, simplices=where)

    bare, on, inside = picture(), picture(membrane("top")), picture(membrane(within))
    tied = picture(StVK(young=1e6, poisson=0.3, area=1e-4, simplices=diagonal))
    faces = bare.cells.shape[1]
    assert on.cells.shape[1] == faces and inside.cells.shape[1] == faces + 1 and tied.cells.shape[1] == faces
    assert tied.lines.shape[1] == bare.lines.shape[1] + 1
    assert np.ptp(tied.moved[tied.lines[:, -1]], axis=0) == pytest.approx([1 + 0.1 * np.sin(1)] * 3, rel=1e-12)
    nodal = picture(membrane(within), field=np.arange(solid.p.shape[1], dtype=float))
    assert set(np.ma.getdata(nodal.values)[:, -1]) == set(within[:, 0]) and not np.ma.getmaskarray(nodal.values)[:, -1].any()
    by_element = picture(membrane(within), field=np.ones(solid.t.shape[1]))
    assert np.ma.getmaskarray(by_element.values)[:, -1].all() and not np.ma.getmaskarray(by_element.values)[:, :-1].any()


def test_a_face_towards_the_light_has_at_most_full_brightness():
    from skfem_stvk.results.matplotlib_plot import LIGHT, _brightness

    across = np.linalg.svd(LIGHT[None])[2][1:]
    angle = np.random.default_rng(0).uniform(0, 2 * np.pi, 500)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ across
    triangles = np.stack([0 * normal, normal, np.cross(LIGHT, normal)], axis=1)
    assert _brightness(triangles).max() <= 1 and _brightness(triangles).min() > 1 - 1e-12


def middle_of(figure):
    """Return the colour in the middle of the axes of a body in space."""
    figure.canvas.draw()
    extent = figure.axes[0].get_window_extent()
    x, y = (extent.x0 + extent.x1) / 2, (extent.y0 + extent.y1) / 2
    return np.asarray(figure.canvas.buffer_rgba())[-int(y), int(x), :3] / 255


@pytest.mark.parametrize("sign", [1, -1])
def test_the_nearest_face_is_seen_and_an_inverted_body_has_no_holes(sign):
    """Colours are distances to the viewer: blue is far, yellow is near. A mirrored body has all its elements inverted."""
    cube = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 4)] * 3)
    mesh = ElementMesh(cube.p, cube.t)
    middle = mesh.p.mean(axis=1, keepdims=True)
    u = (sign - 1) * (mesh.p - middle)
    figure = plot(Fields(mesh, StVK(young=1.0, poisson=0.3)).at(u.T.ravel()), SCREEN[2] @ (mesh.p + u))
    red, _, blue = middle_of(figure)
    assert red > 0.6 and blue < 0.4


def test_a_body_in_space_fills_the_picture_in_one_direction_in_all_frames():
    bar = skfem.MeshTet.init_tensor(np.linspace(0, 4, 9), *[np.linspace(0, 1, 3)] * 2)
    picture = picture_of(
        Fields(ElementMesh(bar.p, bar.t), StVK(young=1.0, poisson=0.3)).at(0 * bar.p.ravel()), "displacement", 1.0, ""
    )
    bent = replace(picture, moved=picture.moved - [[0.0, 0.0, 1.0]] * picture.moved[:, :1] ** 2 / 16)
    figure = new_figure((7.0, 4.5), interactive=False)
    FigureCanvasAgg(figure)
    axes = PictureAxes(figure, picture, View.of([picture, bent]))
    seen = np.zeros((450, 700), dtype=bool)
    for one in (picture, bent):
        axes.show(one)
        figure.canvas.draw()
        seen |= np.asarray(figure.canvas.buffer_rgba()).min(axis=2) < 250
    extent = figure.axes[0].get_window_extent().extents.astype(int)
    inside = seen[450 - extent[3] : 450 - extent[1], extent[0] : extent[2]]
    for axis in (0, 1):
        drawn = np.flatnonzero(inside.any(axis=axis))
        assert drawn[0] < 0.03 * inside.shape[1 - axis] and drawn[-1] > 0.97 * inside.shape[1 - axis]
    assert extent[2] - extent[0] > 500 or extent[3] - extent[1] > 400, "pixels of 700 x 450, besides the colour bar"


def test_axes_in_a_plane_have_the_given_unit_of_length(tmp_path):
    now = at(MESHES["triangles"])
    labels = [plot(now, path=tmp_path / "body.png", **given).axes[0].get_xlabel() for given in ({}, {"length_unit": "mm"})]
    assert labels == ["x [m]", "x [mm]"]


@pytest.mark.parametrize("suffix", [".pdf", ".svg"])
def test_pictures_can_be_vector_graphics(suffix, tmp_path):
    path = tmp_path / f"body{suffix}"
    plot(at(MESHES["tetrahedra"]), "displacement", path=path, backend="matplotlib")
    assert path.stat().st_size > 1000


def test_the_colour_bar_has_the_name_and_the_unit():
    now = at(MESHES["tetrahedra"])
    for field, words in (
        ("von_mises", r"von Mises stress \[.*Pa\]"),
        ("displacement", r"displacement \[.*m\]"),
        ("volume_ratio", "volume ratio"),
    ):
        assert re.fullmatch(words, picture_of(now, field, 1.0, None).label)
    own = picture_of(now, "von_mises", 1.0, "stress [psi]")  # values with a label of the user are not converted
    assert own.label == "stress [psi]" and own.values.max() == pytest.approx(now.at_nodes("von_mises")[own.cells].max())


@pytest.mark.parametrize(("size", "unit"), [(3e-7, "nm"), (2e-3, "mm"), (1.0, "m"), (999.0, "m"), (5e3, "km")])
def test_units_of_colours_have_values_from_1_to_1000(size, unit):
    mesh = MESHES["triangles"]
    u = np.zeros((mesh.nv, 2))
    u[3] = 0, size
    picture = picture_of(Fields(mesh, StVK(young=1.0, poisson=0.3)).at(u.ravel()), "displacement", 1.0, None)
    assert picture.label == f"displacement [{unit}]"
    factor = {"nm": 1e9, "mm": 1e3, "m": 1, "km": 1e-3}[unit]
    assert picture.values.max() == pytest.approx(size * factor) and 1 <= picture.values.max() < 1000


def test_displacements_are_drawn_times_the_scale():
    mesh = MESHES["triangles"]
    now = at(mesh)
    picture = picture_of(now, "volume_ratio", 3.0, None)
    assert np.allclose(picture.moved[:, :2], mesh.p.T + 3 * now.u) and np.allclose(picture.rest[:, :2], mesh.p.T)
    texts = [text.get_text() for text in plot(now, scale=3.0, backend="matplotlib").texts]
    assert texts == ["displacements × 3"]
    assert not plot(now, backend="matplotlib").texts


def test_colours_jump_between_materials():
    mesh = MESHES["tetrahedra"]
    left = mesh.p[0, mesh.t].mean(axis=0) < 0.5
    terms = [StVK(young=1.0, poisson=0.3, region=left), StVK(young=1000.0, poisson=0.3, region=~left)]
    u = state(mesh, 0.05)
    both, alone = (picture_of(Fields(mesh, some).at(u), "von_mises", 1.0, "x").values for some in (terms, terms[:1]))
    (_, elements), _ = visible_faces(mesh)
    mine = left[elements]
    assert np.allclose(both[:, mine], alone[:, mine]) and np.ma.getmaskarray(alone)[:, ~mine].all()


def test_the_body_is_grey_where_values_are_missing(tmp_path):
    mesh = MESHES["triangles"]
    path = tmp_path / "body.png"
    right = np.flatnonzero(mesh.p[0, mesh.t].mean(axis=0) > 0.6)
    plot(at(mesh, region=right), path=path)
    pixels = np.round(255 * matplotlib.image.imread(path)[..., :3]).astype(int)
    grey = (np.ptp(pixels, axis=2) < 3) & (abs(pixels[..., 0] - 0xC8) < 20)
    assert grey.mean() > 0.05


def test_user_supplied_values_can_be_drawn():
    mesh = MESHES["tetrahedra"]
    now = at(mesh)
    picture = picture_of(now, mesh.p[0], 1.0, "x [m]")  # one value per vertex: unchanged
    assert np.allclose(picture.values, mesh.p[0][picture.cells])
    picture = picture_of(now, np.full(mesh.nt, 2.5), 1.0, None)  # one value per element: averaged
    assert np.allclose(picture.values, 2.5) and picture.limits[0] < 2.5 < picture.limits[1]
    picture = picture_of(now, np.where(np.arange(mesh.nt) < 80, np.nan, 1.0), 1.0, None)
    assert np.ma.is_masked(picture.values) and np.isfinite(picture.values.data).all()


def test_invalid_plots_are_refused(tmp_path):
    now = at(MESHES["tetrahedra"])
    for arguments, message in (
        ({"field": "sigma"}, "no field 'sigma'"),
        ({"field": "displacements"}, "no field 'displacements'; known: .* Did you mean 'displacement'?"),
        (
            {"field": "cauchy"},
            r"cauchy_stress has 3 x 3 components; expected a field with one component, such as displacement, "
            r'.* field=state\["cauchy"\]',
        ),
        ({"field": "principal_stretches"}, r"has 3 components.*state\[\"principal_stretches\"\]\[:, 0\], label"),
        (
            {"field": np.zeros(7)},
            r"field has shape \(7,\); expected a name, or one number for each of the 162 elements or 64 vertices",
        ),
        ({"scale": np.inf}, "scale = inf"),
        ({"backend": "paraview"}, "backend = 'paraview'; known: 'matplotlib', 'pyvista'"),
        ({"path": tmp_path / "body.vtu"}, "expected a path that ends in .png or .pdf or .svg"),
        ({"path": tmp_path / "no" / "body.png"}, "does not exist"),
    ):
        with pytest.raises(StvkError, match=message):
            plot(now, **{"backend": "matplotlib", **arguments})


def test_a_scene_without_pyvista_is_refused_with_the_command_to_install_it(monkeypatch):
    monkeypatch.setattr(plotting, "find_spec", lambda name: None)
    with pytest.raises(StvkError, match=r"PyVista is not installed: pip install 'skfem-stvk\[plot\]'"):
        plot(at(MESHES["triangles"]), backend="pyvista")


def test_the_surface_is_closed_and_seen_from_outside():
    mesh = embedded_mesh()
    (corners, elements), _ = visible_faces(mesh)
    cells = mesh.t[corners, elements]
    a, b, c = mesh.p.T[cells]
    enclosed = (np.cross(a, b) * c).sum() / 6
    assert enclosed == pytest.approx(Fields(mesh, StVK(young=1.0, poisson=0.3)).volume.sum(), rel=1e-12)
    edges = np.sort(np.concatenate([cells[[0, 1]], cells[[1, 2]], cells[[2, 0]]], axis=1), axis=0)
    assert (np.unique(edges, axis=1, return_counts=True)[1] % 2 == 0).all()


def test_the_outline_of_a_cube_is_its_twelve_edges():
    mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 4)] * 3)
    (corners, elements), _ = visible_faces(ElementMesh(mesh.p, mesh.t))
    lines = outline(mesh.p.T, mesh.t[corners, elements])
    assert lines.shape == (2, 36)
    on_sides = np.isin(np.round(mesh.p[:, lines], 12), (0, 1)).sum(axis=0)
    assert (on_sides >= 2).all()


def test_the_outline_of_a_sheet_is_its_boundary_and_that_of_segments_are_the_segments():
    mesh = skfem.MeshTri.init_tensor(*[np.linspace(0, 1, 4)] * 2)
    points = np.column_stack([mesh.p.T, np.zeros(mesh.p.shape[1])])
    lines = outline(points, mesh.t)
    assert {tuple(line) for line in np.sort(lines, axis=0).T.tolist()} == {
        tuple(f) for f in np.sort(mesh.facets[:, mesh.boundary_facets()], axis=0).T.tolist()
    }
    assert outline(points, mesh.t[:2]) is not None and np.array_equal(outline(points, mesh.t[:2]), mesh.t[:2])
