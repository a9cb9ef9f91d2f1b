"""Files of reduced bodies: the fields and the coefficients of the quartic, and by what the body is known again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from ..arguments import Array
from ..errors import StvkError
from ..results.archive import CheckpointHeader, finite, read_archive, write_archive
from ..system import System
from ..system.signature import Fingerprint, sums
from .basis import departure
from .quartic import coefficients

FORMAT = "reduced body of skfem-stvk", 1
REMEDY = "Reduce the body anew: ReducedSystem(body, ...)."


class ReducedHeader(CheckpointHeader):
    """The header of a file: how many unknowns, and how many lifts."""

    size: Annotated[int, Field(ge=1)]
    lifts: Annotated[int, Field(ge=0)]


def write_reduced(path: Path, body: System, masses: Array, size: int, arrays: dict[str, Array]) -> None:
    """Replace the file; `arrays` are `columns` (ndofs, size + l) and the coefficients `T`."""
    about = {"size": size, "lifts": arrays["columns"].shape[1] - size}
    problem = _fingerprint(body, masses).signature.model_dump()
    write_archive(path, {"format": FORMAT[0], "version": FORMAT[1], **about, "problem": problem}, arrays)


def read_reduced(path: Path, body: System, masses: Array) -> tuple[int, Array, Array]:
    """`size`, columns and coefficients of a file; StvkError if it is none, is damaged, or is of another body."""
    header, arrays = read_archive(path, ReducedHeader, FORMAT, REMEDY)
    _fingerprint(body, masses).refuse_other(header.problem, path, REMEDY)
    count = header.size + header.lifts
    try:
        columns = finite(arrays, "columns", (body.ndofs, count))
        T = finite(arrays, "T", (coefficients(count + 1),))
    except (KeyError, ValueError) as error:
        raise StvkError(f"{path} is damaged: {error.args[0]}. {REMEDY}") from None
    off = departure(masses, columns[:, : header.size])
    if not off < 1e-11:
        raise StvkError(f"{path} holds a basis that is orthonormal to {off:.1g} only; expected 1e-12. {REMEDY}")
    return header.size, np.ascontiguousarray(columns), T


def _fingerprint(body: System, masses: Array) -> Fingerprint:
    """A reduced body depends on the mesh, the elastic terms, on what is held and on masses; not on loads."""
    return Fingerprint("path of equilibria", body, {}, [], {"masses": sums(masses)})
