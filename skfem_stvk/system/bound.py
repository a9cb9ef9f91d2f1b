"""Terms bound to one mesh: their names, and the checks of the shape of the body."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..arguments import Array, number, whole_array
from ..edges.bound_term import Bound, BoundElements, BoundTerm, bound, joined
from ..edges.elements import Quadrature
from ..edges.pairs import PairTerm
from ..errors import ContactError, RegionError, StvkError, warn
from ..mesh import ElementMesh
from ..mesh.displacements import by_vertex
from ..terms import (
    Body,
    BoundLoad,
    Load,
    Term,
    is_load,
)
from ..terms.connectivity import Connected
from ..terms.loads.contact import BoundContact
from ..terms.loads.load import Moment, Time, bound_load
from ..terms.term import specified

#: Elements below this fraction of their volume are flat: the remaining volume is round-off.
FLAT = 1e-9


class BoundTerms:
    """Terms and loads on one mesh, with results of a `dtype`.

    The specifications `terms` consist of `elastic_terms` for internal forces and `loads` for external forces. `bound_terms` and
    `bound_loads` are their forms on this mesh. `pair_terms` are the elastic ones with their blocks.

    The `body` is the mesh with the terms on its elements. Terms on elements of lower dimensions, on the same nodes, belong to the
    bodies `body.beside`. Element ids are those of the mesh.
    """

    def __init__(
        self,
        mesh: ElementMesh,
        terms: Sequence[Term | Load],
        dtype: DTypeLike,
        quadrature: Quadrature | None = None,
        connectivity: Connected | None = None,
    ) -> None:
        self.mesh, self.space, self.ndofs = mesh, mesh.space, mesh.p.size
        specifications = [specified(term) for term in terms]
        self.dtype, self.terms = np.dtype(dtype), tuple(one.given for one in specifications)
        beside = () if connectivity is None else connectivity.beside
        of = (0,) * len(specifications) if connectivity is None else connectivity.of
        self.loads: tuple[Load, ...] = tuple(filter(is_load, specifications))
        self.elastic_terms: tuple[Any, ...] = tuple(term for term in specifications if not is_load(term))
        if not self.elastic_terms:
            raise StvkError("Got only loads; expected at least one elastic term, such as StVK(young=..., poisson=...).")
        if mesh.space.comm.divided:
            _refuse_not_additive(specifications)
        self._of = tuple(number for number, term in zip(of, specifications, strict=True) if not is_load(term))
        others = [Body(one, self._terms_on(number)) for number, one in enumerate(beside, start=1)]
        self.body = Body(mesh, self._terms_on(0), quadrature, others)
        bodies = (self.body, *others)
        self.bound_terms: tuple[BoundTerm, ...] = tuple(
            bound(term.bind(bodies[number], self.dtype)) for number, term in zip(self._of, self.elastic_terms, strict=True)
        )
        self.bound_loads: tuple[BoundLoad, ...] = tuple(bound_load(load.bind(self.body)) for load in self.loads)
        self._sort()
        names = [contact.name for contact in self.contacts]
        if len(set(names)) < len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            listed = ", ".join(f"name = {name!r}" for name in twice)
            raise ContactError(f"{listed}: several contacts; expected a name of its own for each, such as name='floor'.")
        self.pair_terms = tuple(term.with_blocks(mesh.nv, mesh.d, self.dtype) for term in self.bound_terms)
        self._used = np.zeros(mesh.nv, dtype=bool)
        for term in self.bound_terms:
            self._used[term.nodes_paired.ravel()] = True
        bare = self.space.share(self._used.astype(float)) == 0
        if self.space.comm.any(bool(bare.any())):
            warn(f"{mesh.name_nodes(bare)}: in no term, so their rows of K are zero. Is a region missing from the terms?")

    def _sort(self) -> None:
        """Sort the bound terms and loads by what they can do."""
        every: tuple[Bound, ...] = (*self.bound_terms, *self.bound_loads)
        #: Terms that tie the body to the ground, such as foundations.
        self.foundations = [term for term in self.bound_terms if term.grounded is not None]
        #: Bound terms of contact, and their numbers among the bound terms.
        self.contacts = [term for term in self.bound_terms if isinstance(term, BoundContact)]
        self.contact_numbers = [i for i, term in enumerate(self.bound_terms) if term in self.contacts]
        of_foundations = [term.grounded for term in self.foundations]
        tied = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *of_foundations]))
        self.grounded = self.space.union(tied, self.ndofs)
        # Indices of the terms with a history, and of those that depend on more than displacements: on time, history, an assumption.
        self._with_history = [i for i, term in enumerate(self.bound_terms) if term.has_history]
        self._changing = frozenset(i for i, term in enumerate(self.bound_terms) if term.takes_time)
        self._last_terms: tuple[Moment, tuple[BoundTerm, ...]] | None = None
        self._with_changing_pairs = [one for one in every if one.pairs_change]
        every_elastic = zip(self._of, self.elastic_terms, self.bound_terms, strict=True)
        self.on_elements = [(number, of, term) for number, of, term in every_elastic if isinstance(term, BoundElements)]
        self.__dict__.pop("_with_volume", None)
        self._on_elements_of_mesh = [(of, term) for number, of, term in self.on_elements if number == 0]
        self.working_contacts = [term for term in self.contacts if term.does_work]
        self.elastic_names = [name for name, term in self._named if not is_load(term)]
        self.without_energy = [name for name, term in zip(self.elastic_names, self.bound_terms, strict=True) if not term.has_energy]
        elastic = not self.without_energy and all(term.symmetric for term in self.bound_terms)
        self.conservative = elastic and all(load.has_potential for load in self.bound_loads)
        self.dead = elastic and all(load.dead for load in self.bound_loads)
        self.constant_tangent = self.dead and all(term.constant_tangent for term in self.bound_terms)
        self.quartic = all(term.quartic for term in self.bound_terms)
        self.resists_inversion = any(term.resists_inversion for term in self.elastic_terms)
        self.removed, self.bare = np.flatnonzero(self.body.removed), np.flatnonzero(self.body.bare)

    @cached_property
    def _with_volume(self) -> list[tuple[NDArray[np.int64], BoundElements]]:
        """Terms that provide volume ratios, and the ids of their elements; most often the first term covers all elements."""
        retained: list[tuple[NDArray[np.int64], BoundElements]] = []
        known = np.zeros(self.mesh.nt, dtype=bool)
        for specification, term in self._on_elements_of_mesh:
            elements = self.mesh.elements(specification.region)
            if not known[elements].all():
                retained.append((elements, term))
            known[elements] = True
        return retained

    def _terms_on(self, number: int) -> list[Any]:
        """Return the elastic terms on the mesh, for number 0, or on one of the meshes of lower dimensions."""
        return [term for one, term in zip(self._of, self.elastic_terms, strict=True) if one == number]

    @property
    def _on_mesh(self) -> list[tuple[Any, BoundTerm]]:
        """Elastic terms on the elements of the mesh: pairs of specification and bound term."""
        every = zip(self._of, self.elastic_terms, self.bound_terms, strict=True)
        return [(specification, term) for number, specification, term in every if number == 0]

    def _refuse_terms_without_removal(self) -> None:
        """Raise StvkError if a term or load does not support the removal of elements."""
        unsupported = [type(term.given).__name__ for term, bound in self._on_mesh if not bound.removable]
        unsupported += [
            type(load.given).__name__
            for load, bound in zip(self.loads, self.bound_loads, strict=True)
            if not bound.removable and bound.pairs_change
        ]
        if unsupported:
            raise StvkError(
                f"{', '.join(unsupported)}: elements cannot be removed from it; expected a method without(removed), as in "
                "skfem_stvk.edges.bound_term.Bound; or build a System of the mesh without these elements."
            )

    def _remove_elements(self, elements: NDArray[np.int64]) -> None:
        """Replace the body, the terms and the loads of a copy by those without these elements."""
        removed = self.body.removed.copy()
        removed[elements] = True

        def remaining(specification: Any, bound: Any) -> Any:
            return bound.without(removed[self.mesh.elements(specification.region)])

        every = zip(self._of, self.elastic_terms, self.bound_terms, strict=True)
        terms = [term if number else remaining(specification, term) for number, specification, term in every]
        joined_nodes = np.zeros(self.mesh.nv, dtype=bool)
        for term in terms:
            joined_nodes[joined(term).ravel()] = True
            if term.grounded is not None:
                joined_nodes[term.grounded // self.mesh.d] = True
        self.body = self.body.without(removed, self._used & ~joined_nodes)
        loads = [
            remaining(load, bound) if bound.removable else bound_load(load.bind(self.body))
            for load, bound in zip(self.loads, self.bound_loads, strict=True)
        ]
        self._replace_bound(terms, loads)

    def _replace_bound(self, terms: Sequence[Any], loads: Sequence[BoundLoad]) -> None:
        """Replace the bound terms and loads of a copy by others that couple the same pairs."""
        self.bound_terms, self.bound_loads = tuple(terms), tuple(loads)
        # terms whose pairs change have blocks of their own: those of two bodies may have the same version, and other pairs
        self.pair_terms = tuple(
            term.with_blocks(self.mesh.nv, self.mesh.d, self.dtype) if term.pairs_change else pairs.with_term(term)
            for pairs, term in zip(self.pair_terms, self.bound_terms, strict=True)
        )
        self._sort()

    def terms_at(self, t: Time) -> tuple[BoundTerm, ...]:
        """Return the bound terms at the load factor or moment `t`, with the history of its step."""
        known = self._last_terms  # read once, since other threads write it
        if known is not None and known[0] is t:
            return known[1]
        moment = self._moment(t)
        if not self._changing:
            return self.bound_terms
        histories = iter(() if moment.step is None else moment.step.history)
        history = {i: next(histories, None) for i in self._with_history}
        terms = tuple(term.at(moment, history.get(i)) if i in self._changing else term for i, term in enumerate(self.bound_terms))
        if isinstance(t, Moment):  # a step evaluates them several times at one moment
            self._last_terms = t, terms
        return terms

    def pairs_at(self, t: Time) -> tuple[PairTerm, ...]:
        """Return `terms_at` with their blocks."""
        if not self._changing:
            return self.pair_terms
        return tuple(pairs.with_term(term) for pairs, term in zip(self.pair_terms, self.terms_at(t), strict=True))

    def _moment(self, t: Time) -> Moment:
        """Return the moment of load factor or time `t`, checked. A subclass may evaluate terms at another moment."""
        return Moment.checked(t)

    def first_history(self) -> tuple[Array, ...]:
        """Return the history of each term that has one, before the first step of an analysis."""
        return tuple(self.bound_terms[i].first_history() for i in self._with_history)

    def advanced(self, history: Sequence[Array], u: ArrayLike, t: Time) -> tuple[Array, ...]:
        """Return the history of a step that begins at displacements `u` (ndofs,), at `t`, after a step with this `history`."""
        if not history:
            return ()
        x, moment, terms = self._state(u), self._moment(t), (self.bound_terms[i] for i in self._with_history)
        return tuple(term.advanced(one, x, moment) for term, one in zip(terms, history, strict=True))

    def after_step(self, history: Sequence[Array]) -> tuple[Array, ...]:
        """Return the history after a step that began with it: pairs of nodes that K couples by now are added."""
        terms = (self.bound_terms[i] for i in self._with_history)
        return tuple(term.after_step(one) for term, one in zip(terms, history, strict=True))

    def return_to(self, history: Sequence[Array]) -> None:
        """Prepare for steps from an earlier history. Raises ValueError if it is of another body."""
        if len(history) != len(self._with_history):
            raise ValueError(f"it has the histories of {len(history)} terms; expected {len(self._with_history)}")
        for i, one in zip(self._with_history, history, strict=True):
            self.bound_terms[i].return_to(one)

    def smallest_volume_ratio(self, u: ArrayLike) -> float:
        """Return the smallest volume ratio `J` of an element at `u` to rest; an element with `J < 0` is inverted.

        For triangles in space and segments in more than one dimension `J` is the ratio of areas and lengths, which has no sign.
        StateError as in `energy`.
        """
        x = self._state(u)
        return self.space.comm.least(min((term.smallest_volume_ratio(x) for _, term in self._with_volume), default=np.inf))

    def step_limit(self, u: ArrayLike, v: ArrayLike) -> float:
        """Return the smallest `s > 0` at which an element with `J > 0` at `u` becomes flat at `u + s v`; infinity if none does.

        The result is exact, because `J` is a cubic in `s`. Triangles in space and segments in more than one dimension have no
        orientation and give no limit. StateError as in `energy`, for `v` too.

        Examples
        --------
        >>> import skfem
        >>> from skfem_stvk import StVK, System
        >>> mesh = skfem.MeshTet().refined(1)
        >>> body = System(mesh, StVK(young=1.0, poisson=0.3))
        >>> flatter = -0.5 * (mesh.p * [[0], [0], [1]]).ravel("F")
        >>> round(body.step_limit(0 * flatter, flatter), 12)
        2.0
        """
        x, y = self._state(u), self._state(v, "v")
        return self.space.comm.least(min((term.step_limit(x, y) for _, term in self._with_volume), default=np.inf))

    def contacts_at(self, t: Time) -> list[BoundContact]:
        """Return the contacts at the load factor or moment `t`, with the history of its step."""
        terms: Sequence[Any] = self.terms_at(t) if self.contacts else ()
        return [terms[i] for i in self.contact_numbers]

    def inside_out(self, u: ArrayLike) -> NDArray[np.int64]:
        """Return the ids of the inverted or flat elements at `u`, ascending: `J <= FLAT`. StateError as in `energy`."""
        if self.mesh.k < self.mesh.d or self.smallest_volume_ratio(u) > FLAT:
            return np.empty(0, dtype=np.int64)
        return self.mesh.ids_of_all(inverted_in_part(self, u))

    def smallest_stretch(self, u: ArrayLike) -> float:
        """Return the smallest principal stretch of the mesh's elements at `u`: 1 at rest, 0 if flat. Errors as in `energy`.

        The stretch is measured within the element's own dimensions.

        Below 1/sqrt(3) = 0.577 a St. Venant-Kirchhoff body softens: under uniaxial compression more shortening takes less force.
        """
        x = self._state(u)
        return self.space.comm.least(min((term.smallest_stretch(x) for _, term in self._on_elements_of_mesh), default=np.inf))

    @property
    def _named(self) -> list[tuple[str, Any]]:
        return [(f"{type(term).__name__} {number}", term) for number, term in enumerate(self.terms)]

    def _state(self, u: ArrayLike, name: str = "u") -> Array:
        """Return displacements as (nv, d). All parts of a divided body call this method together."""
        with self.space.comm.together():
            return by_vertex(self.mesh, u, name)


def inverted_in_part(body: BoundTerms, u: ArrayLike) -> NDArray[np.int64]:
    """Return the ids of the elements of `inside_out` in this part of a divided body."""
    x, ids = body._state(u), [np.empty(0, dtype=np.int64)]
    ids += [elements[term.volume_ratios(x) <= FLAT] for elements, term in body._with_volume]
    return np.unique(np.concatenate(ids))


def compressed_in_part(body: BoundTerms, u: ArrayLike, below: float) -> NDArray[np.int64]:
    """Return the ids of the elements of `compressed` in this part of a divided body."""
    x, below, ids = body._state(u), number("below", below, "a finite stretch"), [np.empty(0, dtype=np.int64)]
    for specification, term in body._on_elements_of_mesh:
        if term.smallest_stretch(x) < below:
            ids.append(body.mesh.elements(specification.region)[term.smallest_stretches(x) < below])
    return np.unique(np.concatenate(ids))


def elements_to_remove(body: BoundTerms, elements: Any) -> NDArray[np.int64]:
    """Return the ids of the named elements that are not removed yet, ascending; errors as in `System.without`."""
    ids_or_mask = whole_array(elements)
    none = ids_or_mask is not None and (
        ids_or_mask.shape == (0,) or (ids_or_mask.dtype == bool and ids_or_mask.shape == (body.mesh.nt,))
    )
    none = none and not np.any(ids_or_mask)
    ids = np.empty(0, dtype=np.int64) if none else body.mesh.elements(elements)
    removed = body.body.removed.copy()
    removed[ids] = True
    if removed.all():
        raise RegionError(
            f"All {body.mesh.nt} elements would be removed; expected at least one to remain. Is the limit or the mask inverted?"
        )
    return np.flatnonzero(removed & ~body.body.removed)


def _refuse_not_additive(terms: Sequence[Any]) -> None:
    """Raise StvkError for terms of which the forces of the parts of a divided body do not add up to those of the body."""
    if names := [f"{type(term.given).__name__} {n}" for n, term in enumerate(terms) if not term.per_element]:
        raise StvkError(
            f"{', '.join(names)}: not a sum over elements (per_element = False), so the forces of the parts of a divided body "
            "would not add up; expected other terms, such as StVK(...), or one rank."
        )


def checked_terms(value: Any) -> tuple[Any, ...]:
    """Return one term or several as a tuple; raise StvkError for an object that is not a term."""
    terms = tuple(value) if isinstance(value, Sequence) else (value,)
    if not terms:
        raise StvkError("Got no terms; expected at least one, such as StVK(young=..., poisson=...).")
    return tuple(specified(term) for term in terms)
