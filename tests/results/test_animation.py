"""Contents of animations. The appearance was checked by eye."""

import os
import stat

import matplotlib
import numpy as np
import pytest
from bodies import MESHES, state
from PIL import Image

from skfem_stvk import ElementMesh, StVK, StvkError
from skfem_stvk.results import Fields, Series, animate, plotting, write_vtu
from skfem_stvk.results.picture import _in_words
from skfem_stvk.solvers.state_files import read_state

COUNT = 5


def motion(name="triangles", count=COUNT, step=0.05, **term):
    """Return the states of a body that vibrates about its rest."""
    mesh = MESHES[name]
    fields, u = Fields(mesh, StVK(young=2e6, poisson=0.3, **term)), state(mesh, 0.1)
    return [(step * i, fields.at(np.sin(2 * np.pi * (i + 0.5) / count) * u)) for i in range(count)]


def saved(path, states, fields=("von_mises",)):
    series = Series(path, fields)
    for t, now in states:
        series.add(now, t)
    return path


def frames(path):
    """Return the pixels (n, height, width, 3) and the header of a file."""
    film = Image.open(path)
    pictures = []
    for number in range(film.n_frames):
        film.seek(number)
        pictures.append(np.asarray(film.convert("RGB"), dtype=int))
    return np.array(pictures), film.info


@pytest.mark.few
@pytest.mark.parametrize("name", MESHES)
def test_every_kind_of_body_moves_in_a_film(tmp_path, name):
    path = animate(motion(name), tmp_path / "body.gif", "volume_ratio", scale=2.0)
    pictures, info = frames(path)
    assert len(pictures) == COUNT and info["duration"] == 50 and info["loop"] == 0
    coloured = np.ptp(pictures, axis=3) > 50
    assert (coloured.mean(axis=(1, 2)) > 0.003).all() and [file.name for file in tmp_path.iterdir()] == ["body.gif"]
    assert ((pictures[0] != pictures[1]).any(axis=2)).mean() > 0.001


@pytest.mark.few
@pytest.mark.parametrize("name", MESHES)
def test_a_series_on_disk_gives_the_film_of_its_states(tmp_path, name):
    states = motion(name)
    series = saved(tmp_path / "body.pvd", states)
    one, _ = frames(animate(states, tmp_path / "states.gif"))
    other, _ = frames(animate(series, tmp_path / "files.gif"))
    assert np.abs(one - other).max() <= 40 and (one != other).mean() < 1e-3  # differences in the last digit of a coordinate


def test_colours_and_axes_are_those_of_all_frames():
    states = motion(count=8)
    view, shots = plotting._of_states(states, "displacement", 3.0, None).view_and_pictures()
    shots = list(shots)
    values = np.concatenate([picture.values.ravel() for _, picture in shots])
    assert view.limits == (pytest.approx(values.min()), pytest.approx(values.max()))
    points = np.concatenate([x for _, picture in shots for x in (picture.rest, picture.moved)])
    np.testing.assert_array_equal(view.box, [points.min(axis=0), points.max(axis=0)])
    largest = [picture.values.max() for _, picture in shots]
    assert {picture.label for _, picture in shots} == {"displacement [mm]"}, "not each in a unit of its own"
    norms = [1e3 * np.linalg.norm(now.u, axis=1).max() for _, now in states]
    np.testing.assert_allclose(largest, norms, rtol=1e-12)


def test_only_the_body_and_the_time_change_between_frames(tmp_path):
    pictures, _ = frames(animate(motion(), tmp_path / "body.gif"))
    changed = (pictures != pictures[0]).any(axis=(0, 3))
    columns = np.flatnonzero(changed.any(axis=0))
    bar = pictures.shape[2] * 7 // 8
    assert columns.max() < bar, "the colour bar does not move"
    assert (pictures[0][:, bar:] < 128).any(), "and it is there"


def test_a_body_is_drawn_in_the_dimension_of_its_space(tmp_path):
    for name, d in {"segments": 1, "cable in the plane": 2, "triangles": 2, "cable": 3, "membrane": 3, "tetrahedra": 3}.items():
        film = plotting._of_files(saved(tmp_path / "body.pvd", motion(name, 2)), "displacement", 1.0, None)
        _, shots = film.view_and_pictures()
        assert {picture.d for _, picture in shots} == {d}, name


@pytest.mark.parametrize(
    ("step", "words"), [(0.05, "t = 0.200"), (1.0, "t = 4.0"), (1e-4, "t = 0.00040"), (1 / 3, "t = 1.33"), (50.0, "t = 200")]
)
def test_the_time_has_enough_digits_to_distinguish_frames(step, words):
    times = _in_words([step * i for i in range(COUNT)])
    assert times[-1] == words and len(set(times)) == COUNT
    assert _in_words([0.5]) == ["t = 0.500"]


