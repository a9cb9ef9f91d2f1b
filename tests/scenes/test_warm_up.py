"""`skfem-stvk warm-up` compiles all kernels of a first run."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from skfem_stvk.kernels.compiled import FirstUse
from skfem_stvk.scenes.commands import warm_up
from skfem_stvk.scenes.commands.main import main

ROOT = Path(__file__).parents[2]
FIRST_RUN = """
import numpy as np, skfem
from skfem_stvk import Gravity, LinearBackwardEuler, StVK, System, simulate, solve_static
from skfem_stvk.kernels.compiled import first_use
mesh = skfem.MeshTet().refined(1)
body = System(mesh, [StVK(young=1e5, poisson=0.3, density=1e3), Gravity((0, 0, -1))], fixed={lambda x: x[0] == 0: "xyz"})
(W, F), K = body.energy_and_force(np.zeros(body.ndofs)), body.tangent(np.zeros(body.ndofs))
counts = [first_use.count]
solve_static(body, quiet=True)
simulate(body, LinearBackwardEuler(dt=1e-3), until=1e-3, quiet=True)
print(*counts, first_use.count)
"""


def run(cache, *arguments):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True, cwd=cache, timeout=300)
    assert done.returncode == 0, done.stderr
    return done


@pytest.mark.slow
def test_after_warming_up_a_first_run_compiles_nothing(tmp_path):
    cold, warm = tmp_path / "cold", tmp_path / "warm"
    for folder in (cold, warm):
        folder.mkdir()
    before, _ = map(int, run(cold, "-c", FIRST_RUN).stdout.split())
    assert before == FirstUse.KERNELS
    done = run(warm, "-m", "skfem_stvk.scenes.commands", "warm-up")
    assert int(done.stdout.split()[0]) > before and done.stderr == ""
    assert run(warm, "-m", "skfem_stvk.scenes.commands", "warm-up").stdout.startswith("0 kernels compiled")
    assert run(warm, "-c", FIRST_RUN).stdout.split() == ["0", "0"]


def test_a_law_without_support_for_an_element_is_named_and_left_out(capsys, monkeypatch):
    monkeypatch.setattr(warm_up, "ROWS", ({"bodies": lambda body: None},))
    assert main(["warm-up", "--elements", "segments", "--laws", "stvk", "neo-hookean"]) == 0
    left_out, total = capsys.readouterr().out.splitlines()
    assert left_out.startswith("segments, neo-hookean: NeoHookean is for solids and surfaces") and "kernels compiled in" in total


def test_without_a_writable_cache_folder_nothing_is_compiled(monkeypatch, capsys):
    monkeypatch.setattr(warm_up.first_use, "on_disk", False)
    assert main(["warm-up"]) == 2
    assert "Set NUMBA_CACHE_DIR to a writable folder" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("option", ["--elements", "--laws"])
def test_unknown_names_are_refused_with_the_known_names(option, capsys):
    assert main(["warm-up", option, "tetrahedrons"]) == 2
    err = " ".join(capsys.readouterr().err.split())
    assert f"{option} 'tetrahedrons'" in err and ("tetrahedra" if option == "--elements" else "neo-hookean") in err


@pytest.mark.parametrize("element", warm_up.ELEMENTS)
def test_each_element_has_a_body_that_moves(element):
    body = warm_up.body_of(element, "stvk")
    assert 0 < len(body.supports.held) < body.ndofs and body.mesh.element.name == element
