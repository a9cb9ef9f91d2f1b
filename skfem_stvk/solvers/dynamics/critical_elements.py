"""Elements that limit the step of explicit integrators, and the step that each of them allows."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arguments import Array, whole
from ...edges import ALL
from ...errors import StvkError, name_ids
from ...mesh import ElementMesh
from ...mesh.displacements import by_vertex
from ...system import System
from ...system.bound import BoundTerms
from ...system.coordinates import checked_whole
from ...system.pattern import Pattern

#: Number of elements whose eigenvalues are computed together; their matrices take a few megabytes.
AT_ONCE = 4096


@dataclass(frozen=True, eq=False, repr=False)
class CriticalElements:
    """Elements that limit the critical step of a body, and the largest step that each element allows.

    Attributes
    ----------
    elements
        (n,) ids of the elements, the smallest step first.
    steps
        (n,) steps of these elements [s].
    every
        (nt,) step of each element [s]; infinite for elements without stiffness or with all nodes constrained.
    left_out
        Terms that do not act on elements of the mesh, such as "ElasticFoundation 1" or cables attached to it. They reduce the step
        of the body further.
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
    """Return the n elements that allow the smallest steps of explicit integrators.

    ::

        T_e = 2/omega_e,    omega_e^2 the largest eigenvalue of (K_e, M)        T of the body <= min_e T_e

    `K_e` is an element's own part of K, and M has the lumped masses of the body at its nodes. Both are over its free degrees of
    freedom. `omega_e^2` is the Rayleigh quotient of a motion of these nodes alone. At rest the other elements add stiffness to it,
    hence the inequality. Where one element is much worse than its neighbours, such as a sliver or a stiff one, its `T_e` is the
    step of the body. Remesh there, or use a material that is softer or heavier.

    Parameters
    ----------
    system
        Body with densities, and its supports.
    n
        Number of elements.
    u
        (ndofs,) displacements [m], by default zero.

    Returns
    -------
    CriticalElements
        Ids of the elements with the smallest first, `elements` (n,), their `steps` (n,) [s], and the step of `every` element (nt,).

    Raises
    ------
    MaterialError
        if a material has no density, or a vertex that can move has no mass.
    StateError
        if `u` does not have one finite entry for each degree of freedom.
    StvkError
        if no term acts on elements, for example if there are only springs.

    Examples
    --------
    >>> import numpy as np
    >>> from skfem_stvk import ElementMesh, StVK, System
    >>> line = ElementMesh(np.array([[0.0, 1.0, 1.1, 2.0]]), np.array([[0, 1, 2], [1, 2, 3]]))
    >>> bar = System(line, StVK(young=4.0, poisson=0.3, density=1.0))     # waves of 2 m/s
    >>> found = critical_elements(bar, 2)
    >>> found.elements, found.steps.round(3)
    (array([1, 2]), array([0.162, 0.462]))
    """
    checked_whole(system, "critical_elements(system)")
    n = whole("n", n, "a number of elements, from 1", 1)
    x = np.zeros(system.mesh.p.T.shape) if u is None else by_vertex(system.mesh, u).astype(np.float64)
    system.mass()  # refuses bodies without mass
    on_mesh = [any(term is one for one in system.body.terms) for term in system.elastic_terms]
    chosen = [good and (term.is_law or term.has_pressure) for term, good in zip(system.elastic_terms, on_mesh, strict=True)]
    names = zip(system.elastic_names, chosen, strict=True)
    if not any(chosen):
        raise StvkError(
            f"{', '.join(system.elastic_names)}: expected at least one term on elements, because the steps are those of elements."
        )
    terms = [term for term, good in zip(system.elastic_terms, chosen, strict=True) if good]
    every = _steps(system, terms, x)
    order = np.argsort(every, kind="stable")[: min(n, int(np.isfinite(every).sum()))]
    return CriticalElements(order, every[order], every, tuple(name for name, good in names if not good))


def _steps(system: System, terms: list[Any], x: Array) -> Array:
    """Return the steps (nt,) [s] that the elements allow.

    The parts of K by element are assembled on a mesh in which each element has its own nodes.
    """
    apart, t = _apart(system.mesh), system.mesh.t
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about elements on which these terms do not act
        bound = BoundTerms(apart, terms, np.float64, getattr(system, "rule", None))
    pattern = Pattern(apart.nv, apart.d, [term.nodes_paired for term in bound.bound_terms])
    values, u = np.zeros(pattern.nnz), np.empty((apart.nv, apart.d))
    u[apart.t] = x[t]
    for term in bound.pair_terms:
        term.fill(u, term.rows(pattern), values, True, None, ALL)
    d, order = apart.d, np.argsort(apart.t, axis=0, kind="stable")  # columns of a row of K are in the order of the nodes
    nodes, own = np.take_along_axis(apart.t, order, axis=0), np.take_along_axis(t, order, axis=0)  # apart, in the body
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
    """Return the mesh with separate nodes for each element, with the elements in the same order."""
    m, nt = mesh.element.corners, mesh.nt
    t = np.arange(m * nt).reshape(nt, m).T
    apart = ElementMesh(mesh.p[:, mesh.corners.T.ravel()], t, mesh.subdomains, element=mesh.element.linear)
    if mesh.element.degree == 1:
        return apart
    straight = apart.with_degree(2)
    p = straight.p.copy()
    p[:, straight.t] = mesh.p[:, mesh.t]
    return ElementMesh(p, straight.t, mesh.subdomains, element=mesh.element)
