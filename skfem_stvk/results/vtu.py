"""Results as VTU, the file format of ParaView, through meshio."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unicodedata import category
from xml.sax.saxutils import escape

import meshio
import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..mesh import ElementMesh
from ..mesh.groups import as_cells
from .fields import State, checked_state
from .files import output_path, replacing
from .law import in_space
from .table import Field, find_all

Arrays = dict[str, NDArray[Any]]
#: VTK's order of the components of a symmetric tensor: XX, YY, ZZ, XY, YZ, XZ.
VTK = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
DEFAULT = ("cauchy_stress", "von_mises_stress", "green_strain", "volume_ratio")


def write_vtu(path: str | os.PathLike[str], state: State, fields: Sequence[str] = DEFAULT) -> Path:
    """Write the mesh at rest, the displacements and these fields, by cell and averaged to the points, all under their full names.

    ========================  ==============================================================================================
    points                    at rest, padded to three components; "Warp By Vector" with `displacement` gives the deformed body
    `displacement`            [m], three components; of a body in motion there is `velocity` too [m/s]
    symmetric tensors         six components in VTK's order XX, YY, ZZ, XY, YZ, XZ
    other tensors             nine components, row by row
    `NAME_missing`            only where something is missing: 1 where there is no value, and zeros stand in `NAME`
    `region`                  only if the mesh has subdomains: 1 for the first in its order, 0 for none; the last one counts
    `skfem:s:NAME`            1 in the subdomain, as scikit-fem writes it: `read_mesh` gives the subdomains back; control characters
                              in a name are escaped, such as \\x1b
    ========================  ==============================================================================================

    Quadratic simplices are VTK's quadratic cells, and hexahedra are in VTK's order of nodes. Fields by cell are the means of
    elements with several points, those at nodes are extrapolated from there. Elements that were taken out of the body are left
    out, their nodes stay. The file is renamed into place when it is complete.

    Raises
    ------
    StvkError
        for a field that there is not, or a path that cannot be written, before any work.
    """
    wanted, path = find_all(fields), output_path(path, ".vtu")
    mesh = _with_fields(checked_state(state), wanted)
    with replacing(path) as part:
        meshio.vtu.write(part, mesh, compression=None)
    return path


def _with_fields(state: State, fields: Sequence[Field]) -> meshio.Mesh:
    mesh, there = state.fields.mesh, ~state.fields.gone
    points: Arrays = {name: in_space(vectors) for name, vectors in state.vectors.items()}
    cells = _regions(mesh)
    for field in fields:
        points |= _arrays(field, state.at_nodes(field.name))
        cells |= _arrays(field, state[field.name])
    elements, by_cell = as_cells(mesh.t[:, there], mesh.element), {name: [values[there]] for name, values in cells.items()}
    return meshio.Mesh(in_space(mesh.p.T), [elements], points, by_cell)


def _arrays(field: Field, values: Array) -> Arrays:
    """The components by name, and where there are none."""
    filled = np.ma.filled(values, 0.0)
    arrays: Arrays = {field.name: _components(filled, field.symmetric)}
    if np.ma.is_masked(values):
        arrays[f"{field.name}_missing"] = np.ma.getmaskarray(values).reshape(len(values), -1)[:, 0].astype(np.uint8)
    return arrays


def _components(values: Array, symmetric: bool) -> Array:
    if not symmetric:
        return values.reshape(len(values), -1) if values.ndim > 1 else values
    i, j = np.array(VTK).T
    return values[:, i, j]


def _regions(mesh: ElementMesh) -> Arrays:
    arrays: Arrays = {}
    if mesh.subdomains:
        region = np.zeros(mesh.nt, dtype=np.int32)
        for number, name in enumerate(mesh.subdomains, start=1):
            elements = mesh.elements(name)
            region[elements] = number
            arrays[f"skfem:s:{as_attribute(name)}"] = np.isin(np.arange(mesh.nt), elements).astype(np.uint8)
        arrays["region"] = region
    return arrays


def as_attribute(name: str) -> str:
    r"""A name as an attribute of XML, which meshio writes as it is given; characters that XML does not allow are escaped.

    >>> print(as_attribute('left "<half>" \x1b'))
    left &quot;&lt;half&gt;&quot; \x1b
    """
    legal = "".join(repr(letter)[1:-1] if category(letter) in ("Cc", "Cs", "Cn") else letter for letter in name)
    return escape(legal, {'"': "&quot;"}).encode("ascii", "xmlcharrefreplace").decode()
