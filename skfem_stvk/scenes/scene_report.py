"""Report of a scene: the plots and the picture that it names, and a page that shows them with the results."""

from __future__ import annotations

import base64
import re
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..about import machine, versions
from ..arguments import Array
from ..results import animate, write_vtu
from ..results.complete_files import replacing
from ..results.contact_forces import shapes_at
from ..results.picture import Picture, View, picture_of
from ..results.series import read_list
from ..results.table import NODAL, labels_of_files
from ..results.vtu import DEFAULT, read_vtu
from ..solvers.dynamics import Modes, Run
from ..solvers.runs.ledger import AXES, draw, energy_panels, thinned
from ..solvers.statics import StaticResult
from ..terms.loads.rigid_shapes import RigidShape
from ..units import UNITS
from .build import contacts_of
from .scene_outcome import Curve, SceneOutcome, as_printed

REPORT = "report.html"
#: Displacements are enlarged to about this fraction of the body's size if they are below half of it.
SHOWN = 0.08
#: Number of elastic modes with a picture.
MOST_MODES = 4
DOTS_PER_INCH = 130
#: Dimensions of results by the beginning of their names, other than probes, reactions and contacts.
RESULTS = {"energy": "energy", "frequency": "frequency", "displacement": "length", "stress": "stress", "time": "time"}
GREY, VERMILION = "#c8c8c8", "#D55E00"
#: Labels of a curve.
BACKED, SMALL = {"fc": "white", "ec": "none", "alpha": 0.8, "pad": 0.5}, {"fontsize": 8, "color": VERMILION}


class Drawing(NamedTuple):
    """File with a picture, and its title."""

    title: str
    path: Path

    @property
    def file(self) -> str:
        """Name of the file."""
        return self.path.name

    @property
    def kind(self) -> str:
        """Format of the file."""
        return self.path.suffix[1:]

    @property
    def encoded(self) -> str:
        """Bytes of the file, encoded for a page."""
        return base64.b64encode(self.path.read_bytes()).decode()


def write_report(folder: Path, outcome: SceneOutcome, draw: bool = True) -> Path:
    """Write the last state as a scene's `[output]` requests, and `report.html`, a page that needs no other file.

    Plots are `plot-NAME.png`, the deformed body is `picture.png` (for modes `picture-0.png` and so on). If a picture cannot be
    drawn, the page says so, and the others are still drawn. Without `draw`, only the page is written: the body is on several ranks,
    and too large for one.

    Raises
    ------
    StvkError
        if the last state or the page cannot be written: the disk is full, for example.
    """
    problems: list[str] = []
    drawings = [*_save_drawings(folder, outcome, problems), *_save_animation(folder, outcome, problems)] if draw else []
    failure = None
    if not draw:
        problems.append(
            "Pictures and a last state are not made of a partition file, or of so many elements. A series has the states."
        )
    try:
        if draw:
            _save_last_state(folder, outcome)
    except Exception as error:
        problems.append(f"{outcome.built.sections.output.file} is not written: {error}")
        failure = error
    path = folder / REPORT
    with replacing(path) as part:
        part.write_text(_page(folder, outcome, drawings, problems), encoding="utf-8", errors="backslashreplace")
    if failure is not None:
        raise failure
    return path


def _save_last_state(folder: Path, outcome: SceneOutcome) -> None:
    output, result = outcome.built.sections.output, outcome.result
    if output.file is None:
        return
    fields = DEFAULT if output.fields is None else output.fields
    if isinstance(result, Modes):
        if output.file.endswith(".pvd"):
            result.save(folder / output.file)
        else:
            write_vtu(folder / output.file, result.state(_elastic(result)[0]), fields)
    elif output.file.endswith(".vtu"):
        result.save(folder / output.file, fields)


