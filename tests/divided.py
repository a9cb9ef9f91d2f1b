"""Bodies that are divided into parts, each in its own thread with a mesh and a space of its own."""

import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from copy import deepcopy
from functools import cached_property, reduce
from threading import Barrier, BrokenBarrierError

import numpy as np
import pytest
import skfem
from bodies import EVERY_MESH

from skfem_stvk import ElasticFoundation, ElementMesh, Gravity, StVK, System
from skfem_stvk.errors import StvkError
from skfem_stvk.mesh.facets import linked
from skfem_stvk.space import Communicator, Space


class Exchange:
    """Values that the parts exchange, each part in its own thread."""

    def __init__(self, parts):
        self.barrier, self._values = Barrier(parts, timeout=60), [None] * parts

    def values(self, part, value):
        """Return the values of all parts, in ascending order of parts."""
        self._values[part] = deepcopy(value)
        self.barrier.wait()
        found = list(self._values)
        self.barrier.wait()
        return found


class PartCommunicator(Communicator):
    """Communicator of a part of a body, which counts its reductions and the ids that it sends."""

    def __init__(self, exchange, part):
        self.reductions = self.ids_sent = 0
        self._of_all = lambda value: exchange.values(part, value)
        self.rank, self.size, self.divided = part, exchange.barrier.parties, True

    def total(self, x):
        return sum(self._reduced(x))

    def least(self, x):
        return reduce(np.minimum, self._reduced(x))

    def most(self, x):
        return reduce(np.maximum, self._reduced(x))

    def any(self, x):
        return any(self._reduced(x))

    def _reduced(self, x):
        self.reductions += 1
        return self._of_all(x)

    def each(self, x):
        self.ids_sent += len(x) if isinstance(x, np.ndarray) else 0
        return self._of_all(x)

    def collect(self, x):
        values = self._of_all(x)
        return values if self.leads else []

    def broadcast(self, x):
        return self._of_all(x)[0]

    def united(self, group, numbers, items, keys):
        every, first, links, known, begin = self._of_all((group, numbers, items, keys)), [], [], {}, [0]
        for group, numbers, items, keys in every:
            first += [numbers[group == one].min() for one in range(max(group, default=-1) + 1)]
            for item, key in zip(items, keys.T.tolist(), strict=True):
                label = begin[-1] + group[item]
                links.append((known.setdefault(tuple(key), label), label))
            begin.append(len(first))
        whole = linked(*np.array(links, dtype=int).reshape(-1, 2).T, len(first))
        lowest = {one: min(np.array(first)[whole == one]) for one in set(whole.tolist())}
        order = {one: number for number, one in enumerate(sorted(lowest, key=lowest.get))}
        return np.array([order[whole[begin[self.rank] + one]] for one in every[self.rank][0]], dtype=np.int32)


