"""System: terms that share one mesh and one pattern of K, with loads and supports."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from copy import copy
from math import nan
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array, choice, frozen, number, real_array, shown
from ..edges import ALL, Rows, Tensions
from ..edges.bound_term import BoundTerm
from ..edges.elements import checked_quadrature, nbytes
from ..edges.pairs import AccumulatedBlocks, PairTerm
from ..errors import LoadError, MeshError, StvkError, warn
from ..kernels.threads import CopyableLock, locked
from ..mesh import ElementMesh, MeshLike
from ..mesh.diagnostics import check_mesh, warn_of_flat_elements
from ..mesh.displacements import array_to_fill, by_vertex
from ..mesh.locations import DofsView
from ..terminal import html_table
from ..terms import (
    BoundLoad,
    Load,
    Term,
    is_load,
)
from ..terms.connectivity import connected
from ..terms.loads.load import Time
from ..units import UNITS, implausible_moduli
from .bound import BoundTerms, checked_terms, elements_to_remove
from .mass import KINDS, Mass
from .mechanisms import check_held
from .operator import TangentOperator, refuse_overflow
from .pattern import BareDiagonal, FreeDofs, Pattern, Structure
from .rigid import Pieces
from .supports import Displacements, Supports, dofs_at

SystemType = TypeVar("SystemType", bound="System")


class System(BoundTerms):
    """Elastic body: its strain energy W, internal force F and tangent stiffness K, with its loads and supports.

    ::

        W = 1/4 sum L_ij zeta_i zeta_j        F = dW/du        K = d2W/du2

    The sum is over edges and pairs of edges that share a tetrahedron, with the squared elongations `zeta` of the edges. For
    elements other than linear simplices, it is the sum over the strains at their points. Displacements `u` are flat vectors with
    the degree of freedom `d * node + component`. This is scikit-fem's order for `ElementVector(ElementTetP1())`, `ElementTetP2()`,
    `ElementHex1()` and similar elements.

    `energy`, `internal_force`, `tangent` and `product` are elastic. `potential`, `residual` and `jacobian` include the loads at the
    load factor `t`. Supports change none of them: they determine which degrees of freedom a solver keeps. Shapes that move, and
    frames that rotate, are those at the argument `t`, which is 0 by default in elastic calls and 1 in calls with loads.

    Parameters
    ----------
    mesh
        Mesh of scikit-fem, arrays `(p, t)` of linear simplices, or `ElementMesh`; or bare points (d, n), if terms have elements of
        their own: `StVK(..., simplices=...)`. Then the elements of the highest dimension become `mesh`, and names and ids of
        elements refer to them. Elements of lower dimensions, such as membranes and cables, are stored separately on the same nodes.
    terms
        Term, or several to be added: `StVK`, `VolumePenalty`, `ElasticFoundation`; the loads `Gravity`, `BodyForce`, `NodalLoad`,
        `Traction`, `Pressure`.
    fixed
        Components that do not move, by location: `{"wall": "xyz", "symmetry": "y"}`. A location is the name of a boundary or of a
        node set, node ids, or a predicate of the coordinates, as in scikit-fem. The result of `basis.get_dofs(...)` as a location
        means its nodes. The whole argument `fixed=basis.get_dofs(...)` means exactly its degrees of freedom. Bare integers are
        always nodes.
    prescribed
        Displacements by location and component: `{"handle": {"x": 0.01}}` [m], reached at t = 1; or functions of (x, t).
    degree
        Degree of the shape functions of simplices, by default that of the mesh. 2 makes linear simplices quadratic, with straight
        edges, and 1 makes quadratic ones linear.
    quadrature
        Integration rule. "exact" integrates W exactly on elements with straight edges. By default quadratic segments, triangles and
        tetrahedra have 2, 3 and 4 points, quadrilaterals and hexahedra 4 and 8 (`skfem_stvk.mesh.points.rule_of`). "one-point" is
        for quadrilaterals and hexahedra: it uses mean gradients, and a control of the hourglass modes, which have zero mean
        gradients.
    hourglass
        Coefficient for "one-point", by default 0.05. The energy `hourglass/16 (lam + 2 mu) V sum_a |g_a|^2 sum_k |gamma_k' u|^2` is
        added. Here `g_a` are the mean gradients, and `gamma_k` are the signs +-1 of the mode at the nodes without their affine
        part.
    dtype
        Type of results and coefficients, float64; or float32, with half the memory and more speed on large meshes. Errors of
        float32 are 1e-6 instead of 1e-15, relative to the largest entry and on elements that are not flat.
    units
        System of units of all values, such as "mm-N-MPa", whose densities are in t/mm^3; see `skfem_stvk.units.UNITS`. Plots,
        tables and messages name its units instead of those of SI. No number is converted.

    Attributes
    ----------
    mesh, space, ndofs
        The mesh; the space of the displacements of all nodes, `space.n = ndofs = d nv`.
    supports
        Fixed and prescribed degrees of freedom.
    bound_terms, bound_loads
        Elastic terms and loads with the data of this mesh.
    contacts, working_contacts
        Bound terms of contact, and those of contacts that move or rub.
    elastic_names, without_energy
        Names of the elastic terms, type and number among all terms; and of those whose force is not the gradient of an energy.
    conservative
        Whether all terms have an energy and all loads a potential; if not, the Jacobian is not symmetric.
    dead
        Whether all loads are dead, that is, keep size and direction. Then the Jacobian is the tangent of an energy.
    constant_tangent
        Whether the Jacobian is the same at all displacements and times: linear terms under dead loads.
    quartic
        Whether the strain energy along any line is exactly a quartic; that of `VolumePenalty` is not.
    resists_inversion
        Whether a term resists the inversion of elements, as `VolumePenalty` does.
    grounded
        Degrees of freedom that foundations tie to the ground, ascending.
    removed, bare
        Ids of the removed elements, see `without`, and of nodes that have lost all their elements, ascending.
    made_from, made_of
        Mesh or points from which the system was built, and its other arguments by name, as passed in.
    units
        The system of units.

    Raises
    ------
    MeshError, MaterialError, RegionError, LoadError, SupportError
        if mesh, terms, loads or supports are invalid for an elastic body, before any computation, with ids.

    Notes
    -----
    Arguments that methods share:

    - `u`: (ndofs,) displacements [m].
    - `t`: load factor in statics, time [s] in motions; or a `Moment`, which has the history of a step as well.
    - `out`: matrix that the method returned before, which is overwritten; by default K is a new matrix.
    - `free`: result of `free_dofs`. K then has only the rows and columns of the free degrees of freedom. If only elements
      contribute, this part is assembled directly.
    - `kept`: tensions of edges that enter K. `TENSILE` and `NONE` of `skfem_stvk.edges` omit all parts that can make K indefinite,
      including that of the pressure of a `VolumePenalty`. Then K is positive semi-definite, apart from the loads.

    Methods raise StateError if `u` or another vector does not have one finite entry for each degree of freedom, or is so large that
    the result overflows; or if `t` is not finite. They raise StvkError if `out` has another pattern.

    Examples
    --------
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
        degree: int | None = None,
        quadrature: str | None = None,
        hourglass: float | None = None,
        dtype: DTypeLike = np.float64,
        units: str = "SI",
    ) -> None:
        self.units = UNITS[choice("units", units, UNITS)]
        own = {"quadrature": quadrature, "hourglass": hourglass, "dtype": dtype, "units": units}
        self.made_of: Mapping[str, Any] = frozen({"terms": terms, "fixed": fixed, "prescribed": prescribed}) | own
        double = _float_type(dtype) == np.float64
        found = connected(mesh if degree is None else _with_degree(mesh, degree), checked_terms(terms))
        mesh, self.made_from = found.mesh, found.source
        rule = checked_quadrature(mesh, quadrature, hourglass)
        check_mesh(mesh, found.beside, in_parts=any(not is_load(term) and term.between_parts for term in found.terms))
        if not double:
            mesh.space.comm.refuse_divided("dtype = float32", "float64", "sums over the parts are in double precision.")
            warn_of_flat_elements(mesh)
        self.quadrature, self.rule = quadrature, rule  # the argument, and the rule it selects
        self.supports = Supports(mesh, fixed, prescribed)
        with self.units.of_errors():
            super().__init__(mesh, found.terms, np.float64 if double else np.float32, rule, found)
        self._follower_loads = [AccumulatedBlocks(load, mesh.nv, mesh.d, np.float64) for load in self._bound_follower_loads()]
        self._pattern: Pattern | None = None
        self._row_cache: tuple[int, list[Any], list[Rows]] | None = None
        self._masses: dict[str, Mass] = {}
        self._operator: TangentOperator | None = None
        self._whole: csr_matrix | None = None  # the whole K, when only a part was requested
        self._bare: BareDiagonal | None = None
        self._pieces: Pieces | None = None
        self._lock = CopyableLock()  # of the caches above, which calls of several threads share, and of pairs between `look` and K

    def without(self: SystemType, elements: str | ArrayLike) -> SystemType:
        """Return the body without these elements, as a new system; this system does not change.

        The elements are removed from all terms, the mass and the loads. A facet that belongs only to removed elements carries no
        traction, pressure or foundation, and newly exposed faces carry none either. Both systems share the mesh, the pattern of K
        and the indices of the terms in it. Coefficients are copied, with zeros for the removed elements. Nodes that lose all
        elements stay at their position, without mass and force, and get a diagonal in K. Terms retain their history.

        Parameters
        ----------
        elements
            Ids of elements, a mask (nt,), or the name of a subdomain. Elements that are removed already may be named again. If no
            other elements are named, the method returns this system.

        Raises
        ------
        RegionError
            if ids are out of range or repeated, a mask has the wrong length, or no element would remain.
        StvkError
            if a term does not support the removal of elements; the message names it.

        Warns
        -----
        StvkWarning
            if parts become loose, without a support or foundation: a static solve refuses them, and in a motion they fly freely.

        Examples
        --------
        >>> import skfem
        >>> from skfem_stvk import StVK
        >>> bar = System(skfem.MeshLine(np.linspace(0, 1, 5)), StVK(young=2.0, poisson=0.3, density=1.0), fixed={(0, 4): "x"})
        >>> torn, stretched = bar.without([1]), 0.1 * bar.mesh.p.ravel("F")
        >>> torn.removed, round(torn.energy(stretched) / bar.energy(stretched), 12), torn.mass().total
        (array([1]), 0.75, 0.75)
        """
        self.space.comm.refuse_divided(
            "System.without(elements)", "all elements", "parts do not exchange which nodes lose elements."
        )
        ids = elements_to_remove(self, elements)
        if not len(ids):
            return self
        self._refuse_terms_without_removal()
        other = copy(self)
        other._remove_elements(ids)
        before = Pieces.of(self) if self._pieces is None or self._with_changing_pairs else self._pieces
        other._pieces = Pieces.of(other)
        loose = other._pieces.newly_loose(before)
        if loose:
            warn(f"{loose} In statics, fix or remove such parts as well; in motions they move freely.")
        return other

    def _remove_elements(self, elements: NDArray[np.int64]) -> None:
        whole = self._bare or BareDiagonal.of(self.linear_operator(np.zeros(self.ndofs)).diagonal_blocks())
        super()._remove_elements(elements)
        self._bare = BareDiagonal(whole.stiffness, self.bare)
        self._masses = {kind: mass.of(self, self.body) for kind, mass in self._masses.items()}

    def with_terms(self: SystemType, terms: Sequence[BoundTerm]) -> SystemType:
        """Return the body with other bound terms, which couple the same pairs of nodes; or itself, if they are its own.

        Parameters
        ----------
        terms
            Bound terms in the order of `bound_terms`.
        """
        if all(one is term for one, term in zip(terms, self.bound_terms, strict=True)):
            return self
        other = copy(self)
        other._replace_bound(terms, self.bound_loads)
        other._masses = {kind: mass.of(other, other.body) for kind, mass in self._masses.items()}
        return other

    def _replace_bound(self, terms: Sequence[Any], loads: Sequence[Any]) -> None:
        super()._replace_bound(terms, loads)
        self._follower_loads = [
            AccumulatedBlocks(load, self.mesh.nv, self.mesh.d, np.float64) if load.pairs_change else blocks.with_term(load)
            for blocks, load in zip(self._follower_loads, self._bound_follower_loads(), strict=True)
        ]
        self._operator = None

    def _bound_follower_loads(self) -> list[BoundLoad]:
        return [load for load in self.bound_loads if not load.dead]

    def prescribe(self, u: Array, t: Time) -> Array:
        """Write the displacements of supports to `u` in place; return `u`.

        Parameters
        ----------
        u
            (ndofs,) displacements [m]; those of the supports are overwritten.
        """
        u[self.supports.held] = self.supports.values(t)
        return u

    @property
    def pattern_version(self) -> int:
        """Number of changes of the node couplings by terms; data computed for a pattern are valid for one version."""
        return sum(term.pattern_version for term in self._with_changing_pairs)

    def look(self, u: ArrayLike, t: Time = 0.0) -> None:
        """Let terms whose pairs follow the body, such as contacts, couple those of the tangent at displacements `u`.

        `tangent`, `linearize` and `jacobian` call it. Data that depend on `pattern_version` may have to be made again.
        """
        if self._with_changing_pairs:
            x = self._state(u)
            for one in (*self.terms_at(t), *self.bound_loads):
                one.look(x)

    @property
    def pattern(self) -> Pattern:
        """Pattern of every K of this system, unless a term changes the nodes it couples; created on first use."""
        with self._lock:
            version = self.pattern_version
            if self._pattern is None or self._pattern.version != version:
                pairs = [term.nodes_paired for term in self.bound_terms]
                pairs += [load.term.nodes_paired for load in self._follower_loads if load.term.nodes_paired.size]
                self._pattern = Pattern(self.mesh.nv, self.mesh.d, pairs, version)
            return self._pattern

    def _rows(self) -> tuple[list[Any], list[Rows]]:
        """Return the indices of the blocks of terms and loads in the values of K, cached for each version of the pattern."""
        with self._lock:
            pattern = self.pattern
            if self._row_cache is None or self._row_cache[0] != pattern.version:
                terms = [term.rows(pattern) for term in self.pair_terms]
                self._row_cache = pattern.version, terms, [load.pairs.rows(pattern) for load in self._follower_loads]
            return self._row_cache[1:]

    def energy(self, u: ArrayLike, t: Time = 0.0) -> float:
        """Return the strain energy `W(u)` [J].

        Raises
        ------
        StvkError
            if a term has no energy, such as `Corotated(rotation="vertex")`.
        """
        self._refuse_without_energy()
        return sum(self.elastic_energies(u, t))

    def internal_force(self, u: ArrayLike, t: Time = 0.0) -> Array:
        """Return the internal force `F = dW/du` (ndofs,) [N]; the residual of statics is `F - f_ext`."""
        force = np.empty(self.mesh.p.T.shape, dtype=self.dtype)
        self.space.comm.sum_of(self._energy_of_part, u, t, force, False)
        return self.space.share(force).ravel()

    def energy_and_force(self, u: ArrayLike, out: Array | None = None, t: Time = 0.0) -> tuple[float, Array]:
        """Return `W(u)` [J] and `F(u)` (ndofs,) [N], at the cost of one of them.

        Parameters
        ----------
        out
            Array (ndofs,) to which F is written; by default a new array.

        Raises
        ------
        StvkError
            as `energy`, and if `out` is not a contiguous array of floats of that shape.
        """
        self._refuse_without_energy()
        force = np.empty(self.mesh.p.T.shape, dtype=self.dtype) if out is None else array_to_fill(self.mesh, out)
        energy = self.space.comm.sum_of(self._energy_of_part, u, t, force, True)
        self.space.share(force)
        return energy, force.reshape(-1) if out is None else out

    def tangent(self, u: ArrayLike, out: csr_matrix | None = None, *, free: FreeDofs | None = None, t: Time = 0.0) -> csr_matrix:
        """Return the tangent stiffness `K = d2W/du2` (ndofs, ndofs) [N/m].

        The pattern is always the same, unless a `MeshContact` couples other nodes, and zeros are stored.
        """
        return self._assembled(u, t, out, free=free)[1]

    def linearize(self, u: ArrayLike, out: csr_matrix | None = None, *, t: Time = 0.0) -> tuple[float, Array, csr_matrix]:
        """Return `W(u)` [J], `F(u)` (ndofs,) [N] and `K(u)` (ndofs, ndofs) [N/m] from one pass over the elements.

        The cost is little more than that of K.
        """
        self._refuse_without_energy()
        force = np.zeros(self.mesh.p.T.shape, dtype=self.dtype)
        energy, K = self._assembled(u, t, out, force=force)
        return self.space.comm.total(energy), self.space.share(force).ravel(), K

    @locked
    def product(self, u: ArrayLike, v: ArrayLike, t: Time = 0.0) -> Array:
        """Return `K(u) v` (ndofs,) [N], without forming K.

        The first product at a `u` prepares data that further products at this `u` reuse. These take less time than one with an
        assembled K.

        Parameters
        ----------
        v
            (ndofs,) vector that K is multiplied with [m].
        """
        x, y = self._state(u), self._state(v, "v").ravel()
        if self._operator is None:
            self._operator = self.linear_operator(u, t=t)
        elif self.space.comm.any(not self._operator.is_at(x)) or self._changing:
            self._operator.prepare(u, t=t)
        product = self._operator.matvec(y)
        with self.space.comm.together():
            refuse_overflow(product, "K v", x)
        return product

    def linear_operator(self, u: ArrayLike, *, kept: Tensions = ALL, t: Time = 0.0) -> TangentOperator:
        """Return the operator `v -> K(u) v` for `scipy.sparse.linalg`, with its own data.

        Examples
        --------
        >>> import numpy as np, skfem
        >>> from skfem_stvk import StVK
        >>> body = System(skfem.MeshTet().refined(2), StVK(young=1e5, poisson=0.3))
        >>> u, v = np.zeros(body.ndofs), np.cos(np.arange(body.ndofs))
        >>> K = body.linear_operator(u)
        >>> bool(abs(K @ v - body.tangent(u) @ v).max() < 1e-9), bool(abs(K @ v - body.product(u, v)).max() == 0)
        (True, True)
        """
        return TangentOperator(self.mesh, self.pairs_at, u, self.dtype, _checked_tensions(kept), t)

    def external_force(self, u: ArrayLike, t: Time = 1.0) -> Array:
        """Return the sum of the loads (ndofs,) [N] at displacements `u` and load factor `t`.

        Raises
        ------
        LoadError
            if a load's function does not return finite values.
        """
        x, force, moment = self._state(u), np.zeros(self.mesh.p.T.shape), self._moment(t)

        with self.space.comm.together():
            for load in self.bound_loads:
                load.add_force(x, moment, force)
            refuse_overflow(force, "The external force", x)
        return self.space.share(force).ravel()

    def potential(self, u: ArrayLike, t: Time = 1.0) -> float:
        """Return the total potential energy `W(u) + sum of the loads' potentials` [J]; its gradient is the residual.

        Raises
        ------
        LoadError
            as `external_force`, and if a load has no potential, such as follower pressure.
        """
        moment, energy = self._moment(t), self.energy(u, t)
        loads = zip(self.loads, self.bound_loads, strict=True)
        without = [type(load).__name__ for load, bound in loads if not bound.has_potential]
        if without:
            raise LoadError(f"{', '.join(without)} has no potential: its work depends on the path. Use residual(u, t).")
        x = self._state(u)
        return energy + self.space.comm.total(float(sum(load.potential(x, moment) for load in self.bound_loads)))

    def residual(self, u: ArrayLike, t: Time = 1.0) -> Array:
        """Return the residual `F(u) - f_ext(u, t)` (ndofs,) [N]; in equilibrium only the reactions at the supports are not zero.

        Raises
        ------
        LoadError
            as `external_force`.
        """
        loads = self.external_force(u, t)
        return self.internal_force(u, t) - loads

    def jacobian(
        self, u: ArrayLike, t: Time = 1.0, out: csr_matrix | None = None, *, kept: Tensions = ALL, free: FreeDofs | None = None
    ) -> csr_matrix:
        """Return the derivative of the residual: `K(u)` minus the loads' `df_ext/du` (ndofs, ndofs) [N/m]."""
        return self._assembled(u, t, out, kept=_checked_tensions(kept), loads=self._follower_loads, free=free)[1]

    def load_stiffness(self, u: ArrayLike, t: Time = 1.0) -> csr_matrix | None:
        """Return `-df_ext/du` (ndofs, ndofs) [N/m] of the loads that have a potential and are not dead.

        Return None if there are none.
        """
        x, moment = self._state(u), self._moment(t)
        conservative = [load for load in self._follower_loads if load.term.symmetric]
        if not conservative:
            return None
        pattern = Pattern(self.mesh.nv, self.mesh.d, [load.term.nodes_paired for load in conservative])
        K = pattern.matrix(np.zeros(pattern.nnz))
        for load in conservative:
            load.add_stiffness(x, moment, load.pairs.rows(pattern), K.data)
        return K

    def energies(self, u: ArrayLike, t: Time = 1.0) -> dict[str, float]:
        """Return the energy [J] by term: strain energies, and potentials of the loads that have one.

        Terms are named by type and number. An elastic term without an energy has NaN.
        """
        x, moment = self._state(u), self._moment(t)
        elastic = iter(self.elastic_energies(u, t))
        loads = iter(
            [self.space.comm.total(load.potential(x, moment)) if load.has_potential else None for load in self.bound_loads]
        )
        values = {name: next(loads if is_load(term) else elastic) for name, term in self._named}
        return {name: value for name, value in values.items() if value is not None}

    def elastic_energies(self, u: ArrayLike, t: Time = 0.0) -> list[float]:
        """Return the strain energy of each of `elastic_terms` [J]; NaN for a term without an energy."""
        with self.space.comm.together():
            x = by_vertex(self.mesh, u)
            of_part = [term.energy_and_force(x) if term.has_energy else 0.0 for term in self.terms_at(t)]
            refuse_overflow(sum(of_part), "W", x)
        energies = self.space.comm.total(np.array(of_part, dtype=np.float64)).tolist()
        return [energy if term.has_energy else nan for term, energy in zip(self.bound_terms, energies, strict=True)]

    @locked
    def mass(self, kind: str = "lumped") -> Mass:
        """Return the mass of the body from the densities.

        Parameters
        ----------
        kind
            Kind of the mass, "lumped" at the nodes, or "consistent" with the shape functions.

        Raises
        ------
        MaterialError
            if a material has no density, or a node that can move has no mass.
        StvkError
            if `kind` is unknown.
        """
        if choice("mass", kind, KINDS) not in self._masses:
            with self.units.of_errors():
                self._masses[kind] = KINDS[kind](self, self.body, self.supports.held)
        return self._masses[kind]

    def foundation_force(self, u: ArrayLike) -> Array:
        """Return the force of the foundations on the body (ndofs,) [N], minus their part of the internal force."""
        return self._force_on_body(self.foundations, u, "The force of foundations")

    def contact_force(self, u: ArrayLike, t: Time = 0.0) -> Array:
        """Return the force of the contacts on the body (ndofs,) [N], minus their part of the internal force."""
        return self._force_on_body(self.contacts_at(t), u, "The force of contacts")

    def _force_on_body(self, terms: Sequence[Any], u: ArrayLike, name: str) -> Array:
        """Return minus the internal force (ndofs,) [N] of some terms."""
        x, force = self._state(u), np.zeros(self.mesh.p.T.shape)
        for term in terms:
            term.energy_and_force(x, force)
        with self.space.comm.together():
            refuse_overflow(force, name, x)
        return -self.space.share(force).ravel()

    def energy_along(self, u: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
        """Return the coefficients (5,) of the strain energy [J] along `u + s v`, which are exact.

        ::

            W(u + s v) = c0 + c1 s + c2 s^2 + c3 s^3 + c4 s^4

        Parameters
        ----------
        v
            (ndofs,) direction [m].

        Raises
        ------
        StvkError
            if the energy is not a quartic, see `quartic`.
        """
        if not self.quartic:
            hint = "Use energy_and_force(u + s v)."
            raise StvkError(f"The strain energy along a line is not a quartic with a VolumePenalty among the terms. {hint}")

        coefficients = np.zeros(5)
        with self.space.comm.together():
            x, y = by_vertex(self.mesh, u), by_vertex(self.mesh, v, "v")
            for term in self.bound_terms:
                coefficients = coefficients + term.along(x, y)
            refuse_overflow(coefficients, "W along a line", x)
        return self.space.comm.total(coefficients)

    def round_off(self, u: ArrayLike, t: Time = 0.0) -> Array:
        """Return the sums (ndofs,) of the absolute values of all contributions to `F(u)` [N].

        The sums times eps estimate the round-off of F. The round-off of the displacements is included, because no `u` can be more
        precise.
        """
        x, sums = self._state(u), np.zeros(self.mesh.p.T.shape, dtype=self.dtype)

        with self.space.comm.together():
            for term in self.terms_at(t):
                term.add_round_off(x, sums)
        return self.space.share(sums).ravel()

    def check_held(self, u: ArrayLike | None = None, t: Time = 0.0) -> None:
        """Check that supports, foundations and contacts leave the body no motion without strain.

        Parameters
        ----------
        u
            (ndofs,) displacements [m] at which contacts touch or do not, by default zero.

        Raises
        ------
        SupportError
            if they leave such a motion. The message gives the number and the names of the rigid modes of each part. It also names
            the pieces that can rotate about the nodes or edges that join them.
        """
        solid = np.zeros(self.mesh.nt, dtype=bool)
        for term in self.body.terms:
            solid[term.elements_held_in_shape(self.mesh)] = True
        stay = (self.mesh.d * self.bare[:, None] + np.arange(self.mesh.d)).ravel()
        x, touching = self._state(np.zeros(self.ndofs) if u is None else u), None
        if self.contacts:
            nodes, directions = zip(*(contact.held_directions(x) for contact in self.contacts_at(t)), strict=True)
            touching = np.concatenate(nodes), np.concatenate(directions)
        constrained = np.union1d(self.supports.held, stay)
        check_held(self.mesh, self.bound_terms, constrained, solid & ~self.body.removed, touching)

    def free_dofs(self, fixed: Any) -> FreeDofs:
        """Return the degrees of freedom that are not `fixed`; the object also restricts K to them without slicing.

        Parameters
        ----------
        fixed
            The result of scikit-fem's `basis.get_dofs(...)`; the name of a boundary or node set, or a predicate, for all components
            there; components by location as in `System(fixed=...)`; or bare integers. Here bare integers are degrees of freedom
            `d * node + component`. As locations in `System(fixed=...)` they are nodes.

        Raises
        ------
        RegionError, SupportError
            if a location has no nodes, or the mesh does not have a component.
        StvkError
            if a degree of freedom is out of range, or none is free.
        """
        return FreeDofs(self, dofs_at(self.mesh, fixed))

    def memory(self) -> dict[str, int]:
        """Return the bytes that the system uses now, by part; data that are not computed yet count as 0.

        Examples
        --------
        >>> import skfem
        >>> from skfem_stvk import StVK
        >>> body = System(skfem.MeshTet().refined(3), StVK(young=1e5, poisson=0.3))
        >>> body.memory()["pattern of K"]
        0
        """
        parts = {"mesh": self.mesh.p.nbytes + self.mesh.t.nbytes + sum(body.mesh.t.nbytes for body in self.body.beside)}
        for term in (*self.bound_terms, *self.bound_loads):
            for name, count in term.memory().items():
                parts[name] = parts.get(name, 0) + count
        every: tuple[PairTerm | AccumulatedBlocks, ...] = (*self.pair_terms, *self._follower_loads)
        for blocks in every:
            if count := blocks.own_memory():
                parts["blocks of pairs"] = parts.get("blocks of pairs", 0) + count
        parts["rows of K"] = 0 if self._row_cache is None else nbytes(self._row_cache[1:])
        parts["pattern of K"] = 0 if self._pattern is None else self._pattern.memory()
        parts["product"] = self._operator.memory() if self._operator is not None else 0
        parts["mass"] = sum(mass.memory() for mass in self._masses.values())
        return parts

    def _refuse_without_energy(self) -> None:
        """Raise StvkError if some terms have no energy."""
        if self.without_energy:
            raise StvkError(
                f"{', '.join(self.without_energy)} has no energy; expected terms whose force is the gradient of one, such as StVK. "
                "Use internal_force(u) and tangent(u)."
            )

    def _energy_of_part(self, u: ArrayLike, t: Time, force: Array, check_energy: bool) -> float:
        """Return W of one part of a divided body, and its F in `force`. Refuse an F that overflows, and a W if `check_energy`."""
        x = by_vertex(self.mesh, u)
        force[:] = 0
        energy = 0.0
        for term in self.terms_at(t):
            energy += term.energy_and_force(x, force)
        if check_energy:
            refuse_overflow(float(energy), "W", x)
        refuse_overflow(force, "F", x)
        return float(energy)

    def _assembled(
        self,
        u: ArrayLike,
        t: Time,
        out: csr_matrix | None,
        *,
        force: Array | None = None,
        kept: Tensions = ALL,
        loads: Sequence[AccumulatedBlocks] = (),
        free: FreeDofs | None = None,
    ) -> tuple[float, csr_matrix]:
        """Return W of this part of a body, and K with the stiffness of follower `loads`. Add the internal force to `force`.

        K over the `free` degrees of freedom is filled directly if all contributions support this. Otherwise it is a part of the
        whole K.
        """
        x, moment = self._state(u), self._moment(t)
        with self._lock:
            self.look(u, t)
            structure: Structure = self.pattern
            rows, rows_of_loads = self._rows()
            if free is not None:
                if not isinstance(free, FreeDofs) or free.pattern is not structure:
                    raise StvkError(
                        f"free = {shown(free)}; expected a result of free_dofs() of this system, because K of another system has "
                        "another pattern."
                    )
                structure, indices = free.restriction()
            if out is not None and not structure.fits(out, self.dtype):
                raise StvkError(
                    f"out = {shown(out)} does not have the pattern and type of this system's K ({structure.shape}, "
                    f"{structure.nnz} values of {self.dtype}). Pass a matrix that tangent() returned, with its zeros."
                )
            K = structure.matrix(np.empty(structure.nnz, dtype=self.dtype)) if out is None else out
            if free is not None:
                if self._follower_loads or not all(term.by_rows(kept) for term in self.pair_terms):
                    whole = self._whole if self.pattern.fits(self._whole, self.dtype) else None
                    energy, self._whole = self._assembled(u, t, whole, force=force, kept=kept, loads=loads)
                    return energy, free.matrix(self._whole, K)
                rows = [one.part(indices) for one in rows]
            with self.space.comm.together():
                energy = self._fill(self.pairs_at(t), x, K.data, rows, force=force, kept=kept, free=free)
            for load, rows_of_load in zip(loads, rows_of_loads, strict=bool(loads)):
                load.add_stiffness(x, moment, rows_of_load, K.data)
        return energy, K

    def _fill(
        self,
        terms: Sequence[PairTerm],
        x: Array,
        data: Array,
        rows_of_terms: Sequence[Any],
        *,
        force: Array | None,
        kept: Tensions,
        free: FreeDofs | None,
    ) -> float:
        """Fill the values of K of one part of a divided body, or of K over the `free` degrees of freedom; return the energy.

        `terms` are those of `pairs_at`, and `rows_of_terms` are the results of their `rows`. The internal force is added to `force`
        if given.
        """
        damped: list[tuple[float, Tensions, Any, Any]] = []
        others: list[tuple[float, Tensions, Any, Any]] = []
        for term, rows in zip(terms, rows_of_terms, strict=True):
            factor, own = kept.of(term)
            (others if factor == 1 else damped).append((factor, own, term, rows))
        every = damped + others  # terms with edge damping first, because their factor multiplies all values so far
        add = self.mesh.d**2 * every[0][3].size < self.pattern.nnz  # otherwise the first term writes to all of K
        if add:
            data[:] = 0
        energy, factor = 0.0, every[0][0]
        for own_factor, own, term, rows in every:
            if own_factor != factor:
                data *= factor
                factor = own_factor
            linearized = term.fill(x, rows, data, add, force, own)
            add = True
            refuse_overflow(linearized.total, "K", x)
            energy += linearized.energy
        if factor != 1:
            data *= factor
        if self._bare is not None:
            self._bare.write(self.pattern, data, free)
        if force is not None:
            refuse_overflow(float(energy), "W", x)
            refuse_overflow(force, "F", x)
        return float(energy)

    def implausible(self) -> list[str]:
        """Return, in a sentence each, the Young's moduli that are implausible in the units of the system.

        Examples
        --------
        >>> import skfem
        >>> from skfem_stvk import StVK
        >>> plate = skfem.MeshTri().scaled((100.0, 20.0)).with_boundaries({"left": lambda x: x[0] == 0})
        >>> print(*System(plate, StVK(young=2.1e5, poisson=0.3)).implausible())                             # millimetres and MPa
        material 0: young = 210000 Pa is unusual for a body of 100 m; usual are 500000 to 2e+12 Pa. It would be usual with ...
        >>> System(plate, StVK(young=2.1e5, poisson=0.3), units="mm-N-MPa").implausible()
        []
        """
        laws = [term.material for body in (self.body, *self.body.beside) for term in body.terms if term.material is not None]
        size = float(np.ptp(self.mesh.bounds, axis=1).max())
        moduli = {f"material {number}: young": getattr(law, "young", None) for number, law in enumerate(laws)}
        return implausible_moduli(moduli, self.units, size)

    def __repr__(self) -> str:
        units = "" if self.units.name == "SI" else f", {self.units.name}"
        beside = "".join(f", {body.mesh.element_count} {body.mesh.element.name}" for body in self.body.beside)
        return (
            f"System: {self.mesh.element_count} {self.mesh.kind}{beside}, {self.space.count} degrees of freedom, "
            f"{len(self.terms)} term(s){units}"
        )

    def _repr_html_(self) -> str:
        meshes = [self.mesh, *(body.mesh for body in self.body.beside)]
        with np.printoptions(threshold=6):  # options that are None are left out
            terms = [(type(term).__name__, re.sub(r", \w+=None", "", repr(term))) for term in self.terms]
        supports = [(name, shown(self.made_of[name])) for name in ("fixed", "prescribed") if self.made_of.get(name)]
        elements = ", ".join(f"{mesh.element_count} {mesh.kind}" for mesh in meshes)
        rows = [("elements", elements), ("degrees of freedom", self.space.count), *terms, *supports]
        return html_table("System", rows)


def for_analysis(system: SystemType, in_time: bool) -> SystemType:
    """Return the body for one motion in time, or for one path of equilibria; the body itself if no term has an own state for it.

    Contacts that couple other nodes as the body moves have pairs of nodes of their own.
    """
    with system.units.of_errors():
        return system.with_terms([term.for_analysis(in_time) for term in system.bound_terms])


def _with_degree(mesh: MeshLike, degree: int) -> ElementMesh:
    """Return the mesh with shape functions of this degree."""
    try:
        return ElementMesh.of(mesh).with_degree(degree)
    except MeshError as error:
        if real_array(mesh) is None:
            raise
        raise MeshError(
            f"degree = {shown(degree)} with bare points: {error} Raise the degree of a mesh of the solid part, and name its "
            'boundaries: StVK(..., simplices="skin").'
        ) from error


def _float_type(dtype: Any) -> np.dtype[Any]:
    """Return the type of double or single precision; raise StvkError for any other."""
    try:
        found = np.dtype(dtype)
    except Exception:  # TypeError mostly, but not of all text
        found = np.dtype(object)
    if found not in (np.float64, np.float32):
        raise StvkError(f"dtype = {shown(dtype)}; expected float64 or float32.")
    return found


def _checked_tensions(kept: Tensions) -> Tensions:
    """Return the factors of tensions; raise StvkError for any other object."""
    if not isinstance(kept, Tensions):
        raise StvkError(
            f"kept = {shown(kept)}; expected ALL, TENSILE, NONE or WARPED of skfem_stvk.edges, or Tensions(positive, negative)."
        )
    return kept._replace(positive=number("kept: positive", kept.positive), negative=number("kept: negative", kept.negative))
