"""Every example of the docs runs, draws its picture, and gives the documented number."""

import importlib.util
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

EXAMPLES = Path(__file__).parent.parent / "docs" / "examples"


def run(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    figure = module.picture()
    assert figure.get_axes()
    plt.close(figure)
    return module


def test_ex01_bracket():
    example = run("ex01_bracket")
    assert example.shift == pytest.approx(1.9714e-3, rel=1e-4)
    assert example.energy == pytest.approx(0.57463, rel=1e-4)


def test_ex02_referee():
    example = run("ex02_referee")
    assert example.right.passed and not example.wrong.passed
    assert example.caught_by == {"agreement", "closed forms"}
    assert 0.5 < example.error < 1.5


def test_ex03_speed():
    example = run("ex03_speed")
    assert example.error < 1e-12
    assert set(example.times) == {"W and F", "K", "K v, applied"}


def test_ex04_statics():
    example = run("ex04_statics")
    assert example.result.success
    assert example.push == pytest.approx(541934, rel=1e-5)


def test_ex05_snap_through():
    example = run("ex05_snap_through")
    assert example.result.success and [point.kind for point in example.result.critical_points] == ["limit point"] * 2
    assert example.limit == pytest.approx(340.754, rel=1e-5)


def test_ex06_flag():
    example = run("ex06_flag")
    assert all(run.success for run in example.runs.values())
    assert example.deepest == pytest.approx(-99.290e-3, rel=1e-5) and example.drift < 1e-11


def test_ex07_ring():
    example = run("ex07_ring")
    assert [path.status.name for path in example.perfect.values()] == ["UNSTABLE"] * 2
    assert example.ratio == pytest.approx(0.7809, rel=1e-3) and example.ratio == pytest.approx(3 / 4, rel=0.05)


def test_ex08_own_law():
    example = run("ex08_own_law")
    assert example.error < 1e-8 and min(map(abs, example.forces.values())) > 100
    up, down = example.sags.values()
    assert up == pytest.approx(52.80e-3, rel=1e-3) and down == pytest.approx(-31.63e-3, rel=1e-3)


def test_ex09_curved_bar():
    example = run("ex09_curved_bar")
    linear, _, _, quadratic = example.errors.values()
    assert len({result.system.ndofs for result in example.results.values()}) == 3  # first and last: same number of unknowns
    assert linear == pytest.approx(0.5858, rel=1e-3) and quadratic == pytest.approx(5.0e-4, rel=0.2)


def test_ex10_neo_hookean():
    example = run("ex10_neo_hookean")
    assert example.paths["NeoHookean"].success and example.force["NeoHookean"] == pytest.approx(1.1504, rel=1e-3)
    assert not example.paths["StVK"].success and example.reached["StVK"] == pytest.approx(0.3145, rel=5e-3)
    assert example.force["StVK"] == pytest.approx(0.1832, rel=5e-3)


def test_ex11_springs():
    example = run("ex11_springs")
    ratios = [sprung / elastic for elastic, sprung in example.sags.values()]
    assert ratios == pytest.approx([1.110, 0.9989, 0.878], abs=2e-3)


def test_ex12_linear_rotation():
    example = run("ex12_linear_rotation")
    assert example.areas["StVK"] == pytest.approx([1, 1, 1], abs=1e-6)
    assert example.areas["LinearElastic"] == pytest.approx([1, 1.4746, 1.8921], rel=1e-3)


def test_ex16_edges_and_pairs():
    example = run("ex16_edges_and_pairs")
    assert example.error < 1e-9 and sum(example.shares.values()) == pytest.approx(1, rel=1e-10)
    assert example.widths["edges alone"] == pytest.approx(0.98427, rel=1e-4) and example.expected == pytest.approx(
        0.89554, rel=1e-4
    )


def test_ex13_torn_sheet():
    example = run("ex13_torn_sheet")
    assert example.run.success and 90 < example.torn < 180
    assert example.strongest == pytest.approx(79.7, rel=0.02) and abs(example.force[-1]) < 0.3 * example.strongest
    assert example.closure < 0.02


def test_ex14_fibres():
    example = run("ex14_fibres")
    straight, right, left, none = example.turns.values()
    assert right[0] == pytest.approx(-38.404, rel=1e-4) == -left[0] and right[1] == pytest.approx(left[1], rel=1e-6)
    assert abs(straight[0]) < 1e-5 and abs(none[0]) < 1e-5
    assert straight[1] < right[1] < none[1] and none[1] == pytest.approx(0.1531, rel=1e-3)


def test_ex15_invertible():
    example = run("ex15_invertible")
    ends = {name: (np.abs(u).max(), turned) for name, (u, turned) in example.laws.items()}
    assert example.inside_out > 40 and ends["InvertibleStVK"][1] == ends["Corotated"][1] == 0 < ends["StVK"][1]
    assert max(ends["InvertibleStVK"][0], ends["Corotated"][0]) < 1e-3 and ends["StVK"][0] > 0.1
    linear, corotated = example.energies.values()
    assert linear[6] > 10 and max(corotated) < 1e-20


def test_ex19_wrinkles():
    example = run("ex19_wrinkles")
    wrinkled, plain = example.principal.values()
    assert example.results["with wrinkling"].success and wrinkled[1] == pytest.approx(example.YOUNG * example.E1, rel=0.005)
    assert abs(wrinkled[0]) < 1e-6 * wrinkled[1] and plain[0] < -0.5 * wrinkled[1]
    assert "unstable" in example.results["without"].status.value
    with_wrinkling, without = example.forces.values()
    assert with_wrinkling == pytest.approx(241.8, rel=1e-3) and with_wrinkling < 0.85 * without


def test_ex20_bag():
    example = run("ex20_bag")
    assert example.pulled == pytest.approx(example.weight, rel=1e-9)
    x = example.points + example.bag.u.reshape(-1, 3).T
    down = x[2, example.ropes[1]] - x[2, example.ropes[0]]
    length = np.linalg.norm(x[:, example.ropes[1]] - x[:, example.ropes[0]], axis=0)
    ropes = example.bag.system.body.beside[1].mass.sum() * example.G
    assert (example.tension(example.bag) * down / length).sum() == pytest.approx(example.weight - ropes / 2, rel=1e-7)
    assert 0.03 < example.dent(example.bag) < 0.8 * example.dent(example.bare)


def test_ex17_scene():
    example = run("ex17_scene")
    assert all(outcome.success for outcome in example.outcomes.values())
    assert example.lowest["newmark"] == pytest.approx(example.LOWEST, rel=1e-2)
    assert example.lowest["energy-momentum"] == pytest.approx(example.LOWEST, rel=1e-2)
    assert example.lowest["backward-euler"] > 0.98 * example.LOWEST


def test_ex21_haptics():
    example = run("ex21_haptics")
    assert example.error < 1e-4 and len(example.forces) == 1001 and not example.answers.holes
    assert example.largest == pytest.approx(3524.5, rel=1e-3) and abs(example.work) < 1e-5 * example.largest


def test_ex18_reduced():
    example = run("ex18_reduced")
    assert example.errors["modes and derivatives"] == pytest.approx(0.0124, rel=0.05) and example.errors["modes alone"] > 0.5
    assert example.apart < 0.08 and example.drift < 1e-11


def test_ex22_named():
    example = run("ex22_named")
    assert [example.FAULTS[name].named in example.named[name].names for name in example.PLANTED] == [True] * 10
    assert all(one.residual < 1e-10 < 0.03 < naming.before for naming in example.named.values() for one in naming.explanations)
    page = (EXAMPLES.parent / "naming-bugs.md").read_text(encoding="utf-8")
    assert "\n".join(f"    {line}" for line in example.told()) in page


def test_ex23_law():
    example = run("ex23_law")
    moduli = [f"moduli at rest ({quantity})" for quantity in "APW"]
    assert example.failed == {
        "right": [],
        "lambda doubled everywhere": moduli,
        "E/(1 + nu) taken for mu": moduli,
        "S = dW/dC, not 2 dW/dC": ["derivatives (A)", "derivatives (P)", "moduli at rest (P)"],
        "C = dS/dC, not 2 dS/dC": ["derivatives (A)", "moduli at rest (A)"],
        "2 lambda ln J in C": ["derivatives (A)"],
    }
    assert {name: report.named and report.named.names for name, report in example.reports.items()} == {
        "right": None,
        "lambda doubled everywhere": ["lambda x 2.000, mu x 1.000"],
        "E/(1 + nu) taken for mu": ["lambda x 1.000, mu x 2.000"],
        "S = dW/dC, not 2 dW/dC": ["stress x 0.500"],
        "C = dS/dC, not 2 dS/dC": ["elasticity x 0.500"],
        "2 lambda ln J in C": [],
    }
    assert not example.said(example.reports["right"]) and "small strain" in example.said(example.reports["2 lambda ln J in C"])[0]


def test_ex24_solver():
    example = run("ex24_solver")
    assert example.failed == {
        "right": [],
        "half_of_the_load": ["equilibrium", "order"],
        "linear_elasticity_of_scikit_fem": ["equilibrium", "order", "patch test", "rigid motion"],
    }
    assert list(example.named.values()) == [[], ["load x 0.500"], ["linear strain"]]


def test_ex25_test_vectors():
    example = run("ex25_test_vectors")
    assert [report.passed for report in example.reports.values()] == [True, False, False]
    errors = {name: max(of.values()) for name, of in example.errors.items()}
    assert errors["double precision"] < 2e-15 and 1e-8 < errors["single precision"] < 1e-5
    assert errors["one pair of edges forgotten"] > 1e-3


def test_ex26_own_law():
    example = run("ex26_own_law")
    assert example.failed == {
        "": [],
        "indices of K": ["derivatives (K)", "rigid modes (K)"],
        "log 2J": ["derivatives (F)", "derivatives (K)"],
    }
    assert max(example.worst_errors(example.reports[""]).values()) < 0.1


def test_ex27_ranks():
    example = run("ex27_ranks")
    assert example.result.success and example.tip == pytest.approx(-1.024255e-3, rel=1e-5)


def test_ex28_hand():
    example = run("ex28_hand")
    assert example.size == pytest.approx(7.305, rel=1e-3) and example.error == pytest.approx(0.067, abs=0.01)


def test_ex29_finger():
    example = run("ex29_finger")
    assert example.miss["looking ahead"] == pytest.approx(9.44e-3, rel=0.02)
    assert example.miss["proportional"] > 2 * example.miss["looking ahead"]


def test_ex30_bounce():
    example = run("ex30_bounce")
    assert example.missing < 1e-12
    assert 0.5 < example.energies["lost to friction"][-1] / example.energies["motion"][0] < 0.6
    assert example.energies["contact"].max() > 0.02 * example.energies["motion"][0]


def test_ex31_grip():
    example = run("ex31_grip")
    slipped = 0.02 - example.height
    assert 0 < slipped < 0.02 * 0.12 and example.grip > example.weight
    assert all(0 < example.run.contact(side).gap.min() < 5e-4 for side in ("left", "right"))


def test_ex32_hertz():
    example = run("ex32_hertz")
    assert example.ratios["LinearElastic"] == pytest.approx(1.0006, abs=2e-3)
    assert example.ratios["NeoHookean"] == pytest.approx(0.9766, rel=2e-3) and example.ratios["StVK"] == pytest.approx(
        0.927, rel=2e-3
    )


def test_every_example_has_a_test_and_a_picture():
    tested = {name.removeprefix("test_") for name in globals() if name.startswith("test_ex")}
    assert tested == {path.stem for path in EXAMPLES.glob("ex*.py")}
    assert all(path.with_suffix(".png").exists() for path in EXAMPLES.glob("ex*.py"))
