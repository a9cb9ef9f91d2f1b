"""Public docstrings follow numpydoc: sections, all parameters with shapes and units, and examples."""

import inspect
import re
from functools import cached_property
from itertools import pairwise
from types import FunctionType

import pytest
from numpydoc.validate import validate

import skfem_stvk
from skfem_stvk.solvers.runs.run_result import RunResult

LEFT_OUT = {
    "PR04": "types are annotations, which mypy checks",
    "SA01": "pages of the docs link to related names",
    "ES01": "a summary that says everything needs no extended summary",
}
LEFT_OUT_OF_MEMBERS = {
    "EX01": "the example of the class calls them",
    "RT01": 'the summary says "Return ...", with shape and unit',
}
LEFT_OUT_OF_RESULTS = {"PR01": "no user calls the constructor of a class that documents Attributes alone"}


def members(cls):
    """Public functions and properties that a class defines itself, and those of all results of runs."""
    kinds = (FunctionType, property, cached_property, classmethod, staticmethod)
    own = {name: member for one in cls.__mro__ if one in (cls, RunResult) for name, member in vars(one).items()}
    return [name for name, member in own.items() if name[0] != "_" and isinstance(member, kinds)]


PUBLIC = [name for name in skfem_stvk.__all__ if callable(getattr(skfem_stvk, name))]
CLASSES = [name for name in PUBLIC if inspect.isclass(getattr(skfem_stvk, name))]
MEMBERS = [f"{name}.{member}" for name in CLASSES for member in members(getattr(skfem_stvk, name))]


def documented_in_a_base_class(name):
    """Return whether a member without a docstring of its own overrides a documented one, which tools then show."""
    owner, member = name.split(".")
    family = getattr(skfem_stvk, owner).__mro__
    docs = [getattr(vars(cls)[member], "__doc__", None) for cls in family if member in vars(cls)]
    return not docs[0] and any(docs)


def shared_arguments(cls):
    """Names of the arguments that a class documents once for all of its methods."""
    return set(re.findall(r"^ *- `(\w+)`: ", cls.__doc__, re.MULTILINE))


def is_shared(name, error):
    """Return whether an error is about undocumented parameters of a method that its class documents."""
    owner, _, member = name.partition(".")
    missing = set(re.findall(r"'(\w+)'", error[1])) if error[0] == "PR01" and member else set()
    return bool(missing) and missing <= shared_arguments(getattr(skfem_stvk, owner))


def faults(name):
    """Complaints about a public name or a member, as "code: message", without those that are left out."""
    found = validate(f"skfem_stvk.{name}")
    left_out = {**LEFT_OUT, **(LEFT_OUT_OF_MEMBERS if "." in name else {})}
    titles = re.findall(r"^(\w+)\n-+$", found["docstring"], re.MULTILINE)
    if "Attributes" in titles and "Parameters" not in titles:
        left_out |= LEFT_OUT_OF_RESULTS
    errors = [error for error in found["errors"] if error[0] not in left_out and not is_shared(name, error)]
    return [f"{code}: {text}" for code, text in errors] + unmarked_blocks(found["docstring"])


def unmarked_blocks(docstring):
    """Indented paragraphs outside lists and sections that do not follow `::`, which Sphinx would show as quotations."""
    paragraphs = re.split(r"\n\s*\n", re.split(r"\n(?=\w+\n-+\n)", docstring)[0])
    indented = [(before, block) for before, block in pairwise(paragraphs) if block.startswith("    ")]
    return [f"no '::' before {block}" for before, block in indented if not before.endswith("::") and not before.startswith("    ")]


def test_docstrings_of_public_names_and_their_members_follow_numpydoc():
    names = [*PUBLIC, *(name for name in MEMBERS if not documented_in_a_base_class(name))]
    assert {name: found for name in names if (found := faults(name))} == {}


def test_most_public_names_have_members_that_are_checked():
    assert len(PUBLIC) == len(set(PUBLIC)) > 70 and len(MEMBERS) > 150
    assert "System.energy" in MEMBERS and not documented_in_a_base_class("System.energy")
    assert documented_in_a_base_class("Ramp.factor")
    assert {"u", "t", "out"} < shared_arguments(skfem_stvk.System) and not shared_arguments(skfem_stvk.StVK)


def toy(a, b):
    """Return a sum::

        a + b

    Of two numbers

        a b

    Parameters
    ----------
    a
        First number [m].
    """
    return a + b


def test_faults_of_a_toy_docstring_are_reported(monkeypatch):
    monkeypatch.setattr(skfem_stvk, "toy", toy, raising=False)
    assert [fault.split(":")[0] for fault in faults("toy")] == ["SS03", "PR01", "RT01", "EX01", "no '"]


def test_a_name_that_is_not_public_fails():
    with pytest.raises(AttributeError):
        faults("Nobody")
