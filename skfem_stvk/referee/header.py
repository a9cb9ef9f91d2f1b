"""The head of a report on a body: its mesh and material, the machine and the packages."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..about import PACKAGES, circumstances
from ..materials import FramedMaterial, Isotropic
from ..mesh import ElementMesh
from ..terms import StVK
from .shape import Shape


def mesh_facts(shape: Shape) -> dict[str, Any]:
    """Hash, counts and shape of a mesh, and the rule that it is integrated by; the hash covers coordinates and elements."""
    mesh, aspect = shape.mesh, shape.aspect
    a, b = np.array(mesh.element.edges).T
    lengths = np.linalg.norm(mesh.p[:, mesh.t[a]] - mesh.p[:, mesh.t[b]], axis=0)
    facts: dict[str, Any] = {
        "sha256": hashlib.sha256(mesh.p.tobytes() + mesh.t.tobytes()).hexdigest()[:16],
        "elements": f"{mesh.nt} {mesh.kind}",
        "curved elements": int(shape.curved.sum()),
        "rule": shape.how.described(),
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
    """A term in one line."""
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
    """The head of a report on this body; `source` says where the mesh is from."""
    facts = {
        "mesh": {"source": source} | mesh_facts(shape),
        "material": [material_facts(shape.mesh, term) for term in terms],
        "seed": seed,
    }
    return circumstances(PACKAGES) | facts
