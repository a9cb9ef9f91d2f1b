"""Functions of time as comparable objects: ramps, sines and tables."""

from math import pi

import numpy as np
import pytest
from bodies import box

from skfem_stvk import Gravity, LoadError, NodalLoad, Pressure, Ramp, Sine, StVK, System, Table
from skfem_stvk.terms.loads.load import Moment, Value

X = np.zeros((3, 4))
LAW = StVK(young=2.0, poisson=0.3, density=1.0)
EVERY = [Ramp((0, -2.0, 1), 0.5, 0.25), Sine((0, -2.0, 1), 3.0, 0.1), Table((0, -2.0, 1), [0, 1, 4], [0, 2, -1])]


@pytest.mark.parametrize(("t", "factor"), [(-1, 0), (0.25, 0), (0.3125, 0.25), (0.5, 1), (7, 1)])
def test_a_ramp_is_zero_before_it_grows_and_one_after(t, factor):
    assert Ramp(8.0, until=0.5, start=0.25)(t) == 8 * factor
    assert Ramp((8.0, -4), until=0.5, start=0.25)(t) == (8 * factor, -4 * factor)


def test_a_sine_has_its_frequency_and_its_phase():
    t = np.linspace(0, 2, 41)
    assert np.allclose([Sine(3.0, 1.5, 0.2)(one) for one in t], 3 * np.sin(2 * pi * 1.5 * t + 0.2), rtol=1e-14, atol=1e-14)
    assert np.isclose(Sine(3.0, 1.5, pi / 2)(0), 3.0)


@pytest.mark.parametrize(("t", "factor"), [(-5, 1), (1, 1), (1.5, 2), (2, 3), (6, -1), (9, -1)])
def test_a_table_is_linear_between_its_times_and_constant_outside(t, factor):
    assert Table(2.0, times=(1, 2, 6), factors=(1, 3, -1))(t) == 2 * factor
    assert Table(2.0, times=[1], factors=[0.5])(t) == 1.0


@pytest.mark.parametrize("function", EVERY)
def test_repr_equality_and_hash(function):
    typed = eval(repr(function))
    assert typed == function and hash(typed) == hash(function) and typed(0.37) == function(0.37)


@pytest.mark.parametrize("function", EVERY)
def test_values_do_not_change_with_the_arrays_of_the_constructor(function):
    given = np.array(function.value)
    kept = type(function)(given, *[getattr(function, name) for name in list(function.__dataclass_fields__)[1:]])
    given[:] = 7
    assert kept == function


@pytest.mark.parametrize("function", EVERY)
def test_loads_accept_functions_of_time(function):
    value = Value(function, (3,), X, "It")
    assert value.constant is None
    for t in (0.3, 1.0):
        assert value.at(t).ravel().tolist() == value.at(Moment(t, 1.0)).ravel().tolist() == list(function(t))


def test_functions_of_time_work_in_loads_and_prescribed_displacements():
    mesh = box()
    at = mesh.p[0] > 0.8 * mesh.p[0].max()
    for written, plain in (
        (Gravity(Ramp((0, 0, -9.0), until=0.5)), Gravity(lambda t: (0, 0, -9.0 * min(1, 2 * t)))),
        (NodalLoad(at, Table((0, 1, 0), [0, 1], [1, 3])), NodalLoad(at, lambda t: (0, 1 + 2 * t, 0))),
        (Pressure(at, Sine(5.0, 0.25)), Pressure(at, lambda t: 5 * np.sin(2 * np.pi * 0.25 * t))),
    ):
        one, other = System(mesh, [LAW, written]), System(mesh, [LAW, plain])
        for t in (0.2, 1.0):
            assert np.array_equal(one.external_force(np.zeros(one.ndofs), t), other.external_force(np.zeros(one.ndofs), t))
    moved = System(mesh, LAW, prescribed=[(at, {"x": Ramp(0.1, until=0.5), "y": 0.2}), (~at, Ramp((0, 0, 1.0), until=2))])
    values = np.zeros(moved.ndofs)
    values[moved.supports.held] = moved.supports.values(0.25)
    assert values.reshape(-1, 3)[at].tolist() == [[0.05, 0.05, 0.0]] * at.sum()
    assert values.reshape(-1, 3)[~at].tolist() == [[0, 0, 0.125]] * (~at).sum()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Ramp("a", 1.0), r"Ramp: value = 'a'; expected a number, or one to three components"),
        (lambda: Ramp((1, 2, 3, 4), 1.0), r"Ramp: value = \(1, 2, 3, 4\); expected .* write a function of \(x, t\)"),
        (lambda: Sine((1, np.nan), 1.0), r"Sine: value = \(1, nan\) is not finite"),
        (lambda: Ramp(1.0, until=0.5, start=0.5), r"Ramp: until = 0\.5; expected a finite number after start = 0\.5"),
        (lambda: Ramp(1.0, until=np.inf), r"Ramp: until = inf; expected a finite number after start = 0"),
        (lambda: Sine(1.0, 0), r"Sine: frequency = 0; expected a positive number, cycles per time"),
        (lambda: Sine(1.0, 1, None), r"Sine: phase = None; expected a finite number, an angle in radians"),
        (lambda: Table(1.0, [], []), r"Table: times are empty; expected at least one"),
        (lambda: Table(1.0, [0, 1, 1, 0.5], [0] * 4), r"Table: times do not ascend after 2 entries \(1, 2\)"),
        (lambda: Table(1.0, [0, 1], [0, 1, 2]), r"Table: factors has shape \(3,\); expected \(2,\) numbers, one for each"),
        (lambda: Table(1.0, [0, 1], [0, np.inf]), r"Table: factors is not finite in 1 entry \(1\)"),
        (lambda: Ramp(1.0, 1.0)("now"), r"t = 'now'; expected a finite load factor or time"),
    ],
)
def test_invalid_functions_of_time_are_refused(make, message):
    with pytest.raises(LoadError, match=message):
        make()


def test_a_wrong_number_of_components_is_refused_by_the_load():
    with pytest.raises(LoadError, match=r"Gravity: what the function g returned at t = 0 has shape \(2,\); expected 3 components"):
        System(box(), [LAW, Gravity(Ramp((0, 1), 1.0))])
