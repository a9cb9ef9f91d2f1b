"""Integration points on the reference elements, and their weights, none of which is negative.

With a negative weight, a barrier or any law that is not a polynomial could gain energy instead of resisting. scikit-fem's rules of
order 3 and 4 for tetrahedra have such a weight. Therefore the rules are those of order 2, 5 (14 points, exact to degree 4) and 6
(15 points, exact to degree 5).
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from skfem.quadrature import get_quadrature

from ..arguments import Array
from ..errors import StvkError
from .element import Element

KINDS = ("usual", "exact", "mass", "one-point")
#: Default coefficient of the hourglass stiffness of boxes with one point.
HOURGLASS = 0.05


class Rule(NamedTuple):
    """Points of a reference element, and their weights.

    Attributes
    ----------
    points
        (nq, k) reference coordinates.
    weights
        (nq,) weights, all positive; their sum is the size of the reference element.
    """

    points: Array
    weights: Array


@cache
def rule_of(element: Element, kind: str = "usual") -> Rule:
    """Return the rule of a kind for an element.

        usual        1 point of linear simplices; 2, 3, 4 of quadratic segments, triangles, tetrahedra; 2^k of boxes
        exact        integrates W, a quartic in the gradient, exactly on elements with straight edges: 1; 3, 6, 14; 3^k points
        mass         integrates N_a N_b exactly on such elements; of curved ones the volume and the centre of mass
        one-point    the centre

    Source: `skfem.quadrature`.

    Raises
    ------
    StvkError
        if the kind is unknown.

    Examples
    --------
    >>> from skfem_stvk.mesh.element import ELEMENTS
    >>> [len(rule_of(ELEMENTS["quadratic tetrahedra"], kind).weights) for kind in ("usual", "exact")]
    [4, 14]
    """
    if kind not in KINDS:
        raise StvkError(f"kind = {kind!r}; expected one of {', '.join(KINDS)}.")
    if element.k == 0:
        return Rule(np.zeros((1, 0)), np.ones(1))
    if kind == "one-point" or (element.is_linear_simplex and kind != "mass"):
        return Rule(element.cell.corners.mean(axis=0)[None], get_quadrature(element.cell.reference, 1)[1].sum(keepdims=True))
    points, weights = get_quadrature(element.cell.reference, element.orders[KINDS.index(kind)])
    return Rule(np.ascontiguousarray(points.T), np.asarray(weights))
