"""The referee for the tests of other packages: one assertion per kind of candidate, which fails with the findings.

The fixture and marks of the pytest plugin (`skfem_stvk.pytest_plugin`) call these functions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import skfem
from numpy.typing import ArrayLike

from .arguments import choice, flag, whole
from .edges.materials import Material
from .mesh import MeshLike
from .mesh.element import ELEMENTS
from .referee.law import verify_law
from .referee.report import Report, error_over_limit, failure_in_words
from .referee.results import CheckOutcome
from .referee.verification import claimed_terms, verify_candidate
from .terminal import as_text, printable
from .terms import StVK

#: Kinds of elements for `small_mesh`: those of scikit-fem's meshes.
KINDS = tuple(name for name, element in ELEMENTS.items() if element.mesh is not None)
ONE_LINE = 100_000  # columns: the viewer of the text breaks its lines


class Inconsistent(AssertionError):
    """Error of a candidate that did not pass.

    `report` has all findings. The message names every check that failed or could not run.
    """

    def __init__(self, report: Report, candidate: Any) -> None:
        self.report = report
        name = candidate if isinstance(candidate, str) else getattr(candidate, "__name__", type(candidate).__name__)
        super().__init__(_failure_message(report, name))


def _failure_message(report: Report, name: str) -> str:
    """Return the message of a candidate that did not pass.

    The first line has the number of checks that did not pass. Then follow the identified bug, if identification was requested, and
    the worst failure of each check and quantity. The last lines have the first reason of each check that could not run somewhere.
    """
    failed, missed = report.counts[CheckOutcome.FAILED], report.counts[CheckOutcome.COULD_NOT_RUN]
    applicable = len(report.results) - report.counts[CheckOutcome.NOT_APPLICABLE]
    numbers = f"{failed} of {applicable} checks failed, {missed} could not run" if applicable else "no check applies to it"
    lines = [f"{name} is not consistent: {numbers} (seed {report.header.get('seed', 0)})"]
    if report.named is not None:  # first, since JUnit's message has only the first lines
        lines += report.named.lines()
    lines += report.header.get("lines", [])
    for results in report.groups().values():
        worst = [result for result in results if result.outcome is CheckOutcome.FAILED]
        if worst:
            lines.append(f"failed {len(worst)} of {len(results)}: {failure_in_words(max(worst, key=error_over_limit))}")
    reasons: dict[str, str] = {}
    for result in report.results:
        if result.outcome is CheckOutcome.COULD_NOT_RUN:
            reasons.setdefault(result.check, f"{result.quantity}, {result.state}: {' '.join(result.reason.split())}")
    lines += [f"could not run: {check}, {reason}" for check, reason in reasons.items()]
    return as_text(printable("\n".join(lines)), width=ONE_LINE)


def assert_consistent(
    model: Any,
    mesh: MeshLike,
    material: Material | StVK | Sequence[StVK] | None = None,
    *,
    young: ArrayLike | None = None,
    poisson: ArrayLike | None = None,
    degree: int | None = None,
    quadrature: str | None = None,
    hourglass: float | None = None,
    homogeneous: bool = True,
    seed: int = 0,
) -> Report:
    """Assert that W, F and K of a model are consistent and are those of an elastic body.

    With a material, the model claims to be St. Venant-Kirchhoff. Then it must agree with scikit-fem and with this package, and its
    derivatives must be exact. Without a material, the model may be any hyperelastic law, such as neo-Hookean. Then these properties
    are checked:

    - F is the derivative of W, and K is the derivative of F, to second order in Taylor tests.

    - Translations and rotations change nothing, and forces and torques balance.

    - K is symmetric, and its null space at rest consists of exactly the rigid modes.

    - Under an affine motion no force is left on inner nodes.

    Parameters
    ----------
    model
        Object with at least one of `energy(u)` [J], `internal_force(u)` (ndofs,) [N] and `tangent(u)` (ndofs, ndofs) [N/m]. The
        tangent is dense, sparse or a `LinearOperator`. Degrees of freedom are `d * node + component`.
    mesh, material, young, poisson, degree, quadrature, hourglass, seed
        Arguments of `verify`, as there.
    homogeneous
        Whether the constants and directions of another law are the same everywhere. Only then does a patch test have meaning.

    Returns
    -------
    Report
        Report of the checks that passed.

    Raises
    ------
    Inconsistent
        an `AssertionError` with the attribute `report`. Its message names every failed check with its error, limit and worst
        location.
    StvkError, MeshError, MaterialError, RegionError
        as in `verify`.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import NeoHookean, StVK, System
    >>> mesh = skfem.MeshTet().refined(1)
    >>> assert_consistent(System(mesh, StVK(young=1e5, poisson=0.3)), mesh, young=1e5, poisson=0.3).passed
    True
    >>> other = System(mesh, NeoHookean(young=1e5, poisson=0.3))
    >>> assert_consistent(other, mesh).passed
    True
    >>> assert_consistent(other, mesh, young=1e5, poisson=0.3)
    Traceback (most recent call last):
    skfem_stvk.testing.Inconsistent: System is not consistent: 36 of 112 checks failed, 35 could not run (seed 0)
    ...agreement, W of candidate against scikit-fem, 100 % stretch: 6.03e-01 > 1e-12 of 1.540e+05 (W_ref). ...
    """
    __tracebackhide__ = True  # pytest shows the line of the test
    seed, homogeneous = whole("seed", seed, "a whole number from 0"), flag("homogeneous", homogeneous)
    other_law = material is None and young is None and poisson is None
    given = {"degree": degree, "quadrature": quadrature, "hourglass": hourglass}
    terms = None if other_law else claimed_terms(material, young, poisson)
    report = verify_candidate(model, mesh, terms, homogeneous=homogeneous, given=given, seed=seed)
    if not report.passed:
        raise Inconsistent(report, model)
    return report


def assert_law(**law: Any) -> Report:
    """Assert that an energy density, a stress and a tangent, or a subset, are consistent and form a hyperelastic law.

    Parameters
    ----------
    law
        Arguments of `verify_law`: `energy`, `stress`, `elasticity`, `claims`, `at`, ...

    Returns
    -------
    Report
        Report of the checks that passed.

    Raises
    ------
    Inconsistent
        an `AssertionError` with the attribute `report`. Its message names every failed check.
    StvkError, MaterialError
        as in `verify_law`.

    Examples
    --------
    >>> import numpy as np
    >>> def S(F):
    ...     E = (F.T @ F - np.eye(3)) / 2
    ...     return 10.0 * np.trace(E) * np.eye(3) + 8.0 * E
    >>> assert_law(stress=S).passed
    True
    >>> assert_law(stress=S, claims=StVK(young=1.0, poisson=0.3))
    Traceback (most recent call last):
    skfem_stvk.testing.Inconsistent: law is not consistent: ... checks failed, 0 could not run (seed 0)
    This explains all of it; the error falls from ... to ...:
    lambda x 17.333, mu x 10.400: at rest the moduli are lambda 17.333 x and mu 10.400 x those of the claim
    ...
    """
    __tracebackhide__ = True  # pytest shows the line of the test
    report = verify_law(**law)
    if not report.passed:
        raise Inconsistent(report, "law")
    return report


def small_mesh(kind: str, seed: int = 0) -> skfem.Mesh:
    """Return a small scikit-fem mesh of the unit interval, square or cube for tests of a model.

    The mesh has 3 nodes along each edge, and the inner ones serve a patch test. All edges differ. Simplices have both orientations,
    and elements of second order have curved edges.

    Raises
    ------
    StvkError
        for a kind of elements that is not in `KINDS`.

    Examples
    --------
    >>> small_mesh("tetrahedra").t.shape
    (4, 48)
    >>> small_mesh("tets")
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: kind = 'tets'; known: 'hexahedra', ...
    """
    element, seed = ELEMENTS[choice("kind", kind, KINDS)], whole("seed", seed, "a whole number from 0")
    rng, d = np.random.default_rng(seed), element.k
    mesh = element.linear.mesh.init_tensor(*[np.array([0.0, 0.4, 1.0])] * d)
    t = mesh.t.copy()
    if len(t) == d + 1:  # the orientation of a simplex is reversed by exchanging two vertices
        half = rng.random(t.shape[1]) < 0.5
        t[:2, half] = t[1::-1, half]
    mesh = replace(mesh, doflocs=mesh.doflocs + 0.06 * rng.uniform(-1, 1, mesh.doflocs.shape), t=t)
    if element.degree == 1:
        return mesh
    straight = element.mesh.from_mesh(mesh)
    return replace(straight, doflocs=straight.doflocs + 0.02 * rng.uniform(-1, 1, straight.doflocs.shape))
