"""Response of a body to displacements: strain, stress and energy density at the points of its elements, from its terms."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, choice
from ..edges.materials import Hypothesis
from ..errors import StateError, StvkError
from ..mesh import ElementMesh, MeshLike
from ..mesh.geometry import Geometry, PointGeometry, geometries
from ..mesh.points import sizes_of
from ..terms import Body, Deformation, Term, VolumePenalty, is_load
from ..terms.laws.elastic_law import green_strain_of
from ..terms.term import specified
from .law_on_elements import dilation, rest_frames, strain_and_stress, volume_stress

#: One value per element, or one at a point of each, and a mask of the elements that have none.
Masked: TypeAlias = tuple[Array, NDArray[np.bool_]]


@dataclass(frozen=True)
class ElasticPart:
    """Law on its elements, with their sections (thickness, area or 1)."""

    elements: NDArray[np.int64]
    law: Term
    hypothesis: Hypothesis
    section: Array


@dataclass(frozen=True)
class VolumePart:
    """Volume penalty on its elements, with its stiffness [Pa], and whether the elements are constrained across."""

    elements: NDArray[np.int64]
    term: VolumePenalty
    stiffness: Array
    constrained_across: NDArray[np.bool_]


class ElementPoint(NamedTuple):
    """Point of all elements: their rest geometry there, and (nt, 3, 3) their axes and normals at rest."""

    geometry: Geometry | PointGeometry
    frames: Array


class ElasticBody:
    """A mesh and its terms, with the data that fields need at any displacements.

    Attributes, parameters and errors as in `fields.Fields`.
    """

    def __init__(self, mesh: MeshLike, terms: Any, quadrature: str | None = None) -> None:
        self.mesh = ElementMesh.of(mesh)
        self.kind = "usual" if quadrature is None else choice("quadrature", quadrature, ("exact", "one-point"))
        all_terms = list(terms) if isinstance(terms, Iterable) and not isinstance(terms, np.ndarray) else [terms]
        elastic = [specified(term) for term in all_terms if not is_load(term)]
        if not elastic:
            raise StvkError("None of the terms carries stress; expected at least one StVK(...).")
        self.parts = [self._part(term) for term in elastic if term.is_law]
        self.section, self.total_section = np.zeros(self.mesh.nt), np.zeros(self.mesh.nt)
        for part in self.parts:
            self.section[part.elements] = np.maximum(self.section[part.elements], part.section)
            self.total_section[part.elements] += part.section
        self.without_term: NDArray[np.bool_] = self.total_section == 0
        self.section[self.without_term] = 1.0
        body = Body(self.mesh, elastic)
        self.volume_parts = [self._volume_part(term, body) for term in elastic if term.has_pressure]
        for penalty in self.volume_parts:
            self.without_term[penalty.elements] = False
        for part in self.parts:
            self.without_term[part.elements] |= not part.law.has_stress
        self.removed = np.zeros(self.mesh.nt, dtype=bool)

    def leave_out(self, elements: NDArray[np.int64]) -> None:
        """Leave out elements that are removed from the body: they have no fields, and are neither drawn nor written."""
        self.removed[elements] = True
        self.without_term = self.without_term | self.removed

    def _part(self, term: Term) -> ElasticPart:
        elements, hypothesis = self.mesh.elements(term.region), term.hypothesis(self.mesh)
        term.material.check(len(elements), hypothesis)
        section = np.broadcast_to(term.section(self.mesh, len(elements)), len(elements))
        return ElasticPart(elements, term, hypothesis, section)

    def _volume_part(self, term: Any, body: Body) -> VolumePart:
        """Return a penalty on its elements; elements without another term are in plane strain."""
        constrained = (self.total_section == 0) & (self.mesh.k > 1)
        for part in self.parts:
            constrained[part.elements] |= not part.hypothesis.condensed
        elements = self.mesh.elements(term.region)
        return VolumePart(elements, term, term.moduli(body), constrained[elements])

    @cached_property
    def linear(self) -> NDArray[np.bool_]:
        """Whether (nt,) all terms of an element are linear: its stress is then the same in all measures."""
        linear, others = np.zeros(self.mesh.nt, dtype=bool), np.zeros(self.mesh.nt, dtype=bool)
        for part in self.parts:
            (linear if part.law.small_strain else others)[part.elements] = True
        for penalty in self.volume_parts:
            others[penalty.elements] = True
        return linear & ~others

    @cached_property
    def wrinkling(self) -> NDArray[np.int64]:
        """Ascending ids of the elements that may wrinkle: their volume does not depend on folds."""
        may = [part.elements for part in self.parts if part.law.wrinkling]
        return np.unique(np.concatenate([np.empty(0, np.int64), *may]))

    @cached_property
    def points(self) -> list[ElementPoint]:
        """Points of the elements by the rule of this kind; linear simplices have one."""
        return [ElementPoint(geometry, rest_frames(geometry.axes)) for geometry in geometries(self.mesh, self.kind)]

    @cached_property
    def volume(self) -> Array:
        if self.mesh.element.is_linear_simplex:
            return self.points[0].geometry.volume * self.section
        return sizes_of(self.mesh.p, self.mesh.t, self.mesh.element) * self.section

    @cached_property
    def weights(self) -> Array:
        """Fraction (nq, nt) of the volume of an element at each point, with the sum 1."""
        volumes = np.array([point.geometry.volume for point in self.points])
        return np.asarray(volumes / volumes.sum(axis=0))

    @cached_property
    def material_of(self) -> NDArray[np.int64]:
        """Index (nt,) of each combination of terms on elements: stress jumps between them."""
        element_sets = [part.elements for part in self.parts] + [part.elements for part in self.volume_parts]
        covered = np.zeros((len(element_sets), self.mesh.nt), dtype=bool)
        for row, elements in zip(covered, element_sets, strict=True):
            row[elements] = True
        return np.unique(covered, axis=1, return_inverse=True)[1].reshape(-1)


class Response:
    """Strain and stress of a body at displacements `u` (nv, d) [m] at one point of each element, in its frame there.

    Each is computed at first use. `point` is the point, by default the first, the only one of linear simplices.
    """

    def __init__(self, fields: ElasticBody, u: Array, point: ElementPoint | None = None) -> None:
        self.fields, self.u, self.point = fields, u, point or fields.points[0]
        self._cache: dict[Any, Masked] = {}

    def value(self, function: Callable[[Response], Masked]) -> Masked:
        """Return the finite values by element from a function of this response, and a mask of invalid ones; computed once."""
        if function not in self._cache:
            self._cache[function] = function(self)
        return self._cache[function]

    @property
    def without_strain(self) -> NDArray[np.bool_]:
        """Whether (nt,) an element has no strain: below three dimensions the strain across follows from the material."""
        return self.fields.without_term if self.fields.mesh.k < 3 else self.fields.removed

    @cached_property
    def gradient(self) -> Array:
        """Derivatives (nt, d, k) of the displacement along the elements' axes; 0 for removed elements, as at rest."""
        corners = self.u[self.fields.mesh.t.T]
        found = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2) @ self.point.geometry.gradients[:, 1:]  # sum (u_a - u_0) (x) g_a
        found[self.fields.removed] = 0
        return found

    @property
    def strain(self) -> Array:
        """Green-Lagrange strain (nt, 3, 3) in the elements' frames."""
        return self._response[0]

    @property
    def natural_strain(self) -> Array:
        """The strain (nt, 3, 3) without the folds of elements that wrinkle."""
        return self._response[4]

    @property
    def stress(self) -> Array:
        """Second Piola-Kirchhoff stress (nt, 3, 3) in the elements' frames [Pa]."""
        return self._response[1]

    @property
    def energy_density(self) -> Array:
        """Strain energy per rest volume (nt,) [J/m^3]."""
        return self._response[2]

    @property
    def shrunk(self) -> NDArray[np.bool_]:
        """Whether (nt,) the second Piola-Kirchhoff stress is infinite, for a `VolumePenalty` or another law at `J = 0`."""
        return self._response[3]

    @cached_property
    def _response(self) -> tuple[Array, Array, Array, NDArray[np.bool_], Array]:
        """Strain, stress and energy density, summed over the terms by their sections; a mask of infinite stress, which is set to
        0; and the natural strain.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            strain, stress, density, shrunk, natural = self._summed_over_terms()
        if not np.isfinite(stress).all() or not np.isfinite(density).all():
            largest = np.abs(self.u).max()
            raise StateError(f"Stresses overflow at displacements of up to {largest:.1e}: the previous step may have diverged.")
        return strain, stress, density, shrunk, natural

    def _summed_over_terms(self) -> tuple[Array, Array, Array, NDArray[np.bool_], Array]:
        fields, k = self.fields, self.fields.mesh.k
        axes, frames = self.point.geometry.axes, self.point.frames
        along = np.swapaxes(axes, 1, 2) @ self.gradient
        small = (along + np.swapaxes(along, 1, 2)) / 2  # (A'H + H'A)/2 in the axes A: the strain of linear elasticity
        within = small + np.swapaxes(self.gradient, 1, 2) @ self.gradient / 2  # Green-Lagrange's, without cancellation
        natural, stress, density = np.zeros((len(within), 3, 3)), np.zeros((len(within), 3, 3)), np.zeros(len(within))
        shrunk = np.zeros(len(within), dtype=bool)
        for part in (part for part in fields.parts if part.law.has_stress):
            ids = part.elements
            if not part.law.has_response:
                linear = part.law.small_strain
                small_or_green = small if linear else within
                E, S = strain_and_stress(part.law.material, part.hypothesis, small_or_green[ids], frames[ids])
                W = (S * E).sum(axis=(1, 2)) / 2
                if linear:
                    E[:, :k, :k], E[:, k:, k:] = within[ids], green_strain_of(E[:, k:, k:])
            else:
                present = ~fields.removed[ids, None, None]  # removed elements may be anywhere
                deformed = axes[ids], present * self.gradient[ids], present * within[ids]
                E, S, W, lost = part.law.response(Deformation(ids, part.hypothesis, *deformed))
                shrunk[ids] |= lost
            share = part.section / fields.section[ids]
            natural[ids] += (part.section / fields.total_section[ids])[:, None, None] * E
            stress[ids] += share[:, None, None] * S
            density[ids] += share * W
        strain = natural.copy()
        strain[:, :k, :k] = within
        for penalty in fields.volume_parts:
            ids, gradient = penalty.elements, self.gradient[penalty.elements]
            psi, slope = penalty.term.density_and_slope(dilation(gradient), ids)
            S, lost = volume_stress(penalty.stiffness * slope, gradient, penalty.constrained_across)
            stress[ids] += S
            density[ids] += penalty.stiffness * psi
            shrunk[ids] |= lost
        stress[shrunk] = 0
        return strain, stress, density, shrunk, natural

    def globally(self, tensor: Array) -> Array:
        """Return a tensor (nt, 3, 3) from the elements' frames in global axes."""
        frames, mesh = self.point.frames, self.fields.mesh
        return tensor if mesh.k == mesh.d else frames @ tensor @ np.swapaxes(frames, 1, 2)
