"""Mesh of one rank's part of a body, and the distribution of a mesh over ranks."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ..errors import MeshError, name_ids
from ..mesh import ElementMesh, MeshLike, read_mesh
from ..mesh.diagnostics import check_mesh
from ..mesh.element import Element, named
from ..mesh.facets import edges_of
from ..mesh.locations import Box
from ..mesh.read import is_partition
from ..space import Space
from .divided_space import DividedSpace, Ranks
from .job import MPI, on_each, on_first, refuse_unguarded, world
from .partition import Ids, PartContent, divide
from .partition_files import lines_and_facets, read_part


@dataclass(frozen=True, eq=False, repr=False)
class MeshPart(ElementMesh):
    """Mesh of the elements of one rank, with all of their nodes; `distribute` makes it.

    Nodes of which this rank is the lowest come first, among vertices and among edge midpoints; each group is in reverse
    Cuthill-McKee order. Nodes of a part that shares none have the order of the mesh. Names refer to what this rank has of a
    location, which may be nothing. Ids of nodes and elements that users pass in are those of the whole mesh.

    Attributes
    ----------
    space
        Space of the displacements; its communicator combines the results of all ranks.
    surface
        (m, n) facets of the surface of the whole body; facets between ranks are not among them.
    node_numbers, element_numbers
        (nv,) and (nt,) numbers of nodes and elements in the whole mesh.
    bounds
        (d, 2) smallest and largest coordinates of the whole body.
    element_count
        Number of elements of the whole mesh.
    boundary_numbers, line_numbers
        Numbers of the facets and segments of each name among those of the whole mesh.
    """

    space: DividedSpace = field(kw_only=True)
    surface: NDArray[np.int32] = field(kw_only=True)
    node_numbers: Ids = field(kw_only=True)
    element_numbers: Ids = field(kw_only=True)
    bounds: NDArray[np.float64] = field(kw_only=True)
    element_count: int = field(kw_only=True)
    boundary_numbers: Mapping[str, NDArray[np.integer]] = field(kw_only=True)
    line_numbers: Mapping[str, NDArray[np.integer]] = field(kw_only=True)
    _boxes: dict[Box, Ids] = field(init=False, default_factory=dict)

    checked = True

    def __post_init__(self) -> None:
        for name in ("p", "t", "surface"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name)))

    def elements(self, region: str | Box | slice | NDArray[Any] | None) -> Ids:
        """Return the indices of the elements of a region on this rank; see `ElementMesh.elements`. There may be none.

        All ranks call it together for a `Box` that is new.
        """
        if isinstance(region, str) and region in self.subdomains:
            return self.subdomains[region].astype(np.int64)
        if not isinstance(region, Box):
            return super().elements(region)
        if region not in self._boxes:
            self._boxes[region] = super().elements(region)
        return self._boxes[region]

    @classmethod
    def from_part(cls, part: PartContent, comm: MPI.Comm) -> MeshPart:
        """Return the mesh of this rank's part; each rank of the communicator has its own, numbered by its rank."""
        foreign = np.zeros(part.p.shape[1], dtype=bool)
        foreign[part.shared[0, part.shared[1] < comm.rank]] = True
        order, own = _order(part, foreign)
        number = np.empty(len(order), dtype=np.int32)
        number[order] = np.arange(len(order), dtype=np.int32)
        numbers = part.node_numbers[order]
        neighbours = {}
        for rank in np.unique(part.shared[1]).tolist():
            neighbours[rank] = number[part.shared[0, part.shared[1] == rank]]
        space = DividedSpace(Ranks(comm), len(part.p), numbers, own, neighbours)
        return cls(
            p=part.p[:, order],
            t=number[part.t],
            subdomains=part.subdomains,
            boundaries={name: number[facets] for name, facets in part.boundaries.items()},
            node_sets={name: np.sort(number[ids]) for name, ids in part.node_sets.items()},
            element=part.element,
            lines={name: number[ends] for name, ends in part.lines.items()},
            space=space,
            surface=number[part.surface],
            node_numbers=numbers,
            element_numbers=part.element_numbers,
            bounds=part.bounds,
            element_count=int(space.comm.total(len(part.element_numbers))),
            boundary_numbers=part.boundary_numbers,
            line_numbers=part.line_numbers,
        )

    def values(self, values: NDArray[Any], region: str | Box | NDArray[Any] | None = None) -> NDArray[Any]:
        """Return those of the values of all elements of the body that belong to this rank's elements of a region.

        A rank without such elements gets a single value, which a material takes for any number of elements.

        Parameters
        ----------
        values
            (nt, ...) values of the elements of the whole mesh, such as a stiffness.
        region
            Elements, as in `elements`; None for all.
        """
        found = np.asarray(values)[self.element_numbers[self.elements(region)]]
        return found if len(found) else np.asarray(values)[0]

    def local_nodes(self, ids: Ids) -> Ids:
        """Return the indices of those nodes with these numbers that this rank has, in their order."""
        found = _indices(self.node_numbers, ids)
        return found[found >= 0]

    def local_elements(self, ids: Ids) -> Ids:
        """Return the indices of those elements with these numbers that this rank has, in their order."""
        found = _indices(self.element_numbers, ids)
        return found[found >= 0]

    def beside(self, t: NDArray[np.int32], element: Element, simplices: Sequence[Any] = ()) -> MeshPart:
        """Return the mesh of this rank's other elements `t` (n, nt) on the same nodes; there may be none.

        They have the numbers of the user-supplied `simplices` of the whole mesh, one after another. All ranks call it together.
        """
        facet, numbers, count = named(element.facet), [np.empty(0, dtype=np.int64)], 0
        for own in map(self._numbers_of, simplices):
            numbers.append(count + own.astype(np.int64))
            count += int(self.space.comm.total(float(len(own))))
        return replace(
            self,
            t=t,
            element=element,
            subdomains={},
            boundaries={},
            lines={},
            surface=np.empty((facet.n, 0), dtype=np.int32),
            element_numbers=np.concatenate(numbers) if simplices else np.arange(t.shape[1]),
            element_count=count if simplices else t.shape[1],
        )

    def _numbers_of(self, simplices: Any) -> NDArray[np.integer]:
        """Return the numbers of this rank's simplices of a name, or of nodes of the whole mesh, among all of them."""
        if isinstance(simplices, str):
            return (self.boundary_numbers if self.k > 1 and simplices in self.boundaries else self.line_numbers)[simplices]
        return np.flatnonzero(self._lowest_rank(_indices(self.node_numbers, np.asarray(simplices))) == self.space.comm.rank)

    def _lowest_rank(self, own: Ids) -> Ids:
        """Return the lowest rank (nt,) that has all nodes of each element; `own` (n, nt) are indices on this rank, or -1."""
        return self.space.comm.least(np.where((own >= 0).all(axis=0), self.space.comm.rank, self.space.comm.size))

    def local_cells(self, t: NDArray[np.int32], what: str) -> NDArray[np.int32]:
        """Return those of other elements `t` (n, nt), with the nodes of the whole mesh, that are on this rank, by its own nodes.

        Each is on the lowest rank that has all of its nodes.

        Raises
        ------
        MeshError
            if no rank has all nodes of an element; `what` begins the message.
        """
        own = _indices(self.node_numbers, t)
        rank = self._lowest_rank(own)
        if len(bad := np.flatnonzero(rank == self.space.comm.size)):
            raise MeshError(
                f"{what}: {name_ids(bad, 'element')} with nodes of which no rank has all; expected each on one rank. Name these "
                "elements in mesh.lines or mesh.boundaries before the mesh is divided, and give the name: simplices='cables'."
            )
        return own[:, rank == self.space.comm.rank].astype(np.int32)

    def with_degree(self, degree: int) -> ElementMesh:
        if degree == self.element.degree:
            return self
        raise MeshError(
            f"degree = {degree} for a rank's part of a mesh of degree {self.element.degree}; expected the same degree. Convert the "
            "whole mesh: distribute(mesh.with_degree(2)), or skfem-stvk partition --degree 2."
        )

    def __repr__(self) -> str:
        return f"{super().__repr__().replace('ElementMesh', 'MeshPart')}, on rank {self.space.comm.rank} of {self.space.comm.size}"


