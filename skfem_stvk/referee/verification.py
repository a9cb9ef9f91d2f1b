"""Verification of an elastic body and of a candidate implementation: `verify`, the main function of the referee."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import flag, shown, whole
from ..edges.materials import Material
from ..errors import MaterialError, StvkError, StvkWarning
from ..mesh import ElementMesh, MeshLike
from ..mesh.points import HOURGLASS
from ..system import System
from ..terms import EdgeNetwork, StVK
from .bodies import elasticity, homogeneous_copy, hourglass_control, reference_on
from .case import CANDIDATE, EDGES, OURS, REFERENCE, STRETCH, Case, named_states
from .checks.agreement import OfFewUnknowns, agreement, checks_of_reduced, derivatives, memory
from .checks.homogeneous import homogeneous_states
from .checks.precision import error_table, precision, speed_table
from .checks.rigid_motions import balance, invariance, zero_modes
from .discretisation import Discretisation, Shape
from .exact import Truth
from .implementations import METHODS, Implementation, make_candidate
from .naming import name_the_fault
from .report import Report, carry_out, header
from .results import CheckOutcome, Naming, NotApplicable, Result, Task

#: The checks, in the order of the report. Each takes a case and yields its tasks.
CHECKS: tuple[Callable[[Case], Iterator[Task]], ...] = (
    agreement,
    derivatives,
    memory,
    invariance,
    balance,
    zero_modes,
    homogeneous_states,
    precision,
)
#: The checks that are also run on the sum over edges and pairs of edges.
OF_EDGES = (agreement, derivatives, invariance, balance, zero_modes)


def verify(
    mesh: MeshLike | OfFewUnknowns,
    material: Material | StVK | Sequence[StVK] | None = None,
    *,
    young: ArrayLike | None = None,
    poisson: ArrayLike | None = None,
    degree: int | None = None,
    quadrature: str | None = None,
    hourglass: float | None = None,
    candidate: Any = None,
    candidate_is_stvk: bool = True,
    seed: int = 0,
    quiet: bool = False,
) -> Report:
    """Check W, F and K of this package, and of a candidate, against scikit-fem's standard assembly and against exact properties.

    Parameters
    ----------
    mesh
        Mesh of scikit-fem, arrays `(p, t)` of linear simplices, or `ElementMesh`. A `ReducedSystem` is also accepted, with no other
        argument than `seed` and `quiet`. It is compared with its full body.
    material
        A material, an `StVK` term, or several terms for several regions. Alternatively, pass `young` and `poisson`.
    young, poisson
        Young's modulus [Pa] and Poisson's ratio of an isotropic material.
    degree, quadrature, hourglass
        Element degree, quadrature rule and hourglass coefficient, as in `System`.
    candidate
        An object with at least one of `energy(u)`, `internal_force(u)`, `tangent(u)` (dense, sparse or a `LinearOperator`), for the
        same mesh and rule, with scikit-fem's order of degrees of freedom. Alternatively, a class or function that makes such an
        object from an `ElementMesh`. If no hypothesis explains a failure, the report then includes the smallest piece of the mesh
        on which the candidate fails.
    candidate_is_stvk
        Whether the candidate claims to be St. Venant-Kirchhoff. If not, it is not compared with that law, and its derivatives get a
        Taylor test instead of the exact stencil.
    seed
        Seed of the random numbers.
    quiet
        Whether to hide the progress bar.

    Returns
    -------
    Report
        Use `report.passed`, `print(report)` and `report.save("folder")`.

    Raises
    ------
    MeshError, MaterialError, RegionError
        if the mesh, the material or a region does not define an elastic body.
    StvkError
        if the candidate has none of the three methods.

    Examples
    --------
    >>> import skfem
    >>> report = verify(skfem.MeshTet().refined(1), young=1e5, poisson=0.3, quiet=True)
    >>> report.passed
    True
    """
    started = time.perf_counter()
    seed, quiet = whole("seed", seed, "a whole number from 0"), flag("quiet", quiet)
    candidate_is_stvk = flag("candidate_is_stvk", candidate_is_stvk)
    given: dict[str, Any] = {"degree": degree, "quadrature": quadrature, "hourglass": hourglass}
    if isinstance(mesh, OfFewUnknowns):
        others = {"material": material, "young": young, "poisson": poisson, "candidate": candidate} | given
        return _of_reduced(mesh, [name for name, value in others.items() if value is not None], seed, quiet)
    terms = claimed_terms(material, young, poisson)
    case = _case(mesh, terms, given, candidate, seed)
    case.candidate_is_stvk = candidate_is_stvk
    head = header(case.shape, terms, type(mesh).__name__, seed) | {"reference": case.reference.model.described()}
    report, tasks = Report(head, precision=case.precision), list(_tasks(case))
    naming = partial(name_what_failed, report, case, terms, candidate)
    carry_out(report, "verify", tasks, quiet, {"what it is": naming, "speed": partial(_measure_speed, report, case)})
    report.seconds = time.perf_counter() - started
    return report


def verify_candidate(
    candidate: Any,
    mesh: MeshLike,
    terms: Sequence[StVK] | None = None,
    *,
    homogeneous: bool = True,
    given: dict[str, Any] | None = None,
    seed: int = 0,
) -> Report:
    """Run the checks of a candidate alone, without a progress bar, timings or handling of Ctrl-C.

    `terms` are the terms that the candidate claims to implement. If `terms` is None, the candidate has another law, and
    `homogeneous` says whether its body is homogeneous. `given` holds `degree`, `quadrature` and `hourglass`. All other arguments,
    and the errors, are those of `verify`.
    """
    started = time.perf_counter()
    stand_in = [StVK(young=1.0, poisson=0.3)]  # a placeholder: no check of another law is relative to it
    case = _case(mesh, stand_in if terms is None else terms, given or {}, candidate, seed)
    case.candidate_is_stvk, case.candidate_is_homogeneous = terms is not None, homogeneous
    head = header(case.shape, terms or [], type(mesh).__name__, seed) | {"reference": case.reference.model.described()}
    if terms is None:
        head |= {"material": ["another law: the candidate's"], "reference": "properties of every elastic law"}
    report = Report(head, [task.run() for check in CHECKS for task in check(case) if task.implementation is case.candidate])
    name_what_failed(report, case, terms or [], candidate)
    report.seconds = time.perf_counter() - started
    return report


def name_what_failed(report: Report, case: Case, terms: Sequence[StVK], candidate: Any) -> None:
    """Store the naming of the fault in `report.named`, if the candidate claims to be this body and fails a check."""
    if case.candidate is None or not case.candidate_is_stvk or not report.failures(CANDIDATE):
        return
    try:
        report.named = name_the_fault(case, terms, candidate if _makes_candidates(candidate) else None)
    except Exception as error:  # so that the earlier results are not lost
        report.named = Naming(smallest=f"The hypotheses stopped: {type(error).__name__}: {error}")


def _makes_candidates(candidate: Any) -> bool:
    """Return whether `candidate` is a class or a function that makes candidates from a mesh, not a candidate itself."""
    return callable(candidate) and (isinstance(candidate, type) or not any(hasattr(candidate, name) for name in METHODS.values()))


def failures_of(
    make: Callable[[ElementMesh, Sequence[StVK]], Any], mesh: ElementMesh, terms: Sequence[StVK], given: dict[str, Any], seed: int
) -> list[Result]:
    """Return the failed results if a model replaces this package as the object under test.

    All checks run, the checks of precision included. Only the checks of the edge form are left out.
    """
    case = _case(mesh, terms, given, None, seed)
    case.ours = Implementation(OURS, make(mesh, terms), case.ours.ndofs)
    if case.homogeneous.same:
        case.build = lambda mesh, terms, discretisation: make(mesh, terms)
    results = [task.run() for check in CHECKS for task in check(case) if task.implementation.name == OURS]
    return [result for result in results if result.outcome in (CheckOutcome.FAILED, CheckOutcome.COULD_NOT_RUN)]


def name_of(
    make: Callable[[ElementMesh, Sequence[StVK]], Any], mesh: ElementMesh, terms: Sequence[StVK], given: dict[str, Any], seed: int
) -> Naming:
    """Return the naming of the fault if a faulty model is the candidate."""
    return name_the_fault(_case(mesh, terms, given, make(mesh, terms), seed), terms)


def _of_reduced(reduced: OfFewUnknowns, others: Sequence[str], seed: int, quiet: bool) -> Report:
    """Return the report on a reduced body. Raise StvkError if `others` names arguments that the reduced body already defines."""
    if others:
        raise StvkError(f"{', '.join(others)}: a reduced body defines these; expected verify(reduced) without them.")
    started, body = time.perf_counter(), reduced.body
    discretisation = Discretisation(body.mesh.element.name, body.quadrature, body.rule.hourglass or 0.0)
    laws = [term for term in body.elastic_terms if term.material is not None]
    report = Report(
        header(Shape(body.mesh, discretisation), laws, repr(reduced), seed) | {"reference": "the body in the span of its fields"}
    )
    tasks = list(checks_of_reduced(reduced, np.random.default_rng(seed)))
    carry_out(report, "verify", tasks, quiet)
    report.seconds = time.perf_counter() - started
    return report


def _tasks(case: Case) -> Iterator[Task]:
    """Yield the tasks of all checks, for each check first on the simplices and then on the edges."""
    of_edges = case.of_edges()
    for check in CHECKS:
        yield from check(case)
        if of_edges is not None and check in OF_EDGES:
            yield from check(of_edges)
    if of_edges is None:
        yield Task("agreement", Implementation(EDGES, None, case.ours.ndofs), "W, F, K", "rest", "", partial(_no_edge_form, case))


def _no_edge_form(case: Case) -> dict[str, Any]:
    raise NotApplicable(f"{case.mesh.element.name}: their strain is not uniform, so edge lengths do not determine it")


def _measure_speed(report: Report, case: Case) -> None:
    try:
        report.speed += list(speed_table(case))
        report.errors |= error_table(case)
    except Exception as error:  # so that the earlier results are not lost
        reason = f"{type(error).__name__}: {error}"
        report.results.append(Result("speed", OURS, "W, F, K", STRETCH, CheckOutcome.COULD_NOT_RUN, reason=reason))


def claimed_terms(
    material: Material | StVK | Sequence[StVK] | None, young: ArrayLike | None, poisson: ArrayLike | None
) -> list[StVK]:
    """Return the `StVK` terms for the arguments of `verify`: a material, terms, or the constants of an isotropic material."""
    if material is None:
        return [StVK(young=young, poisson=poisson)]
    if young is not None or poisson is not None:
        raise MaterialError(
            "young and poisson are shorthand for material=Isotropic(young, poisson); expected one of the two, got both."
        )
    if isinstance(material, Material):
        return [StVK(material)]
    expected = "expected a material, StVK, or a list of StVK."
    if not isinstance(material, StVK | list | tuple):
        raise MaterialError(f"material = {shown(material)}; {expected}")
    terms = [material] if isinstance(material, StVK) else list(material)
    for term in terms:
        if not isinstance(term, StVK):
            raise MaterialError(f"material contains an object of type {type(term).__name__}; {expected}")
        if term.wrinkling:
            raise MaterialError(
                "material contains StVK(wrinkling=True); expected StVK without wrinkling: verify has no reference for this energy. "
                "Its derivatives can be checked with skfem_stvk.testing.assert_consistent."
            )
    if not terms:
        raise MaterialError("material is an empty list; expected at least one StVK term.")
    return terms


def _case(mesh: MeshLike, terms: Sequence[StVK], given: dict[str, Any], candidate: Any, seed: int) -> Case:
    """Return the case for a body. `given` may hold `degree`, `quadrature` and `hourglass` of its elements.

    The caller sets the claims of the candidate.
    """
    system = System(ElementMesh.of(mesh), terms, **{name: value for name, value in given.items() if value is not None})
    if candidate is not None and _makes_candidates(candidate):
        more = f" Pass an object with {', '.join(METHODS.values())}, or a class or function that makes it from the mesh alone."
        candidate = make_candidate("candidate(mesh)", partial(candidate, system.mesh), more)
    hourglass = given.get("hourglass")  # already validated by System
    discretisation = Discretisation(
        system.mesh.element.name, given.get("quadrature"), HOURGLASS if hourglass is None else float(hourglass)
    )
    shape, ndofs = Shape(system.mesh, discretisation), system.ndofs
    body, tensor = system.mesh, elasticity(system.mesh, terms, discretisation)
    control = hourglass_control(body, terms, discretisation) if discretisation.is_one_point else None
    case = Case(
        shape=shape,
        ours=Implementation(OURS, system, ndofs),
        reference=Implementation(REFERENCE, Truth(shape, tensor, control), ndofs),
        scikit_fem=Implementation(REFERENCE, reference_on(body.p, body.t, tensor, discretisation, control), ndofs),
        candidate=None if candidate is None else Implementation(CANDIDATE, candidate, ndofs),
        states={},
        seed=seed,
        homogeneous=homogeneous_copy(body, terms, shape),
        network=Implementation(EDGES, _network(body, terms), ndofs) if body.element.is_linear_simplex else None,
        elements_without_term=body.nt - len(np.unique(np.concatenate([body.elements(term.region) for term in terms]))),
    )
    if case.candidate is not None and not any(case.candidate.has(quantity) for quantity in METHODS):
        raise StvkError(f"candidate, of type {type(candidate).__name__}, has none of {', '.join(METHODS.values())}.")
    case.states.update(named_states(case.centred, case.node_size, case.random("states")))
    return case


def _network(mesh: ElementMesh, terms: Sequence[StVK]) -> System:
    """Return the body as a sum over edges and pairs of edges. Warnings are off, because the system of simplices has issued them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        return System(mesh, EdgeNetwork.of(mesh, terms))
