"""A system: terms that share one mesh and one pattern of K, its loads and its supports."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array, number, shown
from ..edges import ALL, Rows, Tensions
from ..errors import LoadError, StateError, StvkError, name_ids, warn
from ..kernels.threads import Turn
from ..mesh import MeshLike, SimplexMesh
from ..mesh.diagnostics import check_mesh, warn_of_flat_elements
from ..mesh.displacements import all_finite, by_vertex
from ..mesh.places import DofsView
from ..terms import (
    Body,
    BoundLoad,
    BoundTerm,
    Grounded,
    HasStress,
    HasStretch,
    HasVolume,
    Load,
    Quartic,
    Term,
    is_load,
)
from ..terms.load import Moment, Time
from .free import FreeDofs
from .held import check_held, grounded_dofs
from .mass import Mass, kind_of_mass
from .operator import TangentOperator
from .pattern import Pattern
from .rigid import parts_of
from .supports import Displacements, Supports, dofs_at

#: Elements of a smaller part of their volume are flat: what is left of it is rounding.
FLAT = 1e-9


class System:
    """An elastic body: its strain energy W, internal force F and tangent stiffness K; what acts on it, and how it is held.

        W = 1/4 sum L_ij zeta_i zeta_j        F = dW/du        K = d2W/du2

    over edges and tetrahedron-sharing edge pairs, `zeta` the squared elongations of the edges. Displacements `u` are flat vectors
    with the degree of freedom `d * vertex + component`, scikit-fem's for `ElementVector(ElementTetP1())`.

    `energy`, `internal_force`, `tangent` and `product` are elastic; `potential`, `residual` and `jacobian` are those of all terms, at the
    load factor `t`. Supports change none of them: they say which degrees of freedom a solver keeps.

    Parameters
    ----------
    mesh : scikit-fem mesh of simplices, arrays `(p, t)`, or `SimplexMesh`.
    terms : a term, or several that add up: `StVK`, `VolumePenalty`, `ElasticFoundation`; the loads `Gravity`, `BodyForce`, `NodalLoad`, `Traction`, `Pressure`.
    fixed : components that do not move, by place: `{"wall": "xyz", "symmetry": "y"}`. A place is the name of a boundary or of a node
        set, vertex ids, a predicate of the coordinates, as in scikit-fem, or what its `basis.get_dofs(...)` returned, which stands for its
        vertices. As a whole, `fixed=basis.get_dofs(...)`, it is its own degrees of freedom; bare integers are always vertices.
    prescribed : displacements by place and component: `{"handle": {"x": 0.01}}` [m], reached at t = 1; or functions of (x, t).
    dtype : float64, or float32: half the memory, faster on large meshes, with errors of 1e-6 instead of 1e-15 (of the largest entry, and
        on elements that are not flat).

    Raises
    ------
    MeshError, MaterialError, RegionError, LoadError, SupportError
        for what cannot carry an elastic body, load or hold it, before any work, with ids.

    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK
    >>> mesh = skfem.MeshTet().refined(2)
    >>> body = System(mesh, StVK(young=1e5, poisson=0.3))
    >>> u = 0.01 * mesh.p.ravel("F")                     # 1 % larger in all directions
    >>> round(body.energy(u), 4), round(9 / 2 * 1e5 / 1.2 * 0.01005**2, 4)
    (37.8759, 37.8759)
    >>> bool(abs(body.internal_force(u).reshape(-1, 3).sum(axis=0)).max() < 1e-10)
    True
    >>> K = body.tangent(u)
    >>> K.shape, bool(abs(K - K.T).max() < 1e-10)
    ((345, 345), True)
    """

    def __init__(
        self,
        mesh: MeshLike,
        terms: Term | Load | Sequence[Term | Load],
        fixed: Displacements | DofsView | None = None,
        prescribed: Displacements | None = None,
        *,
        dtype: DTypeLike = np.float64,
    ) -> None:
        self.mesh = SimplexMesh.of(mesh)
        check_mesh(self.mesh)
        self.dtype = _float_type(dtype)
        self.terms = tuple(terms) if isinstance(terms, Sequence) else (terms,)
        if not self.terms:
            raise StvkError("No terms came; expected at least one, such as StVK(young=..., poisson=...).")
        if self.dtype == np.float32:
            warn_of_flat_elements(self.mesh)
        for term in self.terms:
            if isinstance(term, type) or not hasattr(term, "bind"):
                name = term.__name__ if isinstance(term, type) else type(term).__name__
                raise StvkError(f"A term of type {name} came; expected StVK(...) or a list of terms.")
        self.loads: tuple[Load, ...] = tuple(filter(is_load, self.terms))
        self.elastic_terms: tuple[Any, ...] = tuple(term for term in self.terms if not is_load(term))
        if not self.elastic_terms:
            raise StvkError("Only loads came; expected at least one elastic term, such as StVK(young=..., poisson=...).")
        self.supports = Supports(self.mesh, fixed, prescribed)
        self._body = Body(self.mesh, self.elastic_terms)
        self.bound_terms: tuple[BoundTerm, ...] = tuple(term.bind(self._body, self.dtype) for term in self.elastic_terms)
        self.bound_loads: tuple[BoundLoad, ...] = tuple(load.bind(self._body) for load in self.loads)
        self._masses: dict[str, Mass] = {}
        self._operator: TangentOperator | None = None
        self._turn = Turn()
        self._warn_of_bare_vertices()

    @property
    def elastic_names(self) -> list[str]:
        """Names of `elastic_terms` in `energies` and in messages: their types and their numbers among all terms."""
        return [name for name, term in self._named if not is_load(term)]

    @property
    def resists_inversion(self) -> bool:
        """Whether a term resists that elements turn inside out, as `VolumePenalty` does."""
        return any(getattr(term, "resists_inversion", False) for term in self.elastic_terms)

    @property
    def ndofs(self) -> int:
        """Number of degrees of freedom, `d * nv`."""
        return self.mesh.p.size

    @cached_property
    def pattern(self) -> Pattern:
        """The pattern that every K of this system has; made when it is first needed."""
        loads = [load.edges for load in self.bound_loads if load.edges.size]
        return Pattern(self.mesh.nv, self.mesh.d, [term.edges for term in self.bound_terms] + loads)

    @cached_property
    def _rows(self) -> list[Rows]:
        return [term.rows(self.pattern) for term in self.bound_terms]

    @cached_property
    def _load_places(self) -> list[Any]:
        return [load.places(self.pattern) for load in self.bound_loads]

    @cached_property
    def _with_volume(self) -> list[tuple[NDArray[np.int64], HasVolume]]:
        """Terms that know the volumes of all elements that any term has, and the ids of theirs; most often the first alone."""
        kept: list[tuple[NDArray[np.int64], HasVolume]] = []
        known = np.zeros(self.mesh.nt, dtype=bool)
        for specification, term in zip(self.elastic_terms, self.bound_terms, strict=True):
            if isinstance(term, HasVolume):
                elements = self.mesh.elements(specification.region)
                if not known[elements].all():
                    kept.append((elements, term))
                known[elements] = True
        return kept

    @property
    def conservative(self) -> bool:
        """Whether all loads have a potential; if not, the Jacobian is not symmetric."""
        return all(load.has_potential for load in self.bound_loads)

    @property
    def dead(self) -> bool:
        """Whether all loads keep their size and direction wherever the body goes; if so, the Jacobian is the tangent."""
        return all(load.dead for load in self.bound_loads)

    def energy(self, u: ArrayLike) -> float:
        """Strain energy `W(u)` [J].

        Raises
        ------
        StateError
            if `u` does not have one finite entry for each degree of freedom, or is so large that the result overflows.
        """
        x = self._state(u)
        energy = sum(term.energy(x) for term in self.bound_terms)
        refuse_overflow(energy, "W", x)
        return energy

    def internal_force(self, u: ArrayLike) -> Array:
        """Internal force `F = dW/du` (ndofs,) [N]; the residual of statics is `F - f_ext`.

        Raises
        ------
        StateError
            if `u` does not have one finite entry for each degree of freedom, or is so large that the result overflows.
        """
        x = self._state(u)
        _, force = self._energy_and_force(x)
        refuse_overflow(force, "F", x)
        return force.ravel()

    def energy_and_force(self, u: ArrayLike, out: Array | None = None) -> tuple[float, Array]:
        """`W(u)` [J] and `F(u)` (ndofs,) [N], for the price of one of them.

        Parameters
        ----------
        u : displacements (ndofs,) [m].
        out : where F is written; by default a new array.

        Raises
        ------
        StateError
            if `u` does not have one finite entry for each degree of freedom, or is so large that a result overflows.
        StvkError
            if `out` is no array of floats of that shape, in one piece.
        """
        x = self._state(u)
        energy, force = self._energy_and_force(x, None if out is None else array_to_fill(self.mesh, out))
        refuse_overflow(energy, "W", x)
        refuse_overflow(force, "F", x)
        return energy, force.reshape(-1) if out is None else out

    def tangent(self, u: ArrayLike, out: csr_matrix | None = None) -> csr_matrix:
        """Tangent stiffness `K = d2W/du2` (ndofs, ndofs) [N/m], always of the same pattern, zeros kept.

        Parameters
        ----------
        u : displacements (ndofs,) [m].
        out : a matrix that this method returned before, to be filled anew; by default a new one.

        Raises
        ------
        StateError
            if `u` does not have one finite entry for each degree of freedom, or is so large that the result overflows.
        StvkError
            if `out` has another pattern.
        """
        return self._elastic_tangent(u, out)

    def linearize(self, u: ArrayLike, out: csr_matrix | None = None) -> tuple[float, Array, csr_matrix]:
        """`W(u)`, `F(u)` and `K(u)` in one pass over the simplices, for little more than K; parameters and errors as of `tangent`."""
        x = self._state(u)
        K, force = self._matrix(out), np.zeros(x.shape, dtype=self.dtype)
        energy = self._fill(x, K, force)
        refuse_overflow(energy, "W", x)
        refuse_overflow(force, "F", x)
        return energy, force.ravel(), K

    def product(self, u: ArrayLike, v: ArrayLike) -> Array:
        """`K(u) v` (ndofs,) [N], without forming K.

        The first product at a `u` prepares what the next ones at the same `u` use again; they take less time than one with an assembled K.

        Raises
        ------
        StateError
            if `u` or `v` does not have one finite entry for each degree of freedom, or the result overflows.
        """
        x, y = self._state(u), self._state(v, "v").ravel()
        with self._turn:
            if self._operator is None:
                self._operator = self.linear_operator(u)
            elif not self._operator.is_at(x):
                self._operator.prepare(u)
            product = self._operator.matvec(y)
        refuse_overflow(product, "K v", x)
        return product

    def linear_operator(self, u: ArrayLike, *, kept: Tensions = ALL) -> TangentOperator:
        """`v -> K(u) v` as an operator of its own for `scipy.sparse.linalg`; `kept` as of `jacobian`.

        >>> import numpy as np, skfem
        >>> from skfem_stvk import StVK
        >>> body = System(skfem.MeshTet().refined(2), StVK(young=1e5, poisson=0.3))
        >>> u, v = np.zeros(body.ndofs), np.cos(np.arange(body.ndofs))
        >>> K = body.linear_operator(u)
        >>> bool(abs(K @ v - body.tangent(u) @ v).max() < 1e-9), bool(abs(K @ v - body.product(u, v)).max() == 0)
        (True, True)
        """
        return TangentOperator(self.bound_terms, self._state, u, self.dtype, _factors(kept))

    def external_force(self, u: ArrayLike, t: Time = 1.0) -> Array:
        """Sum of the loads (ndofs,) [N] at displacements `u` and load factor `t`.

        Raises
        ------
        StateError
            if `u` does not have one finite entry for each degree of freedom, or `t` is not finite.
        LoadError
            if a load that is given as a function does not return finite values.
        """
        x, force, moment = self._state(u), np.zeros(self.mesh.p.T.shape), Moment.checked(t)
        for load in self.bound_loads:
            load.add_force(x, moment, force)
        refuse_overflow(force, "The external force", x)
        return force.ravel()

    def potential(self, u: ArrayLike, t: Time = 1.0) -> float:
        """Total potential energy `W(u) + sum of the loads' potentials` [J]; its gradient is the residual.

        Raises
        ------
        StateError
            as `energy`.
        LoadError
            if a load has no potential, such as follower pressure.
        """
        moment = Moment.checked(t)
        return self.energy(u) + self._potential(self._state(u), moment)

    def residual(self, u: ArrayLike, t: Time = 1.0) -> Array:
        """`F(u) - f_ext(u, t)` (ndofs,) [N]; at rest it vanishes but for the reactions at the supports. Errors as of `energy`."""
        loads = self.external_force(u, t)
        return self.internal_force(u) - loads

    def jacobian(self, u: ArrayLike, t: Time = 1.0, out: csr_matrix | None = None, *, kept: Tensions = ALL) -> csr_matrix:
        """Derivative of the residual: `K(u)` minus the loads' `df_ext/du` (ndofs, ndofs) [N/m]; parameters and errors as of `tangent`.

        `kept` are the tensions of edges that stay in it: `TENSILE` and `NONE` of `skfem_stvk.edges` leave out all that can make K indefinite,
        what the pressure of a `VolumePenalty` adds as well. It is positive semi-definite then, but for the loads.
        """
        moment = Moment.checked(t)
        K = self._elastic_tangent(u, out, _factors(kept))
        for load, places in zip(self.bound_loads, self._load_places, strict=True):
            load.add_stiffness(self._state(u), moment, places, K.data)
        return K

    @cached_property
    def _turning(self) -> tuple[Pattern, list[tuple[BoundLoad, Any]]]:
        """Loads that have a potential and are not dead, and the pattern of their stiffness alone."""
        loads = [load for load in self.bound_loads if load.has_potential and not load.dead]
        pattern = Pattern(self.mesh.nv, self.mesh.d, [load.edges for load in loads])
        return pattern, [(load, load.places(pattern)) for load in loads]

    def load_stiffness(self, u: ArrayLike, t: Time = 1.0) -> csr_matrix | None:
        """`-df_ext/du` (ndofs, ndofs) [N/m] of the loads that have a potential and are not dead; None if there are none. Errors as in `jacobian`."""
        x, moment = self._state(u), Moment.checked(t)
        if not any(load.has_potential and not load.dead for load in self.bound_loads):
            return None
        pattern, loads = self._turning
        K = pattern.matrix(np.zeros(pattern.nnz))
        for load, places in loads:
            load.add_stiffness(x, moment, places, K.data)
        return K

    def energies(self, u: ArrayLike, t: Time = 1.0) -> dict[str, float]:
        """Energy by term [J], named after its type and number: strain energies, and the potentials of loads that have one."""
        x, moment = self._state(u), Moment.checked(t)
        elastic = iter(self.elastic_energies(u))
        loads = iter([load.potential(x, moment) if load.has_potential else None for load in self.bound_loads])
        values = {name: next(loads if is_load(term) else elastic) for name, term in self._named}
        return {name: value for name, value in values.items() if value is not None}

    def elastic_energies(self, u: ArrayLike) -> list[float]:
        """Strain energy of each of `elastic_terms` [J]."""
        x = self._state(u)
        return [term.energy(x) for term in self.bound_terms]

    def mass(self, kind: str = "lumped") -> Mass:
        """The mass of the body, from the density of its materials: "lumped" at the vertices, or "consistent" with linear displacements.

        Raises
        ------
        MaterialError
            if a material has no density, or a vertex that can move has no mass.
        StvkError
            if `kind` is unknown.
        """
        made = kind_of_mass(kind)
        if kind not in self._masses:
            self._masses[kind] = made(self, self.mesh, self._body.mass, self.supports.held)
        return self._masses[kind]

    @cached_property
    def grounded(self) -> NDArray[np.int64]:
        """Degrees of freedom that foundations tie to the ground, ascending."""
        return grounded_dofs(self.bound_terms)

    def foundation_force(self, u: ArrayLike) -> Array:
        """Force of the foundations on the body (ndofs,) [N], which is minus their part of the internal force; errors as in `internal_force`."""
        x, force = self._state(u), np.zeros(self.mesh.p.T.shape)
        for term in self.bound_terms:
            if isinstance(term, Grounded):
                term.energy(x, force)
        refuse_overflow(force, "The force of foundations", x)
        return -force.ravel()

    @property
    def quartic(self) -> bool:
        """Whether the strain energy along any line is exactly a quartic: that of `VolumePenalty` is not."""
        return all(isinstance(term, Quartic) for term in self.bound_terms)

    def energy_along(self, u: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
        """(5,) coefficients of the strain energy along `u + s v` [J]: `W(u + s v) = c0 + c1 s + c2 s^2 + c3 s^3 + c4 s^4`, exactly.

        Raises
        ------
        StateError
            if `u` or `v` does not have one finite entry for each degree of freedom, or the result overflows.
        StvkError
            if the energy is no quartic: ask `quartic`.
        """
        quartics = [term for term in self.bound_terms if isinstance(term, Quartic)]
        if len(quartics) < len(self.bound_terms):
            raise StvkError(
                "The strain energy along a line is no quartic with a VolumePenalty among the terms. Ask for energy_and_force(u + s v) instead."
            )
        x, y = self._state(u), self._state(v, "v")
        coefficients = sum((term.along(x, y) for term in quartics), np.zeros(5))
        refuse_overflow(coefficients, "W along a line", x)
        return coefficients

    def round_off(self, u: ArrayLike) -> Array:
        """(ndofs,) sums of the absolute values of all that adds up to `F(u)` [N]: times eps, the size of its rounding error.

        Displacements count as rounded, too: no `u` can do better. Errors as of `internal_force`.
        """
        x = self._state(u)
        sums = np.zeros(x.shape, dtype=self.dtype)
        for term in self.bound_terms:
            term.add_round_off(x, sums)
        return sums.ravel()

    def check_held(self) -> None:
        """Refuse a body that can move without strain, by its supports and foundations.

        Raises
        ------
        SupportError
            with the rigid modes that are left to each part, and the pieces that can turn about the vertices or edges that join them,
            counted and named.
        """
        solid = np.zeros(self.mesh.nt, dtype=bool)
        for term in self.elastic_terms:
            if isinstance(term, HasStress):
                solid[self.mesh.elements(term.region)] = True
        check_held(self.mesh, self.bound_terms, self.supports.held, solid)

    def parts(self) -> NDArray[np.int32]:
        """(nv,) number of the part that each vertex is of: parts are what terms hold together."""
        return parts_of([term.edges for term in self.bound_terms], self.mesh.nv)

    def smallest_volume_ratio(self, u: ArrayLike) -> float:
        """The smallest ratio `J` of an element's volume at `u` to that at rest; below zero it is inside out. Errors as of `energy`.

        Of triangles in space and segments in more than one dimension the ratio of areas and lengths, which has no sign.
        """
        x = self._state(u)
        return min((term.smallest_volume_ratio(x) for _, term in self._with_volume), default=np.inf)

    def step_limit(self, u: ArrayLike, v: ArrayLike) -> float:
        """The smallest `s > 0` at which an element that is right side out at `u` (`J > 0`) has no volume left at `u + s v`; or infinity.

        Exact: `J` is a cubic in `s`. Triangles in space and segments in more than one dimension have no inside, so that nothing limits them.

        Raises
        ------
        StateError
            if `u` or `v` does not have one finite entry for each degree of freedom.

        >>> import skfem
        >>> from skfem_stvk import StVK
        >>> mesh = skfem.MeshTet().refined(1)
        >>> body = System(mesh, StVK(young=1.0, poisson=0.3))
        >>> flatter = -0.5 * (mesh.p * [[0], [0], [1]]).ravel("F")
        >>> round(body.step_limit(0 * flatter, flatter), 12)
        2.0
        """
        x, y = self._state(u), self._state(v, "v")
        return min((term.step_limit(x, y) for _, term in self._with_volume), default=np.inf)

    def inside_out(self, u: ArrayLike) -> NDArray[np.int64]:
        """Ids of the elements that are inside out or flat at `u`, ascending: `J <= FLAT`. Errors as of `energy`."""
        if self.mesh.k < self.mesh.d or self.smallest_volume_ratio(u) > FLAT:
            return np.empty(0, dtype=np.int64)
        x = self._state(u)
        turned = [elements[term.volume_ratios(x) <= FLAT] for elements, term in self._with_volume]
        return np.unique(np.concatenate(turned))

    def smallest_stretch(self, u: ArrayLike) -> float:
        """The smallest principal stretch of all elements at `u`, within their own dimensions: 1 at rest, 0 flat. Errors as of `energy`.

        Below 1/sqrt(3) = 0.577 a St. Venant-Kirchhoff body gives way: under uniaxial compression more shortening takes less force.
        """
        x = self._state(u)
        return min((term.smallest_stretch(x) for term in self.bound_terms if isinstance(term, HasStretch)), default=np.inf)

    def compressed(self, u: ArrayLike, below: float) -> NDArray[np.int64]:
        """Ids of the elements whose smallest principal stretch at `u` is less than `below`, ascending. Errors as of `energy`."""
        x, below = self._state(u), number("below", below, "a finite stretch")
        ids = [np.empty(0, dtype=np.int64)]
        for specification, term in zip(self.elastic_terms, self.bound_terms, strict=True):
            if isinstance(term, HasStretch) and term.smallest_stretch(x) < below:
                ids.append(self.mesh.elements(specification.region)[term.smallest_stretches(x) < below])
        return np.unique(np.concatenate(ids))

    def free_dofs(self, fixed: Any) -> FreeDofs:
        """The degrees of freedom that are not `fixed`, and K restricted to them without slicing.

        Parameters
        ----------
        fixed : what scikit-fem's `basis.get_dofs(...)` returned; the name of a boundary or node set or a predicate, for all components there;
            components by place as in `System(fixed=...)`; or bare integers, which are degrees of freedom `d * vertex + component` here, and
            vertices at the places of `System(fixed=...)`.

        Raises
        ------
        RegionError, SupportError
            if there is nothing at a place, or a component is not of the mesh.
        StvkError
            if a degree of freedom is out of range, or none is free.
        """
        return FreeDofs(self, dofs_at(self.mesh, fixed))

    def memory(self) -> dict[str, int]:
        """Bytes of what the system holds now, by part; what has not been asked for yet is not there.

        >>> import skfem
        >>> from skfem_stvk import StVK
        >>> body = System(skfem.MeshTet().refined(3), StVK(young=1e5, poisson=0.3))
        >>> body.memory()["pattern of K"]
        0
        """
        parts = {"mesh": self.mesh.p.nbytes + self.mesh.t.nbytes}
        every: list[BoundTerm | BoundLoad] = [*self.bound_terms, *self.bound_loads]
        for term in every:
            for name, count in term.memory().items():
                parts[name] = parts.get(name, 0) + count
        rows = self.__dict__.get("_rows", [])
        parts["rows of K"] = sum(array.nbytes for row in rows for array in row)
        parts["pattern of K"] = self.pattern.memory() if "pattern" in self.__dict__ else 0
        parts["product"] = self._operator.memory() if self._operator is not None else 0
        parts["mass"] = sum(mass.memory() for mass in self._masses.values())
        return parts

    def _potential(self, x: Array, moment: Moment) -> float:
        if not self.conservative:
            pairs = zip(self.loads, self.bound_loads, strict=True)
            without = [type(term).__name__ for term, load in pairs if not load.has_potential]
            raise LoadError(f"{', '.join(without)} has no potential: its work depends on the path. Ask for residual(u, t) instead.")
        return sum(load.potential(x, moment) for load in self.bound_loads)

    def _elastic_tangent(self, u: ArrayLike, out: csr_matrix | None, kept: Tensions = ALL) -> csr_matrix:
        x = self._state(u)
        K = self._matrix(out)
        self._fill(x, K, None, kept)
        return K

    def _energy_and_force(self, x: Array, out: Array | None = None) -> tuple[float, Array]:
        force = np.zeros(x.shape, dtype=self.dtype) if out is None else out
        force[:] = 0
        return sum(term.energy(x, force) for term in self.bound_terms), force

    def _matrix(self, out: csr_matrix | None) -> csr_matrix:
        if out is None:
            return self.pattern.matrix(np.empty(self.pattern.nnz, dtype=self.dtype))
        if not self.pattern.fits(out, self.dtype):
            raise StvkError(
                f"out = {shown(out)} does not have the pattern and type of this system's K "
                f"({self.pattern.shape}, {self.pattern.nnz} values of {self.dtype}). Hand in a matrix that tangent() returned, "
                "unchanged by eliminate_zeros() and the like."
            )
        return out

    def _fill(self, x: Array, K: csr_matrix, force: Array | None, kept: Tensions = ALL) -> float:
        """Fill the values of K; adds the force; the energy."""
        add = self.mesh.d**2 * len(self._rows[0].entries) < self.pattern.nnz  # otherwise the first term writes to all of K
        if add:
            K.data[:] = 0
        energy = 0.0
        for term, rows in zip(self.bound_terms, self._rows, strict=True):
            linearized = term.tangent(x, rows, K.data, add, force, kept)
            add = True
            refuse_overflow(linearized.total, "K", x)
            energy += linearized.energy
        return energy

    def _state(self, u: ArrayLike, name: str = "u") -> Array:
        """Displacements as (nv, d)."""
        return by_vertex(self.mesh, u, name)

    @property
    def _named(self) -> list[tuple[str, Any]]:
        return [(f"{type(term).__name__} {number}", term) for number, term in enumerate(self.terms)]

    def _warn_of_bare_vertices(self) -> None:
        used = np.zeros(self.mesh.nv, dtype=bool)
        for term in self.bound_terms:
            used[term.edges.ravel()] = True
        bare = np.flatnonzero(~used)
        if len(bare):
            warn(f"{name_ids(bare, 'vertex')}: in no term, so their rows of K are zero. Is a region missing from the terms?")

    def __repr__(self) -> str:
        return f"System: {self.mesh.nt} {self.mesh.kind}, {self.ndofs} degrees of freedom, {len(self.terms)} term(s)"


def checked_system(system: Any) -> System:
    """Refuses what is no system."""
    if not isinstance(system, System):
        raise StvkError(f"system = {shown(system)}; expected a System: System(mesh, terms, fixed=..., prescribed=...).")
    return system


def _float_type(dtype: Any) -> np.dtype[Any]:
    """Double or single precision."""
    try:
        found = np.dtype(dtype)
    except Exception:  # TypeError mostly, but not of all text
        found = np.dtype(object)
    if found not in (np.float64, np.float32):
        raise StvkError(f"dtype = {shown(dtype)}; expected float64 or float32.")
    return found


def array_to_fill(mesh: SimplexMesh, out: Array) -> Array:
    """An array (ndofs,) to write to, as (nv, d).

    Raises
    ------
    StvkError
        if it is no array of floats of that shape, in one piece.
    """
    own = isinstance(out, np.ndarray) and not isinstance(out, np.ma.MaskedArray) and out.dtype.char in "df"
    if not own or out.shape != (mesh.p.size,) or not (out.flags.carray and out.dtype.isnative):
        raise StvkError(
            f"out = {shown(out)}; expected an array of floats ({mesh.p.size},) in one piece that can be written to, such as "
            "np.zeros(system.ndofs)."
        )
    return out.reshape(-1, mesh.d)


def _factors(kept: Tensions) -> Tensions:
    """Refuses what are no factors of tensions."""
    if not isinstance(kept, Tensions):
        raise StvkError(
            f"kept = {shown(kept)}; expected ALL, TENSILE or NONE of skfem_stvk.edges, or Tensions(positive, negative)."
        )
    return Tensions(number("kept: positive", kept.positive), number("kept: negative", kept.negative))


def refuse_overflow(values: ArrayLike, name: str, u: Array) -> None:
    """Refuse results, called `name`, that are not finite at displacements `u`.

    Raises
    ------
    StateError
    """
    if not (isfinite(values) if isinstance(values, float | int) else all_finite(np.asarray(values))):
        raise StateError(
            f"{name} overflows at displacements of up to {np.abs(u).max():.1e}: did the step before diverge, or are units mixed up?"
        )