def distribute(mesh: MeshLike | str | os.PathLike[str], comm: MPI.Comm | None = None, part_of: Any = None) -> MeshPart:
    """Return this rank's part of a mesh; all ranks of the communicator call this function together.

    Kernels then run on one thread on each rank, unless `NUMBA_NUM_THREADS` is set. `numba.set_num_threads` changes it afterwards.

    Parameters
    ----------
    mesh
        Path of a partition file (.h5), of which each rank reads its part: see `write_partition`. Or path of another mesh file,
        which rank 0 reads by `read_mesh` and divides. Or a mesh as for `System`. The argument of rank 0 counts, and other ranks
        may pass None.
    comm
        Communicator, by default all ranks.
    part_of
        (nt,) rank of each element of a mesh; by default METIS divides the graph of elements that share a facet.

    Raises
    ------
    MeshError
        if the mesh cannot carry an elastic body, or has fewer elements than there are ranks; if the file cannot be read, is
        damaged, or has fewer parts than there are ranks; on all ranks.
    StvkError
        if an error on one of several ranks would not end the others: start the program by `mpiexec -n 4 python -m mpi4py run.py`.
        Or if the launcher and mpi4py belong to different MPI libraries.

    Warns
    -----
    StvkWarning
        on rank 0, for vertices at the same point, and for parts of the body that are not connected.

    Examples
    --------
    >>> import skfem
    >>> distribute(skfem.MeshTet().refined(1))
    MeshPart: 40 tetrahedra in 3D, 26 vertices, on rank 0 of 1
    """
    comm = world() if comm is None else comm
    refuse_unguarded(comm)
    if comm.size > 1 and "NUMBA_NUM_THREADS" not in os.environ:
        numba.set_num_threads(1)
    file = comm.bcast(mesh if isinstance(mesh, str | os.PathLike) else None)
    if file is not None and is_partition(file):
        if part_of is not None:
            raise MeshError(f"part_of is given with the file {file}, which is divided already; expected a mesh. Leave it out.")
        return MeshPart.from_part(on_each(comm, lambda: read_part(file, comm.rank, comm.size)), comm)

    def divided() -> Iterator[PartContent]:
        body = ElementMesh.of(mesh if file is None else read_mesh(file))
        check_mesh(body, lines_and_facets(body))
        return divide(body, comm.size, part_of)

    parts = on_first(comm, divided)
    if parts is None:
        return MeshPart.from_part(comm.recv(source=0), comm)
    own = next(parts)
    for rank, part in enumerate(parts, start=1):
        comm.send(part, rank)
    return MeshPart.from_part(own, comm)


