"""The footprint lists elements, bytes and packages for each part of a scene, and unused parts cost nothing."""

import json
import subprocess
import sys

import pytest
from slow import slow

from skfem_stvk.cli.main import main
from skfem_stvk.scene import Scene
from skfem_stvk.scene.footprint import OF_RESULTS, OF_SOLVERS, footprint, table
from skfem_stvk.terminal import as_text

BODY = {
    "mesh": {"type": "box", "size": [4.0, 1.0, 1.0], "cells": [20, 3, 3]},
    "materials": {"rubber": {"model": "isotropic", "young": 1e6, "poisson": 0.4, "density": 1000.0}},
    "terms": [{"type": "stvk", "material": "rubber"}],
    "fixed": {"left": "xyz"},
    "analysis": {"type": "static"},
}
EXPLICIT = {"type": "dynamic", "integrator": "velocity-verlet", "until": 0.1}
#: Terms in addition to the law.
ADDED = {
    "gravity": {"g": [0.0, 0.0, -1.0]},
    "body-force": {"force": [0.0, 0.0, -1.0]},
    "traction": {"on": "right", "traction": [0.0, 0.0, -1.0]},
    "pressure": {"on": "right", "pressure": 100.0},
    "nodal-load": {"on": [4.0, 0.0, 0.0], "force": [0.0, 0.0, -1.0]},
    "elastic-foundation": {"on": "bottom", "stiffness": 1e4},
    "volume-penalty": {},
    "spring-network": {"material": "rubber"},
    "edge-network": {"material": "rubber"},
    "neo-hookean": {"material": "rubber"},
}
#: Terms whose matrix consists of blocks of pairs of nodes, which have a separate row.
BLOCKS = ("pressure", "elastic-foundation")


def costs(*terms, **changed):
    rows = footprint(Scene.of_data(BODY | {"terms": [*BODY["terms"], *terms]} | changed).built)
    return {row.name: row for row in rows}


@pytest.mark.parametrize("kind", ADDED)
def test_a_term_has_its_own_row_and_no_other_row_contains_its_bytes(kind):
    without, found = costs(), costs({"type": kind} | ADDED[kind])
    own = found[f"terms[1] {kind}"]
    assert set(found) - set(without) - {"blocks of pairs"} == {own.name} and own.nbytes > 0
    assert ("blocks of pairs" in found) == (kind in BLOCKS)
    for name in ("mesh", "terms[0] stvk", "analysis static", "results"):
        assert found[name] == without[name]


def test_a_term_on_a_part_of_the_elements_costs_that_part():
    """A term on a twentieth of a bar has a twentieth of the elements and less than 6 % of the bytes."""
    mesh = {"type": "box", "size": [40.0, 1.0, 1.0], "cells": [80, 5, 5]}
    places = {"end": {"type": "box", "low": [38.0, -1.0, -1.0], "high": [41.0, 2.0, 2.0]}}
    found = costs({"type": "neo-hookean", "material": "rubber", "region": "end"}, mesh=mesh, places=places)
    whole, part = found["terms[0] stvk"], found["terms[1] neo-hookean"]
    assert part.elements == whole.elements / 20 and part.nbytes < 0.06 * whole.nbytes


def test_explicit_motions_allocate_no_stiffness_and_no_pattern_and_statics_no_mass():
    static, explicit, modes = costs(), costs(analysis=EXPLICIT), costs(analysis={"type": "modes", "n": 2})
    made = {"pattern of K", "rows of K", "mass"}
    assert (made & set(static), made & set(explicit), made & set(modes)) == (made - {"mass"}, {"mass"}, made)
    assert explicit["terms[0] stvk"].nbytes < static["terms[0] stvk"].nbytes


def test_the_sum_of_all_bytes_equals_the_memory_of_the_system():
    for changed in ({}, {"analysis": EXPLICIT}, {"terms": [*BODY["terms"], {"type": "pressure"} | ADDED["pressure"]]}):
        built = Scene.of_data(BODY | changed).built
        assert sum(row.nbytes for row in footprint(built)) == sum(built.system.memory().values()) > 0


def test_the_table_and_the_command_contain_all_rows(tmp_path, capsys):
    rows = list(costs().values())
    text = as_text(table(rows))
    assert all(row.name in text for row in rows)
    scene = tmp_path / "bar.toml"
    Scene.of_data(BODY).write(scene)
    assert main(["info", str(scene), "--footprint", "--json"]) == 0
    assert [row["name"] for row in json.loads(capsys.readouterr().out)] == [row.name for row in rows]
    assert main(["info", str(scene), "--footprint"]) == 0 and "pattern of K" in capsys.readouterr().out
    assert main(["info", "bar.msh", "--footprint"]) == 2 and main(["info", "--footprint"]) == 2


@pytest.mark.parametrize("solver", ["superlu", slow("amg-cg")])
def test_packages_are_imported_only_when_they_are_needed(solver):
    """A new process imports the packages of the solver when it solves, and those of the results when it writes them."""
    pulled = BODY | {"prescribed": {"right": {"x": 0.1}}, "solver": {"name": solver}}
    program = f"""if True:
        import json, sys, tempfile
        from skfem_stvk.scene import Scene
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
