"""The head of every report: what was measured, on which machine, and with which packages."""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from collections.abc import Sequence
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from ..arguments import THREAD_LIMITS
from ..materials import FramedMaterial, Isotropic
from ..mesh import ElementMesh
from ..peers import PEERS
from ..terms import StVK
from .shape import Shape

PACKAGES = (
    "skfem-stvk",
    "scikit-fem",
    "numpy",
    "scipy",
    "numba",
    "meshio",
    "rich",
    "matplotlib",
    "jinja2",
    "pyamg",
    "filelock",
    "pydantic",
)
#: Optional packages, and what installs them.
OPTIONAL = {
    "pypardiso": "pip install 'skfem-stvk[pardiso]'",
    "pyvista": "pip install 'skfem-stvk[plot]'",
    "gmsh": "pip install gmsh",
    **{package.distribution: package.install for package in PEERS.values()},
    "h5py": "pip install h5py (meshes in .h5, .xdmf, .med)",
    "netCDF4": "pip install netCDF4 (meshes in .exo, .e)",
}


def versions(packages: Sequence[str] = PACKAGES) -> dict[str, str]:
    """Versions of Python and the packages; "not installed" for those that are not."""

    def installed(package: str) -> str:
        try:
            return version(package)
        except PackageNotFoundError:
            return "not installed"

    return {"python": platform.python_version()} | {package: installed(package) for package in packages}


def optional() -> dict[str, str]:
    """Versions of the optional packages, or the line that installs them."""
    found = versions(list(OPTIONAL))
    return {name: f"not installed: {line}" if found[name] == "not installed" else found[name] for name, line in OPTIONAL.items()}


def caches() -> dict[str, str]:
    """The folder of compiled kernels, and whether it can be written to."""
    from ..kernels.topology import expand

    folder = getattr(getattr(expand, "_cache", None), "cache_path", None)
    if folder is None:
        return {"kernels kept in": "no folder: every process compiles. Set NUMBA_CACHE_DIR to one that can be written to"}
    nearest = next(parent for parent in (Path(folder), *Path(folder).parents) if parent.exists())
    writable = "writable" if os.access(nearest, os.W_OK | os.X_OK) else "NOT writable; set NUMBA_CACHE_DIR to a folder that is"
    kept = len(list(Path(folder).glob("*.nbc")))
    return {"kernels kept in": f"{folder} ({kept} files, {writable})"}


def machine() -> dict[str, Any]:
    """Processor, cores, system and the settings that change a speed."""
    limits = [f"{name}={os.environ[name]}" for name in THREAD_LIMITS if name in os.environ]
    return {
        "system": platform.platform(),
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "threads": ", ".join(limits) or "not limited by the environment",
    }


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


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


def circumstances(packages: Sequence[str]) -> dict[str, Any]:
    """Date, command, versions and machine of a run."""
    return {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "versions": versions(packages),
        "machine": machine(),
    }


def header(shape: Shape, terms: Sequence[StVK], source: str, seed: int) -> dict[str, Any]:
    """The head of a report on this body; `source` says where the mesh is from."""
    facts = {
        "mesh": {"source": source} | mesh_facts(shape),
        "material": [material_facts(shape.mesh, term) for term in terms],
        "seed": seed,
    }
    return circumstances(PACKAGES) | facts