def _save_drawings(folder: Path, outcome: SceneOutcome, problems: list[str]) -> Iterator[Drawing]:
    """Draw and write the requested pictures; failures are added to `problems`."""
    for title, name, drawing in _wanted(outcome):
        try:
            figure = drawing()
            with replacing(folder / f"{name}.png") as part:
                figure.savefig(part, format="png", dpi=DOTS_PER_INCH, bbox_inches="tight")
            yield Drawing(title, folder / f"{name}.png")
        except Exception as error:  # matplotlib fails in many ways, and results matter more than their pictures
            problems.append(f"{title} is not drawn: {error}")


def _wanted(outcome: SceneOutcome) -> Iterator[tuple[str, str, Callable[[], Any]]]:
    """Yield the title of each plot, its file without suffix, and the function that draws it."""
    output, result = outcome.built.sections.output, outcome.result
    if output.picture and isinstance(result, Modes):
        for number in _elastic(result)[:MOST_MODES]:
            yield f"mode {number}", f"picture-{number}", partial(_mode, outcome, number)
    elif output.picture:
        yield "The last state", "picture", partial(_last_state, outcome)
    for name, file in plot_files(output.plots).items():
        if name in outcome.curves:
            yield name, file, partial(_curve, outcome, name)
        elif name == "ledger":
            yield "Energies", file, partial(_ledger, outcome)
        else:
            yield "Load and displacement", file, partial(_path, outcome)


def plot_files(names: Sequence[str]) -> dict[str, str]:
    """Return the file name of each plot without its suffix: letters, digits, `_`, `.` and `-` only, and no name twice.

    >>> plot_files(["tip", "a b", "a/b"])
    {'tip': 'plot-tip', 'a b': 'plot-a_b', 'a/b': 'plot-a_b-2'}
    """
    files: dict[str, str] = {}
    taken: set[str] = set()
    for name in dict.fromkeys(names):
        plain = f"plot-{re.sub('[^A-Za-z0-9_.-]+', '_', name)}"
        different = (plain if count == 1 else f"{plain}-{count}" for count in range(1, len(taken) + 2))
        files[name] = next(one for one in different if one.lower() not in taken)
        taken.add(files[name].lower())
    return files


def _save_animation(folder: Path, outcome: SceneOutcome, problems: list[str]) -> Iterator[Drawing]:
    output = outcome.built.sections.output
    if output.animation is None or output.file is None:
        return
    held = DEFAULT if output.fields is None else output.fields
    field = output.picture if output.picture in (*held, *NODAL) else "displacement"
    series, target = folder / output.file, folder / output.animation
    try:
        scale = 1.0 if isinstance(outcome.result, Modes) else _scale(outcome.built.mesh.p, _largest_saved(series))
        labels = labels_of_files(field, outcome.built.system.units)
        animate(series, target, field, scale=scale, shapes=partial(_shapes, outcome), **labels)
        if target.suffix == ".gif":
            yield Drawing(f"The states in {output.file}{_times(scale)}", target)
    except Exception as error:
        problems.append(f"{output.animation} is not made: {error}")


def _shapes(outcome: SceneOutcome, t: float) -> list[RigidShape]:
    """Return the rigid shapes at a time of the series: of arc length the number of the state, of modes of any."""
    result = outcome.result
    if isinstance(result, Run):
        return shapes_at(result.system, result.motion.moment(t))
    if isinstance(result, Modes):
        return []
    return shapes_at(result.system, result.history.t[int(t) - 1] if outcome.built.sections.analysis.type == "arc-length" else t)


def _largest_saved(series: Path) -> float:
    """Return the largest displacement of a node in the states of a .pvd file."""
    states = (read_vtu(series.with_name(name)).point_data["displacement"] for _, name in read_list(series))
    return max(_largest(u) for u in states)


# pictures


def _last_state(outcome: SceneOutcome) -> Any:
    """Draw the deformed body, coloured by the field that the scene names."""
    result, field = outcome.result, outcome.built.sections.output.picture
    mesh = outcome.built.mesh
    scale = _scale(mesh.p, _largest(result.u.reshape(-1, mesh.d)))
    when = f"time {result.t:.6g} {_symbol(outcome, 'time')}" if isinstance(result, Run) else f"load factor {result.t:.6g}"
    picture = picture_of(result.state, field, scale, None)
    if np.ma.getmaskarray(picture.values).all():  # no term has the field, for example stresses
        picture = picture_of(result.state, "displacement", scale, None)
    return _body(outcome, picture, f"{when}{_times(scale)}")


