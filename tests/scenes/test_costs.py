"""Parts that a scene does not name cost nothing: no arrays, and no packages."""

import json
import subprocess
import sys

import pytest
from slow import slow

from skfem_stvk.scenes.scene import Scene

BODY = {
    "mesh": {"type": "box", "size": [4.0, 1.0, 1.0], "cells": [20, 3, 3]},
    "materials": {"rubber": {"model": "isotropic", "young": 1e6, "poisson": 0.4, "density": 1000.0}},
    "terms": [{"type": "stvk", "material": "rubber"}, {"type": "gravity", "g": [0.0, 0.0, -9.81]}],
    "fixed": {"left": "xyz"},
    "analysis": {"type": "static"},
}
EXPLICIT = {"type": "dynamic", "integrator": "velocity-verlet", "until": 1e-3}
#: Packages that a linear solver imports in addition to scipy.
OF_SOLVERS = {"amg-cg": ("pyamg",)}
#: Packages that the folder of results imports, for the picture of the body and for the page.
OF_RESULTS = ("matplotlib", "jinja2")


def memory(**changed):
    """Return the bytes of the parts of a scene's system after its analysis has used it."""
    scene = Scene.of_data(BODY | changed)
    scene.solve(quiet=True)
    return {name: count for name, count in scene.system().memory().items() if count}


def test_explicit_motions_allocate_no_stiffness_and_no_pattern_and_statics_no_mass():
    made = {"pattern of K", "rows of K", "mass"}
    static, explicit = memory(), memory(analysis=EXPLICIT)
    assert (made & set(static), made & set(explicit)) == (made - {"mass"}, {"mass"})


@pytest.mark.parametrize("solver", ["superlu", slow("amg-cg")])
def test_packages_are_imported_only_when_they_are_needed(solver):
    """A new process imports the packages of the solver when it solves, and those of the results when it writes them."""
    pulled = BODY | {"prescribed": {"right": {"x": 0.1}}, "solver": {"name": solver}}
    program = f"""if True:
        import json, sys, tempfile
        from skfem_stvk.scenes.scene import Scene
        scene, known = Scene.of_data(json.loads({json.dumps(json.dumps(pulled))})), []
        scene.built; known.append(sorted(sys.modules))
        scene.solve(quiet=True); known.append(sorted(sys.modules))
        with tempfile.TemporaryDirectory() as folder:
            scene.solve(folder + "/out", quiet=True); known.append(sorted(sys.modules))
        print(json.dumps(known))
    """
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    built, solved, written = map(set, json.loads(run.stdout))
    of_solvers = {package for packages in OF_SOLVERS.values() for package in packages}
    assert not (of_solvers | set(OF_RESULTS)) & built
    assert of_solvers & solved == set(OF_SOLVERS.get(solver, ())) and not set(OF_RESULTS) & solved
    assert set(OF_RESULTS) <= written and of_solvers & written == of_solvers & solved
