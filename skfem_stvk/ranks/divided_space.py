"""Space of the displacements of a body on several ranks: sums over shared nodes, and reductions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import errors
from ..arguments import Array
from ..kernels.threads import threads
from ..mesh.facets import linked
from ..space import Item, Number, Space
from .mpi import MPI

Ids = NDArray[np.int64]


@dataclass
class Traffic:
    """Counts of what a rank has sent since the last `reset`: bytes and messages to neighbours, and reductions over all ranks."""

    bytes: int = 0
    messages: int = 0
    reductions: int = 0

    def reset(self) -> None:
        """Set all counts to zero."""
        self.bytes = self.messages = self.reductions = 0


class Ranks(Space):
    """Space of the vectors (d nv,) of one rank's part of a body, with all nodes of its elements.

    Sums over elements are complete at the nodes of one rank alone. `share` adds the contributions at nodes of several ranks in
    ascending order of ranks, from zero, so that all of them have the same bits. Each node counts on the lowest rank that has it.

    Parameters
    ----------
    comm
        Communicator; the space has a duplicate of it.
    d
        Number of components at each node.
    node_numbers
        (nv,) numbers of the nodes in the whole body.
    own
        Ranges of the nodes that count on this rank, ascending.
    neighbours
        Nodes shared with each neighbouring rank, in ascending order of their numbers.
    element_numbers
        (nt,) numbers of the elements in the whole body.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        d: int,
        node_numbers: Ids,
        own: tuple[slice, ...],
        neighbours: Mapping[int, NDArray[np.integer]],
        element_numbers: Ids,
    ) -> None:
        super().__init__(d * len(node_numbers))
        self.comm, self.d, self.traffic = comm.Dup(), d, Traffic()
        self.rank, self.size = comm.rank, comm.size
        self.node_numbers, self.neighbours = node_numbers, dict(sorted(neighbours.items()))
        self.element_numbers = element_numbers
        self._owned = tuple(slice(d * nodes.start, d * nodes.stop) for nodes in own)
        self._is_own = np.zeros(len(node_numbers))
        for nodes in own:
            self._is_own[nodes] = 1
        self._shared = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *self.neighbours.values()])).astype(np.int64)
        self._exchanges: dict[int, _Exchange] = {}
        self._one, self._sum = np.empty(1), np.empty(1)
        self.count = int(self.total(float(d * self._is_own.sum())))
        self._parts = self._described()
        if self.divided and errors.on_rank is None:
            errors.on_rank = errors.RankWarnings(prints=self.leads)

    @property
    def prints(self) -> bool:
        return errors.on_rank is None or errors.on_rank.prints

    @property
    def parts(self) -> str:
        return self._parts

    def _described(self) -> str:
        """Return the number of ranks, and the numbers of elements and shared nodes of the smallest and the largest part."""
        sizes = len(self.element_numbers), len(self.shared)
        elements, nodes = (f"{self.least(size):.0f} to {self.most(size):.0f}" for size in sizes)
        each = f"{threads()} thread{'s' * (threads() > 1)}"
        return f"\n{self.size} ranks with {elements} elements, {nodes} shared nodes and {each} each" if self.divided else ""

    @property
    def owned(self) -> tuple[slice, ...]:
        return self._owned

    @property
    def shared(self) -> Ids:
        """Nodes of this rank that other ranks have, too, ascending."""
        return self._shared

    @cached_property
    def numbers(self) -> Ids:
        return (self.d * self.node_numbers[:, None] + np.arange(self.d)).ravel()

    def share(self, f: Array) -> Array:
        if self.neighbours:
            rows = f.reshape(len(self.node_numbers), -1)
            if rows.shape[1] not in self._exchanges:
                self._exchanges[rows.shape[1]] = _Exchange(self, rows.shape[1])
            self._exchanges[rows.shape[1]].add_up(rows)
        return f

    def counted(self, x: Array) -> Array:
        return x * (self._is_own if len(x) < self.n or self.d == 1 else np.repeat(self._is_own, self.d))

    def total(self, x: Number) -> Number:
        return self._reduced(x, MPI.SUM)

    def least(self, x: Number) -> Number:
        return self._reduced(x, MPI.MIN)

    def most(self, x: Number) -> Number:
        return self._reduced(x, MPI.MAX)

    def any(self, x: bool) -> bool:
        return self._reduced(float(x), MPI.MAX) > 0

    def each(self, x: Item) -> list[Item]:
        return self.comm.allgather(x)

    def end_step(self, stop: bool) -> bool:
        if errors.on_rank is None:
            return self.any(stop)
        stops, warned = self.total(np.array([stop, bool(errors.on_rank.texts)], dtype=float))
        if warned:
            own, parts = errors.on_rank.texts, self.comm.gather(errors.on_rank.texts)
            others = dict.fromkeys(text for texts in parts or () for text in texts if text not in own)
            errors.on_rank.texts = []
            for text in others:
                errors.issue(text)
        return bool(stops)

    def element_ids(self, ids: Ids, most: int | None = None) -> Ids:
        return np.unique(np.concatenate(self.each(np.sort(self.element_numbers[ids])[:most])))[:most]

    def collect(self, x: Any) -> list[Any]:
        return self.comm.gather(x) or []

    def broadcast(self, x: Any) -> Any:
        return self.comm.bcast(x)

    def united(self, group: NDArray[np.int32], numbers: Ids, items: Ids, keys: Ids) -> NDArray[np.int32]:
        first = np.full(int(group.max(initial=-1)) + 1, np.iinfo(np.int64).max)
        np.minimum.at(first, group, numbers)
        counts = self.comm.allgather(len(first))
        begin = sum(counts[: self.rank])
        links = self.collect(self._with_equal_keys(begin + group[items], keys))
        firsts, numbered = self.collect(first), None
        if self.leads:
            a, b = np.concatenate(links, axis=1)
            of_all = linked(a, b, sum(counts))
            lowest = np.full(int(of_all.max(initial=-1)) + 1, np.iinfo(np.int64).max)
            np.minimum.at(lowest, of_all, np.concatenate(firsts))
            numbered = np.split(np.argsort(np.argsort(lowest)).astype(np.int32)[of_all], np.cumsum(counts)[:-1])
        return np.asarray(self.comm.scatter(numbered)[group])

    def _with_equal_keys(self, labels: Ids, keys: Ids) -> Ids:
        """Return pairs (2, n) of the labels of all ranks with equal keys, each pair once; each rank compares some of the keys."""
        to = keys.sum(axis=0) % self.size
        rows = np.concatenate([keys, labels[None]])
        received = np.concatenate(self.comm.alltoall([rows[:, to == rank] for rank in range(self.size)]), axis=1)
        received = received[:, np.lexsort(received[::-1])]
        same = (received[:-1, 1:] == received[:-1, :-1]).all(axis=0)
        return np.unique(np.stack([received[-1, :-1][same], received[-1, 1:][same]]), axis=1)

    def _reduced(self, x: Number, operation: MPI.Op) -> Number:
        self.traffic.reductions += 1
        if isinstance(x, np.ndarray):
            values = np.ascontiguousarray(x)
            found = np.empty_like(values)
            self.comm.Allreduce(values, found, operation)
            return found
        self._one[0] = x
        self.comm.Allreduce(self._one, self._sum, operation)
        return float(self._sum[0])


