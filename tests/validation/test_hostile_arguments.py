"""Every public function gets hostile values of each argument: its error names the argument, or its result is correct."""

from inspect import isclass, isfunction

import numpy as np
import pytest

import skfem_stvk
from skfem_stvk import StvkError
from validation.hostile import arguments
from validation.hostile.calls import Call, calls
from validation.hostile.case import Wrong

#: Public names without a row in the table, with the reason.
WITHOUT = {
    *("Interrupted", "MeshQuality", "Report", "Run", "StaticResult"),  # made by the package only
    *("Scene", "read_mesh", "embedded_mesh"),  # files: the families "meshes" and "stores" test them
    *("verify_solver", "verify_integrator", "verify_law", "verify_results"),  # tests of the referee test them
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
def test_each_function_accepts_the_good_arguments(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for call in calls():
        function, good = call.make()
        assert np.isfinite(arguments.plain(function(**good))).all(), call.name


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_errors_name_the_hostile_argument_and_equal_values_give_equal_results(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cases = list(arguments.cases())
    faults = [fault for case in cases if (fault := fault_of(case, tmp_path))]
    assert len(cases) > 4000 and not faults, "\n".join([f"{len(faults)} faults", *faults[:20]])


def test_every_public_function_and_class_has_a_row():
    known = {call.name.split(".")[0] for call in calls()}
    public = set()
    for name in skfem_stvk.__all__:
        thing = getattr(skfem_stvk, name)
        if isfunction(thing) or (isclass(thing) and not issubclass(thing, Exception)):
            public.add(name)
    assert public - known - WITHOUT == set(), "each public name has a row in validation/hostile/calls.py, or in WITHOUT here"


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
    cases = arguments.cases_of([Call("f", lambda: (function, {"x": 2.0}))])
    faults = [fault for case in cases if (fault := fault_of(case, tmp_path))]
    assert len(faults) > 3
