"""Report of a verification: its head, its results, and its output as text and as files."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..about import PACKAGES, circumstances
from ..arguments import path
from ..edges.materials import FramedMaterial, Isotropic
from ..errors import StvkError
from ..mesh import ElementMesh
from ..results.complete_files import cannot_write, replacing
from ..terminal import CountedProgress, as_text, html_table
from ..terms import StVK
from .rendering import checks_as_rows, rendered
from .results import Findings, Task
from .shape import Shape


class Report(Findings):
    """Results of `verify` and of the other checks; `print(report)` shows them.

    Attributes
    ----------
    header
        Versions, machine, mesh, material, command line, seed.
    results
        Results of all checks of all quantities in all states.
    precision
        Rows of error against strain (`checks.precision.precision_table`).
    speed
        Rows of time and memory (`checks.precision.speed_table`).
    errors
        Errors against 50 digits, which are plotted with the speed.
    named
        Explanations of a candidate that does not agree, or None if no explanation was searched for.
    interrupted
        Whether the verification was stopped before its end.
    seconds
        Duration of the verification [s].

    Examples
    --------
    >>> from skfem_stvk import verify_integrator
    >>> def euler(system, u, v, dt):                                      # explicit Euler, which claims to conserve energy
    ...     return u + dt * v, v - dt * system.mass().solve(system.internal_force(u))
    >>> report = verify_integrator(euler, order=1, conserves=("energy",), quiet=True)
    >>> report.passed, sorted({result.check for result in report.results if result.outcome.value == "failed"})
    (False, ['drift', 'stability limit'])
    """

    def __str__(self) -> str:
        return as_text(rendered(self))

    def _repr_html_(self) -> str:
        title = f"{'PASSED' if self.passed else 'NOT PASSED'} in {self.seconds:.1f} s{', interrupted' if self.interrupted else ''}"
        named = [("fault", *self.named.lines())] if self.named is not None else []
        return html_table(title, [*named, *checks_as_rows(self)])

    def save(self, folder: str | Path) -> Path:
        """Write `report.json` and the self-contained `report.html` into a folder, and return its path.

        Each file is written under another name first and then renamed, so that no file is ever half written.

        Parameters
        ----------
        folder
            Path of the folder, which is created if it is missing.

        Raises
        ------
        StvkError
            if the folder cannot be written to, or a picture cannot be drawn.
        """
        folder = folder_for(folder)
        write(folder / "report.json", json.dumps(self.to_dict(), indent=1))
        write(folder / "report.html", self._page())
        return folder

    def _page(self) -> str:
        try:
            from .plots import page  # matplotlib is imported only when a page is made
        except (ImportError, ValueError) as error:
            raise StvkError(
                f"report.html needs matplotlib, which cannot be imported: {error}. MPLBACKEND = "
                f"{os.environ.get('MPLBACKEND', '')!r}; 'agg' always works. report.json is written."
            ) from error
        return page(self)


def judge(command: str, head: Mapping[str, Any], tasks: Sequence[Task], quiet: bool, explain: Callable[[Report], None]) -> Report:
    """Return the report on a candidate without a mesh: run the tasks, then call `explain` to name the fault.

    `head` holds the `lines` that describe the candidate.
    """
    started, report = time.perf_counter(), Report(circumstances(PACKAGES) | dict(head))
    carry_out(report, command, tasks, quiet, {"what it is": partial(explain, report)})
    report.seconds = time.perf_counter() - started
    return report


def carry_out(
    report: Report, command: str, tasks: Sequence[Task], quiet: bool, then: Mapping[str, Callable[[], None]] | None = None
) -> None:
    """Run the tasks and then the named steps of `then`, with a progress bar, and add the results to the report.

    After Ctrl-C the results so far are kept. Tasks that did not run are reported as interrupted, and the remaining steps are
    skipped.
    """
    steps = then or {}
    with CountedProgress(command, len(tasks) + len(steps), quiet) as progress:
        try:
            for task in tasks:
                progress.step(f"{task.check}: {task.implementation.name}, {task.quantity}, {task.state}")
                report.results.append(task.run())
            for name, step in steps.items():
                progress.step(name)
                step()
        except KeyboardInterrupt:
            report.interrupted = True
            report.results += [task.missed("interrupted") for task in tasks[len(report.results) :]]


def folder_for(name: str | Path) -> Path:
    """Return the folder with this path, and create it if it is missing. Raise StvkError if it cannot be created."""
    folder = path("folder", name, "the path of a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
    return folder


def write(path: Path, text: str) -> None:
    """Write a file under another name first and then rename it."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")