class _Exchange:
    """Exchange of rows of `width` numbers at shared nodes with all neighbours, by persistent requests."""

    def __init__(self, space: Ranks, width: int) -> None:
        self._traffic, self._shared = space.traffic, space.shared
        nodes = np.concatenate([np.empty(0, dtype=np.int64), *space.neighbours.values()]).astype(np.int64)
        ends = np.cumsum([0, *(len(ids) for ids in space.neighbours.values())])
        self._nodes, self._sent, self._received = nodes, np.empty((len(nodes), width)), np.empty((len(nodes), width))
        self._sum, self._requests = np.empty((len(self._shared), width)), []
        position = np.searchsorted(self._shared, nodes)
        parts: list[tuple[int, Ids | None, Array | None]] = [(space.rank, None, None)]
        for rank, begin, end in zip(space.neighbours, ends[:-1], ends[1:], strict=True):
            self._requests.append(space.comm.Recv_init(self._received[begin:end], rank, width))
            self._requests.append(space.comm.Send_init(self._sent[begin:end], rank, width))
            parts.append((rank, position[begin:end], self._received[begin:end]))
        self._parts = [part[1:] for part in sorted(parts, key=lambda part: part[0])]

    def add_up(self, rows: Array) -> None:
        """Add the rows of all ranks at shared nodes, in ascending order of ranks, in place."""
        np.take(rows, self._nodes, axis=0, out=self._sent, mode="clip")
        MPI.Prequest.Startall(self._requests)
        self._traffic.messages += len(self._parts) - 1
        self._traffic.bytes += self._sent.nbytes
        own = rows[self._shared]
        self._sum[:] = 0
        MPI.Prequest.Waitall(self._requests)
        for position, received in self._parts:
            if position is None or received is None:
                self._sum += own
            else:
                self._sum[position] += received
        rows[self._shared] = self._sum
