"""Verdicts on invented numbers."""

import numpy as np
import pytest

from validation.bench import Benchmark, Plan
from validation.bench.meshes import Specimen
from validation.bench.results import CONTROL, CSR, OURS, REFERENCE, Memory, Timing
from validation.bench.targets import TARGETS, Target, TargetVerdict, judged, of_memory, of_time, over, slope, verdicts

PLAN = Plan("made up", boxes=(40, 250), parts=(40,), judged=(40, 250), referenced=())
MESHES = {"box 40": 42, "box 250": 256, "part 40": 38}


def at_most(value, limit=2.0, moonshot=1.0):
    return TargetVerdict(Target("time", limit, lambda results, mesh: None, moonshot), {"a": value})


def at_least(value, limit=25.0, moonshot=50.0):
    return TargetVerdict(Target("ratio", limit, lambda results, mesh: None, moonshot, at_least=True), {"a": value})


def made_up(**times):
    """Return a benchmark in which the given calls have the given times on all meshes [ns per tetrahedron]."""
    results = Benchmark(PLAN, {}, meshes={name: {"nt": nt, "nv": nt} for name, nt in MESHES.items()})
    for mesh, nt in MESHES.items():
        for implementation, quantity, ns in times["calls"]:
            results.timings.append(Timing(mesh, nt, implementation, quantity, 1, "float64", ns, ns, 5))
    return results


@pytest.mark.parametrize(
    ("verdict", "words", "met", "moonshot"),
    [
        (at_most(0.9), "met", True, True),
        (at_most(1.0), "met", True, True),
        (at_most(1.5), "met", True, False),
        (at_most(2.0), "met", True, False),
        (at_most(2.5), "missed by 25 %", False, False),
        (at_least(50.0), "met", True, True),
        (at_least(25.0), "met", True, False),
        (at_least(20.0), "missed by 20 %", False, False),
    ],
)
def test_a_target_is_met_at_its_limit_and_missed_beyond(verdict, words, met, moonshot):
    assert (verdict.in_words(), verdict.met, verdict.moonshot) == (words, met, moonshot)


def test_the_worst_mesh_decides():
    both = {"a": 1.0, "b": 3.0}
    assert TargetVerdict(at_most(0).target, both).worst == 3.0 and TargetVerdict(at_least(0).target, both).worst == 1.0


def test_an_unmeasured_target_is_neither_met_nor_missed():
    nothing = TargetVerdict(at_most(0).target, {})
    assert (nothing.met, nothing.moonshot, nothing.in_words()) == (None, None, "not measured")
    assert all(verdict.met is None for verdict in verdicts(made_up(calls=[])))


def test_a_target_without_a_moonshot_has_none():
    assert at_most(0.5, moonshot=None).moonshot is None


def test_ratios_are_of_sums_of_times():
    results = made_up(calls=[(REFERENCE, "W", 100.0), (REFERENCE, "F", 200.0), (OURS, "W+F", 10.0)])
    assert over((REFERENCE, "W", "F"), (OURS, "W+F"))(results, "box 40") == pytest.approx(30)
    assert over((REFERENCE, "W", "K"), (OURS, "W+F"))(results, "box 40") is None
    assert over((OURS, "W+F"), (OURS, "W+F"), threads=2)(results, "box 40") is None


def test_the_targets_compare_the_named_times():
    calls = [(OURS, "W+F", 12.0), (OURS, "K", 70.0), (CSR, "K v", 10.0), (CONTROL, "F", 10.0), (CONTROL, "K", 140.0)]
    found = {verdict.target.what: verdict for verdict in verdicts(made_up(calls=calls))}
    assert found["W + F, in CSR products"].met
    assert found["W + F, of the C loop's F"].worst == pytest.approx(1.2)
    assert not found["W + F, of the C loop's F"].met
    assert found["K into CSR, in CSR products"].met and not found["K into CSR, in CSR products"].moonshot
    assert found["K into CSR, of the C loop's K"].worst == pytest.approx(0.5)
    assert set(found["K into CSR, in CSR products"].values) == set(MESHES)


def test_two_threads_are_judged_on_the_largest_mesh_only():
    results = made_up(calls=[(OURS, "K", 90.0)])
    for mesh, ns in (("box 40", 90.0), ("box 250", 45.0)):
        results.timings.append(Timing(mesh, MESHES[mesh], OURS, "K", 2, "float64", ns, ns, 5))
    (verdict,) = [v for v in verdicts(results) if v.target.what == "K, 2 threads against 1"]
    assert verdict.values == {"box 250": 2.0} and verdict.met and verdict.moonshot


def test_only_measured_meshes_are_judged():
    assert judged(made_up(calls=[])) == ["box 40", "part 40", "box 250"]


def test_no_target_is_stated_twice():
    assert len({target.what for target in TARGETS}) == len(TARGETS)
    assert all(target.moonshot is None or target.meets(target.moonshot, target.limit) for target in TARGETS)


@pytest.mark.parametrize("exponent", [0.9, 1.0, 1.37])
def test_the_slope_of_a_power_is_its_exponent(exponent):
    sizes = np.array([5e3, 4e4, 2.5e5, 2e6])
    assert slope(sizes, 3.7 * sizes**exponent) == pytest.approx(exponent, abs=1e-12)


def test_one_size_has_no_slope():
    assert slope([10.0], [3.0]) is None and slope([10.0, 10.0], [3.0, 4.0]) is None


def test_growth_is_fitted_over_the_boxes():
    """A constant time per tetrahedron gives the exponent one; the part, with a different time, is left out."""
    results = made_up(calls=[(OURS, "K", 7.0)])
    results.timings = [
        t if t.mesh != "part 40" else Timing("part 40", 38, OURS, "K", 1, "float64", 900.0, 900.0, 5) for t in results.timings
    ]
    results.memory = [Memory(mesh, nt, "F", "float64", {"all": nt**2, "pattern of K": 0}) for mesh, nt in MESHES.items()]
    assert of_time(results, "K") == pytest.approx(1) and of_memory(results, "F") == pytest.approx(2)
    assert of_time(results, "W+F") is None


def test_sizes_have_short_names():
    assert [Specimen("box", n).name for n in (96, 5_000, 250_000, 2_000_000)] == ["box 96", "box 5 k", "box 250 k", "box 2 M"]