def _mode(outcome: SceneOutcome, number: int) -> Any:
    """Draw a mode."""
    modes = outcome.result
    frequency = f"{modes.frequencies[number]:.6g} {_symbol(outcome, 'frequency')}"
    picture = picture_of(modes.state(number), "displacement", 1.0, "displacement, of any size")
    return _body(outcome, picture, f"mode {number}: {'unstable' if modes.unstable[number] else frequency}")


def _body(outcome: SceneOutcome, picture: Picture, title: str) -> Any:
    from ..results.matplotlib_plot import SIZE, PictureAxes, new_figure  # matplotlib is imported only when something is drawn

    figure = new_figure(SIZE, interactive=False)
    PictureAxes(figure, picture, View.of([picture])).show(picture)
    for text in list(figure.texts):
        text.remove()  # the title states the factor of displacements
    figure.suptitle(title, fontsize=11)
    return figure


def _elastic(modes: Modes) -> list[int]:
    """Return the numbers of the modes that are not rigid; all modes if all are rigid."""
    found = [int(number) for number in np.flatnonzero(~modes.rigid)]
    return found or list(range(len(modes)))


def _largest(u: Array) -> float:
    """Return the length of the largest of displacements (n, d)."""
    return float(np.linalg.norm(u, axis=1).max())


def _scale(p: Array, largest: float) -> float:
    """Return a factor that makes the `largest` displacement visible: 1, or a round number such as 20 or 500."""
    size = np.linalg.norm(np.ptp(p, axis=1))
    if not 0 < largest < SHOWN / 2 * size:
        return 1.0
    factor = SHOWN * size / largest
    power = 10.0 ** np.floor(np.log10(factor))
    return float(power * next(digit for digit in (5, 2, 1) if digit * power <= factor * (1 + 1e-12)))


def _times(scale: float) -> str:
    return "" if scale == 1 else f", displacements × {scale:g}"


# plots


def _axes(xlabel: str, height: float = 1.0) -> tuple[Any, Any]:
    """Make a figure with axes."""
    from ..results.matplotlib_plot import new_figure

    figure = new_figure((7.0, 1.2 + 2.4 * height), interactive=False)
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    axes.axhline(0, color=GREY, lw=0.6, zorder=0)
    axes.set_xlabel(xlabel)
    return figure, axes


def _along(outcome: SceneOutcome) -> str:
    """Return the abscissa of probes and reactions."""
    return f"time [{_symbol(outcome, 'time')}]" if isinstance(outcome.result, Run) else "load factor"


