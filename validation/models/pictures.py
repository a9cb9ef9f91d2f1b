"""Pictures of all models: deformed bars, paths, and speed against error."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import skfem
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from skfem_stvk.about import write_machine
from skfem_stvk.arguments import Array
from skfem_stvk.mesh import ElementMesh

from . import bars, motions
from .costs import Cost
from .models import COLOURS, MODELS, TRUE, Model

#: Line styles of the models of one family.
DASHES: tuple[Any, ...] = ("-", "--", ":", "-.", (0, (5, 1, 1, 1, 1, 1)))
#: Markers of the models of one family.
MARKS = "os^Dv"
#: Models with their names to the left of their points, and below them.
LEFT, BELOW = {"linear", "neo-Hookean", "corotated by vertex"}, {"linear", "StVK + volume"}
#: Directions to the right and upwards on the page, seen from the side and slightly from above.
ACROSS, UP = np.array([0.96, -0.28, 0.0]), np.array([-0.08, -0.28, 0.957])


def side_by_side(mesh: ElementMesh, found: Mapping[Model, Array], folder: Path, name: str) -> Path:
    """Draw each model's deformed bar in front of StVK's; the panel after the last shows the scale."""
    surface = skfem.MeshTet(mesh.p, mesh.t)
    facets = surface.facets[:, surface.boundary_facets()]
    columns = 3
    rows = len(found) // columns + 1
    figure = Figure(figsize=(2 * columns, 1.5 * rows), layout="constrained")
    panels = np.array(figure.subplots(rows, columns, sharex=True, sharey=True)).ravel()
    behind = _projected(mesh.p.T + found[TRUE], facets)
    every = np.concatenate([_projected(mesh.p.T + u, facets).reshape(-1, 2) for u in found.values() if np.isfinite(u).all()])
    for axes, (model, u) in zip(panels, found.items(), strict=False):
        axes.add_collection(PolyCollection(list(behind), facecolors="#dddddd", edgecolors="none"))
        if np.isfinite(u).all():
            x = mesh.p.T + u
            shown = _projected(x, facets)
            order = np.argsort(x[facets.T].mean(axis=1) @ np.cross(ACROSS, UP))
            axes.add_collection(
                PolyCollection(list(shown[order]), facecolors="white", edgecolors=COLOURS[model.family], linewidths=0.6)
            )
        axes.set_title(model.name.replace(" +", "\n+"), fontsize=9)
        axes.set(xlim=(every[:, 0].min() - 0.2, every[:, 0].max() + 0.2), ylim=(every[:, 1].min() - 0.2, every[:, 1].max() + 0.2))
        axes.set_aspect("equal")
    left, middle = every[:, 0].min(), every[:, 1].mean()
    panels[len(found)].plot([left, left + ACROSS[0]], [middle, middle + UP[0]], color="black", lw=1.5)
    panels[len(found)].text(left, middle - 0.2, "1 m along the bar;\ngrey: StVK", fontsize=9, va="top")
    for axes in panels:
        axes.axis("off")
    path = folder / f"models-{name}.png"
    figure.savefig(path, dpi=110)
    return path


def _projected(x: Array, facets: Any) -> Array:
    """Return the corners of the facets on the page, (n, 3, 2)."""
    return np.stack([x @ ACROSS, x @ UP], axis=1)[facets.T]


def paths(found: Mapping[str, motions.Path], folder: Path, name: str) -> Path:
    """Plot the height of the end against time for each model."""
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.subplots()
    seen: dict[str, int] = {}
    for model in MODELS:
        bold, number = model is TRUE, seen.get(model.family, 0)
        seen[model.family] = number + 1
        axes.plot(
            found[model.name].times,
            found[model.name].tip[:, 2],
            color=COLOURS[model.family],
            lw=2.5 if bold else 1.0,
            ls=DASHES[number],
            zorder=3 if bold else 2,
            label=model.name,
        )
    largest = np.abs(found[TRUE.name].tip[:, 2]).max()
    axes.set(xlabel="time [s]", ylabel="height of the end [m]", ylim=(-2.5 * largest, 2.5 * largest), title=f"a bar that is {name}")
    axes.grid(alpha=0.25)
    figure.legend(loc="outside right upper", fontsize=7)
    path = folder / f"models-{name}.png"
    figure.savefig(path, dpi=80)
    return path


def speed_against_error(found: Mapping[str, Cost], folder: Path, quick: bool) -> Path:
    """Plot the error of the bent and of the twisted bar, against StVK on the same mesh, over the time of W and F."""
    n = bars.QUICK_ACROSS if quick else bars.ACROSS
    figure = Figure(figsize=(6, 6.6), layout="constrained")
    for axes, trial in zip(figure.subplots(2, 1, sharex=True), (bars.BENT, bars.TWISTED), strict=True):
        truth = bars.of_model(trial, TRUE, n).measured
        seen: dict[str, int] = {}
        for model in MODELS:
            one = bars.of_model(trial, model, n).measured
            error = bars.error(one, truth) if one.shape == truth.shape else np.nan
            if not error < 10:
                continue
            number = seen.get(model.family, 0)
            seen[model.family] = number + 1
            at, mark, colour = (found[model.name].force, max(error, 1e-4)), MARKS[number], COLOURS[model.family]
            axes.loglog(*at, mark, color=colour, ms=6, ls="", label=model.name)
            if not model.family.startswith("springs"):
                side, right = ("right", -5) if model.name in LEFT else ("left", 5)
                words = model.name.replace(" by", "\nby") if model.name in LEFT else model.name
                shift = right, (-11 if model.name in BELOW else 3)
                axes.annotate(words, at, shift, textcoords="offset points", ha=side, fontsize=9)
        axes.set_title(f"a bar that is {trial.name}", fontsize=9)
        axes.tick_params(labelsize=9)
        axes.grid(True, alpha=0.25)
        axes.margins(0.1)
        axes.set_ylabel("error against StVK,\nat least 1e-4")
        handles, labels = axes.get_legend_handles_labels()
    figure.axes[-1].set_xlabel("W and F [ns per tetrahedron]")
    springs = [(handle, label) for handle, label in zip(handles, labels, strict=True) if "springs" in label]
    figure.legend(*zip(*springs, strict=True), loc="outside upper center", ncols=2, fontsize=9, frameon=False)
    write_machine(figure)
    path = folder / "models-speed-error.png"
    figure.savefig(path, dpi=140)
    return path
