"""Where integrals over elements are taken: points on the reference element, and their weights, none of which is negative.

A negative weight would turn what resists into what gains: a barrier, or any law that is not a polynomial. scikit-fem's rules of
order 3 and 4 for tetrahedra have one. What is used here are those of order 2, 5 (14 points, exact to degree 4) and 6 (15 points,
exact to degree 5).
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from skfem.quadrature import get_quadrature
from skfem.refdom import RefHex, RefLine, RefQuad, RefTet, RefTri

from ..arguments import Array
from ..errors import StvkError
from .element import Element

REFERENCE: dict[tuple[int, bool], Any] = {
    (1, False): RefLine,
    (2, False): RefTri,
    (3, False): RefTet,
    (2, True): RefQuad,
    (3, True): RefHex,
}
#: scikit-fem's order of the usual rule, that of the exact one, and that of masses, by (is_box, degree) and dimension.
ORDERS = {
    (False, 1): {1: (1, 1, 2), 2: (1, 1, 2), 3: (1, 1, 2)},
    (False, 2): {1: (3, 4, 4), 2: (2, 4, 4), 3: (2, 5, 6)},
    (True, 1): {2: (3, 5, 5), 3: (3, 5, 5)},
}
KINDS = ("usual", "exact", "mass", "one-point")
#: How much boxes with one point resist their hourglass modes, if nothing else is said.
HOURGLASS = 0.05


class Rule(NamedTuple):
    """Points of a reference element, and their weights.

    Attributes
    ----------
    points : (nq, k) reference coordinates.
    weights : (nq,) positive; their sum is the size of the reference element.
    """

    points: Array
    weights: Array


@cache
def rule_of(element: Element, kind: str = "usual") -> Rule:
    """The rule of a kind for an element.

        usual        1 point of linear simplices; 2, 3, 4 of quadratic segments, triangles, tetrahedra; 2^k of boxes
        exact        integrates W, a quartic in the gradient, exactly on elements with straight edges: 1; 3, 6, 14; 3^k points
        mass         integrates N_a N_b exactly on such elements; of curved ones the volume and the centre of mass
        one-point    the centre

    Source: `skfem.quadrature`.

    Raises
    ------
    StvkError
        if the kind is unknown.

    >>> from skfem_stvk.elements import ELEMENTS
    >>> [len(rule_of(ELEMENTS["quadratic tetrahedra"], kind).weights) for kind in ("usual", "exact")]
    [4, 14]
    """
    if kind not in KINDS:
        raise StvkError(f"Rule {kind!r} is unknown; expected one of {', '.join(KINDS)}.")
    if element.k == 0:
        return Rule(np.zeros((1, 0)), np.ones(1))
    reference, k = REFERENCE[element.k, element.is_box], element.k
    if kind == "one-point" or (element.is_linear_simplex and kind != "mass"):
        points = np.full((1, k), 0.5 if element.is_box else 1 / (k + 1))
        return Rule(points, get_quadrature(reference, 1)[1].sum(keepdims=True))
    points, weights = get_quadrature(reference, ORDERS[element.is_box, element.degree][k][KINDS.index(kind)])
    return Rule(np.ascontiguousarray(points.T), np.asarray(weights))
