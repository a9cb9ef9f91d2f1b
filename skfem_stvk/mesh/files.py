"""A mesh file through meshio, with errors that say what to do and nothing printed."""

from __future__ import annotations

from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import meshio

from ..errors import MeshError
from .abaqus import check_one_node_section


def load(path: Path) -> meshio.Mesh:
    """What meshio reads from the file.

    Raises
    ------
    MeshError
        if the file is missing, empty, of an unknown format or damaged, or needs a package that is not installed.
    """
    check_file(path)
    printed, warned = StringIO(), StringIO()
    try:
        with redirect_stdout(printed), redirect_stderr(warned):
            if path.suffix.lower() == ".inp":
                check_one_node_section(path)
            mesh = meshio.read(path)
    except MeshError:
        raise
    except ModuleNotFoundError as error:
        raise MeshError(
            f"Reading {path.suffix} files needs the package {error.name}, which is not installed: pip install {error.name}"
        ) from error
    except SystemExit as error:  # how meshio gives up, after printing why
        raise damaged(path, " ".join(printed.getvalue().split()) or "meshio does not say why") from error
    except Exception as error:
        raise damaged(path, f"{type(error).__name__}: {error}") from error
    if "not closed by" in warned.getvalue():
        raise damaged(path, " ".join(warned.getvalue().split()))
    return mesh


def check_file(path: Path) -> None:
    if not path.is_file():
        raise MeshError(f"{path} is no file; expected the path of a mesh file. Is the path relative to another folder?")
    endings = {ending.lower() for ending in (path.suffix, "".join(path.suffixes[-2:]))}
    if not endings & set(meshio.extension_to_filetypes):
        raise MeshError(
            f"{path} has the unknown extension {path.suffix!r}; known: {', '.join(sorted(meshio.extension_to_filetypes))}. "
            "Rename the file if it is of one of these formats, or convert it."
        )
    if path.stat().st_size == 0:
        raise MeshError(f"{path} is empty. Did the program that writes it fail, or is it still writing?")


def damaged(path: Path, reason: str) -> MeshError:
    again = "Write it anew" + (", from Gmsh with Mesh.SaveAll = 0." if path.suffix.lower() == ".msh" else ".")
    return MeshError(
        f"{path} could not be read: {reason.rstrip('.: ')}. Is it cut off, or not really a {path.suffix} file? {again}"
    )