class PartSpace(Space):
    """Space of a part of a body with `n` degrees of freedom, `d` at each node; `numbers` are those of the part."""

    numbers = owned = None

    def __init__(self, exchange, part, n, d, numbers, owned):
        super().__init__(len(numbers), PartCommunicator(exchange, part))
        self._whole, self.numbers, self.owned = n, numbers, owned
        self.count, self._d = n, d

    def share(self, f):
        each = self.n // len(f)  # d for rows of nodes
        numbers, rows = self.numbers[::each] // each, f.reshape(self.n // each, -1)
        total = np.zeros((self._whole // each, rows.shape[1]))
        for of_part, values in self.comm._of_all((numbers, rows)):
            total[of_part] += values
        rows[:] = total[numbers]
        return f

    @property
    def shared(self):
        others = [ids for part, ids in enumerate(self.comm._of_all(self.numbers)) if part != self.comm.rank]
        return np.flatnonzero(np.isin(self.numbers[:: self._d], np.concatenate(others)))


class Part(ElementMesh):
    """Part of a mesh, with attributes that are set afterwards. Midpoints need not be in scikit-fem's order."""

    space = surface = node_numbers = element_numbers = element_count = bounds = None
    checked = True

    def __post_init__(self):
        object.__setattr__(self, "t", np.ascontiguousarray(self.t))

    def local_nodes(self, ids):
        return here(self.node_numbers, ids)

    def local_elements(self, ids):
        return here(self.element_numbers, ids)


def here(numbers, ids):
    """Return the indices of those `ids` that are among `numbers`, in their order."""
    index = {number: i for i, number in enumerate(numbers.tolist())}
    return np.array([index[i] for i in np.asarray(ids).tolist() if i in index], dtype=np.int64)


def part_of(mesh, parts, number, exchange):
    """Return the mesh of some elements, with the facets of the body's surface that it has, and its degrees of freedom.

    A node belongs to the first part that has it. Among the vertices and among the midpoints, a part's own nodes come first.
    """
    ids, d = parts[number], mesh.d
    nodes = np.unique(mesh.t[:, ids])
    middle, foreign = (
        np.isin(nodes, mesh.t[mesh.element.corners :]),
        np.isin(nodes, mesh.t[:, np.concatenate([[], *parts[:number]]).astype(int)]),
    )
    order = np.lexsort((foreign, middle))
    starts = d * np.array([0, np.count_nonzero(~middle)])
    counts = d * np.array([np.count_nonzero(~middle & ~foreign), np.count_nonzero(middle & ~foreign)])
    owned = tuple(slice(start, start + count) for start, count in zip(starts, counts, strict=True))
    nodes = nodes[order]
    local = np.empty(mesh.p.shape[1], dtype=np.int32)
    local[nodes] = np.arange(len(nodes))
    facets = {frozenset(mesh.t[list(of), e]) for e in ids for of in mesh.element.facets}
    skin = np.array([facet for facet in mesh.boundaries["skin"].T if frozenset(facet) in facets])
    skin = local[skin.reshape(-1, len(mesh.boundaries["skin"]))].T
    part = Part(mesh.p[:, nodes], local[mesh.t[:, ids]], boundaries={"skin": skin}, element=mesh.element)
    dofs = (d * nodes[:, None] + np.arange(d)).ravel()
    attributes = {"space": PartSpace(exchange, number, mesh.p.size, d, dofs, owned), "surface": skin, "bounds": mesh.bounds}
    attributes |= {"node_numbers": nodes, "element_numbers": ids, "element_count": mesh.nt}
    for name, value in attributes.items():
        object.__setattr__(part, name, value)
    return part, dofs


class Division:
    """A body, a mesh or its name, in three parts: strips along x, or random ones. Each element has another stiffness."""

    def __init__(self, mesh, how):
        bare, rng = EVERY_MESH[mesh] if isinstance(mesh, str) else mesh, np.random.default_rng(3)
        self.mesh = ElementMesh(bare.p, bare.t, boundaries={"skin": bare.surface}, element=bare.element)
        self.young = rng.uniform(1, 5, self.mesh.nt)
        order = np.argsort(bare.p[0, bare.t].mean(axis=0)) if how == "strips" else rng.permutation(bare.nt)
        self.parts = [np.sort(ids) for ids in np.array_split(order, 3)]

    def run(self, work, make):
        """Return for each part its degrees of freedom and `work(system, dofs)`, and the result of the whole body.

        `make(mesh, young)` returns a system, with a stiffness for each element.
        """
        return self.only_parts(work, make), work(make(self.mesh, self.young), np.arange(self.mesh.p.size))

    def only_parts(self, work, make):
        """Return the results of `run` for the parts alone."""
        exchange = Exchange(len(self.parts))

        def run(number):
            try:
                part, dofs = part_of(self.mesh, self.parts, number, exchange)
                return dofs, work(make(part, self.young[self.parts[number]]), dofs)
            except BaseException:
                exchange.barrier.abort()
                raise

        with ThreadPoolExecutor(len(self.parts)) as pool:
            futures = [pool.submit(run, number) for number in range(len(self.parts))]
        failed = [future for future in futures if future.exception() and not isinstance(future.exception(), BrokenBarrierError)]
        return [future.result() for future in failed or futures]


def combined(found, shape):
    """Return a field of the whole body from those of the parts, which have the same bits at nodes that they share."""
    field = np.full(shape, np.nan)
    for dofs, values in found:
        rows, known = values.reshape(len(dofs), -1), ~np.isnan(field[dofs])
        assert np.array_equal(field[dofs][known], rows[known])
        field[dofs] = rows
    return field


@pytest.fixture
def separate_threads(monkeypatch):
    """Parts run in threads, which share the locks that cached properties have before Python 3.12; remove these."""
    modules = [module for name, module in list(sys.modules.items()) if name.partition(".")[0] == "skfem_stvk"]
    classes = {one for module in modules for one in vars(module).values() if isinstance(one, type)}
    for one in [value for cls in classes for value in vars(cls).values() if isinstance(value, cached_property)]:
        if hasattr(one, "lock"):
            monkeypatch.setattr(one, "lock", nullcontext())


def grounded(mesh, young, *terms, law=StVK, load=0.05):
    """Return a body of one law on a foundation, under its weight."""
    materials = law(young=young, poisson=0.3, density=2.0)
    return System(mesh, [materials, *terms, ElasticFoundation("skin", 3.0), Gravity(g=load * np.arange(1, mesh.d + 1))])


def free_body(mesh, young):
    return System(mesh, StVK(young=young, poisson=0.3, density=2.0))


def beam(how, length=6):
    """Return the division of a slender body along x into three parts."""
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, length, 2 * length + 1), *[np.linspace(0, 1, 3)] * 2)
    return Division(ElementMesh.of(mesh), how)


def caught(work):
    """Return the type and the text of the error of `work()`; None if there is no error."""
    try:
        work()
    except StvkError as error:
        return type(error), str(error)
    return None
