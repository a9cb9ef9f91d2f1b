"""A program imports only the packages and the parts of this package that it uses; each case runs in a fresh process."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import skfem_stvk

ROOT = Path(__file__).parent.parent
#: Packages that take long to import, or that are optional.
HEAVY = [
    "pydantic",
    "meshio",
    "filelock",
    "jinja2",
    "matplotlib",
    "pyvista",
    "pyamg",
    "pypardiso",
    "gmsh",
    "h5py",
    "mpi4py",
    "pymetis",
    "hypothesis",
    "scipy.spatial",
    "scipy.optimize",
    "scipy.integrate",
    "scipy.interpolate",
    "scipy.stats",
    "mujoco",
    "felupe",
    "ngsolve",
]
#: Parts of this package that the energy does not need.
PARTS = ["solvers", "referee", "ranks", "scenes"]

BODY = """
import numpy, skfem
from skfem_stvk import StVK, System, Traction
mesh = skfem.MeshTri.init_tensor(numpy.linspace(0, 2, 5), numpy.linspace(0, 1, 3)).with_defaults()
terms = [StVK(young=1e5, poisson=0.3, density=1e3), Traction("right", (0.0, -50.0))]
system = System(mesh, terms, fixed={"left": "xy"})
u = numpy.zeros(system.ndofs)
"""
ENERGY = BODY + "system.energy(u), system.internal_force(u), system.tangent(u)\n"
STATIC = BODY + "from skfem_stvk import solve_static\nresult = solve_static(system, steps=1, solver='superlu', quiet=True)\n"
EXPLICIT = (
    BODY + "from skfem_stvk import VelocityVerlet, simulate\nrun = simulate(system, VelocityVerlet(), until=1e-3, quiet=True)\n"
)
IMPLICIT = BODY + "from skfem_stvk import EnergyMomentum, simulate\nstepper = EnergyMomentum(dt=1e-3, solver='superlu')\n"
#: Code by name of use, and the heavy packages that this code may import.
USES = {
    "the package alone": ("import skfem_stvk", ""),
    "energy, force and tangent": (ENERGY, ""),
    "springs": (BODY + "from skfem_stvk import SpringNetwork\nSystem(mesh, [SpringNetwork(young=1e5, poisson=0.3)]).energy(u)", ""),
    "statics": (STATIC, ""),
    "arc length": (STATIC.replace("quiet", "method='arc-length', quiet"), ""),
    "explicit motion": (EXPLICIT, ""),
    "implicit motion": (IMPLICIT + "simulate(system, stepper, until=2e-3, quiet=True)", ""),
    "modes": (BODY + "from skfem_stvk import modes\nmodes(system, 2, solver='superlu')", ""),
    "results as numbers": (STATIC + "result.state['cauchy_stress'], result.reaction('left')", ""),
    "a mesh file": ("from skfem_stvk import embedded_mesh\nembedded_mesh()", "meshio"),
    "a series": (STATIC + "result.save('series.pvd')", "meshio filelock"),
    "a table": (EXPLICIT + "run.ledger.save('ledger.csv')", ""),
    "a checkpoint": (IMPLICIT + "simulate(system, stepper, until=2e-3, checkpoint='here', quiet=True)", "filelock"),
    "a path on disk": (STATIC.replace("quiet", "checkpoint='here', quiet"), "filelock"),
    "a precomputed response": (
        BODY + "from skfem_stvk import PrecomputedResponse\n"
        "free = System(mesh, terms, fixed={'left': 'xy'})\n"
        "PrecomputedResponse(free, 'right', ([0.0, 0.1], [0.0]), checks=0, solver='superlu', quiet=True)",
        "",
    ),
    "a scene": (
        "from skfem_stvk import Scene\nbox = {'type': 'box', 'size': [2.0, 1.0], 'cells': [2, 1]}\n"
        "law, steel = {'type': 'stvk', 'material': 'steel'}, {'model': 'isotropic', 'young': 1.0, 'poisson': 0.3}\n"
        "Scene.of_data({'mesh': box, 'materials': {'steel': steel}, 'terms': [law], 'analysis': {'type': 'static'}}).system()",
        "pydantic",
    ),
    "a picture": (STATIC + "result.plot(path='body.png')", "matplotlib"),
}


#: Command on a scene.
SOLVE = """
from skfem_stvk.scenes.commands.main import main
from skfem_stvk.scenes import templates
with open("scene.toml", "w") as file:
    file.write(templates.example("static"))
main(["solve", "scene.toml", "--quiet"])
"""

#: Program that runs each code in a process forked from one that has imported scikit-fem and numba, and in a folder of its own.
EACH = """
import json, os, sys, skfem, numba, scipy.sparse
uses, before = json.loads(sys.argv[1]), set(sys.modules)
for number, code in enumerate(uses):
    if os.fork() == 0:
        os.mkdir(str(number))
        os.chdir(str(number))
        exec(code, {"__name__": "__main__"})
        with open("modules", "w") as file:
            print(*sorted(set(sys.modules) - before), file=file)
        os._exit(0)
    if os.wait()[1] != 0:
        sys.exit(code)
"""


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """Return the modules that each use imports in a fresh process, except those of scikit-fem and numba."""
    folder = tmp_path_factory.mktemp("uses")
    codes = {name: code for name, (code, _) in USES.items()} | {"a command": SOLVE}
    paths = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", EACH, json.dumps(list(codes.values()))]
    done = subprocess.run(command, cwd=folder, env=paths, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return {name: set((folder / str(number) / "modules").read_text().split()) for number, name in enumerate(codes)}


def test_a_use_imports_only_the_packages_that_it_needs(imported):
    needed = {name: [package for package in HEAVY if package in packages.split()] for name, (_, packages) in USES.items()}
    assert {name: [package for package in HEAVY if package in imported[name]] for name in USES} == needed


@pytest.mark.parametrize(
    "use, parts",
    [
        ("energy, force and tangent", PARTS),
        ("statics", ["solvers.dynamics", "solvers.reduced", "referee", "scenes"]),
    ],
)
def test_a_use_imports_only_the_parts_of_the_package_that_it_needs(use, parts, imported):
    ours = {name for name in imported[use] if name.startswith("skfem_stvk.")}
    assert ours and not [name for name in ours for part in parts if f"{name}.".startswith(f"skfem_stvk.{part}.")]


def test_the_package_alone_imports_none_of_its_parts(imported):
    assert not [name for name in imported["the package alone"] if name.startswith("skfem_stvk.")]


def test_a_command_on_one_machine_imports_nothing_of_ranks(imported):
    assert "skfem_stvk.scenes.run_scene" in imported["a command"]
    assert not [name for name in imported["a command"] if name.startswith(("mpi4py", "pymetis", "skfem_stvk.ranks"))]


def test_all_public_names_can_be_imported():
    """All public names can be imported singly and together, and so can parts of the package; other names are refused."""
    assert {name: getattr(skfem_stvk, name).__name__ for name in skfem_stvk.__all__} == {name: name for name in skfem_stvk.__all__}
    assert set(skfem_stvk.__all__) <= set(dir(skfem_stvk))
    everything: dict[str, object] = {}
    exec("from skfem_stvk import *", everything)
    assert set(skfem_stvk.__all__) == set(everything) - {"__builtins__"}
    assert skfem_stvk.solvers.dynamics.modes is skfem_stvk.modes
    with pytest.raises(AttributeError, match="no attribute 'StVX'"):
        skfem_stvk.StVX  # noqa: B018
    with pytest.raises(ImportError, match="cannot import name 'Nobody'"):
        from skfem_stvk import Nobody  # noqa: F401
