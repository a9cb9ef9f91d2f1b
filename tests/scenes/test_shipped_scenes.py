"""Each scene of the documentation meets its expectations without a warning."""

import re
import runpy
import warnings
from pathlib import Path

import numpy as np
import pytest
import skfem

from skfem_stvk import EnergyMomentum, Friction, Gravity, RigidContact, RigidPlane, StVK, System, simulate, solve_static
from skfem_stvk.errors import StvkWarning
from skfem_stvk.mesh import box
from skfem_stvk.scenes.info import inspect_scene
from skfem_stvk.scenes.scene import Scene

FOLDER = Path(__file__).parents[2] / "docs" / "scenes"
SCENES = sorted(path.name for path in FOLDER.glob("*.toml"))
#: Settings for a quick run of a scene that still meets its expectations.
QUICK = {"thrown.toml": ["analysis.until=5e-4"]}


def test_there_are_twelve_scenes():
    assert len(SCENES) == 12


@pytest.mark.few(6)
@pytest.mark.parametrize("name", SCENES)
def test_a_scene_meets_its_expectations(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error", StvkWarning)
        scene = Scene.read(FOLDER / name, set=QUICK.get(name, []))
        outcome = scene.solve(quiet=True)
    assert scene.implausible() == []
    assert outcome.judged and [one for one in outcome.judged if not one.passed] == []
    assert outcome.exit_code == 0, outcome.message


def test_the_scenes_of_the_tutorial_have_the_results_that_it_names(tmp_path):
    """The beam under its weight, a hundred times stiffer, with linear elements, and in motion."""
    beam, motion = re.findall(r"^```toml\n(.*?)^```", (FOLDER.parent / "tutorials" / "scenes.md").read_text(), re.M | re.S)
    (tmp_path / "beam.toml").write_text(beam)
    (tmp_path / "swing.toml").write_text(beam[: beam.index("[analysis]")] + motion)
    tips = []
    for settings in ([], ["materials.rubber.young=1e8"], ["materials.rubber.young=1e8", "mesh.degree=1"]):
        outcome = Scene.read(tmp_path / "beam.toml", set=settings).solve(quiet=True)
        assert outcome.exit_code == 0 and outcome.judged
        tips.append(1e3 * outcome.values["tip.z"])
    assert np.allclose(tips, [-134.8, -1.478, -0.624], rtol=1e-3)
    swing = Scene.read(tmp_path / "swing.toml", set=["mesh.degree=1", "analysis.until=0.05"]).solve(quiet=True)
    assert swing.exit_code == 0 and swing.judged


def test_the_bag_equals_its_example_bit_for_bit():
    example = runpy.run_path(str(FOLDER.parent / "examples" / "ex12_bag.py"))
    assert Scene.read(FOLDER / "bag.toml").solve(quiet=True).result.u.tobytes() == example["bag"].u.tobytes()


def test_the_disc_equals_the_membrane_in_python_bit_for_bit():
    disc = skfem.MeshTri.init_circle(3)
    rim = np.flatnonzero(np.hypot(*disc.p) > 1 - 1e-9)
    flat = np.concatenate([disc.p, np.zeros((1, disc.p.shape[1]))])
    sheet = [StVK(young=1e9, poisson=0.3, thickness=1e-3, density=1000.0), Gravity(g=(0, 0, -9.81))]
    sagged = solve_static(System((flat, disc.t), sheet, fixed={tuple(rim): "xyz"}), quiet=True)
    assert Scene.read(FOLDER / "disc.toml").solve(quiet=True).result.u.tobytes() == sagged.u.tobytes()


def test_the_dropped_block_equals_the_block_in_python_bit_for_bit():
    outcome = Scene.read(FOLDER / "dropped.toml").solve(quiet=True)
    mesh = box((0.1, 0.1, 0.1), (4, 4, 4))
    floor = RigidContact(RigidPlane((0, 0, -0.005), (0, 0, 1)), "front", friction=Friction(0.3, slip_speed=0.01), name="floor")
    body = System(mesh, [StVK(young=1e5, poisson=0.4, density=1000.0), Gravity((0, 0, -9.81)), floor])
    run = simulate(body, EnergyMomentum(2.5e-4), until=0.015, v0=np.tile([0.5, 0.0, -1.0], mesh.nv), quiet=True)
    assert outcome.result.u.tobytes() == run.u.tobytes()
    assert [outcome.values[f"floor.{axis}"] for axis in "xyz"] == run.contact("floor").resultant.tolist()
    assert "force of contact floor" in [row.name for row in outcome.summary] and outcome.values["energy.dissipated"] > 0.01


@pytest.mark.parametrize("name", ["bag.toml", "disc.toml", "block.toml"])
def test_scenes_with_elements_of_several_kinds_have_no_remarks(name):
    assert inspect_scene(Scene.read(FOLDER / name)).remarks == []
