"""Programs of the gallery and of other pages run, draw their pictures, and give the documented numbers."""

import importlib.util
import io
import json
import re
import runpy
from pathlib import Path
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
import skfem

from skfem_stvk import Corotated, InvertibleStVK, LinearElastic, StVK, System

DOCS = Path(__file__).parent.parent / "docs"
GALLERY, PROGRAMS = DOCS / "examples", DOCS / "programs"


@pytest.fixture
def run(monkeypatch, capsys):
    """Run a program of the gallery as the gallery does, in its folder without a `__file__` of its own; draw its figures."""

    def program(name):
        plt.close("all")
        monkeypatch.chdir(GALLERY)
        monkeypatch.setattr(plt, "show", lambda: None)
        with plt.rc_context(), plt.ioff():
            found = runpy.run_path(f"{name}.py", run_name="__main__")
            assert plt.get_fignums()
            for number in plt.get_fignums():
                figure = plt.figure(number)
                assert 1 <= len(figure.get_axes()) <= 4  # three panels and a colour bar
                figure.canvas.draw()  # of a film the first moment
                figure.savefig(io.BytesIO())
        plt.close("all")
        assert 1 <= len(capsys.readouterr().out.splitlines()) <= 2
        return SimpleNamespace(**found)

    return program


def drawn(path):
    """Return the module of a program with a function `picture`, after drawing it."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    figure = module.picture()
    assert figure.get_axes()
    figure.savefig(io.BytesIO())
    plt.close(figure)
    return module


def test_ex01_loaded_bracket(run):
    example = run("ex01_loaded_bracket")
    assert example.result.success
    assert example.push == pytest.approx(541934, rel=1e-5)


def test_ex02_newton(run):
    example = run("ex02_newton")
    assert example.sag == pytest.approx(0.4102, rel=1e-3)
    assert all(len(one) <= 7 for one in example.residuals)
    *_, before, last = example.residuals[-1]
    assert last < 1e-3 * before


def test_ex03_rotation(run):
    example = run("ex03_rotation")
    assert example.areas["StVK"] == pytest.approx([1, 1, 1], abs=1e-6)
    assert example.areas["LinearElastic"] == pytest.approx([1, 1.4746, 1.8921], rel=1e-3)


def test_ex04_springs(run):
    example = run("ex04_springs")
    ratios = [sprung / elastic for elastic, sprung in example.sags.values()]
    assert ratios == pytest.approx([1.110, 0.9989, 0.878], abs=2e-3)


def test_ex05_edge_pairs(run):
    example = run("ex05_edge_pairs")
    assert example.error < 1e-9
    assert example.widths["edges alone"] == pytest.approx(0.98427, rel=1e-4)
    assert example.expected == pytest.approx(0.89554, rel=1e-4)
    whole, u = example.whole, example.found["edges and pairs"].ravel()
    edges, without_opposite, without_adjacent, all_ = (
        System(example.mesh, network).energy(u)
        for network in (whole.diagonal(), whole.without("opposite"), whole.without("adjacent"), whole)
    )
    assert edges + (without_opposite - edges) + (without_adjacent - edges) == pytest.approx(all_, rel=1e-10)


def test_ex06_curved_bar(run):
    example = run("ex06_curved_bar")
    assert example.bars[24, 2, 1][1].size == example.bars[12, 1, 2][1].size  # the same number of unknowns
    assert len({u.size for _, u in example.bars.values()}) == 3
    assert example.errors[24, 2, 1] == pytest.approx(0.5858, rel=1e-3)
    assert example.errors[12, 1, 2] == pytest.approx(5.6e-4, rel=0.2)


def test_ex07_crushed_foam(run):
    example = run("ex07_crushed_foam")
    assert example.paths["NeoHookean"].success and example.force["NeoHookean"] == pytest.approx(1.1504, rel=1e-3)
    assert not example.paths["StVK"].success and example.reached["StVK"] == pytest.approx(0.3145, rel=5e-3)
    assert example.force["StVK"] == pytest.approx(0.1832, rel=5e-3)


def test_ex08_mirrored(run):
    example = run("ex08_mirrored")
    assert example.energies["Newton"] == pytest.approx(1108.58, rel=1e-5) and example.inverted["Newton"] == 216
    assert example.energies["solve_static"] == pytest.approx(1726.764, rel=1e-6) and example.inverted["solve_static"] == 0
    free = np.delete(example.body.internal_force(example.states["Newton"]), example.plates)
    assert np.abs(free).max() < 1e-8 * np.abs(example.body.internal_force(example.states["Newton"])).max()


def test_ex09_snap_through(run):
    example = run("ex09_snap_through")
    assert example.result.success and [point.kind for point in example.result.critical_points] == ["limit point"] * 2
    assert example.limit == pytest.approx(340.754, rel=1e-5)


def test_ex10_ring(run):
    example = run("ex10_ring")
    assert [path.status.name for path in example.perfect.values()] == ["UNSTABLE"] * 2
    assert example.ratio == pytest.approx(0.7809, rel=1e-3) and example.ratio == pytest.approx(3 / 4, rel=0.05)


def test_ex11_muscle(run):
    example = run("ex11_muscle")
    straight, right, left, none = example.turns.values()
    assert right[0] == pytest.approx(-38.404, rel=1e-4) == -left[0] and right[1] == pytest.approx(left[1], rel=1e-6)
    assert abs(straight[0]) < 1e-5 and abs(none[0]) < 1e-5
    assert straight[1] < right[1] < none[1] and none[1] == pytest.approx(0.1531, rel=1e-3)


def test_ex12_bag(run):
    example = run("ex12_bag")
    assert example.pulled == pytest.approx(example.weight, rel=1e-9)
    x = example.points + example.bag.u.reshape(-1, 3).T
    rest = np.linalg.norm(example.points[:, example.ropes[1]] - example.points[:, example.ropes[0]], axis=0)
    down = x[2, example.ropes[1]] - x[2, example.ropes[0]]
    length = np.linalg.norm(x[:, example.ropes[1]] - x[:, example.ropes[0]], axis=0)
    ropes = example.bag.system.body.beside[1].mass.sum() * example.G
    s = length / rest
    tension = 1e9 * 2e-5 * (s**3 - s) / 2
    assert (tension * down / length).sum() == pytest.approx(example.weight - ropes / 2, rel=1e-7)
    assert 0.03 < example.dent(example.bag) < 0.8 * example.dent(example.bare)


def test_ex13_flag(run):
    example = run("ex13_flag")
    tip = np.flatnonzero(np.isclose(example.x, 0.6) & np.isclose(example.y, 0.2))[0]
    deepest = min(u[2 * tip + 1] for _, u in example.states)
    assert deepest == pytest.approx(-99.290e-3, rel=1e-5) and example.drift < 1e-11
    assert all(outcome.success for outcome in example.outcomes.values())
    assert example.lowest["newmark"] == pytest.approx(example.LOWEST, rel=1e-2)
    assert example.lowest["energy-momentum"] == pytest.approx(example.LOWEST, rel=1e-2)
    assert example.lowest["backward-euler"] > 0.98 * example.LOWEST


def test_ex14_integrators(run):
    example = run("ex14_integrators")
    drift = {name: np.abs(energy - 1).max() for name, energy in example.energy.items()}
    spin = {name: np.abs(momentum).max() for name, momentum in example.momentum.items()}
    assert drift["EnergyMomentum"] < 1e-11 and spin["EnergyMomentum"] < 1e-11
    assert drift["BackwardEuler"] == pytest.approx(0.189, abs=0.01) and drift["LinearBackwardEuler"] > 0.15
    assert all(drift[name] < 0.01 for name in ("ForwardEuler", "VelocityVerlet", "Newmark", "GeneralizedAlpha"))
    assert max(spin["ForwardEuler"], spin["VelocityVerlet"]) < 1e-11 < spin["Newmark"] < 0.01 < spin["BackwardEuler"]
    size = np.abs(example.exact).max()
    for name, errors in example.error.items():
        assert errors[0] > errors[1] > errors[2]
        assert (errors[2] > 0.01 * size) == (name in ("BackwardEuler", "LinearBackwardEuler"))


def test_ex15_recovery(run):
    example = run("ex15_recovery")
    assert example.inverted > 40
    for law, recovers in ((InvertibleStVK, True), (Corotated, True), (StVK, False)):
        _, u, turned = example.states(law)[-1]
        assert (np.abs(u).max() < 1e-3) == (len(turned) == 0) == recovers and (recovers or np.abs(u).max() > 0.1)


def test_a_rotation_costs_energy_with_linear_elasticity_and_none_with_corotated():
    bar = skfem.MeshTet.init_tensor(np.linspace(0, 4, 9), np.linspace(0, 1, 3), np.linspace(0, 1, 3))
    energies = {}
    for law in (LinearElastic, Corotated):
        body = System(bar, law(young=1e3, poisson=0.3))
        for degrees in range(0, 91, 5):
            c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
            rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
            energies[law, degrees] = body.energy((rotation @ bar.p - bar.p).ravel("F"))
    assert energies[LinearElastic, 30] > 10 and max(energies[Corotated, degrees] for degrees in range(0, 91, 5)) < 1e-20


def test_ex16_torn_sheet(run):
    example = run("ex16_torn_sheet")
    assert example.run.success and 90 < example.torn < 180
    assert example.force.max() == pytest.approx(79.7, rel=0.02) and abs(example.force[-1]) < 0.3 * example.force.max()
    assert example.closure < 0.02


def test_ex17_grip(run):
    example = run("ex17_grip")
    slipped = 0.02 - example.height
    assert 0 < slipped < 0.02 * 0.12 and example.grip > example.weight
    assert all(0 < example.run.contact(side).gap.min() < 5e-4 for side in ("left", "right"))


def test_ex18_reduced(run):
    example = run("ex18_reduced")
    assert example.errors["modes and derivatives"] == pytest.approx(0.0124, rel=0.05) and example.errors["modes alone"] > 0.5
    assert example.apart < 0.08 and example.drift < 1e-11


def test_ex19_hand(run):
    example = run("ex19_hand")
    assert example.size == pytest.approx(7.305, rel=1e-3) and example.error == pytest.approx(0.067, abs=0.01)


def test_ex20_factor_of_two(run):
    example = run("ex20_factor_of_two")
    assert example.right.passed and not example.wrong.passed
    assert example.caught_by == {"agreement", "closed forms"}
    assert 0.5 < example.error < 1.5 and example.wrong.named.names == ["lambda doubled"]


def test_ex21_bounce(run):
    example = run("ex21_bounce")
    assert example.missing < 1e-12
    assert 0.5 < example.energies["lost to friction"][-1] / example.energies["motion"][0] < 0.6
    assert example.energies["contact"].max() > 0.02 * example.energies["motion"][0]


def test_ex22_hertz(run):
    ratios = run("ex22_hertz").ratios
    assert ratios["LinearElastic"] == pytest.approx(1.0006, abs=2e-3)
    assert ratios["NeoHookean"] == pytest.approx(0.9766, rel=2e-3)
    assert ratios["StVK"] == pytest.approx(0.927, rel=2e-3)


def test_bracket():
    example = drawn(PROGRAMS / "bracket.py")
    assert example.shift == pytest.approx(1.9714e-3, rel=1e-4)
    assert example.energy == pytest.approx(0.57463, rel=1e-4)


def test_speed():
    example = drawn(PROGRAMS / "speed.py")
    assert example.error < 1e-12
    assert set(example.times) == {"W and F", "K", "K v, applied"}


def test_own_law():
    example = drawn(PROGRAMS / "own_law.py")
    assert example.error < 1e-8 and min(map(abs, example.forces.values())) > 100
    up, down = example.sags.values()
    assert up == pytest.approx(52.80e-3, rel=1e-3) and down == pytest.approx(-31.63e-3, rel=1e-3)


def test_ten_faults():
    example = drawn(PROGRAMS / "ten_faults.py")
    assert [example.FAULTS[name].named in example.named[name].names for name in example.PLANTED] == [True] * 10
    assert all(one.residual < 1e-10 < 0.03 < naming.before for naming in example.named.values() for one in naming.explanations)
    page = (DOCS / "measurements" / "named-faults.md").read_text(encoding="utf-8")
    assert "\n".join(f"    {line}" for line in example.told()) in page


def test_textbook_law():
    example = drawn(PROGRAMS / "textbook_law.py")
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


def test_solvers():
    example = drawn(PROGRAMS / "solvers.py")
    assert example.failed == {
        "right": [],
        "half_of_the_load": ["equilibrium", "order"],
        "linear_elasticity_of_scikit_fem": ["equilibrium", "order", "patch test", "rigid motion"],
    }
    assert list(example.named.values()) == [[], ["load x 0.500"], ["linear strain"]]


def test_test_vectors():
    example = drawn(PROGRAMS / "test_vectors.py")
    assert [report.passed for report in example.reports.values()] == [True, False, False]
    errors = {name: max(of.values()) for name, of in example.errors.items()}
    assert errors["double precision"] < 2e-15 and 1e-8 < errors["single precision"] < 1e-5
    assert errors["one pair of edges forgotten"] > 1e-3


def test_own_body():
    example = drawn(PROGRAMS / "own_body.py")
    assert example.failed == {
        "": [],
        "indices of K": ["derivatives (K)", "rigid modes (K)"],
        "log 2J": ["derivatives (F)", "derivatives (K)"],
    }
    assert max(example.worst_errors(example.reports[""]).values()) < 0.1


def test_ranks():
    example = drawn(PROGRAMS / "ranks.py")
    assert example.result.success and example.tip == pytest.approx(-1.024255e-3, rel=1e-5)


def test_finger():
    example = drawn(PROGRAMS / "finger.py")
    assert example.miss["looking ahead"] == pytest.approx(9.44e-3, rel=0.02)
    assert example.miss["proportional"] > 2 * example.miss["looking ahead"]


def test_round_off():
    assert drawn(PROGRAMS / "round_off.py").report.passed


def test_every_program_has_a_test():
    tested = {name.removeprefix("test_") for name in globals() if name.startswith("test_")}
    programs = {path.stem for folder in (GALLERY, PROGRAMS) for path in folder.glob("*.py")}
    assert len(programs) >= 32 and programs <= tested


def test_programs_of_the_gallery_are_short():
    """The gallery shows lines of 88 characters; a program has 20 to 60 lines that are not empty."""
    for path in GALLERY.glob("ex*.py"):
        text = path.read_text(encoding="utf-8")
        title, underline = text.splitlines()[1:3]
        assert underline == "=" * len(title) and len(title.split()) <= 8, path
        assert max(map(len, text.splitlines())) <= 88, path
        assert 20 <= sum(1 for line in text.splitlines() if line.strip()) <= 60, path
        assert "# %%" not in text and "def main" not in text and "__file__" not in text, path


def test_pictures_in_git_are_shown_by_a_page():
    """Pictures that only the gallery shows are drawn when it is built."""
    pages = [DOCS.parent / "README.md", *DOCS.rglob("*.md")]
    shown = {name for page in pages for name in re.findall(r"(?:examples|programs)/(\w+)\.png", page.read_text(encoding="utf-8"))}
    assert {path.stem for folder in (GALLERY, PROGRAMS) for path in folder.glob("*.png")} <= shown


def test_a_notebook_of_the_gallery_runs_as_it_is(tmp_path, monkeypatch):
    """No cell of the notebook installs a package, because this one is on no index."""
    notebook = pytest.importorskip("sphinx_gallery.notebook", exc_type=ImportError)
    from sphinx_gallery.gen_gallery import DEFAULT_GALLERY_CONF
    from sphinx_gallery.py_source_parser import split_code_and_text_blocks

    _, blocks = split_code_and_text_blocks(str(GALLERY / "ex03_rotation.py"))
    written = notebook.jupyter_notebook(blocks, DEFAULT_GALLERY_CONF, str(tmp_path))
    notebook.save_notebook(written, tmp_path / "ex03_rotation.ipynb")
    cells = json.loads((tmp_path / "ex03_rotation.ipynb").read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert len(code) == 1 and not re.search(r"^[!%]|pip install", code[0], re.M)
    monkeypatch.setattr(plt, "show", lambda: None)
    names = {"__name__": "__main__"}
    with plt.rc_context():
        exec(compile(code[0], "notebook", "exec"), names)
    assert plt.get_fignums() and names["areas"]["LinearElastic"][2] == pytest.approx(1.8921, rel=1e-3)
    plt.close("all")