def test_velocities_colour_a_film_by_their_length(tmp_path):
    fields, u = motion()[0][1].fields, state(MESHES["triangles"], 0.1)
    states = [(0.1 * i, fields.at(0.1 * i * u, (1 + i) * u[::-1])) for i in range(3)]
    for film in (
        plotting._of_states(states, "velocity", 1.0, None),
        plotting._of_files(saved(tmp_path / "body.pvd", states), "velocity", 1.0, None),
    ):
        shots = [picture for _, picture in film.view_and_pictures()[1]]
        assert shots[0].label == "velocity [mm/s]"
        for i, picture in enumerate(shots):
            speed = 1e3 * (1 + i) * np.linalg.norm(u[::-1].reshape(-1, 2), axis=1)
            np.testing.assert_allclose(picture.values, speed[picture.cells], rtol=1e-12)


def test_fields_of_files_have_their_names_and_units(tmp_path):
    states = motion()
    series = saved(tmp_path / "body.pvd", states, ["von_mises", "volume_ratio"])
    for field, label in (
        ("von_mises", "von Mises stress [kPa]"),
        ("von_mises_stress", "von Mises stress [kPa]"),
        ("volume_ratio", "volume ratio"),
    ):
        _, shots = plotting._of_files(series, field, 1.0, None).view_and_pictures()
        _, picture = next(shots)
        assert picture.label == label
        expected = np.asarray(states[0][1].at_nodes(field))[picture.cells]
        np.testing.assert_allclose(picture.values, expected * (1e-3 if "kPa" in label else 1), rtol=1e-9)
    _, shots = plotting._of_files(series, "von_mises", 1.0, "stress [psi]").view_and_pictures()
    _, picture = next(shots)
    assert picture.label == "stress [psi]" and picture.values.max() > 1e3, "numbers stay as they are"


def test_missing_values_of_files_are_masked_in_the_film(tmp_path):
    right = np.flatnonzero(MESHES["triangles"].p[0, MESHES["triangles"].t].mean(axis=0) > 0.6)
    series = saved(tmp_path / "body.pvd", motion(region=right))
    _, shots = plotting._of_files(series, "von_mises", 1.0, None).view_and_pictures()
    _, picture = next(shots)
    assert 0 < np.ma.getmaskarray(picture.values).mean() < 1


def test_invalid_films_are_refused(tmp_path):
    series = saved(tmp_path / "body.pvd", motion())
    (tmp_path / "empty.pvd").write_text("<VTKFile><Collection/></VTKFile>")
    (tmp_path / "lost.pvd").write_text('<VTKFile><Collection><DataSet timestep="0" file="no.vtu"/></Collection></VTKFile>')
    (tmp_path / "none.pvd").write_text("hello")
    for arguments, message in (
        ({"path": tmp_path / "body.avi"}, r"expected a path that ends in .gif or .mp4"),
        ({"path": tmp_path / "no" / "body.gif"}, "does not exist"),
        ({"field": "volume_ratio"}, r"body_0000\.vtu has no field 'volume_ratio'; known: 'displacement', 'von_mises_stress'"),
        ({"series": tmp_path / "missing.pvd"}, r"missing\.pvd is not a series of results"),
        ({"series": tmp_path / "none.pvd"}, r"none\.pvd is not a series of results"),
        ({"series": tmp_path / "empty.pvd"}, "lists no states"),
        ({"series": tmp_path / "lost.pvd"}, r"no\.vtu cannot be read"),
        ({"series": []}, "has no states"),
        ({"series": motion(), "field": "cauchy"}, "has 3 x 3 components"),
        ({"scale": np.nan}, "scale = nan"),
        ({"fps": 0}, "fps = 0"),
    ):
        with pytest.raises(StvkError, match=message):
            animate(**({"series": series, "path": tmp_path / "body.gif"} | arguments))
    assert not list(tmp_path.glob("*.gif")) and not list(tmp_path.glob(".*"))


def test_frames_of_another_mesh_are_refused(tmp_path):
    """States and files of different meshes are refused.

    One other mesh has the same numbers of nodes and elements, and one has the same nodes.
    """
    mesh = MESHES["triangles"]
    moved = ElementMesh(mesh.p * [[1.0], [1.5]], mesh.t)
    others = [motion("tetrahedra")[0][1], Fields(moved, StVK(young=1.0, poisson=0.3)).at(0 * mesh.p.ravel())]
    for number, other in enumerate(others):
        states = [*motion(count=2), (0.1, other)]
        with pytest.raises(StvkError, match="state 2 belongs to another mesh than state 0"):
            animate(states, tmp_path / "body.gif")
        with pytest.raises(StvkError, match=r"_0002\.vtu belongs to another mesh than .*_0000\.vtu"):
            animate(saved(tmp_path / f"{number}.pvd", states), tmp_path / "body.gif")
    half = ElementMesh(mesh.p, mesh.t[:, ::2])
    with pytest.raises(StvkError, match="state 1 belongs to another mesh"):
        animate([motion()[0], (0.1, Fields(half, StVK(young=1.0, poisson=0.3)).at(0 * mesh.p.ravel()))], tmp_path / "body.gif")
    assert not list(tmp_path.glob("*.gif"))


