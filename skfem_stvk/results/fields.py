"""Fields of a body by element and by node, for any displacements: what its mesh and its terms give, kept."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import StvkError
from ..materials import Hypothesis, Material
from ..mesh import MeshLike, SimplexMesh
from ..mesh.displacements import by_vertex
from ..mesh.geometry import Geometry
from ..terms import Body, HasPressure, HasStress
from .frames import rest_frames
from .kinematics import Array
from .nodal import NodalAverage
from .state import State


@dataclass(frozen=True)
class Part:
    """A term on its elements, with their sections (thickness, area or 1)."""

    elements: NDArray[np.int64]
    material: Material
    hypothesis: Hypothesis
    section: Array


@dataclass(frozen=True)
class VolumePart:
    """A volume penalty on its elements, with its stiffness [Pa], and whether something keeps them from giving way across."""

    elements: NDArray[np.int64]
    term: HasPressure
    stiffness: Array
    held_across: NDArray[np.bool_]


class Fields:
    """Strains and stresses of a body, for any displacements of it.

    Parameters
    ----------
    mesh : as `System` takes it.
    terms : a term, or several; loads among them carry no stress and are passed over.

    Where several terms share an element, their forces add up: stress is that of all of them per `section`, the largest of theirs (the
    same for all in solids), and a strain across that differs between them is averaged, weighted by their sections. The stress of one
    of them is that of `Fields(mesh, [term])`.

    Attributes
    ----------
    section : (nt,) thickness [m], area [m^2] or 1.
    volume : (nt,) rest volume [m^3]: length, area or volume times section.
    without_term : (nt,) whether an element is in no term.

    Raises
    ------
    MaterialError, RegionError
        if a term does not fit the mesh.
    StvkError
        if none of the terms carries stress.

    >>> import skfem
    >>> mesh = skfem.MeshTet().refined(1)
    >>> now = Fields(mesh, StVK(young=2.6, poisson=0.3)).at(0.1 * mesh.p.ravel("F"))   # 10 % larger in all directions
    >>> E = (1.1**2 - 1) / 2                             # S = 3 K E I, sigma = F S F'/J = 3 K E/1.1 I with K = 13/6
    >>> bool(np.allclose(now["green_strain"], E * np.eye(3))), bool(np.allclose(now["cauchy"], 6.5 * E / 1.1 * np.eye(3)))
    (True, True)
    """

    def __init__(self, mesh: MeshLike, terms: Any) -> None:
        self.mesh = SimplexMesh.of(mesh)
        every = list(terms) if isinstance(terms, Iterable) and not isinstance(terms, np.ndarray) else [terms]
        carrying = [term for term in every if isinstance(term, HasStress)]
        penalties = [term for term in every if isinstance(term, HasPressure)]
        if not carrying and not penalties:
            raise StvkError("None of the terms carries stress; expected at least one StVK(...).")
        self.parts = [self._part(term) for term in carrying]
        self.section, self.total_section = np.zeros(self.mesh.nt), np.zeros(self.mesh.nt)
        for part in self.parts:
            self.section[part.elements] = np.maximum(self.section[part.elements], part.section)
            self.total_section[part.elements] += part.section
        self.without_term: NDArray[np.bool_] = self.total_section == 0
        self.section[self.without_term] = 1.0
        body = Body(self.mesh, carrying)
        self.volume_parts = [self._volume_part(term, body) for term in penalties]
        for penalty in self.volume_parts:
            self.without_term[penalty.elements] = False

    def _part(self, term: HasStress) -> Part:
        elements, hypothesis = self.mesh.elements(term.region), term.hypothesis(self.mesh)
        term.material.check(len(elements), hypothesis)
        section = np.broadcast_to(term.section(self.mesh, len(elements)), len(elements))
        return Part(elements, term.material, hypothesis, section)

    def _volume_part(self, term: HasPressure, body: Body) -> VolumePart:
        """What no other term is on is in plane strain."""
        held = (self.total_section == 0) & (self.mesh.k > 1)
        for part in self.parts:
            held[part.elements] |= not part.hypothesis.condensed
        elements = self.mesh.elements(term.region)
        return VolumePart(elements, term, term.moduli(body), held[elements])

    @cached_property
    def geometry(self) -> Geometry:
        return Geometry(self.mesh.p, self.mesh.t)

    @cached_property
    def frames(self) -> Array:
        """(nt, 3, 3) axes and normals of the simplices at rest."""
        return rest_frames(self.geometry.axes)

    @cached_property
    def volume(self) -> Array:
        volume: Array = self.geometry.volume * self.section
        return volume

    @cached_property
    def average(self) -> NodalAverage:
        return NodalAverage(self.mesh.t, self.volume, self.mesh.nv)

    @cached_property
    def material_of(self) -> NDArray[np.int64]:
        """(nt,) a number for each combination of terms that elements are in: stress jumps between them."""
        every = [part.elements for part in self.parts] + [part.elements for part in self.volume_parts]
        covered = np.zeros((len(every), self.mesh.nt), dtype=bool)
        for row, elements in zip(covered, every, strict=True):
            row[elements] = True
        return np.unique(covered, axis=1, return_inverse=True)[1].reshape(-1)

    def at(self, u: ArrayLike, v: ArrayLike | None = None) -> State:
        """The state at displacements `u` (ndofs,) [m], of a body in motion with velocities `v` (ndofs,) [m/s].

        Raises
        ------
        StateError
            if `u` or `v` does not have one finite entry for each degree of freedom.
        """
        moving = None if v is None else by_vertex(self.mesh, v, "v").astype(np.float64)
        return State(self, by_vertex(self.mesh, u).astype(np.float64), moving)
