"""Arguments of static solves, stops and results that are refused, each with a message that names it and what was expected."""

import numpy as np
import pytest
from beams import beam, bent
from test_arc_length import bar
from test_springs import tied

from skfem_stvk import Gravity, Isotropic, Pressure, Stop, StVK, System, Traction, solve_static
from skfem_stvk.errors import LoadError, RegionError, StateError, StvkError, SupportError
from skfem_stvk.linear import Kind
from skfem_stvk.solvers.statics import SolveError

MATERIAL = StVK(young=1e4, poisson=0.3)
PULL = Traction("tip", (0, 0, -1.0))
WALL = {"wall": "xyz"}


class WithoutMatrix:
    name, takes, matrix_free, iterative = "free", Kind.SYMMETRIC, True, True

    def analyse(self, unknowns):
        raise AssertionError


def solve(**options):
    return lambda: solve_static(bent(), quiet=True, **options)


def follow(**options):
    return lambda: solve_static(bar(), **{"method": "arc-length", "quiet": True} | options)


def stopped_at(*displacement):
    return follow(stop=Stop(displacement=displacement))


def of(*terms, system=None, **supports):
    return lambda: solve_static(System(beam(), [MATERIAL, *terms], **supports), quiet=True, **(system or {}))


REFUSED = {
    "nothing acts": (LoadError, "Nothing acts on the body", of(fixed=WALL)),
    "not held": (SupportError, r"Not held: .*6 rigid modes.*translation along x.*rotation", of(PULL)),
    "one mode": (SupportError, r"has 1 rigid mode left, translation along z\.", of(PULL, fixed={"wall": "xy"})),
    "single precision": (StvkError, "float32.*float64", of(PULL, fixed=WALL, dtype=np.float32)),
    "support": (RegionError, r"'wal'.*'wall'", of(fixed={"wal": "xyz"})),
    "load": (RegionError, r"'tipp'.*'tip'", of(Traction("tipp", (0, 0, 1.0)))),
    "both": (StvkError, "fixed and prescribed", of(fixed=WALL, prescribed={"wall": {"x": 0.1}})),
    "density": (ValueError, "density", lambda: System(beam(), [StVK(Isotropic(1e4, 0.3)), Gravity(g=(0, 0, -9.81))])),
    "steps 0": (StvkError, "steps = 0; expected a whole number", solve(steps=0)),
    "steps 2.5": (StvkError, "steps = 2.5", solve(steps=2.5)),
    "rtol 0": (StvkError, "rtol = 0.0", solve(rtol=0.0)),
    "rtol nan": (StvkError, "rtol = nan", solve(rtol=float("nan"))),
    "rtol None": (StvkError, r"^rtol = ", solve(rtol=None)),
    "rtol text": (StvkError, r"^rtol = ", solve(rtol="1e-8")),
    "solver": (StvkError, "solver = 'mumps'; expected 'auto', 'superlu'", solve(solver="mumps")),
    "u0 short": (StvkError, r"shape \(5,\)", solve(u0=np.zeros(5))),
    "u0 text": (StvkError, r"^u0? (= |is |has )", solve(u0="zero")),
    "u0 function": (StvkError, r"^u0? (= |is |has )", solve(u0=lambda x: x)),
    "u0 nan": (StateError, "not finite in 1 entry", solve(u0=np.where(np.arange(297) == 3, np.nan, 0.0))),
    "save nowhere": (StvkError, "nowhere", solve(save="nowhere/at/all.pvd")),
    "save 3": (StvkError, r"^save = ", solve(save=3)),
    "resume": (StvkError, "resume = True; expected a checkpoint", solve(resume=True)),
    "checkpoint": (StvkError, "checkpoint = 3", solve(checkpoint=3)),
    "resume text": (StvkError, "resume = 'yes'; expected True or False", solve(resume="yes")),
    "stability text": (StvkError, "stability = 'yes'; expected True or False", solve(stability="yes")),
    "method": (StvkError, "known: 'arc-length', 'load-steps'", solve(method="riks")),
    "stop of load steps": (StvkError, "with method='arc-length'", solve(stop=Stop(load=1.0))),
    "t0": (StvkError, "t0 = 1", solve(t0=1.0)),
    "amg-cg": (StvkError, r"direct solver, 'superlu', 'pardiso'", follow(solver="amg-cg")),
    "nan by arc length": (StateError, "not finite in 4 entries", follow(u0=np.full(4, np.nan))),
    "unsymmetric": (ValueError, r"general.*superlu", of(Pressure("tip", 10.0), system={"solver": "amg-cg"}, fixed=WALL)),
    "no matrix": (StvkError, r"solver = 'free', which forms no matrix; expected one that does", lambda: solve_static(
        tied(), solver=WithoutMatrix(), quiet=True
    )),
    "no stop": (StvkError, "expected a load", Stop),
    "turns": (StvkError, "turns = 0", lambda: Stop(turns=0)),
    "states": (StvkError, "states = True", lambda: Stop(states=True)),
    "stop at nan": (StvkError, "load = nan", lambda: Stop(load=np.nan)),
    "5": (StvkError, "a location, a component and a value", follow(stop=Stop(displacement=5))),
    "z": (StvkError, "component = 'z'", stopped_at([1], "z", 0.1)),
    "xy": (StvkError, "component = 'xy'", stopped_at([1], "xy", 0.1)),
    "fixed": (StvkError, r"component = 'x' is fixed at 1 vertex \(1\); expected a component that can", stopped_at([1], "x", 0.1)),
    "inf": (StvkError, "finite displacement", stopped_at([1], "y", np.inf)),
    "apex": (StvkError, "apex", stopped_at("apex", "y", 0.1)),
    "7": (StvkError, "7", stopped_at([7], "y", 0.1)),
    "no response": (SolveError, "no displacement changes as the load grows", of(
        Traction("wall", (0, 0, -10.0)), system={"method": "arc-length"}, fixed=WALL
    )),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_solved_is_refused_in_words(case):
    error, message, call = REFUSED[case]
    with pytest.raises(error, match=message):
        call()


@pytest.fixture(scope="module")
def result():
    return solve_static(bent(), steps=3, quiet=True)


@pytest.mark.parametrize(
    ("error", "message", "of_result"),
    [
        (SupportError, "no support and no foundation acts at 'tip', so there is no reaction", lambda found: found.reaction("tip")),
        (RegionError, r"'wall'", lambda found: found.reaction("wal")),
        (StvkError, "pk1", lambda found: found.stress("piola")),
        (StvkError, "known: 'elements', 'nodes'", lambda found: found.stress("cauchy", at="vertices")),
    ],
)
def test_what_a_result_does_not_have_is_refused_in_words(result, error, message, of_result):
    with pytest.raises(error, match=message):
        of_result(result)


@pytest.mark.parametrize("folder", ["missing/path", "file"])
def test_a_folder_that_cannot_be_created_is_refused_before_the_solve(folder, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StvkError, match="cannot be written"):
        solve(checkpoint=tmp_path / folder)()
