"""User-given constants and functions become functions of location and time."""

from functools import partial

import numpy as np
import pytest

from skfem_stvk.errors import LoadError, SupportError
from skfem_stvk.terms.loads.load import Moment, Value

X = np.array([[0.0, 1.0, 2.0], [5.0, 5.0, 6.0]])


class Callable:
    def __call__(self, x, t):
        return t * x


@pytest.mark.few
@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ((1, 2), [[0.5], [1]]),
        (np.array([1, 2], dtype=np.float32), [[0.5], [1]]),
        ([[1, 2, 3], [4, 5, 6]], [[0.5, 1, 1.5], [2, 2.5, 3]]),
        ([[1], [4]], [[0.5], [2]]),
        (lambda t: (t, 1), [[0.5], [1]]),
        (lambda time, scale=4: (scale * time, 1), [[2], [1]]),
        (lambda x, t: t * x, 0.5 * X),
        (lambda x, t: (0, x[1]), [[0, 0, 0], [5, 5, 6]]),
        (partial(lambda a, x, t: a * t * x, 2), X),
        (Callable(), 0.5 * X),
    ],
)
def test_components_are_constants_that_ramp_or_functions_as_they_are(given, expected):
    value = Value(given, (2,), X, "It")
    assert value.at(0.5).tolist() == np.array(expected, dtype=float).tolist()
    assert (value.constant is None) == callable(given)


@pytest.mark.parametrize(
    ("given", "expected"),
    [(3, [1.5]), ([1, 2, 3], [0.5, 1, 1.5]), (lambda t: t**2, [0.25]), (lambda x, t: x[0], [0, 1, 2]), (lambda x, t: t, [0.5])],
)
def test_numbers_are_constants_that_ramp_or_functions(given, expected):
    assert Value(given, (), X, "It").at(0.5).tolist() == expected


def test_constants_ramp_with_the_load_factor_and_do_not_in_time():
    constant, function = Value(3, (), X, "It"), Value(lambda t: 3 * t, (), X, "It")
    for t in (0.0, 0.25, 1.0):
        assert [constant.at(t).item(), constant.at(Moment(t, 1.0)).item()] == [3 * t, 3]
        assert [function.at(t).item(), function.at(Moment(t, 1.0)).item()] == [3 * t, 3 * t]


def test_a_function_cannot_change_the_coordinates():
    x = X.copy()
    Value(lambda x, t: x.__iadd__(1), (2,), x, "It").at(1.0)
    assert np.array_equal(x, X)


def test_constants_are_copied():
    given = np.array([1.0, 2.0])
    value = Value(given, (2,), X, "It")
    given[:] = np.nan
    assert np.isfinite(value.at(1.0)).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            (1, 2, 3),
            r"^It: the value has shape \(3,\); expected 2 components \(x, y\), or \(2, 3\), "
            r"one column for each of the 3 vertices there\.$",
        ),
        (np.ones((3, 2)), r"shape \(3, 2\); expected 2 components"),
        ((1, np.inf), r"the value is not finite\.$"),
        (np.array([[1, np.nan, 1], [1, 1, np.nan]]), r"not finite in 2 entries \(1, 2\)"),
        ((1, None), "expected 2 components"),
        ((1j, 2), "expected 2 components"),
        (lambda: 1, "the function has 0 arguments"),
        (lambda x, y, t: 1, "the function has 3 arguments"),
        (lambda x: x, "a function of one argument is a function of t, but this one calls it x"),
        (lambda t: [1, [2, 3]] and (t,), r"what the function returned at t = 0 has shape \(1,\)"),
        (lambda t: (1 if t else np.nan, 1), r"what the function returned at t = 0 is not finite"),
        (lambda t: (np.nan if t == 1 else 1, 1), r"what the function returned at t = 1 is not finite"),
        (lambda t: None, "what the function returned at t = 0 is None; expected 2 components"),
        (dict, r"cannot tell the arguments|a function of"),
    ],
)
def test_invalid_values_are_refused_at_construction(given, message):
    for error in (LoadError, SupportError):
        with pytest.raises(error, match=message):
            Value(given, (2,), X, "It", error)
