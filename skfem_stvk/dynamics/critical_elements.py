"""The elements that make explicit steps short: the step that each of them allows."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import Array, whole
from ..edges import ALL
from ..errors import StvkError, name_ids
from ..mesh import ElementMesh
from ..mesh.displacements import by_vertex
from ..system import System
from ..system.bound import BoundTerms
from ..system.pattern import Pattern
from ..system.protocol import checked_system
from ..terms import HasStress
from ..terms.protocols import HasPressure

#: Elements whose eigenvalues are computed at once: matrices of some megabytes.
AT_ONCE = 4096


@dataclass(frozen=True, eq=False, repr=False)
class CriticalElements:
    """The elements that make the critical step of a body short, and the step that each element allows at most.

    Attributes
    ----------
    elements : (n,) ids, the smallest step first.
    steps : (n,) their steps [s].
    every : (nt,) the step of each element; infinite of those without stiffness, and that are held all round.
    left_out : terms that are not of elements of the mesh, such as "ElasticFoundation 1" or cables beside it, which make the step of
        the body shorter still.
    """

    elements: NDArray[np.int64]
    steps: Array
    every: Array
    left_out: tuple[str, ...]

    def __repr__(self) -> str:
        usual = float(np.median(self.every))
        shown = ", ".join(f"{step:.3g} s" for step in self.steps[:3])
        return f"CriticalElements: {name_ids(self.elements, 'element')} allow steps of {shown}; in the median {usual:.3g} s"


def critical_elements(system: System, n: int = 5, *, u: ArrayLike | None = None) -> CriticalElements:
    """The n elements that allow the smallest steps of explicit integrators, at displacements `u` (ndofs,) [m], by default at rest.

        T_e = 2/omega_e,    omega_e^2 the largest eigenvalue of (K_e, M)        T of the body <= min_e T_e

    with an element's own part of K and the lumped masses of the body at its nodes, over its free degrees of freedom: the Rayleigh
    quotient of a motion of these nodes alone, which the rest of a body at rest makes stiffer still. Where one element is much worse
    than its neighbours, as a sliver or a stiff one, its `T_e` is the step of the body. Remesh there, or give it a material that is
    softer or heavier.

    Raises
    ------
    MaterialError
        if a material has no density, or a vertex that can move has no mass.
    StateError
        if `u` does not have one finite entry for each degree of freedom.
    StvkError
        if no term is of elements, as where there are springs alone.

    >>> import numpy as np
    >>> from skfem_stvk import ElementMesh, StVK, System
    >>> line = ElementMesh(np.array([[0.0, 1.0, 1.1, 2.0]]), np.array([[0, 1, 2], [1, 2, 3]]))
    >>> bar = System(line, StVK(young=4.0, poisson=0.3, density=1.0))     # waves of 2 m/s
    >>> found = critical_elements(bar, 2)
    >>> found.elements, found.steps.round(3)
    (array([1, 2]), array([0.162, 0.462]))
    """
    checked_system(system)
    n = whole("n", n, "a number of elements, from 1", 1)
    x = np.zeros(system.mesh.p.T.shape) if u is None else by_vertex(system.mesh, u).astype(np.float64)
    system.mass()  # refuses what has no mass
    on_mesh = [any(term is one for one in system.body.terms) for term in system.elastic_terms]
    chosen = [good and isinstance(term, HasStress | HasPressure) for term, good in zip(system.elastic_terms, on_mesh, strict=True)]
    names = zip(system.elastic_names, chosen, strict=True)
    if not any(chosen):
        raise StvkError(f"{', '.join(system.elastic_names)}: no term is of elements, so that none has a step of its own.")
    terms = [term for term, good in zip(system.elastic_terms, chosen, strict=True) if good]
    every = _steps(system, terms, x)
    order = np.argsort(every, kind="stable")[: min(n, int(np.isfinite(every).sum()))]
    return CriticalElements(order, every[order], every, tuple(name for name, good in names if not good))


def _steps(system: System, terms: list[Any], x: Array) -> Array:
    """(nt,) steps that the elements allow, from their parts of K as if each had nodes of its own."""
    apart, t = _apart(system.mesh), system.mesh.t
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of elements that these terms are not on
        bound = BoundTerms(apart, terms, np.float64, getattr(system, "rule", None))
    pattern = Pattern(apart.nv, apart.d, [term.nodes_paired for term in bound.bound_terms])
    values, u = np.zeros(pattern.nnz), np.empty((apart.nv, apart.d))
    u[apart.t] = x[t]
    for term in bound.pair_terms:
        term.fill(u, term.rows(pattern), values, True, None, ALL)
    d, order = apart.d, np.argsort(apart.t, axis=0, kind="stable")  # columns of a row of K are in the order of the nodes
    nodes, own = np.take_along_axis(apart.t, order, axis=0), np.take_along_axis(t, order, axis=0)  # apart, and in the body
    mass, is_free = system.mass().vertex, system.mass().free
    inverse = is_free * np.divide(1.0, np.sqrt(mass), out=np.zeros(len(mass)), where=mass > 0)[:, None]
    scale = inverse[own].transpose(1, 0, 2).reshape(t.shape[1], -1)  # (nt, n d)
    dofs = (d * nodes.T[:, :, None] + np.arange(d)).reshape(t.shape[1], -1)
    full = pattern.indptr[dofs[:, 0] + 1] - pattern.indptr[dofs[:, 0]] == dofs.shape[1]
    full[system.removed] = False
    steps = np.full(t.shape[1], np.inf)
    for ids in np.array_split(np.flatnonzero(full), max(1, full.sum() // AT_ONCE)):
        K = values[pattern.indptr[dofs[ids]][:, :, None] + np.arange(dofs.shape[1])]
        square = np.linalg.eigvalsh(K * scale[ids][:, :, None] * scale[ids][:, None, :])[:, -1]
        with np.errstate(divide="ignore"):
            steps[ids] = 2 / np.sqrt(np.maximum(square, 0.0))
    return steps


def _apart(mesh: ElementMesh) -> ElementMesh:
    """The elements with nodes of their own, in their order."""
    m, nt = mesh.element.corners, mesh.nt
    t = np.arange(m * nt).reshape(nt, m).T
    apart = ElementMesh(mesh.p[:, mesh.corners.T.ravel()], t, mesh.subdomains, element=mesh.element.linear)
    if mesh.element.degree == 1:
        return apart
    straight = apart.with_degree(2)
    p = straight.p.copy()
    p[:, straight.t] = mesh.p[:, mesh.t]
    return ElementMesh(p, straight.t, mesh.subdomains, element=mesh.element)