# the head


def mesh_facts(shape: Shape) -> dict[str, Any]:
    """Return the hash, counts and shape of a mesh, and its integration rule. The hash covers coordinates and elements."""
    mesh, aspect = shape.mesh, shape.aspect
    a, b = np.array(mesh.element.edges).T
    lengths = np.linalg.norm(mesh.p[:, mesh.t[a]] - mesh.p[:, mesh.t[b]], axis=0)
    facts: dict[str, Any] = {
        "sha256": hashlib.sha256(mesh.p.tobytes() + mesh.t.tobytes()).hexdigest()[:16],
        "elements": f"{mesh.nt} {mesh.kind}",
        "curved elements": int(shape.curved.sum()),
        "rule": shape.discretisation.described(),
        "nodes": mesh.nv,
        "dofs": mesh.p.size,
        "size": [float(extent) for extent in np.ptp(mesh.p, axis=1)],
        "edges": {"shortest": float(lengths.min()), "median": float(np.median(lengths)), "longest": float(lengths.max())},
        "aspect ratio": f"{np.median(aspect):.3g} median, {aspect.max():.3g} in element {aspect.argmax()} "
        "(longest edge/smallest height)",
        "measure": float(shape.volume.sum()),
        "subdomains": {name: len(ids) for name, ids in mesh.subdomains.items()},
        "boundaries": {name: facets.shape[1] for name, facets in mesh.boundaries.items()},
    }
    if mesh.k == mesh.d:
        facts["negative elements"] = int((shape.orientation < 0).sum())
    return facts


def material_facts(mesh: ElementMesh, term: StVK) -> str:
    """Return the description of a term in one line."""
    material = term.material
    if isinstance(material, Isotropic):
        words = f"isotropic, E = {_range(material.young)}, nu = {'-' if material.poisson is None else _range(material.poisson)}"
    elif isinstance(material, FramedMaterial):
        stiffness = np.einsum("...ii->...i", material.stiffness())
        frames = {0: "", 2: ", a frame", 3: ", a frame per element"}[np.ndim(material.frame) if material.frame is not None else 0]
        words = f"{type(material).__name__}, diagonal of the elasticity matrix {_range(stiffness)}{frames}"
    else:
        words = type(material).__name__
    extras, sections = [f"plane {term.plane}"] if term.plane else [], {"thickness": term.thickness, "area": term.area}
    extras += [f"{name} {_range(value)}" for name, value in sections.items() if value is not None]
    return _region(mesh, term) + ", ".join([words, *extras])


def _region(mesh: ElementMesh, term: StVK) -> str:
    if term.region is None:
        return ""
    return f"{term.region!r}: " if isinstance(term.region, str) else f"{len(mesh.elements(term.region))} elements: "


def _range(values: Any) -> str:
    array = np.asarray(values, dtype=float)
    return f"{array.min():.6g}" if array.min() == array.max() else f"{array.min():.6g} ... {array.max():.6g}"


def header(shape: Shape, terms: Sequence[StVK], source: str, seed: int) -> dict[str, Any]:
    """Return the head of a report on this body. `source` names the type or origin of the mesh."""
    facts = {
        "mesh": {"source": source} | mesh_facts(shape),
        "material": [material_facts(shape.mesh, term) for term in terms],
        "seed": seed,
    }
    return circumstances(PACKAGES) | facts
