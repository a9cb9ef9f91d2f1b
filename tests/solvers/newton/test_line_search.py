"""Minima of the line search: the first minimum of a quartic, and a root of a slope."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skfem_stvk.solvers.newton.newton import quartic_minimum, root_of_slope

numbers = st.floats(-10, 10).filter(lambda x: x == 0 or abs(x) > 1e-3)


@settings(max_examples=200)
@given(numbers, numbers, numbers, st.floats(0.1, 10), st.floats(1e-6, 10))
def test_the_first_minimum_of_a_quartic_is_found(c0, c2, c3, c4, fall):
    c = np.array([c0, -fall, c2, c3, c4])
    s = quartic_minimum(c)
    slope = np.polynomial.Polynomial(c).deriv()
    below = np.linspace(0, s, 1000)[1:-1]
    tiny = 1e-6 * np.abs([fall, 2 * c2 * s, 3 * c3 * s**2, 4 * c4 * s**3]).max()
    assert abs(slope(s)) <= tiny
    assert (slope(below) <= tiny).all()


def test_a_second_lower_minimum_is_not_chosen():
    """The quartic (s - 1)^2 (s - 3)^2 is tilted so that its second minimum, a mirrored state, is lower."""
    c = np.polynomial.polynomial.polyfromroots([1, 1, 3, 3]) - np.array([0, 0.2, 0, 0, 0])
    s = quartic_minimum(c)
    assert 0.9 < s < 1.2
    assert np.polynomial.Polynomial(c)(3) < np.polynomial.Polynomial(c)(s)


def test_an_unbounded_decrease_has_no_minimum():
    assert quartic_minimum(np.array([0, -1.0, -1.0, 0, 0])) == np.inf


@pytest.mark.parametrize("size", [1e-12, 1e-3, 1.0, 1e6, 1e12])
@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_the_minimum_does_not_depend_on_units_and_on_the_length_of_the_direction(scale, size):
    c = np.array([0, -3.0, 1.0, 0.5, 0.2])
    assert quartic_minimum(scale * c * size ** np.arange(5)) * size == pytest.approx(quartic_minimum(c), rel=1e-9)


@pytest.mark.parametrize("root", [1e-3, 0.3, 1.0, 7.0, 60.0])
def test_a_root_of_the_slope_is_found_near_and_far(root):
    def slope(s):
        return (s / root) ** 3 - 1

    s = root_of_slope(slope, -1.0)
    assert s is not None and abs(slope(s)) <= 0.1


def test_a_slope_without_root_gives_none():
    assert root_of_slope(lambda s: -1.0 - s, -1.0) is None


@pytest.mark.few
@pytest.mark.parametrize("longest", [1e-4, 0.4, 1.0, 1.5, 3.0, 5.0, 100.0])
@pytest.mark.parametrize("root", [0.3, 2.0, 60.0])
def test_the_slope_is_not_evaluated_beyond_the_longest_length(longest, root):
    asked = []

    def slope(s):
        asked.append(s)
        return (s / root) ** 3 - 1

    s = root_of_slope(slope, -1.0, longest)
    assert max(asked) <= longest and 0 < s <= longest
    assert s == longest or abs((s / root) ** 3 - 1) <= 0.1
    assert (s == longest) or root * 0.9 ** (1 / 3) <= longest
