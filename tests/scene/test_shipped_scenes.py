"""The scenes that the documentation shows: each gives what it expects, and none is a warning's."""

import warnings
from pathlib import Path

import pytest

from skfem_stvk.errors import StvkWarning
from skfem_stvk.scene import Scene

FOLDER = Path(__file__).parents[2] / "docs" / "scenes"
SCENES = sorted(path.name for path in FOLDER.glob("*.toml"))
#: Settings by which a scene is quick, and still gives what it expects.
QUICK = {"thrown.toml": ["analysis.until=5e-4"]}


def test_there_are_nine():
    assert len(SCENES) == 9


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_gives_what_it_expects(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error", StvkWarning)
        scene = Scene.read(FOLDER / name, set=QUICK.get(name, []))
        outcome = scene.solve(quiet=True)
    assert scene.implausible() == []
    assert outcome.judged and [one for one in outcome.judged if not one.passed] == []
    assert outcome.exit_code == 0, outcome.message
