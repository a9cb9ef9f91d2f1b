"""Elements in which the model is not reliable, even if the equations are solved accurately."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..edges.materials import FramedMaterial, Isotropic, Material
from ..errors import name_ids
from ..mesh import ElementMesh
from ..npz import Ids
from ..system import System
from ..system.bound import FLAT, compressed_in_part, inverted_in_part

#: Poisson's ratio above which linear elements lock, and the stretch below which St. Venant-Kirchhoff bodies soften.
LOCKING, SOFTENING = 0.45, 3**-0.5
#: Number of ids that parts of a divided body exchange for a finding.
FEW = 5


@dataclass(frozen=True, eq=False)
class Finding:
    """Warning about elements, or about a contact.

    Attributes
    ----------
    name
        Name of the finding, "locking", "inside out", "compressed", "deep contact", "wrong side", "thin shape",
        "short contact" or "lagging friction".
    elements
        (n,) ids of the elements in the whole mesh, ascending; none for a contact. If the body is divided, the first `FEW` of them:
        the text has their number.
    extreme
        Most extreme value: the largest Poisson's ratio, the smallest `J`, the smallest principal stretch, the largest
        depth over the mean edge of the facets, the same of nodes, the thickness over the edge of the smallest facet, the smallest
        number of steps that a contact lasts, the part of the largest friction that is missing, in the order of the names.
    text
        The fault, the elements or the contact, a location or a time, the consequence and the remedy.
    """

    name: str
    elements: Ids
    extreme: float
    text: str

    def __repr__(self) -> str:
        return f"Finding({self.name!r}, {self.text!r})"


class Monitors:
    """Search for elements outside the range of the model. It costs about two forces per state.

        locking         Poisson's ratio above 0.45 in solids and plane strain, where linear simplices, and boxes with more than one
                        point, are much too stiff; for anisotropic materials that of the Reuss averages,
                        `(3 K - 2 G)/(6 K + 2 G)`: the stress is the same in all directions
        inside out      J <= 1e-9, for elements that fill their space: inverted or flat, as in `System.inside_out`
        compressed      smallest principal stretch below 1/sqrt(3), where uniaxial compression has its limit point; at the points

    >>> import skfem
    >>> from skfem_stvk import StVK, System
    >>> mesh = skfem.MeshTet()
    >>> monitors = Monitors(System(mesh, StVK(young=1.0, poisson=0.3)))
    >>> [(finding.name, round(finding.extreme, 9)) for finding in monitors.at(-0.5 * mesh.p.ravel("F"))]
    [('compressed', 0.5)]
    """

    def __init__(self, system: System) -> None:
        self._system = system

    def before(self) -> tuple[Finding, ...]:
        """Return the findings on elements and their materials, without a state.

        >>> import skfem
        >>> from skfem_stvk import StVK, System
        >>> print(Monitors(System(skfem.MeshTet(), StVK(young=1.0, poisson=0.49))).before()[0].text)
        5 elements (0, 1, 2, 3, 4), the first at (0.25, 0.25, 0.25) at rest: Poisson's ratio above 0.45 (up to 0.49), ...
        """
        element = self._system.mesh.element
        if element.degree == 2 or getattr(self._system, "quadrature", None) == "one-point":
            return ()
        ratio = np.full(self._system.mesh.nt, -1.0)
        for term in self._system.body.terms:
            if term.is_law and not term.hypothesis(self._system.mesh).condensed:
                elements = self._system.mesh.elements(term.region)
                ratio[elements] = np.maximum(ratio[elements], poisson_of(term.material))
        largest = self._system.space.comm.most(float(ratio.max(initial=-1.0)))
        if largest <= LOCKING:
            return ()
        remedy = 'one point to an element (quadrature="one-point")' if element.shape.one_point else "quadratic elements (degree=2)"
        what = (
            f"Poisson's ratio above {LOCKING} (up to {largest:.4g}), so that these linear elements lock: bodies are too "
            f"stiff, and pressures oscillate between elements. Use {remedy}, or a smaller Poisson's ratio; otherwise compare "
            "with a finer mesh."
        )
        return tuple(self._finding("locking", np.flatnonzero(ratio > LOCKING), largest, what))

    def at(self, u: Array) -> tuple[Finding, ...]:
        """Return the findings at displacements `u` (ndofs,), a state that the system accepts."""
        return tuple(self._findings_at(u))

    def _findings_at(self, u: Array) -> Iterator[Finding]:
        system = self._system
        if system.mesh.k == system.mesh.d and (J := system.smallest_volume_ratio(u)) <= FLAT:
            what = f"inverted or flat (J down to {J:.3g}). {self._inversion_remedy()}"
            yield from self._finding("inside out", inverted_in_part(system, u), J, what)
        if (stretch := system.smallest_stretch(u)) < SOFTENING:
            what = (
                f"compressed to a principal stretch below 1/sqrt(3) = 0.577 (down to {stretch:.3g}), where a St. Venant-Kirchhoff "
                f"body softens. {self._compression_remedy()}"
            )
            yield from self._finding("compressed", compressed_in_part(system, u, SOFTENING), stretch, what)

    def _inversion_remedy(self) -> str:
        remedy = "" if self._system.resists_inversion else ", or add a VolumePenalty, which resists inversion"
        return f"No real body can invert, so the state has no meaning there. Use smaller steps, a finer mesh{remedy}."

    def _compression_remedy(self) -> str:
        if self._system.mesh.k < self._system.mesh.d:
            return "Membranes and cables wrinkle or become slack much earlier. Check that the loads pull and do not push."
        if self._system.resists_inversion:
            return "The VolumePenalty carries the load there, so the result depends on the penalty more than on the StVK law."
        local = "At a corner, or under a load on few vertices, refine the mesh or distribute the load"
        return f"Beyond this, more compression needs less force. {local}; elsewhere add a VolumePenalty, or reduce the load."

    def _finding(self, name: str, here: NDArray[np.int64], extreme: float, what: str) -> Iterator[Finding]:
        """Yield the finding on elements with the ids `here` in the parts of the body, if there are any."""
        mesh = self._system.mesh
        ids, count = mesh.ids_of_all(here, FEW), int(mesh.space.comm.total(len(here)))
        if count:
            where = point_of(mesh, ids[0])
            yield Finding(name, ids, extreme, f"{name_ids(ids, 'element', count=count)}, the first at {where} at rest: {what}")


def named_elements(mesh: ElementMesh, ids: NDArray[np.int64]) -> str:
    """Return the first few elements, and the location of the first one at rest; empty if there are none."""
    return f"{name_ids(ids, 'element')}, the first one near x = {point_of(mesh, ids[0])}" if len(ids) else ""


def point_of(mesh: ElementMesh, element: int) -> str:
    """Return the centre at rest of an element, by its number in the whole mesh."""
    centre = np.zeros(mesh.d)
    for here in mesh.local_elements(np.array([element])):  # none in other parts of a divided body
        centre += mesh.p[:, mesh.t[:, here]].mean(axis=1)
    return f"({', '.join(f'{x:.4g}' for x in mesh.space.comm.total(centre))})"


def poisson_of(material: Material) -> Array:
    """Return Poisson's ratio, a number or (n,); for anisotropic materials that of the Reuss averages, 0 if there is none.

    >>> from skfem_stvk import Isotropic, Orthotropic
    >>> round(float(poisson_of(Orthotropic(young=(2.6, 2.6, 2.6), poisson=(0.3, 0.3, 0.3), shear=(1.0, 1.0, 1.0)))), 12)
    0.3
    """
    if isinstance(material, Isotropic):
        return np.asarray(0.0 if material.poisson is None else material.poisson)
    if not isinstance(material, FramedMaterial):
        return np.asarray(0.0)
    compliance = np.linalg.inv(material.stiffness())
    normal = compliance[..., :3, :3]
    trace, total = np.trace(normal, axis1=-2, axis2=-1), normal.sum(axis=(-2, -1))
    shear = np.trace(compliance[..., 3:, 3:], axis1=-2, axis2=-1)
    K, G = 1 / total, 15 / (6 * trace - 2 * total + 3 * shear)
    return (3 * K - 2 * G) / (6 * K + 2 * G)
