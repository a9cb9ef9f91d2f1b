"""Runs on ranks that are killed go on from their checkpoints: bit for bit on the same ranks, and otherwise to the same states."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from resumed_on_ranks import MOTIONS, SAVED, STEPS, motion, path, plate, system_on

from skfem_stvk import ElementMesh, StvkError, read_state
from skfem_stvk.results import animate
from skfem_stvk.results.series import listed_states

PROGRAM = Path(__file__).with_name("resumed_on_ranks.py")


@pytest.fixture(scope="module")
def folders(on_ranks, tmp_path_factory):
    """Folders of runs by name: "whole" on 3 ranks; "killed" on 3 ranks and "early" on one machine, which ended early; both resumed.

    In "killed", the path ended by a full disk, and a motion because a rank was killed.
    """
    of = {name: tmp_path_factory.mktemp(name) for name in ("whole", "killed", "early")}
    done = on_ranks(3, PROGRAM, "full", of["killed"], check=False)
    (of["killed"] / "full.json").write_text(json.dumps([done.returncode, done.stderr]))
    done = on_ranks(3, PROGRAM, "whole", of["whole"], "killed", of["killed"], check=False)
    assert done.returncode and "Exit code:    9" in done.stderr, done.stderr
    serial = system_on(ElementMesh.of(plate()))
    path(serial, of["early"])
    for file in [*sorted((of["early"] / "path").glob("state_*.npz"))[2:], *of["early"].glob("path_000[23].vtu")]:
        file.unlink()
    for name in MOTIONS:
        motion(serial, name, of["early"], SAVED)
    copied = {f"{name} on {n}": of[name] for name in ("killed", "early") for n in (1, 2, 3) if (name, n) != ("early", 1)}
    for name, source in copied.items():
        of[name] = shutil.copytree(source, tmp_path_factory.mktemp(name) / "copy")
    for n in (2, 3):
        on_ranks(n, PROGRAM, "resumed", of[f"killed on {n}"], "resumed", of[f"early on {n}"])
    folder = of["killed on 1"]
    np.savez(folder / "path.npz", u=path(serial, folder, resume=True).u)
    for name in MOTIONS:
        run = motion(serial, name, folder, resume=True)
        np.savez(folder / f"{name}.npz", u=run.u, ledger=run.ledger.rows())
    return of


@pytest.mark.slow
@pytest.mark.parametrize("name", ["path", *MOTIONS])
def test_a_killed_run_is_resumed_bit_for_bit_on_the_same_ranks(folders, name):
    whole, again = (np.load(folders[one] / f"{name}.npz") for one in ("whole", "killed on 3"))
    assert whole.files == again.files
    for key in whole.files:
        assert np.array_equal(whole[key], again[key], equal_nan=True), key


@pytest.mark.slow
@pytest.mark.parametrize("name", ["path", *MOTIONS])
@pytest.mark.parametrize("how", ["killed on 1", "killed on 2", "early on 2", "early on 3"])
def test_a_run_is_resumed_on_other_ranks_within_the_tolerance_of_its_solves(folders, how, name):
    whole, again = (np.load(folders[one] / f"{name}.npz") for one in ("whole", how))
    computed = (how[:5], name) == ("early", "found")  # its computed steps are those of one machine
    assert 0 < np.abs(whole["u"] - again["u"]).max() <= (1e-4 if computed else 1e-10) * np.abs(whole["u"]).max()
    if name != "path" and not computed:
        size = np.abs(whole["ledger"]).max(axis=0)
        energies = size[1:8].max()  # differences and errors of energies cancel
        assert (np.abs(whole["ledger"] - again["ledger"]) <= 1e-8 * np.maximum(size, energies)).all()


@pytest.mark.slow
def test_the_series_of_a_resumed_run_has_all_states(folders):
    for how in ("whole", "killed on 1", "killed on 2", "killed on 3", "early on 2"):
        for name in ("path", *MOTIONS):
            listed, whole = (listed_states(folders[one] / f"{name}.pvd") for one in (how, "whole"))
            assert [t for t, _ in listed] == pytest.approx([t for t, _ in whole], rel=1e-12) or (how[:5], name) == (
                "early",
                "found",
            )
            assert len(whole) == {"path": 4, "found": 3}.get(name, STEPS // 4 + 1)
            files = {one.name for one in folders[how].glob(f"{name}_*vtu")}
            pieces = {f"{file.stem}_r{rank:04d}.vtu" for _, file in listed for rank in range(3) if file.suffix == ".pvtu"}
            assert {file.name for _, file in listed} <= files <= pieces | {file.name for _, file in listed}


@pytest.mark.slow
def test_states_of_files_on_ranks_are_read_on_one_machine(folders):
    mesh = ElementMesh.of(plate())
    for name in ("path", *MOTIONS):
        expected = np.load(folders["whole"] / f"{name}.npz")["u"]
        for file in (f"{name}.pvd", name)[: 1 if name == "found" else 2]:  # it ends with a shorter step
            assert np.array_equal(read_state(folders["whole"] / file, mesh)[0], expected)
    with pytest.raises(StvkError, match="belongs to another mesh"):
        read_state(folders["whole"] / "path", ElementMesh(mesh.p * 1.1, mesh.t))
    assert animate(folders["killed on 2"] / "path.pvd", folders["whole"] / "path.gif", "von_mises_stress").stat().st_size > 1000


@pytest.mark.slow
def test_the_ledger_is_written_once(folders):
    for name in MOTIONS:
        table = np.genfromtxt(folders["whole"] / f"{name}.csv", delimiter=",", names=True)
        assert len(table) == len(np.load(folders["whole"] / f"{name}.npz")["ledger"])


@pytest.mark.slow
def test_a_checkpoint_of_one_machine_has_its_former_form(folders):
    with np.load(folders["early"] / "euler" / "motion.npz") as file:
        header = json.loads(str(file["header"]))
        assert "parts" not in header and {f"array state {name}" for name in ("u", "v", "a", "reaction")} | {"array rows"} <= set(
            file.files
        )
    assert not [*folders["killed on 1"].glob("*/rank*_motion_*")]


@pytest.mark.slow
def test_one_rank_writes_the_checkpoint_of_one_machine(folders, tmp_path):
    """Its nodes have the order of the mesh."""
    distribute = pytest.importorskip("skfem_stvk.ranks").distribute
    own = system_on(distribute(plate()))
    assert np.array_equal(own.mesh.node_numbers, np.arange(own.mesh.nv))
    motion(own, "verlet", tmp_path, SAVED)
    again, whole = motion(system_on(ElementMesh.of(plate())), "verlet", tmp_path, resume=True), folders["whole"]
    u = np.load(whole / "verlet.npz")["u"]
    assert np.abs(again.u - u).max() <= 1e-12 * np.abs(u).max()
    there = read_state(tmp_path / "verlet.pvd", own.mesh)[0]
    assert np.array_equal(there, again.u[own.space.numbers])
    back = motion(own, "verlet", tmp_path, resume=True)
    assert np.array_equal(back.u, there)


@pytest.mark.slow
def test_a_header_is_written_after_the_parts_and_names_them(folders):
    killed = folders["killed"]
    for name in MOTIONS:
        with np.load(killed / name / "motion.npz") as file:
            header = json.loads(str(file["header"]))
        assert header["record"]["steps"] == SAVED or name == "found"
        there = {one.name for one in (killed / name).glob("rank*.npz")}
        assert set(header["parts"]) <= there and (name == "verlet" or set(header["parts"]) == there)
    assert len([*(killed / "path").glob("state_*.npz")]) == 2  # of the third, one rank has not written its part
    parts = {one.name.rpartition("_")[0] for one in (killed / "path").glob("rank*_state_00002_*.npz")}
    assert parts <= {f"rank{rank:04d}_state_00002" for rank in (0, 2)}


@pytest.mark.slow
def test_a_part_that_is_missing_or_changed_is_named(folders, tmp_path):
    serial = system_on(ElementMesh.of(plate()))
    for fault in (lambda file: file.unlink(), lambda file: file.write_bytes(file.read_bytes()[:-200])):
        folder = shutil.copytree(folders["killed"], tmp_path / str(fault))
        part = next((folder / "euler").glob("rank0001*"))
        fault(part)
        with pytest.raises(StvkError, match=part.name):
            motion(serial, "euler", folder, resume=True)


@pytest.mark.slow
def test_a_full_disk_of_one_rank_ends_the_job_with_one_message(folders):
    code, stderr = json.loads((folders["killed"] / "full.json").read_text())
    said = set(re.findall(r"\S+ could not be written: [^.]*\.", stderr))
    assert code and len(said) == 1
    assert re.search(r"rank0001_state_00002_\w+\.npz could not be written: No space left", said.pop())
