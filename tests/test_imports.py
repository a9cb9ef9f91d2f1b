"""A program imports only the packages and the parts of this package that it uses; each case runs in a fresh process."""

import subprocess
import sys
from pathlib import Path

import pytest
from slow import slow_but

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
    "a checkpoint": (IMPLICIT + "simulate(system, stepper, until=2e-3, checkpoint='here', quiet=True)", "pydantic filelock"),
    "a path on disk": (STATIC.replace("quiet", "checkpoint='here', quiet"), "pydantic filelock"),
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


def imported(code, folder):
    """Return the modules that the code imports in a fresh process, except those of scikit-fem and numba."""
    before = "import sys, skfem, numba, scipy.sparse\nbefore = set(sys.modules)\n"
    after = "\nprint(*sorted(set(sys.modules) - before))"
    path = f"import sys; sys.path.insert(0, {str(ROOT)!r})\n"
    done = subprocess.run([sys.executable, "-c", path + before + code + after], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines()[-1].split())


#: Command on a scene; at its end the modules that it imported are printed.
SOLVE = """
from skfem_stvk.scenes.commands.main import main
from skfem_stvk.scenes import templates
with open("scene.toml", "w") as file:
    file.write(templates.example("static"))
main(["solve", "scene.toml", "--quiet"])
"""

QUICK = ("the package alone", "energy, force and tangent", "statics", "implicit motion", "a series", "a scene", "a picture")


@pytest.mark.parametrize("use", slow_but(QUICK, USES))
def test_a_use_imports_only_the_packages_that_it_needs(use, tmp_path):
    code, needed = USES[use]
    there = imported(code, tmp_path)
    assert [name for name in HEAVY if name in there] == [name for name in HEAVY if name in needed.split()]


@pytest.mark.parametrize(
    "code, parts",
    [("import skfem_stvk", "all"), (ENERGY, PARTS), (STATIC, ["solvers.dynamics", "solvers.reduced", "referee", "scenes"])],
)
def test_a_use_imports_only_the_parts_of_the_package_that_it_needs(code, parts, tmp_path):
    ours = {name for name in imported(code, tmp_path) if name.startswith("skfem_stvk.")}
    if parts == "all":
        assert ours == set()
    else:
        assert ours and not [name for name in ours for part in parts if f"{name}.".startswith(f"skfem_stvk.{part}.")]


def test_a_command_on_one_machine_imports_nothing_of_ranks(tmp_path):
    there = imported(SOLVE, tmp_path)
    assert "skfem_stvk.scenes.run_scene" in there
    assert not [name for name in there if name.startswith(("mpi4py", "pymetis", "skfem_stvk.ranks"))]


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
