"""Hypotheses on factors of lambda and mu, fitted in each region on six homogeneous states, with their usual causes.

A region consists of the elements of a term with the same constants. So each value of an array of constants has its own factors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ..arguments import Array
from ..edges.materials import Isotropic, Material
from ..errors import MaterialError
from ..mesh import ElementMesh
from ..terms import StVK
from .bodies import is_condensed, reference_on, tensor_of
from .case import Case
from .evidence import Evidence, Model, Values
from .implementations import ContractViolation, Implementation

#: Largest number of regions of equal constants whose factors are fitted.
MOST_REGIONS = 10

LAME_WORDS = {
    "lambda of plane strain": ": lam = E nu/((1 + nu) (1 - 2 nu)) is for plane strain and solids",
    "lambda of plane stress": ": 2 lam mu/(lam + 2 mu) = E nu/(1 - nu^2) is for plane stress",
    "mu halved": ": E/(4 (1 + nu)), or the engineering shear strain taken for the tensor's",
    "mu doubled": ": E/(1 + nu) is 2 G",
    "bulk modulus for lambda": ": lam + 2/3 mu is the bulk modulus",
}


def lame_factors(evidence: Evidence, terms: Sequence[StVK]) -> Iterator[tuple[str, str, Model]]:
    """Yield hypotheses on factors of lambda and mu in each region.

    If there are more than MOST_REGIONS regions, or too few data, the factors are fitted for each term instead. Then the usual
    causes are also tried in every element.
    """
    case = evidence.case
    if not all(isinstance(term.material, Isotropic) for term in terms) or case.mesh.k == 1:
        return
    regions = [region for term in terms for region in regions_of(case.mesh, term)]
    fit = _fit(evidence, regions) if len(regions) <= MOST_REGIONS else None
    if fit is None:  # as many unknowns as values of W would fit any values
        regions, fit = list(terms), _fit(evidence, terms)
    if fit is not None:
        yield from _named(evidence, regions, fit)
    if any(len(regions_of(case.mesh, term)) > 1 for term in regions):
        yield from _usual_everywhere(evidence, terms)


def regions_of(mesh: ElementMesh, term: StVK) -> list[StVK]:
    """Return the term split into one term for each set of elements with the same constants, or `[term]` without arrays."""
    assert isinstance(term.material, Isotropic)
    ids, material = mesh.elements(term.region), term.material
    given: dict[str, Any] = {"young": material.young, "poisson": material.poisson, "thickness": term.thickness, "area": term.area}
    arrays = {name: np.broadcast_to(np.asarray(value), len(ids)) for name, value in given.items() if np.ndim(value)}
    if not arrays:
        return [term]
    rows, of = np.unique(np.stack(list(arrays.values()), axis=1), axis=0, return_inverse=True)
    parts = []
    for region, row in enumerate(rows):
        own = given | dict(zip(arrays, row.tolist(), strict=True))
        law, where = Isotropic(own["young"], own["poisson"]), ids[of.ravel() == region]
        parts.append(StVK(law, where, plane=term.plane, thickness=own["thickness"], area=own["area"]))
    return parts


def _fit(evidence: Evidence, regions: Sequence[StVK]) -> Array | None:
    """Return the factors of lambda and mu, (number of regions, 2), by least squares, or None if nothing can be fitted."""
    case = evidence.case
    parts = [_part(case, term, *pair) for term in regions for pair in ((1.0, 0.0), (0.0, 1.0))]
    quantity = "F" if "F" in evidence.quantities else evidence.quantities[-1]
    rows, columns = [], []
    # additional states are needed to separate the regions by W, and a candidate may raise in some states
    for u in [*_homogeneous(case), *(case.states[state] for state in evidence.found)]:
        try:
            rows.append(evidence.column(evidence.values(evidence.implementation, u, quantity)[quantity]))
        except ContractViolation:
            continue
        columns.append(np.stack([evidence.column(evidence.values(part, u, quantity)[quantity]) for part in parts], axis=1))
    if not rows:
        return None
    A, b = np.concatenate(columns), np.concatenate(rows)
    if len(b) < A.shape[1] + 3 or not (np.isfinite(b).all() and np.isfinite(A).all()):
        return None
    size = np.linalg.norm(A, axis=0)
    factors = np.linalg.lstsq(A / np.where(size, size, 1.0), b, rcond=None)[0] / np.where(size, size, 1.0)
    return np.asarray(np.where(size, factors, np.roll(factors, -1)).reshape(-1, 2))  # at nu = 0 lambda gets mu's


def _named(evidence: Evidence, regions: Sequence[StVK], pairs: Array) -> Iterator[tuple[str, str, Model]]:
    """Yield the model with these factors under each name that applies."""
    if np.abs(pairs - 1).max() < 1e-6 or np.ptp(pairs) <= 1e-6 * np.abs(pairs).max():
        return  # correct, or one common factor
    off = [i for i, pair in enumerate(pairs) if np.abs(pair - 1).max() > 1e-6]
    same = np.ptp(pairs, axis=0).max() <= 1e-6 * np.abs(pairs).max()
    numbers = "; ".join(
        f"your lambda is {number(pairs[i, 0])} x, your mu {number(pairs[i, 1])} x{'' if same else _where(regions[i])}"
        f"{_of_region(evidence.case.mesh, regions[i], *pairs[i]) if not same or len(regions) == 1 else ''}"
        for i in (off[:1] if same else off)
    )
    no_reading = "lambda and mu by region" if len(regions) > 1 else "lambda and mu"
    readings = [_readings(evidence.case.mesh, regions[i], *pairs[i]) for i in off]
    for name in [name for name in readings[0] if all(name in each for each in readings)] or [no_reading]:
        yield name, f"{numbers}{LAME_WORDS.get(name, '')}", _scaled(evidence, regions, pairs)


def _usual_everywhere(evidence: Evidence, terms: Sequence[StVK]) -> Iterator[tuple[str, str, Model]]:
    """Yield the usual causes whose factors differ from element to element."""
    mesh = evidence.case.mesh
    usual = [_usual(mesh, term) for term in terms]
    for name in usual[0]:
        pairs = [each[name] for each in usual]
        factors = np.concatenate([np.atleast_1d(factor) for pair in pairs for factor in pair])
        if np.isfinite(factors).all() and max(np.ptp(factor) for pair in pairs for factor in pair) > 1e-6:
            words = f"in every element by its own constants{LAME_WORDS.get(name, '')}"
            yield name, words, _scaled(evidence, terms, pairs)


def number(factor: float) -> str:
    """Return a factor as text with three decimals, or with three digits if it is far from one.

    >>> number(2.0), number(1e-9)
    ('2.000', '1e-09')
    """
    return f"{factor + 0.0:.3f}" if factor == 0 or 0.01 <= abs(factor) < 1000 else f"{factor:.3g}"


def engineering_constants(lam: float | Array, mu: float | Array, claimed: Material | None, condensed: bool = False) -> str:
    """Return Young's modulus and Poisson's ratio of `lam` and `mu` in parentheses, where they differ from those of a material.

    The text is empty if no material has these constants, or if they differ from element to element. `condensed`: `lam` is that of
    plane stress.

    >>> engineering_constants(2 * 1.5, 1.0, Isotropic(young=2.6, poisson=0.3))
    ' (E = 2.75 where 2.6 was claimed, nu = 0.375 where 0.3 was claimed)'
    """
    if not isinstance(claimed, Isotropic) or claimed.poisson is None or np.ndim(claimed.young) or np.ndim(claimed.poisson):
        return ""
    with np.errstate(divide="ignore", invalid="ignore"):
        solid = 2 * lam * mu / (2 * mu - lam) if condensed else lam
    try:
        found = Isotropic.from_lame(solid, mu)
    except MaterialError:
        return ""
    E, nu, *others = (float(np.asarray(one)) for one in (found.young, found.poisson, claimed.young, claimed.poisson))
    texts = [
        f"{name} = {one:.6g} where {other:.6g} was claimed"
        for name, one, other in (("E", E, others[0]), ("nu", nu, others[1]))
        if not np.isclose(one, other, 1e-6)
    ]
    return f" ({', '.join(texts)})" if texts else ""


def _of_region(mesh: ElementMesh, term: StVK, of_lam: float, of_mu: float) -> str:
    """Return the engineering constants of a region with these factors of lambda and mu."""
    assert isinstance(term.material, Isotropic)
    lam, mu = term.material.lame(term.hypothesis(mesh))
    return engineering_constants(of_lam * lam, of_mu * mu, term.material, is_condensed(mesh, term))


def _where(term: StVK) -> str:
    if term.region is None:
        return ""
    if isinstance(term.region, str):
        return f" in {term.region}"
    ids = np.asarray(term.region).ravel()
    return f" in the region of elements {', '.join(map(str, ids[:3]))}, ... ({len(ids)})"


def _readings(mesh: ElementMesh, term: StVK, of_lam: float, of_mu: float) -> list[str]:
    """Return the usual causes of these factors in the order of likelihood. All causes with equal factors at this nu are listed."""
    usual = _usual(mesh, term).items()
    return [name for name, pair in usual if all(np.allclose(a, b, 1e-6, 1e-7) for a, b in zip(pair, (of_lam, of_mu), strict=True))]


def _usual(mesh: ElementMesh, term: StVK) -> dict[str, tuple[Array, Array]]:
    """Return the factors of lambda and mu by cause, as numbers or arrays with one entry per element.

    A factor is nan if the cause does not apply.
    """
    assert isinstance(term.material, Isotropic)
    E, nu = np.asarray(term.material.young, float), np.asarray(term.material.poisson, float)
    solid, mu, condensed = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu)), is_condensed(mesh, term)
    lam = 2 * solid * mu / (solid + 2 * mu) if condensed else solid
    one, over = np.ones_like(lam), 1 / np.where(lam == 0, np.nan, lam)
    return {
        "lambda doubled": (2 * one, one),
        "lambda halved": (one / 2, one),
        "lambda of plane strain": (solid * over if condensed else np.nan * one, one),
        "lambda of plane stress": (np.nan * one if condensed else 2 * mu / (lam + 2 * mu), one),
        "bulk modulus for lambda": (1 + 2 / 3 * mu * over, one),
        "lambda is left out": (0 * one, one),
        "mu halved": (one, one / 2),
        "mu doubled": (one, 2 * one),
        "mu is left out": (one, 0 * one),
        "lambda and mu exchanged": (mu * over, lam / mu),
        "Young's modulus for mu": (one, E / mu),
    }


def _scaled(evidence: Evidence, terms: Sequence[StVK], pairs: Sequence[tuple[Array, Array]] | Array) -> Model:
    """Return the reference with lambda and mu of each term multiplied by a pair of factors, numbers or one per element."""
    parts = [_part(evidence.case, term, *pair) for term, pair in zip(terms, pairs, strict=True)]

    def model(u: Array, quantities: str) -> Values:
        each = [evidence.values(part, u, quantities) for part in parts]
        return {q: sum(value[q] for value in each) for q in quantities}

    return model


def _part(case: Case, term: StVK, of_lam: float | Array, of_mu: float | Array) -> Implementation:
    """Return the reference of a term with lambda and mu multiplied by factors."""
    assert isinstance(term.material, Isotropic)
    mesh, discretisation, ids = case.mesh, case.discretisation, case.mesh.elements(term.region)
    tensor, eye = tensor_of(term, mesh), np.eye(case.mesh.k)
    lam = tensor[:, :1, :1, 1:2, 1:2] * np.einsum("ij,kl->ijkl", eye, eye)
    lam_factor, mu_factor = (np.reshape(factor, (-1, 1, 1, 1, 1)) for factor in (of_lam, of_mu))
    scaled = lam_factor * lam + mu_factor * (tensor - lam)
    control = discretisation.hourglass * scaled[:, 0, 0, 0, 0] * np.ones(len(ids)) if discretisation.is_one_point else None
    return Implementation("part", reference_on(mesh.p, mesh.t[:, ids], scaled, discretisation, control), mesh.p.size)


def _homogeneous(case: Case) -> Iterator[Array]:
    """Yield six homogeneous states, each with a different strain of 10 to 20 % and a rotation."""
    d = case.mesh.d
    Q = np.linalg.qr(case.random("homogeneous").standard_normal((d, d)))[0]
    for number in range(6):
        strain = 0.1 * case.random(f"homogeneous {number}").standard_normal((d, d))
        F = Q @ (np.eye(d) + strain + strain.T)
        yield (case.centred @ (F - np.eye(d)).T).ravel()
