"""Forces on some nodes: their resultant, their moment, and each single force."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import arguments
from ..arguments import Array
from ..errors import SupportError
from ..linear import Kind, Unknowns
from ..linear.choose import direct
from ..mesh import ElementMesh
from ..mesh.displacements import by_vertex
from ..mesh.locations import LocationShape, Where, describe, vertices_at
from ..system import FreeDofs, System
from ..units import UNITS, UnitSystem


@dataclass(frozen=True, eq=False)
class Reaction:
    """Forces on some nodes of a deformed body, such as those of a support: vertices, and edge midpoints of quadratic elements.

    Attributes
    ----------
    vertices
        (n,) ids of the nodes in the whole mesh, ascending.
    by_node
        (n, d) force on each node [N].
    rest, u
        (n, d) positions of the nodes at rest, and their displacements [m].
    units
        System of units, for the text.

    Examples
    --------
    >>> mesh = ElementMesh(p=[[0, 2, 2, 0], [0, 0, 1, 1]], t=[[0, 0], [1, 2], [2, 3]])
    >>> force = np.array([[0, 0], [3.0, 1], [-3, 1], [0, 0]])
    >>> right = Reaction.of(mesh, np.zeros(8), force, [1, 2])
    >>> right
    Reaction at 2 vertices: resultant (0, 2) N, moment 3 N m about (2, 0.5)
    >>> right.moment(about=(0, 0))
    7.0
    """

    vertices: NDArray[np.int64]
    by_node: Array
    rest: Array
    u: Array
    units: UnitSystem = UNITS["SI"]

    @classmethod
    def of(cls, mesh: ElementMesh, u: ArrayLike, forces: ArrayLike, vertices: Where, units: UnitSystem = UNITS["SI"]) -> Reaction:
        """Return the nodal forces (nv, d) [N], flat or not, on the vertices at a location at displacements `u` (ndofs,) [m].

        Raises
        ------
        StateError
            if `u` or `forces` do not fit the mesh or are not finite.
        RegionError
            if there are no vertices, or not the listed ones.
        """
        mesh = ElementMesh.of(mesh)
        ids = np.sort(vertices_at(mesh, vertices, "Reaction at vertices"))
        here = cls(ids, _nodal(forces, "forces", mesh)[ids], mesh.p.T[ids], _nodal(u, "u", mesh)[ids], units)
        return here._of_all_parts(mesh) if mesh.space.comm.divided else here

    def _of_all_parts(self, mesh: ElementMesh) -> Reaction:
        """Return the forces on the nodes of all parts of a divided body, with ids of the whole mesh."""
        own = mesh.space.counted(np.ones(mesh.nv))[self.vertices] > 0
        values = np.stack([self.by_node, self.rest, self.u], axis=1)[own]
        ids, values = mesh.space.comm.gather(mesh.node_numbers[self.vertices[own]], values)
        forces, rest, u = values.transpose(1, 0, 2)
        return Reaction(ids, forces, rest, u, self.units)

    @property
    def resultant(self) -> Array:
        """Sum (d,) of the forces [N]."""
        return self.by_node.sum(axis=0)

    @property
    def centroid(self) -> Array:
        """Mean current position (d,) of the vertices [m]."""
        return self.rest.mean(axis=0) + self.u.mean(axis=0)

    def moment(self, about: ArrayLike | None = None) -> Array | float:
        """Return the moment `sum (x - about) x f` [N m] with current lever arms: (3,) in space, a number in the plane, 0 on a line.

        `about` is a point (d,), by default the current centroid of these vertices.

        Raises
        ------
        StvkError
            if `about` is not a point of this space.
        """
        if about is None:
            levers = _centred(self.rest) + _centred(self.u)
        else:
            d = self.rest.shape[1]
            levers = self.rest - arguments.array("about", about, (d,), f"a point with {d} coordinates [m]") + self.u
        return moment_of(levers, self.by_node)

    def __repr__(self) -> str:
        count = f"{len(self.vertices)} {'vertex' if len(self.vertices) == 1 else 'vertices'}"
        moment = (
            ""
            if self.rest.shape[1] == 1
            else f", moment {_digits(self.moment())} {self.units.of('N m')} about {_digits(self.centroid)}"
        )
        return f"Reaction at {count}: resultant {_digits(self.resultant)} {self.units.of('N')}{moment}"


def moment_of(levers: Array, forces: Array) -> Array | float:
    """Return the moment `sum levers x forces` of vectors (n, d) [N m]: (3,) in space, a number in the plane, 0 on a line."""
    if levers.shape[1] == 3:
        return np.cross(levers, forces).sum(axis=0)
    return float((levers[:, 0] * forces[:, -1] - levers[:, -1] * forces[:, 0]).sum())


def ground_forces_at_rest(system: System, u: Array, t: float, projected: bool = False) -> Array:
    """Return the forces (ndofs,) of supports and foundations on a body in equilibrium at the load factor `t` [N].

    `projected`: the displacements are in equilibrium only on a basis. The tangent there carries the remaining forces at free
    degrees of freedom to the ground, as after one more step of Newton's method. With them the reactions balance the loads.
    """
    constrained, forces, residual = system.supports.held, system.foundation_force(u), system.residual(u, t)
    if projected:
        K, free = system.jacobian(u, t), system.free_dofs(constrained)
        factors = direct(len(free.free)).analyse(unknowns_of(free, system.mesh.d)).factorise(free.matrix(K), Kind.GENERAL)
        du = free.vector(factors.solve(-residual[free.free]).x)
        residual += K @ du
        forces = system.foundation_force(u + du)
    forces[constrained] += residual[constrained]
    return forces


def unknowns_of(free: FreeDofs, d: int) -> Unknowns:
    """Return the free degrees of freedom as direct solvers take them."""
    return Unknowns(*np.divmod(free.free, d), free.structure.indptr, free.structure.indices)


def constrained_vertices(system: System, where: Where | None, what: str = "reaction") -> NDArray[np.int64]:
    """Return the ascending indices of the vertices at a location that supports constrain or foundations tie to the ground; None
    means everywhere.

    Raises SupportError if there are none. Messages begin with the purpose `what`.
    """
    constrained = np.union1d(system.supports.held, system.grounded)
    vertices, space = np.unique(constrained // system.mesh.d).astype(np.int64), system.space
    if where is None:
        if not space.comm.any(len(vertices) > 0):
            raise SupportError(f"{what}: the body has no supports and no foundations, so it has no reactions.")
        return vertices
    vertices = np.intersect1d(vertices, vertices_at(system.mesh, where, what))
    if not space.comm.any(len(vertices) > 0):
        raise SupportError(
            f"{what}: no support and no foundation acts at {describe(where)}, so there is no reaction. Check the location."
        )
    return vertices


class ReactionPlace(NamedTuple):
    """Location of a reaction: its vertices (n,), the shares (n, d) of the forces there, and its words if it is that of a support.

    The location of a support has the components that this support constrains. A component that k supports constrain at a node
    gives each of them 1/k of the force, so that the reactions of all supports add up. Forces of foundations belong to the supports
    at a node, or to the foundation where there are none. Any other location has all forces at its nodes.
    """

    vertices: NDArray[np.int64]
    shares: Array
    support: str

    @classmethod
    def of(cls, system: System, where: Where | None, what: str = "reaction", support: str | None = None) -> ReactionPlace:
        """Return the vertices at a location that are constrained, and their shares. Errors as in `constrained_vertices`.

        The location of a support is the same name, shape or tuple of ids as for `fixed` or `prescribed`, or the same object. If
        `support` is not None, it has the words of the support whose vertices are `where`, or is empty for another location.
        """
        vertices, d, own = constrained_vertices(system, where, what), system.mesh.d, np.zeros(system.ndofs)
        words, (by_words, counts) = describe(where) if support is None else support, _dofs_of_supports(system)
        alike = support is not None or isinstance(where, str | tuple | LocationShape)
        for place, dofs in by_words.get(words, ()):
            own[dofs] += (alike or place is where) and np.isin(dofs // d, vertices).all()
        if where is None or not system.space.comm.any(bool(own.any())):
            return cls(vertices, np.ones((len(vertices), d)), "")
        return cls(vertices, (own / np.maximum(counts, 1)).reshape(-1, d)[vertices], words)

    def forces(self, of_all: Array) -> Array:
        """Return the forces (n, d) on its vertices, from those of supports and foundations on all nodes (ndofs,)."""
        of_vertices: Array = self.shares * of_all.reshape(-1, self.shares.shape[1])[self.vertices]
        return of_vertices

    def reaction(self, system: System, u: Array, of_all: Array) -> Reaction:
        """Return the reaction at displacements `u`, from the forces on all nodes (ndofs,)."""
        forces = np.zeros((system.mesh.nv, system.mesh.d))
        forces[self.vertices] = self.forces(of_all)
        return Reaction.of(system.mesh, u, forces, system.mesh.node_numbers[self.vertices], system.units)


def _dofs_of_supports(system: System) -> tuple[dict[str, list[tuple[Where | None, NDArray[np.int64]]]], Array]:
    """Return the degrees of freedom whose reactions belong to a support, and how many supports (ndofs,) each belongs to.

    They are listed with the location of the support, by its words. The force of a foundation belongs to the supports at a node,
    and to the foundation where there are none.
    """
    d, counts = system.mesh.d, np.zeros(system.ndofs)
    found: dict[str, list[tuple[Where | None, NDArray[np.int64]]]] = defaultdict(list)

    def add(where: Where | None, dofs: NDArray[np.int64]) -> None:
        found[describe(where)].append((where, dofs))
        counts[dofs] += 1

    tied = np.setdiff1d(system.grounded, system.supports.held)
    for where, dofs in system.supports.entries:
        add(where, np.concatenate([dofs, tied[np.isin(tied // d, dofs // d)]]))
    alone = tied[counts[tied] == 0]
    for term in system.foundations:
        add(term.where, np.intersect1d(alone, system.space.union(term.grounded, system.ndofs)))
    return found, counts


def _centred(x: Array) -> Array:
    """Return the rows without their mean. The first row is subtracted before, since far from the origin the mean would round `u`
    off.
    """
    x = x - x[0]
    return x - x.mean(axis=0)


def _nodal(values: ArrayLike, name: str, mesh: ElementMesh) -> Array:
    """Return finite numbers (nv, d), from the same shape or from (nv d,)."""
    given = arguments.real_array(values)
    flat = values if given is None or given.shape != (mesh.nv, mesh.d) else given.ravel()
    return by_vertex(mesh, flat, name).astype(np.float64, copy=False)


def _digits(values: ArrayLike) -> str:
    numbers = [f"{value:.6g}" for value in np.atleast_1d(values)]
    return numbers[0] if np.ndim(values) == 0 else f"({', '.join(numbers)})"
