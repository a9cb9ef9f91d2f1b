"""Displacements and velocities from the files of an earlier run, as the start of another run."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, number
from ..arguments import path as checked_path
from ..errors import StvkError, name_ids, warn
from ..mesh import ElementMesh, MeshLike
from ..mesh.groups import from_cells
from ..mesh.locations import SAME_POINT
from ..results.complete_files import ForeignFile
from ..results.law_on_elements import in_space
from ..results.series import listed_states
from ..results.vtu import pieces_of, read_vtu
from ..system.signature import SAME, mesh_numbers
from .dynamics.motion_checkpoint import MOTION_FILE, MotionCheckpoint
from .runs.archive import check_lengths, pattern, refusing_damage, validated
from .statics.path_checkpoint import PathCheckpoint

if TYPE_CHECKING:
    import meshio

#: Tolerance of a requested time, as a fraction of the largest time of the series.
SAME_TIME = 1e-9
#: Remedy for an unreadable checkpoint.
OTHER = "Use another file of the run, such as its .pvd."


def read_state(path: str | os.PathLike[str], mesh: MeshLike, time: float | None = None) -> tuple[Array, Array | None]:
    """Return displacements [m] and velocities [m/s] of a state from a file.

    The file is written by `write_vtu`, `save=...`, `result.save` or `checkpoint=...`.

    Parameters
    ----------
    path
        Path of a .vtu or .pvtu file; or of a .pvd file or the folder of a checkpoint, from which one state is taken.
    mesh
        Mesh of the result, equal to that of the file. For a part of it, the result has the values of that part; all parts call this
        function together.
    time
        Time or load factor of the state in a .pvd file or a checkpoint; by default the last one.

    Returns
    -------
    u, v
        Arrays (ndofs,) each, as `solve_static` and `simulate` take them for `u0` and `v0`; `v` is None without velocities.

    Raises
    ------
    StvkError
        if the file is missing or not written by this package; for another mesh; for a time that is not in it.

    Warns
    -----
    StvkWarning
        for elements that were removed from the body.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import skfem
    >>> from skfem_stvk import StVK
    >>> from skfem_stvk.results import Fields, write_vtu
    >>> mesh = ElementMesh.of(skfem.MeshTri().refined(1))
    >>> u = 0.01 * mesh.p.ravel("F")
    >>> with TemporaryDirectory() as folder:
    ...     file = write_vtu(f"{folder}/moved.vtu", Fields(mesh, StVK(young=1.0, poisson=0.3)).at(u))
    ...     again, v = read_state(file, mesh)
    >>> bool((again == u).all()), v
    (True, None)
    """
    mesh = ElementMesh.of(mesh)
    path = checked_path("path", path, "the path of a .vtu or .pvd file, or of the folder of a checkpoint")
    time = None if time is None else number("time", time, "a finite time or load factor")
    if path.is_dir() or (path.is_file() and path.suffix.lower() == ".npz"):
        return _of_checkpoint(path, mesh, time)
    if not path.is_file():
        raise StvkError(
            f"path = {path}: there is no such file; expected the .vtu or .pvd file of a run. Check the folder of the path."
        )
    file = _listed(path, time) if path.suffix.lower() == ".pvd" else path
    if file is path and time is not None:
        raise StvkError(f"time = {time:g}, but {path} has one state and no time. Pass the .pvd file, or leave out time.")
    if file.suffix.lower() not in (".vtu", ".pvtu"):
        raise StvkError(f"{file} is not a file of states; expected a .vtu or .pvd file, as write_vtu or save=... writes it.")
    read = read_vtu(file)
    _refuse_other(file, read, mesh)
    u = _vectors(file, read, mesh, "displacement")
    if u is None:
        raise StvkError(
            f"{file} has no displacements; expected a result of this package. Its fields are {sorted(read.point_data)}."
        )
    return u, _vectors(file, read, mesh, "velocity")


def parts_of_state(path: Path, time: float | None = None) -> list[Path]:
    """Return the regular files from which a state is read: a file, and for an undamaged .pvd or .pvtu the files that it lists."""
    parts = [path]
    with suppress(StvkError, OSError, ValueError, KeyError, ET.ParseError):
        if path.suffix.lower() == ".pvd":
            parts.append(_listed(path, time))
        if parts[-1].suffix.lower() == ".pvtu":
            parts += pieces_of(parts[-1])
    return [part for part in parts if part.is_file()]


def _listed(path: Path, time: float | None) -> Path:
    """Return the file of the state at a time, or of the last one, of a series."""
    states = sorted(listed_states(path))
    return states[_chosen(path, [t for t, _ in states], time)][1]


def _chosen(path: Path, ascending: list[float], time: float | None) -> int:
    """Return the index of the state at a time, or of the last one."""
    times = np.array(ascending)
    if time is None:
        return len(times) - 1
    nearest = int(np.argmin(np.abs(times - time)))
    if abs(times[nearest] - time) > SAME_TIME * max(1e-300, float(np.abs(times).max())):
        raise StvkError(
            f"{path} has no state at time = {time:.12g}: of its {len(times)} states from {times[0]:.12g} to {times[-1]:.12g} the "
            f"nearest is at {times[nearest]:.12g}. Use that time, or leave out time for the last state."
        )
    return nearest


def _of_checkpoint(path: Path, mesh: ElementMesh, time: float | None) -> tuple[Array, Array | None]:
    """Return displacements, and velocities for a motion."""
    files = [path] if path.is_file() else [*path.glob(MOTION_FILE)] or sorted(path.glob(pattern(PathCheckpoint.name)))
    if not files:
        raise StvkError(
            f"The folder {path} is not a checkpoint: it has neither {MOTION_FILE} nor {pattern(PathCheckpoint.name)}. {OTHER}"
        )
    store: Any = PathCheckpoint if files[0].match(pattern(PathCheckpoint.name)) else MotionCheckpoint
    headers, times = [store.read_header(file, OTHER) for file in files], []
    for file, header in zip(files, headers, strict=True):
        with refusing_damage(file, OTHER):
            times.append(validated(store.schema, header.record, lambda *_: np.empty(0)).state.t)
    chosen = _chosen(path, times, time)
    written, expected = headers[chosen].problem.numbers.get("the mesh", []), mesh_numbers(mesh)
    if len(written) != len(expected):
        raise ForeignFile(f"{files[chosen]} is damaged: it does not identify its mesh. {OTHER}")
    if written[:2] != expected[:2]:
        was = (
            f"it has {written[0]:.0f} {mesh.words} and {written[1]:.0f} elements, this one {expected[0]:.0f} and {expected[1]:.0f}"
        )
        raise StvkError(f"{files[chosen]} belongs to another mesh: {was}.")
    if not np.allclose(written, expected, rtol=SAME, atol=0.0):
        raise StvkError(f"{files[chosen]} belongs to another mesh: its {mesh.words} or its elements differ.")
    _, found = store.read_file(files[chosen], mesh.space, OTHER)
    with refusing_damage(files[chosen], OTHER):
        check_lengths(found, mesh.p.size)
    if store is PathCheckpoint:
        return found.state.u, None
    _warn_of_lost(path, found.removed.size, mesh)
    return found.state.u, found.state.v


def _warn_of_lost(path: Path, lost: int, mesh: ElementMesh) -> None:
    """Warn that the body of the state had lost elements."""
    if lost:
        warn(
            f"{path} is the state of a body from which {lost} of {mesh.element_count} elements were removed. The new body has all "
            "of them."
        )


def _refuse_other(file: Path, read: meshio.Mesh, mesh: ElementMesh) -> None:
    """Refuse the file of another mesh, and warn if its body had lost elements."""
    what = f"{file} belongs to another mesh"
    hint = "Pass the mesh on which its states were computed, with the same degree."
    if len(read.points) != (nodes := mesh.space.count // mesh.d):
        raise StvkError(f"{what}: it has {len(read.points)} {mesh.words}, this one {nodes}. {hint}")
    far = np.abs(read.points[mesh.node_numbers].T - in_space(mesh.p.T).T) > SAME_POINT * mesh.extent.max()
    if len(bad := mesh.node_numbers[far.any(axis=0)]):
        raise StvkError(f"{what}: {name_ids(np.sort(bad), mesh.word)} of {nodes} have other coordinates. {hint}")
    try:
        t, element = from_cells(read.cells[0].type, read.cells[0].data)
    except (KeyError, IndexError) as error:
        raise StvkError(f"{what}: it has no supported elements. {hint}") from error
    if element.name != mesh.element.name:
        raise StvkError(f"{what}: it has {element.name}, this one {mesh.element.name}. {hint}")
    known = float(np.count_nonzero(np.isin(_rows(t), _rows(mesh.node_numbers[mesh.t]))))
    if others := t.shape[1] - int(mesh.space.comm.total(known)):
        raise StvkError(f"{what}: {others} of its {t.shape[1]} elements are not in this mesh. {hint}")
    _warn_of_lost(file, mesh.element_count - t.shape[1], mesh)


def _rows(t: NDArray[Any]) -> NDArray[Any]:
    """Return the nodes of each element as one value (nt,)."""
    rows = np.ascontiguousarray(t.T, dtype=np.int64)
    return rows.view([("", np.int64)] * len(t)).ravel()


def _vectors(file: Path, read: meshio.Mesh, mesh: ElementMesh, name: str) -> Array | None:
    """Return finite vectors (ndofs,) of the nodes by name; None if there are none."""
    given = read.point_data.get(name)
    if given is None:
        return None
    nodes = mesh.space.count // mesh.d
    if given.shape != (nodes, 3) or not np.isfinite(given).all() or given[:, mesh.d :].any():
        raise StvkError(f"{file} is damaged: {name} is not {mesh.d} finite components for each of {nodes} {mesh.words}.")
    return np.ascontiguousarray(given[mesh.node_numbers, : mesh.d], dtype=np.float64).reshape(-1)
