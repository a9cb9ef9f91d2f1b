"""A body: a mesh with its material properties, as loads need them."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..edges.elements import Quadrature
from ..edges.materials import Isotropic
from ..errors import LoadError, MaterialError, name_ids
from ..mesh import ElementMesh
from ..mesh.element import Element, named
from ..mesh.facets import facets_of, find_facets
from ..mesh.points import sizes_of
from .loads.spread import lumped_shares
from .term import Term


class Body:
    """A mesh and its elastic terms. Every property is computed at first use.

    The bodies `beside` it have elements of lower dimensions on the same nodes, such as membranes and cables on tetrahedra.

    >>> import skfem
    >>> from skfem_stvk import StVK
    >>> body = Body(ElementMesh.of(skfem.MeshTri()), [StVK(young=1.0, poisson=0.3, density=2.0, thickness=0.1)])
    >>> body.volumes, body.mass
    (array([0.05, 0.05]), array([0.1, 0.1]))
    """

    def __init__(
        self, mesh: ElementMesh, terms: Sequence[Term], quadrature: Quadrature | None = None, beside: Sequence[Body] = ()
    ) -> None:
        self.mesh, self.terms, self.beside = mesh, tuple(terms), tuple(beside)
        self.quadrature = quadrature or Quadrature.of(mesh.element)
        self.removed, self.bare = np.zeros(mesh.nt, dtype=bool), np.zeros(mesh.nv, dtype=bool)

    def without(self, removed: NDArray[np.bool_], bare: NDArray[np.bool_]) -> Body:
        """Return the body without the removed elements `removed` (nt,), which then have no size, volume or mass.

        Facets of only these elements have no area. The nodes `bare` (nv,) are no longer in any element.
        """
        other = copy(self)
        other.removed, other.bare = removed, bare
        for name in ("sizes", "mass", "lumped_mass"):
            other.__dict__.pop(name, None)
        return other

    @cached_property
    def sizes(self) -> Array:
        """Lengths, areas or volumes (nt,) of the elements at rest [m^k]; 0 for removed elements."""
        return np.where(self.removed, 0.0, sizes_of(self.mesh.p, self.mesh.t, self.mesh.element))

    @cached_property
    def section(self) -> Array:
        """Factor (nt,) from size to volume: thickness of surfaces [m], area of segments [m^2], 1 for solids.

        Raises
        ------
        LoadError
            if terms on the same elements have different sections.
        """
        section = np.full(self.mesh.nt, np.nan)
        for term in self.terms:
            ids = self.mesh.elements(term.region)
            of_term = term.section(self.mesh, len(ids))
            if of_term is None:
                continue
            own = np.broadcast_to(of_term, ids.shape)
            bad = self.mesh.element_numbers[ids[~np.isnan(section[ids]) & (section[ids] != own)]]
            if len(bad):
                raise LoadError(
                    f"{name_ids(bad, 'element')}: terms of different {'thickness' if self.mesh.k == 2 else 'area'} on the same "
                    "elements, so forces per volume or per area have no meaning there. Give all of them the same; for forces on "
                    "nodes use NodalLoad."
                )
            section[ids] = own
        return np.nan_to_num(section, nan=1.0)

    @cached_property
    def confined_modulus(self) -> Array:
        """Modulus `lam + 2 mu` (nt,) [Pa] of all terms on each element, the stiffness without lateral strain; 0 without a term."""
        modulus = np.zeros(self.mesh.nt)
        for term in self.terms:
            ids = self.mesh.elements(term.region)
            modulus[ids] += term.confined_modulus(self.mesh, len(ids))
        return modulus

    @cached_property
    def young(self) -> Array:
        """Young's modulus (nt,) [Pa] of the isotropic materials of all terms on each element; NaN without one."""
        young = np.full(self.mesh.nt, np.nan)
        for term in self.terms:
            if isinstance(term.material, Isotropic):
                ids = self.mesh.elements(term.region)
                young[ids] = np.nan_to_num(young[ids]) + np.broadcast_to(term.material.young, len(ids))
        return young

    @property
    def volumes(self) -> Array:
        """Volumes (nt,) at rest [m^3]: sizes times section."""
        return self.sizes * self.section

    @cached_property
    def mass(self) -> Array:
        """Masses (nt,) [kg] of the elements, from all terms on each.

        Raises
        ------
        MaterialError
            if a material has no density.
        """
        heavy = [term for term in self.terms if term.has_mass]
        if not heavy:
            raise MaterialError("No term has a density. Give one to the material: StVK(..., density=...).")
        mass = np.zeros(self.mesh.nt)
        for term in heavy:
            ids = self.mesh.elements(term.region)
            mass[ids] += term.mass(self.mesh, self.sizes[ids])
        return mass

    @cached_property
    def lumped_mass(self) -> Array:
        """Masses (nv,) [kg] of all elements, including those of the bodies in `beside`, lumped at their nodes by
        `spread.lumped_shares`. Raises the errors of `mass`.
        """
        mesh = self.mesh
        if mesh.element.is_linear_simplex:
            shares = np.tile(self.mass / (mesh.k + 1), mesh.k + 1)
        else:
            shares = (lumped_shares(mesh.p, mesh.t, mesh.element) * self.mass).ravel()
        own = np.bincount(mesh.t.ravel(), weights=shares, minlength=mesh.nv).astype(np.float64)
        return sum((body.lumped_mass for body in self.beside), own)

    @property
    def facet(self) -> Element:
        """Kind of the facets."""
        return named(self.mesh.element.facet)

    def facet_areas(self, facets: NDArray[np.int32]) -> Array:
        """Return the areas (n,) of facets (m, n) at rest [m^2]: their sizes times section; 0 if all their elements are removed."""
        return sizes_of(self.mesh.p, facets, self.facet) * self.facet_sections(facets)

    def facet_sections(self, facets: NDArray[np.int32]) -> Array:
        """Return the section (n,) of the element of each facet (m, n). It is the mean of both for a facet between two elements, and
        0 if these are removed.

        Raises
        ------
        LoadError
            if a facet belongs to no simplex and the section is not uniform.
        """
        if not self.removed.any() and (self.section == self.section[0]).all():
            return np.full(facets.shape[1], self.section[0])
        every, t2f = self._facets
        owners, there = t2f.ravel(), np.tile(~self.removed, len(t2f))
        means = np.bincount(owners, weights=there * np.tile(self.section, len(t2f))) / np.maximum(np.bincount(owners, there), 1)
        found = find_facets(facets, every, self.mesh.nv)
        bad = np.flatnonzero(found < 0)
        if len(bad):
            raise LoadError(f"{name_ids(bad, 'facet')} of {len(found)}: of no element, so without thickness or area.")
        return means[found]

    @cached_property
    def _facets(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        return facets_of(self.mesh.t, self.mesh.nv, self.mesh.element)
