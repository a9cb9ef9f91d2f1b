"""Spaces of vectors: products, norms and maps between a space and its subspaces; and the communicator of a divided body."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cached_property
from math import nan
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .arguments import Array
from .errors import StateError, StvkError

Number = TypeVar("Number", float, Array)
Item = TypeVar("Item")

#: Range of sums of squares. Outside it they may have underflowed or overflowed.
SQUARES = 1e-280, 1e300
#: Block of work that no other part takes part in.
ALONE = nullcontext()


class Communicator:
    """Communicator of the parts of a body. Here there is one part, on one process; on several ranks see `ranks.Ranks`.

    All parts must call its methods in the same order, and so the methods that use them.

    Attributes
    ----------
    rank, size, divided
        Number of this part, from 0, number of parts, and whether there are several.
    mpi
        Communicator of MPI; None on one process.
    """

    rank, size, divided = 0, 1, False
    mpi: Any = None

    @property
    def leads(self) -> bool:
        """Whether this part prints and writes what is of the whole body."""
        return self.rank == 0

    def total(self, x: Number) -> Number:
        """Return the sum of a number, or of an array entry by entry, over all parts."""
        return x

    def least(self, x: Number) -> Number:
        """Return the smallest of the numbers of all parts; of arrays, entry by entry."""
        return x

    def most(self, x: Number) -> Number:
        """Return the largest of the numbers of all parts; of arrays, entry by entry."""
        return x

    def any(self, x: bool) -> bool:
        """Return whether `x` is true in any part."""
        return x

    def each(self, x: Item) -> list[Item]:
        """Return the objects `x` of all parts, in their order."""
        return [x]

    def collect(self, x: Any) -> list[Any]:
        """Return the objects of all parts, in their order, on the part that leads; an empty list elsewhere."""
        return [x]

    def broadcast(self, x: Any) -> Any:
        """Return the object of the part that leads."""
        return x

    def end_step(self, stop: bool) -> bool:
        """Return whether `stop` is true in any part. The warnings of all parts since the last call are issued once."""
        return stop

    def united(
        self, group: NDArray[np.int32], numbers: NDArray[np.int64], items: NDArray[np.int64], keys: NDArray[np.int64]
    ) -> NDArray[np.int32]:
        """Return the group (n,) of each item in the whole body, from its group in this part; groups with equal keys are one.

        Items are nodes or elements, with `numbers` (n,) in the whole body, and `keys[:, i]` is a key of `items[i]`. Groups are in
        the order of their first items.
        """
        return group

    def gather(self, numbers: NDArray[np.int64], values: Array) -> tuple[NDArray[np.int64], Array]:
        """Return the `numbers` (n,) of all parts, ascending, and their `values` (n, ...). Each number is in one part only."""
        every, of_all = (np.concatenate(arrays) for arrays in zip(*self.each((numbers, values)), strict=True))
        order = np.argsort(every)
        return every[order], of_all[order]

    def together(self) -> AbstractContextManager[None]:
        """Raise StateError in all parts of a divided body if the block raises it in one.

        The block is for one part: it does not combine results.
        """
        return self._together() if self.divided else ALONE

    @contextmanager
    def _together(self) -> Iterator[None]:
        error = None
        try:
            yield
        except StateError as one:
            error = one
        self._raise_in_all(error, self.any(error is not None))

    def sum_of(self, work: Callable[..., float], *arguments: Any) -> float:
        """Return the sum of `work(*arguments)` over all parts, with the errors of `together` and one reduction."""
        if not self.divided:
            return work(*arguments)
        found, error = None, None
        try:
            found = work(*arguments)
        except StateError as one:
            error = one
        total, errors = self.total(np.array([nan if found is None else found, error is not None], dtype=np.float64))
        self._raise_in_all(error, bool(errors))
        return float(total)

    def refuse_divided(self, what: str, expected: str, reason: str) -> None:
        """Refuse an analysis or an option `what` of a body that is divided into parts, with the expected value and the reason.

        >>> Communicator().refuse_divided("stability = True", "False", "K is not factorised.")
        """
        if self.divided:
            raise StvkError(f"{what}; expected {expected} for a body that is divided into parts: {reason}")

    def _raise_in_all(self, error: StateError | None, raised: bool) -> None:
        if raised:
            text = next(filter(None, self.each("" if error is None else str(error))), "")
            raise error or StateError(text)


#: Communicator of a body that is not divided.
ONE_PROCESS = Communicator()


class Space:
    """Space of vectors (n,), such as the displacements of all degrees of freedom of a body.

    `on` and `spanned_by` return subspaces. A space has vectors of one kind, and the kind is never inferred from their length. A
    subclass maps its vectors to those of another space: it overrides `expand` and `restrict`. In a divided body each part has the
    vectors of its own nodes, and `comm` combines the results of the parts.

    Parameters
    ----------
    n
        Length of its vectors.
    comm
        Communicator of the parts of a divided body.

    Examples
    --------
    >>> V = np.array([[1.0], [1.0], [2.0]])
    >>> whole = Space(3)
    >>> whole.on(np.array([0, 2])).expand(np.array([5.0, 7.0])), whole.on(np.array([0, 2])).restrict(np.array([1.0, 2.0, 3.0]))
    (array([5., 0., 7.]), array([1., 3.]))
    >>> whole.spanned_by(V).expand(np.array([2.0])), whole.spanned_by(V).restrict(np.array([1.0, 2.0, 3.0]))
    (array([2., 2., 4.]), array([9.]))
    """

    def __init__(self, n: int, comm: Communicator = ONE_PROCESS) -> None:
        self.n, self.comm = n, comm

    @cached_property
    def owned(self) -> tuple[slice, ...]:
        """Ranges of the entries that count in products and sums: all, or in a divided body those of this part, ascending."""
        return (slice(0, self.n),)

    @cached_property
    def count(self) -> int:
        """Number of entries of the vectors of the whole body."""
        return int(self.comm.total(sum(own.stop - own.start for own in self.owned)))

    @cached_property
    def numbers(self) -> NDArray[np.int64]:
        """Numbers (n,) of the entries, independent of the division of a mesh."""
        return np.arange(self.n)

    @cached_property
    def shared(self) -> NDArray[np.int64]:
        """Nodes that other parts have, too, ascending."""
        return np.empty(0, dtype=np.int64)

    def on(self, dofs: NDArray[np.integer] | slice) -> Space:
        """Return the space of some entries, by their indices: the free degrees of freedom, for example."""
        return Entries(self, dofs)

    def spanned_by(self, V: Array) -> Space:
        """Return the space of coordinates x (m,) of vectors `V x`, with the columns of `V` (n, m)."""
        return Span(V)

    def expand(self, x: Array) -> Array:
        """Return the vector of the parent space; `x` itself if there is no parent space."""
        return x

    def restrict(self, f: Array) -> Array:
        """Apply the transpose of `expand`: return the forces (n,) on the coordinates of this space."""
        return f

    def entries(self, dofs: NDArray[np.integer]) -> Callable[[Array], Array]:
        """Return a function that computes the entries `dofs` of `expand(x)` alone, such as the displacements of a few nodes."""
        return lambda x: self.expand(x)[dofs]

    def dot(self, x: Array, y: Array) -> float:
        """Return `x . y` without BLAS, whose threads wait for those of the kernels.

        On a busy machine this takes 0.05 ms instead of 5 ms for 50 000 entries.
        """
        product = 0.0
        for own in self.owned:
            product += float(np.einsum("i,i", x[own], y[own]))
        return self.comm.total(product)

    def norm(self, x: Array) -> float:
        """Return `|x|`, also if squares underflow or overflow, because forces of 1e-200 N count."""
        square = self.dot(x, x)  # einsum does not warn of overflow
        if SQUARES[0] < square < SQUARES[1]:
            return float(np.sqrt(square))
        largest = self.comm.most(float(np.abs(x).max(initial=0.0)))
        return largest * self.norm(x / largest) if 0 < largest < np.inf else largest

    def random(self, seed: int = 0) -> Array:
        """Return normally distributed numbers (n,), the same for each seed and each division of a body."""
        return normal(self.numbers, seed)

    def share(self, f: Array) -> Array:
        """Add, in place, the contributions of other parts at shared nodes to `f`; return `f`.

        `f` is contiguous, with one number or row for each entry, or for each node: (n,), (nv,), (nv, d) or (nv, d, d).
        """
        return f

    def counted(self, x: Array) -> Array:
        """Return `x`, (n,) or (nv,), with zeros at the entries or nodes that other parts count; `x` itself on one process."""
        if not self.comm.divided:
            return x
        each, counts = max(self.n // max(len(x), 1), 1), np.zeros(len(x))  # a part may have no free degrees of freedom
        for own in self.owned:
            counts[own.start // each : own.stop // each] = 1
        return x * counts

    def union(self, ids: NDArray[np.int64], count: int) -> NDArray[np.int64]:
        """Return the nodes, or entries, that at least one of the parts names by its `ids`, ascending.

        The part has `count` nodes or entries. Another part may have the facets or elements at a shared node that a name means.
        """
        if not self.comm.divided:
            return ids
        named = np.zeros(count)
        named[ids] = 1
        return np.flatnonzero(self.share(named))

    def few(self, nodes: NDArray[np.bool_], most: int = 5) -> tuple[NDArray[np.int64], int]:
        """Return the first numbers in the whole body of the chosen nodes (nv,) of all parts, and how many these nodes are."""
        d = self.n // len(nodes)
        numbers = np.unique(self.numbers[::d][nodes] // d)[:most]
        count = int(self.comm.total(float(self.counted(nodes.astype(float)).sum())))
        return np.unique(np.concatenate(self.comm.each(numbers)))[:most], count


class Entries(Space):
    """Subspace of some of the entries of a space's vectors."""

    def __init__(self, whole: Space, dofs: NDArray[np.integer] | slice) -> None:
        super().__init__(len(range(whole.n)[dofs]) if isinstance(dofs, slice) else len(dofs), whole.comm)
        self._whole, self._dofs = whole, dofs

    @cached_property
    def numbers(self) -> NDArray[np.int64]:
        return self._whole.numbers[self._dofs]

    @cached_property
    def owned(self) -> tuple[slice, ...]:
        dofs = np.arange(self._whole.n)[self._dofs]  # ascending
        return tuple(slice(*np.searchsorted(dofs, [own.start, own.stop])) for own in self._whole.owned)

    def expand(self, x: Array) -> Array:
        v = np.zeros(self._whole.n)
        v[self._dofs] = x
        return v

    def restrict(self, f: Array) -> Array:
        part: Array = f[self._dofs]
        return part

    def share(self, f: Array) -> Array:
        if self.comm.divided:
            f[:] = self.restrict(self._whole.share(self.expand(f)))
        return f