def _indices(numbers: Ids, wanted: NDArray[np.integer]) -> Ids:
    """Return the index among the `numbers` of this rank's nodes or elements of each wanted one; -1 for those of other ranks."""
    order = np.append(np.argsort(numbers), -1)
    index = order[np.searchsorted(numbers, wanted, sorter=order[:-1])]
    return np.where(np.append(numbers, -1)[index] == wanted, index, -1)


def _order(part: PartContent, foreign: NDArray[np.bool_]) -> tuple[Ids, tuple[slice, ...]]:
    """Return the order of the nodes, and the ranges of own nodes: vertices first, and of each kind the nodes that are not
    `foreign`. A part that shares no nodes, such as that of the only rank, keeps the order of the mesh.
    """
    element, n, vertices = part.element, part.p.shape[1], part.vertices
    position = np.arange(n, dtype=np.float64)
    if part.shared.size:
        a, b = edges_of(part.t[: element.corners], element, n)[0]
        links = coo_matrix((np.ones(2 * len(a), dtype=np.int8), (np.append(a, b), np.append(b, a))), shape=(n, n)).tocsr()
        position[reverse_cuthill_mckee(links, symmetric_mode=True)] = np.arange(n)
        for i, corners in enumerate(element.means):
            position[part.t[element.corners + i]] = position[part.t[list(corners)]].mean(axis=0)
    middle = np.arange(n) >= vertices
    order = np.lexsort((np.arange(n), position, foreign, middle))
    ends = vertices - np.count_nonzero(foreign[:vertices]), n - np.count_nonzero(foreign[vertices:])
    own = slice(0, ends[0]), slice(vertices, ends[1])
    return order, own if element.degree == 2 else own[:1]


def gathered(space: Space, x: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the vector of the whole body on rank 0, in the order of the user's mesh; None on other ranks.

    Parameters
    ----------
    space
        Space of the vectors: `system.space`.
    x
        (n,) this rank's entries, or (nv,) numbers at its nodes.
    """
    if space.comm.mpi is None:
        return x
    each = space.n // len(x)
    own = np.concatenate([np.arange(slice_.start // each, slice_.stop // each) for slice_ in space.owned])
    numbers = space.numbers[::each][own] // each
    parts = space.comm.mpi.gather((numbers, x[own]))
    if parts is None:
        return None
    whole = np.empty(space.count // each)
    for ids, values in parts:
        whole[ids] = values
    return whole
