"""Content of mesh files, read by meshio or by the readers of this package; a file must hold the content that it declares."""

from __future__ import annotations

from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from shlex import quote

import meshio
import numpy as np

from ..errors import MeshError, StvkWarning
from .content import check_cells
from .formats import CHECKS, PARTS, READERS, REFUSED, Counts, CutOff, Damaged, refused

#: What pip installs for a package, if it is an extra of this one.
EXTRAS = {"netCDF4": "'skfem-stvk[exodus]'"}


def load(path: Path) -> meshio.Mesh:
    """Return the points, cells, groups and data of a file."""
    check_file(path)
    try:
        return checked(path)
    except Damaged as error:
        raise damaged(path, str(error), isinstance(error, CutOff)) from error
    except PermissionError as error:
        raise MeshError(f"{path} cannot be read: {error.strerror}. Change its permissions, or copy it.") from error
    except ModuleNotFoundError as error:
        raise MeshError(
            f"Reading {path.suffix} files needs the package {error.name}, which is not installed: pip install "
            f"{EXTRAS.get(error.name or '', error.name)}"
        ) from error
    except MemoryError as error:
        raise MeshError(f"{path} declares more data than fit into memory. Is it damaged? Write it again.") from error
    except StvkWarning:  # a note of what is left out, which the user has made an error
        raise
    except Exception as error:
        raise damaged(path, f"its content is inconsistent ({error})", False) from error


def parts_of(path: Path) -> list[Path]:
    """Return the regular files of a mesh: a file, and the files that it includes or names, if it is not damaged."""
    try:
        parts = [path, *PARTS.get(path.suffix.lower(), lambda path: ())(path)]
    except (Damaged, OSError):
        parts = [path]
    return [part for part in parts if part.is_file()]


def checked(path: Path) -> meshio.Mesh:
    """Return the content of a file, which is checked before and after it is read."""
    ending = path.suffix.lower()
    if ending in READERS:
        mesh = READERS[ending](path)
    else:
        counts: Counts = CHECKS[ending](path) if ending in CHECKS else (None, None)
        mesh = quietly(path)
        check_counts(mesh, counts)
    check_cells(mesh)
    return mesh


def quietly(path: Path) -> meshio.Mesh:
    """Return the content that meshio reads; its printed lines become part of the error."""
    printed = StringIO()
    try:
        with redirect_stdout(printed), redirect_stderr(StringIO()), np.errstate(over="ignore"):
            return meshio.read(path)
    except SystemExit as error:  # meshio exits this way after printing the reason
        raise Damaged(" ".join(printed.getvalue().split()) or "meshio gives no reason") from error
    except KeyError as error:  # meshio raises it for unknown ids
        raise Damaged(f"it names {error.args[0]!r}, which is not defined in it") from error


def check_counts(mesh: meshio.Mesh, counts: Counts) -> None:
    """Refuse a mesh that differs from the declared counts."""
    for what, declared, read in zip(("nodes", "cells"), counts, (len(mesh.points), sum(map(len, mesh.cells))), strict=True):
        if declared is not None and declared != read:
            raise Damaged(f"{declared} {what} are declared, {read} were read")


def check_file(path: Path) -> None:
    """Refuse a file that is not regular, is empty, or has a refused or unknown format."""
    try:
        if not path.is_file():
            what = "is not a regular file" if path.exists() else "does not exist"
            raise MeshError(f"{path} {what}; expected the path of a mesh file. Is the path relative to another folder?")
        name = refused(path)
    except OSError as error:
        raise MeshError(f"{path} cannot be read: {error.strerror}. Change its permissions or its folder's, or copy it.") from error
    if name:
        writer = " (as meshio writes .msh without file_format='gmsh')" if name == "Fluent" else ""
        raise MeshError(
            f"{path} is a {name} file{writer}; expected a format in which damage can be detected. If the file is whole, convert "
            "it: "
            f"meshio convert {quote(str(path))} {quote(f'{path.stem}.vtu')}"
        )
    known = sorted({*meshio.extension_to_filetypes, *READERS} - set(REFUSED))
    if path.suffix.lower() not in known:
        raise MeshError(
            f"{path} has the unknown extension {path.suffix!r}; known: {', '.join(known)}. Rename the file if it is of one of "
            "these formats, or convert it."
        )
    if path.stat().st_size == 0:
        raise MeshError(f"{path} is empty. Did the program that writes it fail, or is it still writing?")


def damaged(path: Path, reason: str, cut_off: bool) -> MeshError:
    """Return the error for a file that cannot be read; one of which something is missing may be cut off."""
    return MeshError(f"{path} could not be read: {reason.rstrip('.: ')}.{' Is it cut off? Write it again.' if cut_off else ''}")
