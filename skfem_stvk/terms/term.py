"""Terms before there is a body: their region, its material, and the mass and stiffness of its elements."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from ..edges.bound_term import BoundTerm
from ..edges.materials import Hypothesis
from ..errors import StvkError
from ..mesh import ElementMesh


class Deformation(NamedTuple):
    """Deformation of elements at a point of each.

    Attributes
    ----------
    elements
        (n,) ids of the elements, for messages.
    hypothesis
        Components of strain or stress that vanish across them.
    axes
        (n, d, k) an orthonormal basis of their own line or plane at rest, as columns.
    gradient
        (n, d, k) derivatives of the displacement along these axes.
    strain
        (n, k, k) Green-Lagrange strain within the elements, without cancellation.
    """

    elements: NDArray[Any]
    hypothesis: Hypothesis
    axes: Array
    gradient: Array
    strain: Array


class PointResponse(NamedTuple):
    """Response of a law at a point of each of n elements, in a frame of their axes followed by the normals.

    Attributes
    ----------
    strain
        (n, 3, 3) Green-Lagrange strain of the material, including the strain across; without folds if it wrinkles.
    stress
        (n, 3, 3) second Piola-Kirchhoff stress [Pa]; 0 where it is infinite.
    density
        (n,) strain energy per rest volume [J/m^3].
    infinite
        (n,) whether the stress is infinite, for example where elements have no volume left.
    """

    strain: Array
    stress: Array
    density: Array
    infinite: NDArray[np.bool_]


class TermOrLoad:
    """A specification without a mesh, usable in many systems.

    Attributes
    ----------
    external
        Whether it is a load.
    region
        Name of a subdomain, element ids, or None for all elements.
    per_element
        Whether it is a sum over elements, facets or own nodes, so that forces of the parts of a divided body add up to those of the
        body.
    """

    external: ClassVar[bool] = False
    region: Any = None
    per_element: Any = False

    @property
    def given(self) -> Any:
        """The user's object."""
        return self


class Term(TermOrLoad, ABC):
    """A specification of an elastic term or a contact. The defaults are those of a term without elements.

    Attributes
    ----------
    simplices
        Elements of its own on the nodes of the mesh; None without them.
    material
        Its material; None without one.
    resists_inversion
        Whether elements that invert are pushed back, or cannot invert.
    has_mass
        Whether its elements have a `mass`.
    is_law
        Whether it is a law of a material on elements, with a `hypothesis` and a `section`. Strain and stress at a point follow from
        the material unless it has a `response` of its own.
    has_stress
        Whether stress and energy density of a law are known; a law of forces on nodes has none.
    has_response
        Whether a law has a `response` other than St. Venant-Kirchhoff's `S = C : E` of its material.
    between_parts
        Whether it acts between parts of a body that share no nodes, so that a mesh may be in parts.
    small_strain
        Whether the stress of a law is that of the small strain.
    wrinkling
        Whether a law gives way to compression by folds.
    has_pressure
        Whether it is an energy of volume ratios, with the members of `VolumePenalty`.
    without_mass
        Reason for which its nodes have no mass, for messages; empty without one of its own.
    """

    resists_inversion: ClassVar[bool] = False
    has_mass: ClassVar[bool] = False
    is_law: ClassVar[bool] = False
    between_parts: ClassVar[bool] = False
    small_strain: ClassVar[bool] = False
    has_pressure: ClassVar[bool] = False
    simplices: Any = None
    material: Any = None
    has_stress: Any = True
    has_response: Any = False
    wrinkling: bool = False
    without_mass: Any = ""

    @abstractmethod
    def bind(self, body: Any, dtype: DTypeLike) -> BoundTerm:
        """Return the term on a body.

        Parameters
        ----------
        body
            Body, or its mesh alone, which has thickness or area 1 and no materials.
        dtype
            Type of results and of stored numbers, float64 or float32.
        """

    def hypothesis(self, mesh: ElementMesh) -> Hypothesis:
        """Return the hypothesis of a law: the components of strain or stress that vanish across the elements of this mesh.

        Raises
        ------
        MaterialError
            if its `plane`, `thickness` or `area` does not apply to them; if it has its own simplices, which a `System` connects.
        """
        raise StvkError(f"{type(self).__name__} is no law of a material; expected one such as StVK.")

    def response(self, at: Deformation) -> PointResponse:
        """Return strain, stress and energy of a law at a point of all elements of its `region`, in their order.

        Parameters
        ----------
        at
            Deformation of the elements at a point of each.

        Raises
        ------
        MaterialError
            if the law has forces and no stress (`has_stress`).
        StateError
            for inverted or flat elements, where the energy is infinite.
        """
        raise StvkError(f"{type(self).__name__} has no response of its own; its stress follows from its material.")

    def mass(self, mesh: ElementMesh, sizes: Array) -> Array:
        """Return the masses (n,) [kg] of the region's elements, from their lengths, areas or volumes `sizes` (n,).

        Raises
        ------
        MaterialError
            if a material has no density.
        """
        return np.zeros(len(sizes))

    def section(self, mesh: ElementMesh, n: int) -> Any:
        """Return the factor from the size of each of n elements to its volume: thickness, area or 1; None without elements."""
        return None

    def confined_modulus(self, mesh: ElementMesh, n: int) -> Array:
        """Return `lam + 2 mu` [Pa] of n elements, a number or (n,); 0 without a material."""
        return np.zeros(n)

    def elements_held_in_shape(self, mesh: ElementMesh) -> NDArray[np.int64]:
        """Return the ids (n,) of elements that are rigid as long as the term has no energy.

        These are the elements of a law; those with springs along all edges.
        """
        return mesh.elements(self.region) if self.is_law else np.empty(0, dtype=np.int64)


class PlainSpecification(Term):
    """Term or load of a user's class that inherits from neither `Term` nor `Load`: its members, and defaults of those it lacks."""

    of_methods: ClassVar[dict[str, str]] = {
        "has_mass": "mass",
        "is_law": "hypothesis",
        "has_response": "response",
        "has_pressure": "density_and_slope",
    }

    def __init__(self, of: Any) -> None:
        declared = [name for name in (*vars(TermOrLoad), *vars(Term)) if name[0] != "_" and name not in ("bind", "given")]
        vars(self).update(of=of, **{name: hasattr(of, method) for name, method in self.of_methods.items()})
        vars(self).update({name: getattr(of, name) for name in declared if hasattr(of, name)})

    @property
    def given(self) -> Any:
        return self.of

    def bind(self, body: Any, *dtype: DTypeLike) -> BoundTerm:
        return cast(BoundTerm, self.of.bind(body, *dtype))

    def __getattr__(self, name: str) -> Any:
        if name == "of" or name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.of, name)


def specified(term: Any) -> Any:
    """Return a term or load with all members of a specification; refuse an object that does not bind."""
    if isinstance(term, TermOrLoad):
        return term
    if isinstance(term, type) or not hasattr(term, "bind"):
        name = term.__name__ if isinstance(term, type) else type(term).__name__
        raise StvkError(f"Got a term of type {name}; expected StVK(...) or a list of terms.")
    return PlainSpecification(term)
