"""Every public function gets hostile values of each argument: its error names the argument, or its result is correct."""

from importlib import import_module
from inspect import isclass, isfunction

import numpy as np
import pytest
from slow import slow

from skfem_stvk import StvkError, System
from validation.hostile import arguments
from validation.hostile.call import Call
from validation.hostile.case import Wrong
from validation.hostile.values import EVERY

PARTS = (
    "",
    "dynamics",
    "edges",
    "linear",
    "materials",
    "mesh",
    "peers",
    "reduced",
    "referee",
    "results",
    "statics",
    "system",
    "terms",
)
#: Public names without a row in the tables, with the reason.
WITHOUT = {
    # created by the package only: users do not call the constructors
    *(
        "Deformation",
        "PointResponse",
        "Analysis",
        "Attempt",
        "BetweenPoints",
        "CheckOutcome",
        "CriticalPoint",
        "CriticalElements",
        "CriticalStep",
        "EdgeBlocks",
        "End",
        "Finding",
        "FreeOperator",
        "History",
    ),
    *(
        "Iterations",
        "Linearized",
        "Mass",
        "Modes",
        "Extreme",
        "MeshQuality",
        "NetworkComparison",
        "Outcome",
        "Report",
        "Result",
        "Rows",
        "Run",
        "Solution",
        "StaticResult",
        "Status",
    ),
    *("Step", "TangentOperator", "Pattern", "Body"),
    # protocols and base classes
    *(
        "BoundContact",
        "BoundElements",
        "BoundLoad",
        "BoundTerm",
        "Factors",
        "FramedMaterial",
        "HasPressure",
        "HasResponse",
        "HasStress",
        "HoldsShape",
        "Integrator",
    ),
    *("LinearSolver", "Load", "Material", "MeshLike", "Operator", "Peer", "Term", "is_load"),
    # errors and warnings, enumerations, names without arguments
    *(
        "Hypothesis",
        "Interrupted",
        "Kind",
        "SimulationError",
        "SolveError",
        "AmgCg",
        "Pardiso",
        "SuperLU",
        "available",
        "embedded_mesh",
        "names",
    ),
    # internal classes: `System` checks their arrays
    *("Assembly", "EdgeForm", "NodeBlocks", "Tensions"),
    # files: the family "meshes" and tests/scenes test them
    *("read_mesh", "Scene"),
    # a user's function and a few numbers: tests/referee/test_solvers_judged.py and test_integrators_judged.py test them
    *("verify_solver", "verify_integrator"),
}


def fault_of(case, folder):
    """Return the description of the fault in the outcome of a case; None if there is no fault."""
    try:
        result = case.attempt(folder)
    except Exception as error:
        return None if case.refused(error) else f"{case.name}: {type(error).__name__}: {str(error)[:200]}"
    try:
        case.judge(result)
    except Wrong as wrong:
        return f"{case.name}: {wrong.why[:200]}"
    return None


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("table", [slow(name) if name == "table_of_results" else name for name in arguments.TABLES])
def test_errors_name_the_hostile_argument_and_legal_values_give_the_correct_result(table, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cases = list(arguments.cases_of_calls(arguments.calls_of(table), costly=False))
    faults = [fault for case in cases if (fault := fault_of(case, tmp_path))]
    assert len(cases) > 1500 and not faults, "\n".join([f"{len(faults)} faults", *faults[:20]])


def test_every_public_function_and_class_has_a_row():
    calls = [call.name for table in arguments.TABLES for call in arguments.calls_of(table)]
    known = {name.split(".")[0].split(" ")[0] for name in calls}
    known |= {name.split(".")[-1].split(" ")[0] for name in calls if name.startswith("peers.")}
    public = set()
    for part in PARTS:
        module = import_module(f"skfem_stvk.{part}".rstrip("."))
        for name in module.__all__:
            thing = getattr(module, name)
            if isfunction(thing) or (isclass(thing) and not issubclass(thing, Exception)):
                public.add(name)
    assert public - known - WITHOUT == set(), "each public name has a row in a validation/hostile/table_of_*.py, or in WITHOUT here"
    assert public | {"Interrupted", "MeshLike", "SimulationError", "SolveError"} >= WITHOUT


def test_every_method_of_a_system_has_a_row():
    calls = {call.name.split(" ")[0] for call in arguments.calls_of("table_of_systems")}
    methods = {name: getattr(System, name) for name in dir(System) if name[0] != "_"}
    names = "advanced", "after_step", "contact_force", "contacts_at", "look", "pairs_at", "prescribe", "return_to", "terms_at"
    for name in (*names, "with_terms"):  # for analyses
        del methods[name]
    with_arguments = {name for name, method in methods.items() if isfunction(method) and method.__code__.co_argcount > 1}
    assert {f"System.{name}" for name in with_arguments} <= calls and len(with_arguments) > 15


def accepts_everything(x):
    return x


def raises_type_error_inside(x):
    return float(np.sqrt(x) + None)


def does_not_name_its_argument(x):
    raise StvkError("Something is wrong with the value.")


def depends_on_the_type(x):
    return 1.0 if isinstance(x, float) else 2.0


@pytest.mark.parametrize(
    "function", [accepts_everything, raises_type_error_inside, does_not_name_its_argument, depends_on_the_type]
)
def test_a_function_that_does_not_check_its_argument_is_found(function, tmp_path):
    cases = arguments.cases_of_calls([Call("f", lambda: (function, {"x": 2.0}))])
    faults = [fault for case in cases if (fault := fault_of(case, tmp_path))]
    assert len(faults) > 3


def test_there_are_more_than_70_hostile_values_with_unique_names():
    assert len({value.name for value in EVERY}) == len(EVERY) > 70
