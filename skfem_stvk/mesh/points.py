"""Spokes and sizes of elements and facets of all kinds, at points of a rule."""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import NDArray

from ..elements import Element, Rule, rule_of
from ..kernels.geometry import measures

Ids = NDArray[np.int32]


def spokes(x: NDArray[np.float64], t: Ids, slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, d, n) spokes `sum_a dN_a/dxi_i x_a` of elements `t` (m, n) at one point, from `x` (d, nv) at the nodes.

    `slopes` (m, k) are `Element.derivatives` there. Of a linear simplex the spokes are `x_i - x_0`, to the last bit.
    """
    return np.asarray(np.einsum("ai,dan->idn", slopes[1:], x[:, t[1:]] - x[:, t[:1]]))


def measured(spokes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) lengths, areas or volumes that `k` spokes (k, d, n) span."""
    k, d = spokes.shape[:2]
    if k == 1:
        return np.asarray(np.linalg.norm(spokes[0], axis=0))
    if k == d == 2:
        return np.asarray(np.abs(spokes[0, 0] * spokes[1, 1] - spokes[0, 1] * spokes[1, 0]))
    normal = np.cross(spokes[0], spokes[1], axis=0)
    return np.asarray(np.linalg.norm(normal, axis=0) if k == 2 else np.abs(np.einsum("dn,dn->n", normal, spokes[2])))


def sizes_at_points(p: NDArray[np.float64], t: Ids, element: Element, rule: Rule) -> NDArray[np.float64]:
    """(nq, n) the part of each point of a rule in the size of elements or facets `t` (m, n) of a kind [m^k].

    Their sums are the sizes of the elements: exact for lines, surfaces and solids that fill their space, curved ones too, if the
    rule is that of masses.

    >>> from skfem_stvk import ElementMesh
    >>> mesh = ElementMesh(p=[[0, 2, 0], [0, 0, 1]], t=[[0], [1], [2]]).with_degree(2)
    >>> round(float(sizes_at_points(mesh.p, mesh.t, mesh.element, rule_of(mesh.element, "mass")).sum()), 12)
    1.0
    """
    return np.stack(
        [w * measured(spokes(p, t, slopes)) for w, slopes in zip(rule.weights, element.derivatives(rule.points), strict=True)]
    )


def element_sizes(p: NDArray[np.float64], t: Ids, element: Element) -> NDArray[np.float64]:
    """(n,) lengths, areas or volumes of elements or facets `t` (m, n) of a kind [m^k]."""
    if element.k == 0:
        return np.ones(t.shape[1])
    if element.is_linear_simplex:
        return np.asarray(measures(p, np.ascontiguousarray(t))[0] / factorial(element.k))
    return np.asarray(sizes_at_points(p, t, element, rule_of(element, "mass")).sum(axis=0))
