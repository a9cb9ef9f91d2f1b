"""Random legal bodies at extreme scales: lengths and stiffnesses from 1e-150 to 1e150, nu at its limits, slivers, loose parts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import skfem

from skfem_stvk import ElementMesh, StVK
from skfem_stvk.arguments import Array

from .extended_stvk import ExtendedStVK

#: Poisson's ratios: common values, and values near the legal limits.
POISSON = (
    0.3,
    0.0,
    0.45,
    -0.5,
    0.49,
    -0.99,
    0.4999,
    0.499999,
    -1 + 1e-6,
    0.5 - 1e-9,
    -1 + 1e-12,
    0.5 - 1e-15,
    np.nextafter(0.5, 0),
)
#: Half widths of the distributions of decimal exponents: moderate, large, and near the range of double precision.
WIDTHS = (3, 12, 150)


@dataclass(frozen=True)
class Body:
    """Body with its scales.

    Attributes
    ----------
    unit
        Size of the body [m], the unit of length.
    pressure
        Stress that causes a strain of about 1 [Pa].
    notes
        Description of the body's special properties.
    """

    mesh: ElementMesh
    term: StVK
    exact: ExtendedStVK
    unit: float
    pressure: float
    section: float
    density: float
    notes: list[str] = field(default_factory=list)

    @property
    def force(self) -> float:
        """Force that causes a strain of about 1 [N]; infinite or zero if it is out of the range of double precision."""
        with np.errstate(over="ignore", under="ignore"):
            return float(np.longdouble(self.pressure) * np.longdouble(self.section) * np.longdouble(self.unit) ** (self.mesh.k - 1))

    @property
    def time(self) -> float:
        """Time of a wave through the body [s]."""
        with np.errstate(over="ignore", under="ignore"):
            return float(np.longdouble(self.unit) * np.sqrt(np.longdouble(self.density) / np.longdouble(self.pressure)))


def body(rng: np.random.Generator) -> Body:
    """Return a random body."""
    notes: list[str] = []
    p, t = MESHES[str(rng.choice(list(MESHES)))]
    p = p + 0.1 * rng.uniform(-1, 1, p.shape) / p.shape[1] ** (1 / p.shape[0])
    for change in (_sliver, _doubled, _hanging, _far_away):
        if rng.random() < 0.07:
            p, t = change(p, t, rng)
            notes.append(change.__name__.strip("_").replace("_", " "))
    width = int(rng.choice(WIDTHS, p=(0.5, 0.25, 0.25)))
    unit, young, section, density = (float(2.0 ** round(3.32 * rng.uniform(-width, width))) for _ in range(4))
    poisson = float(rng.choice(POISSON, p=[0.4, *[0.6 / (len(POISSON) - 1)] * (len(POISSON) - 1)]))
    mesh = ElementMesh(p * unit, t)
    condensed = bool(mesh.k == mesh.d == 2 and rng.random() < 0.5)
    options: dict[str, Any] = {1: {"area": section}, 2: {"thickness": section}}.get(mesh.k, {})
    section = section if options else 1.0
    term = StVK(young=young, poisson=poisson, density=density, plane="stress" if condensed else None, **options)
    exact = ExtendedStVK(mesh, young, poisson, section, density, condensed)
    notes.append(
        f"{mesh.k} in {mesh.d}, size {unit:.1e}, E {young:.1e}, nu {poisson:.17g}, section {section:.1e}, density {density:.1e}"
    )
    return Body(mesh, term, exact, unit, young, section, density, notes)


def _meshes() -> dict[str, tuple[Array, Array]]:
    tets = skfem.MeshTet.init_tensor(*(np.linspace(0, 1, n) for n in (3, 2, 2)))
    sheet = skfem.MeshTri.init_tensor(np.linspace(0, 1, 4), np.linspace(0, 1, 3))
    x = np.linspace(0, 1, 5)
    line = np.stack([np.arange(4), np.arange(1, 5)])
    membrane = np.vstack([sheet.p, 0.2 * np.sin(3 * sheet.p[:1]) + 0.1 * sheet.p[1:] ** 2])
    return {
        "tetrahedra": (tets.p, tets.t),
        "triangles": (sheet.p, sheet.t),
        "membrane": (membrane, sheet.t),
        "segments": (x[None], line),
    }


MESHES = _meshes()


def _sliver(p: Array, t: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Make one element nearly flat: move its first vertex close to the centre of the others."""
    element, p = t[:, rng.integers(t.shape[1])], p.copy()
    middle = p[:, element[1:]].mean(axis=1)
    p[:, element[0]] = middle + 10.0 ** rng.uniform(-4, -1) * (p[:, element[0]] - middle)
    return p, t


def _doubled(p: Array, t: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Add a second body next to the first, without a connection."""
    return np.hstack([p, p + 1.5]), np.hstack([t, t + p.shape[1]])


def _hanging(p: Array, t: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Add a vertex that belongs to no element."""
    return np.hstack([p, p.mean(axis=1)[:, None] + 0.01]), t


def _far_away(p: Array, t: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Move the body far from the origin."""
    return p + 10.0 ** rng.uniform(1, 6), t