def _curve(outcome: SceneOutcome, name: str) -> Any:
    """Draw the components of a mean displacement or of a force."""
    curve: Curve = outcome.curves[name]
    figure, axes = _axes(_along(outcome))
    t, components = curve.t, curve.values
    from_rest = outcome.built.u0 is None and outcome.built.sections.initial.t0 == 0
    if isinstance(outcome.result, StaticResult) and curve.dimension == "length" and from_rest:
        t, components = np.append(0.0, t), np.concatenate([np.zeros((1, components.shape[1])), components])
    for (axis, colour), values in zip(AXES.items(), components.T, strict=False):
        axes.plot(*thinned(t, values), marker="." if len(t) <= 40 else "", color=colour, lw=1.2, label=axis)
    words = "displacement of" if curve.dimension == "length" else "force of supports at"
    axes.set_ylabel(f"{words} {name} [{_symbol(outcome, curve.dimension)}]")
    axes.legend(fontsize=9, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _ledger(outcome: SceneOutcome) -> Any:
    """Draw the energies of a motion that are not zero throughout, and the error of their sum."""
    ledger = outcome.result.ledger
    return draw(ledger, energy_panels(ledger, _symbol(outcome, "energy")), _along(outcome))


def _path(outcome: SceneOutcome) -> Any:
    """Draw the load factor against the largest displacement of a node, with the critical points."""
    result, initial = outcome.result, outcome.built.u0
    d, begin = outcome.built.mesh.d, np.zeros(result.system.ndofs) if initial is None else initial

    def largest(u: Array) -> float:
        return _largest(u.reshape(-1, d))

    figure, axes = _axes(f"largest displacement [{_symbol(outcome, 'length')}]", 1.5)
    t = [outcome.built.sections.initial.t0, *result.history.t]
    axes.plot([largest(begin), *map(largest, result.history.u)], t, ".-", color="#0072B2", lw=1.2)
    for point in result.critical_points:
        axes.plot(largest(point.u), point.t, "o", color=VERMILION, ms=6, mfc="none")
        axes.annotate(point.kind, (largest(point.u), point.t), (5, 5), textcoords="offset points", bbox=BACKED, **SMALL)
    axes.set_ylabel("load factor")
    return figure


# units


def _symbol(outcome: SceneOutcome, dimension: str) -> str:
    return UNITS[outcome.built.sections.units].symbol(dimension)


def _unit_of_result(outcome: SceneOutcome, name: str) -> str:
    first = name.partition(".")[0]
    forces = dict.fromkeys(contacts_of(outcome.built.sections).values(), "force")
    dimension = ({one: curve.dimension for one, curve in outcome.curves.items()} | forces | RESULTS).get(first)
    return "" if dimension is None else _symbol(outcome, dimension)


# the page


def _page(folder: Path, outcome: SceneOutcome, drawings: list[Drawing], problems: list[str]) -> str:
    from jinja2 import Environment  # only when a page is made

    template = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(
        files(__package__).joinpath("report.html").read_text(encoding="utf-8")
    )
    resolved = folder / "resolved.toml"
    failed = sum(not one.passed for one in outcome.judged)
    return template.render(
        title=outcome.built.sections.title or folder.resolve().name,
        outcome=outcome,
        as_printed=as_printed,
        verdict=f"{failed} of {len(outcome.judged)} not as expected" if outcome.success and failed else outcome.status,
        drawings=drawings,
        problems=problems,
        values=[(name, value, _unit_of_result(outcome, name)) for name, value in outcome.values.items()],
        built=list(_built_facts(outcome)),
        commands=list(_commands(resolved.exists())),
        scene=resolved.read_text(encoding="utf-8") if resolved.exists() else "",
        circumstances=versions() | machine(),
    )


def _built_facts(outcome: SceneOutcome) -> Iterator[tuple[str, str]]:
    sections, system, result = outcome.built.sections, outcome.built.system, outcome.result
    mesh, held = system.mesh, len(system.supports.held)
    yield "mesh", f"{mesh.element_count} {mesh.kind}, {system.space.count // mesh.d} nodes"
    if outcome.ranks:
        yield "ranks", outcome.ranks
    if not system.space.comm.divided:
        yield "unknowns", f"{system.ndofs - held} free, {held} constrained"
    for number, term in enumerate(sections.terms):
        material = getattr(term, "material", None)
        yield f"terms[{number}]", term.type + (f" of {material}" if material else "")
    for name, components in sections.fixed.items():
        yield f"fixed.{name}", components
    yield "analysis", _analysis(result, sections.analysis.type)
    yield "units", sections.units


def _analysis(result: Any, kind: str) -> str:
    if isinstance(result, StaticResult):
        return f"{kind}, {len(result.history)} states, {result.history.iterations} iterations, solver {result.solver}"
    return f"{kind}, {result.ledger.steps - 1} steps with {result.integrator}" if isinstance(result, Run) else kind


def _commands(resolved: bool) -> Iterator[str]:
    """Yield the command line that wrote the report, if it is of this package, and a command that repeats it in the folder of
    results.
    """
    program = Path(sys.argv[0]).name
    if program.startswith("skfem-stvk"):
        yield shlex.join([program, *sys.argv[1:]])
    if resolved:
        yield "skfem-stvk solve resolved.toml --out again"