def test_files_with_as_many_other_elements_are_drawn_with_their_elements(tmp_path):
    mesh, law = MESHES["triangles"], StVK(young=1.0, poisson=0.3)
    halves = [ElementMesh(mesh.p, mesh.t[:, begin : begin + mesh.nt // 2]) for begin in (0, mesh.nt // 2)]
    series = saved(tmp_path / "body.pvd", [(0.1 * k, Fields(half, law).at(0 * mesh.p.ravel())) for k, half in enumerate(halves)])
    _, shots = plotting._of_files(series, "displacement", 1.0, None).view_and_pictures()
    drawn = [{tuple(sorted(cell)) for cell in picture.cells.T.tolist()} for _, picture in shots]
    assert drawn == [{tuple(sorted(cell)) for cell in half.t.T.tolist()} for half in halves]


@pytest.mark.parametrize("time", ["inf", "-inf", "nan"])
def test_times_that_are_not_finite_are_refused(tmp_path, time):
    series = saved(tmp_path / "body.pvd", motion())
    series.write_text(series.read_text().replace('timestep="0.05"', f'timestep="{time}"'))
    for call in (lambda: animate(series, tmp_path / "body.gif"), lambda: read_state(series, MESHES["triangles"])):
        with pytest.raises(StvkError, match=rf"1 times are not finite, the first of them {time} of body_0001\.vtu"):
            call()


def test_a_frame_without_the_field_is_refused(tmp_path):
    series = saved(tmp_path / "body.pvd", motion())
    write_vtu(tmp_path / "body_0001.vtu", motion()[1][1], ["volume_ratio"])
    with pytest.raises(StvkError, match=r"body_0001\.vtu has no field 'von_mises'"):
        animate(series, tmp_path / "body.gif", "von_mises")


def test_without_ffmpeg_an_mp4_is_refused_with_a_remedy(tmp_path):
    with (
        matplotlib.rc_context({"animation.ffmpeg_path": str(tmp_path / "ffmpeg")}),
        pytest.raises(StvkError, match="apt install ffmpeg"),
    ):
        animate(motion(), tmp_path / "body.mp4")


RECORDER = """#!/bin/sh
for last; do :; done
cat > "$last"
echo "$@" > {log}
"""


def test_an_mp4_is_the_output_of_ffmpeg_for_all_frames(tmp_path):
    log, recorder = tmp_path / "log", tmp_path / "ffmpeg"
    recorder.write_text(RECORDER.format(log=log))
    recorder.chmod(recorder.stat().st_mode | stat.S_IXUSR)
    with matplotlib.rc_context({"animation.ffmpeg_path": str(recorder)}):
        path = animate(motion(), tmp_path / "body.mp4", fps=12)
    width, height = 840, 540
    assert path.stat().st_size == COUNT * width * height * 4
    words = log.read_text()
    assert f"{width}x{height}" in words and "-f mp4" in words and " 12" in words


@pytest.mark.parametrize("name", ["segments", "cable in the plane", "triangles", "tetrahedra"])
def test_each_frame_is_the_figure_drawn_as_a_whole(name):
    """Frames are drawn onto a background with the axes and the colour bar."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from skfem_stvk.results import matplotlib_plot as module

    figure = module.new_figure(module.SIZE, interactive=False)
    canvas, film = FigureCanvasAgg(figure), plotting._of_states(motion(name), "displacement", 1.0, None)
    for frame in module._images(canvas, module._shown(figure, film)):
        canvas.draw()
        whole = Image.frombuffer("RGBA", canvas.get_width_height(), bytes(canvas.buffer_rgba())).convert("RGB")
        whole = np.asarray(whole.quantize(palette=frame, dither=Image.Dither.NONE).convert("RGB"), dtype=int)
        different = (np.asarray(frame.convert("RGB"), dtype=int) != whole).any(axis=2)
        assert different.mean() < 1e-4  # where a line ends on an axis


def test_a_film_that_fails_leaves_an_existing_file_unchanged(tmp_path, monkeypatch):
    from skfem_stvk.results import matplotlib_plot

    path = animate(motion(), tmp_path / "body.gif")
    before = path.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(matplotlib_plot, "_images", full)
    with pytest.raises(OSError, match="No space"):
        animate(motion(), path)
    assert path.read_bytes() == before and [file.name for file in tmp_path.iterdir()] == ["body.gif"]


@pytest.mark.parametrize("kind", ["series", "file"])
def test_a_pipe_instead_of_a_series_or_one_of_its_files_is_refused(tmp_path, kind):
    os.mkfifo(tmp_path / "pipe.vtu")
    listed = '<VTKFile><Collection><DataSet timestep="0" file="pipe.vtu"/></Collection></VTKFile>'
    if kind == "series":
        os.mkfifo(tmp_path / "run.pvd")
    else:
        (tmp_path / "run.pvd").write_text(listed)
    with pytest.raises(StvkError, match="it is not a regular file"):
        animate(tmp_path / "run.pvd", tmp_path / "film.gif")