class Span(Space):
    """Coordinates of the vectors of a space that lie in the span of some columns."""

    def __init__(self, V: Array) -> None:
        super().__init__(V.shape[1])
        self._V = V

    def expand(self, x: Array) -> Array:
        v: Array = self._V @ x
        return v

    def restrict(self, f: Array) -> Array:
        part: Array = f @ self._V
        return part

    def entries(self, dofs: NDArray[np.integer]) -> Callable[[Array], Array]:
        V = self._V[dofs]
        return lambda x: V @ x


def normal(numbers: NDArray[np.int64], seed: int) -> Array:
    """Return normally distributed numbers (n,) that depend on the `numbers` (n,) and the seed alone.

    Counters are mixed by SplitMix64 (Steele, Lea, Flood 2014, OOPSLA) and transformed as by Box and Muller (1958).

    >>> bool(normal(np.array([7, 3]), 0)[1] == normal(np.array([3]), 0)[0])
    True
    """
    x = 2 * numbers.astype(np.uint64) + np.uint64((seed * 0xD1342543DE82EF95) % 2**64)
    radius, angle = ((_mixed(x + np.uint64(i)) >> np.uint64(11)) * 2.0**-53 for i in range(2))
    return np.sqrt(-2 * np.log1p(-radius)) * np.cos(2 * np.pi * angle)


def _mixed(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return the numbers of SplitMix64 for counters `x`."""
    x = (x + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))
