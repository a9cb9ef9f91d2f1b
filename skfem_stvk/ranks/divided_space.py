"""Ranks of MPI as a communicator, and the space of the displacements of a body on them: sums over shared nodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import errors
from ..arguments import Array
from ..mesh.facets import linked
from ..space import Communicator, Item, Number, Space
from .job import MPI

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


class Ranks(Communicator):
    """Communicator of ranks of MPI, each of which has a part of a body.

    Parameters
    ----------
    mpi
        Communicator of MPI; this one has a duplicate of it.
    """

    def __init__(self, mpi: MPI.Comm) -> None:
        self.mpi, self.traffic = mpi.Dup(), Traffic()
        self.rank, self.size, self.divided = mpi.rank, mpi.size, mpi.size > 1
        self._one, self._sum = np.empty(1), np.empty(1)
        if self.divided and errors.on_rank is None:
            errors.on_rank = errors.RankWarnings(prints=self.leads)

    def total(self, x: Number) -> Number:
        return self._reduced(x, MPI.SUM)

    def least(self, x: Number) -> Number:
        return self._reduced(x, MPI.MIN)

    def most(self, x: Number) -> Number:
        return self._reduced(x, MPI.MAX)

    def any(self, x: bool) -> bool:
        return self._reduced(float(x), MPI.MAX) > 0

    def each(self, x: Item) -> list[Item]:
        return self.mpi.allgather(x)

    def collect(self, x: Any) -> list[Any]:
        return self.mpi.gather(x) or []

    def broadcast(self, x: Any) -> Any:
        return self.mpi.bcast(x)

    def end_step(self, stop: bool) -> bool:
        if errors.on_rank is None:
            return self.any(stop)
        stops, warned = self.total(np.array([stop, bool(errors.on_rank.texts)], dtype=float))
        if warned:
            own, parts = errors.on_rank.texts, self.mpi.gather(errors.on_rank.texts)
            others = dict.fromkeys(text for texts in parts or () for text in texts if text not in own)
            errors.on_rank.texts = []
            for text in others:
                errors.issue(text)
        return bool(stops)

    def united(self, group: NDArray[np.int32], numbers: Ids, items: Ids, keys: Ids) -> NDArray[np.int32]:
        first = np.full(int(group.max(initial=-1)) + 1, np.iinfo(np.int64).max)
        np.minimum.at(first, group, numbers)
        counts = self.mpi.allgather(len(first))
        begin = sum(counts[: self.rank])
        links = self.collect(self._with_equal_keys(begin + group[items], keys))
        firsts, numbered = self.collect(first), None
        if self.leads:
            a, b = np.concatenate(links, axis=1)
            of_all = linked(a, b, sum(counts))
            lowest = np.full(int(of_all.max(initial=-1)) + 1, np.iinfo(np.int64).max)
            np.minimum.at(lowest, of_all, np.concatenate(firsts))
            numbered = np.split(np.argsort(np.argsort(lowest)).astype(np.int32)[of_all], np.cumsum(counts)[:-1])
        return np.asarray(self.mpi.scatter(numbered)[group])

    def _with_equal_keys(self, labels: Ids, keys: Ids) -> Ids:
        """Return pairs (2, n) of the labels of all ranks with equal keys, each pair once; each rank compares some of the keys."""
        to = keys.sum(axis=0) % self.size
        rows = np.concatenate([keys, labels[None]])
        received = np.concatenate(self.mpi.alltoall([rows[:, to == rank] for rank in range(self.size)]), axis=1)
        received = received[:, np.lexsort(received[::-1])]
        same = (received[:-1, 1:] == received[:-1, :-1]).all(axis=0)
        return np.unique(np.stack([received[-1, :-1][same], received[-1, 1:][same]]), axis=1)

    def _reduced(self, x: Number, operation: MPI.Op) -> Number:
        self.traffic.reductions += 1
        if isinstance(x, np.ndarray):
            values = np.ascontiguousarray(x)
            found = np.empty_like(values)
            self.mpi.Allreduce(values, found, operation)
            return found
        self._one[0] = x
        self.mpi.Allreduce(self._one, self._sum, operation)
        return float(self._sum[0])


class DividedSpace(Space):
    """Space of the vectors (d nv,) of one rank's part of a body, with all nodes of its elements.

    Sums over elements are complete at the nodes of one rank alone. `share` adds the contributions at nodes of several ranks in
    ascending order of ranks, from zero, so that all of them have the same bits. Each node counts on the lowest rank that has it.

    Parameters
    ----------
    comm
        Communicator of the ranks.
    d
        Number of components at each node.
    node_numbers
        (nv,) numbers of the nodes in the whole body.
    own
        Ranges of the nodes that count on this rank, ascending.
    neighbours
        Nodes shared with each neighbouring rank, in ascending order of their numbers.
    """

    comm: Ranks

    def __init__(
        self, comm: Ranks, d: int, node_numbers: Ids, own: tuple[slice, ...], neighbours: Mapping[int, NDArray[np.integer]]
    ) -> None:
        super().__init__(d * len(node_numbers), comm)
        self.neighbours = dict(sorted(neighbours.items()))
        self.numbers = (d * node_numbers[:, None] + np.arange(d)).ravel()
        self.owned = tuple(slice(d * nodes.start, d * nodes.stop) for nodes in own)
        self.shared = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *self.neighbours.values()])).astype(np.int64)
        self.count = int(comm.total(sum(of.stop - of.start for of in self.owned)))
        self._nodes, self._exchanges = len(node_numbers), dict[int, _Exchange]()

    def share(self, f: Array) -> Array:
        if self.neighbours:
            rows = f.reshape(self._nodes, -1)
            if rows.shape[1] not in self._exchanges:
                self._exchanges[rows.shape[1]] = _Exchange(self, rows.shape[1])
            self._exchanges[rows.shape[1]].add_up(rows)
        return f


class _Exchange:
    """Exchange of rows of `width` numbers at shared nodes with all neighbours, by persistent requests."""

    def __init__(self, space: DividedSpace, width: int) -> None:
        self._traffic, self._shared = space.comm.traffic, space.shared
        nodes = np.concatenate([np.empty(0, dtype=np.int64), *space.neighbours.values()]).astype(np.int64)
        ends = np.cumsum([0, *(len(ids) for ids in space.neighbours.values())])
        self._nodes, self._sent, self._received = nodes, np.empty((len(nodes), width)), np.empty((len(nodes), width))
        self._sum, self._requests = np.empty((len(self._shared), width)), []
        position = np.searchsorted(self._shared, nodes)
        parts: list[tuple[int, Ids | None, Array | None]] = [(space.comm.rank, None, None)]
        for rank, begin, end in zip(space.neighbours, ends[:-1], ends[1:], strict=True):
            self._requests.append(space.comm.mpi.Recv_init(self._received[begin:end], rank, width))
            self._requests.append(space.comm.mpi.Send_init(self._sent[begin:end], rank, width))
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
