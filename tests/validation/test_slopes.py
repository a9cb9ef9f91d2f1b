"""Reference slopes, and the small print of pictures that show times."""

from fractions import Fraction

import numpy as np
import pytest
from matplotlib.figure import Figure

from skfem_stvk.about import write_machine
from validation.slopes import draw_slope


@pytest.mark.parametrize("exponent", [-2, Fraction(-2, 3)])
def test_a_slope_has_its_exponent_and_its_distance(exponent):
    axes = Figure().subplots()
    draw_slope(axes, [4.0, 1.0, np.nan, 2.0], [1.0, 8.0, 1.0, 3.0], exponent, below=0.25)
    (line,) = axes.lines
    (x0, x1), (y0, y1) = line.get_data()
    assert (x0, x1, y0) == (1.0, 4.0, 2.0) and np.log(y1 / y0) / np.log(x1 / x0) == pytest.approx(float(exponent))
    assert axes.texts[0].get_text() == f"time$^{{{exponent}}}$"


def test_one_point_has_no_slope():
    axes = Figure().subplots()
    draw_slope(axes, [1.0, 2.0], [1.0, np.nan], -1)
    assert not axes.lines


def test_small_print_names_the_machine_and_the_day():
    figure = Figure()
    write_machine(figure, {"machine": {"processor": "a processor"}, "date": "2026-11-24T12:00:00+00:00"})
    assert figure.get_supxlabel() == "a processor, 2026-11-24"
