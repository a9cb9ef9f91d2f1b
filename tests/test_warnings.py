"""Warnings are attributed to the line of the user's program that caused them."""

import warnings
from pathlib import Path

import numpy as np
import skfem

from skfem_stvk import Gravity, StVK, System, VelocityVerlet, simulate, solve_static
from skfem_stvk.errors import StvkWarning


def _lines(act):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        act()
    return [Path(one.filename) for one in caught if issubclass(one.category, StvkWarning)]


def _two_parts():
    x = np.array([[0.0, 1, 0, 5, 6, 5], [0.0, 0, 1, 0, 0, 1]])
    System((x, np.array([[0, 3], [1, 4], [2, 5]])), StVK(young=1.0, poisson=0.3))


def _locks():
    mesh = skfem.MeshTri().refined(1)
    terms = [StVK(young=1.0, poisson=0.49, density=1.0), Gravity((0, -1e-6))]
    solve_static(System(mesh, terms, fixed={lambda x: x[0] == 0: "xy"}), quiet=True)


def _steps_too_large():
    mesh = skfem.MeshTri().refined(1)
    system = System(mesh, [StVK(young=1.0, poisson=0.3, density=1.0), Gravity((0, -1e-6))], fixed={lambda x: x[0] == 0: "xy"})
    simulate(system, VelocityVerlet(dt=0.5), until=1.0, quiet=True, raise_on_failure=False)


def test_warnings_point_at_the_first_line_outside_of_the_package():
    for act in (_two_parts, _locks, _steps_too_large):
        lines = _lines(act)
        assert lines and all(line == Path(__file__) for line in lines), (act.__name__, lines)
