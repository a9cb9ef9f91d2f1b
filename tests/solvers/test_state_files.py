"""States are read back from the files of a run bitwise identical, and refused on another mesh."""

import copy

import numpy as np
import pytest
from bodies import MESHES, boxes, curved, state

from skfem_stvk import ElementMesh, EnergyMomentum, StVK, StvkError, StvkWarning, System, read_state, simulate, solve_static
from skfem_stvk.mesh import box
from skfem_stvk.results import Fields, Series, write_vtu
from skfem_stvk.solvers.dynamics.motion_checkpoint import MotionCheckpoint
from skfem_stvk.solvers.runs.archive import read_archive, write_archive

EVERY = {
    **MESHES,
    "quadratic tetrahedra": curved(MESHES["tetrahedra"]),
    "quadratic triangles": curved(MESHES["triangles"]),
    "hexahedra": boxes(3),
    "quadrilaterals": boxes(2),
}
MESH = box((2.0, 1.0), (4, 2))
LAW = StVK(young=2.0, poisson=0.3, density=1.0)


def moving(mesh, seed=0):
    fields = Fields(mesh, LAW)
    u, v = state(mesh, 0.03, seed=seed), np.random.default_rng(seed + 1).normal(size=mesh.p.size)
    return fields.at(u, v), u, v


@pytest.mark.few
@pytest.mark.parametrize("name", EVERY)
def test_displacements_and_velocities_are_read_back_bitwise(name, tmp_path):
    mesh = EVERY[name]
    now, u, v = moving(mesh)
    again = read_state(write_vtu(tmp_path / "body.vtu", now, []), mesh)
    assert np.array_equal(again[0], u) and np.array_equal(again[1], v)
    still = write_vtu(tmp_path / "still.vtu", Fields(mesh, LAW).at(u))
    assert np.array_equal(read_state(still, mesh)[0], u) and read_state(still, mesh)[1] is None


def test_a_series_gives_its_last_state_or_that_of_a_given_time(tmp_path):
    states = {t: moving(MESH, seed) for seed, t in enumerate((0.0, 0.1, 0.30000000000000004))}
    with Series(tmp_path / "run.pvd", []) as series:
        for t, (now, *_) in states.items():
            series.add(now, t)
    path = tmp_path / "run.pvd"
    for requested, t in ((None, 0.30000000000000004), (0.3, 0.30000000000000004), (0.1, 0.1), (0, 0.0)):
        assert np.array_equal(read_state(path, MESH, requested)[0], states[t][1])
        assert np.array_equal(read_state(str(path), MESH, time=requested)[1], states[t][2])
    with pytest.raises(StvkError, match=r"no state at time = 0\.2: of its 3 states from 0 to 0\.3 the nearest is at 0\.1"):
        read_state(path, MESH, 0.2)


def test_a_run_that_starts_from_files_equals_one_from_arrays(tmp_path):
    system = System(MESH, LAW, fixed={"left": "xy"})
    v0 = np.tile([0.0, 0.05], MESH.nv)
    v0[system.supports.held] = 0
    first = simulate(system, EnergyMomentum(dt=0.1), until=0.4, v0=v0, save=tmp_path / "run.pvd", every=2, fields=[], quiet=True)
    u0, v0 = read_state(tmp_path / "run.pvd", MESH)
    assert np.array_equal(u0, first.u) and np.array_equal(v0, first.v)
    one, other = (
        simulate(system, EnergyMomentum(dt=0.1), until=0.8, u0=u, v0=v, t0=0.4, quiet=True)
        for u, v in ((u0, v0), (first.u, first.v))
    )
    assert np.array_equal(one.u, other.u)


def test_an_equilibrium_is_read_back_as_saved(tmp_path):
    result = solve_static(System(MESH, LAW, fixed={"left": "xy"}, prescribed={"right": {"x": 0.1}}), quiet=True)
    result.save(tmp_path / "pulled.vtu")
    assert np.array_equal(read_state(tmp_path / "pulled.vtu", MESH)[0], result.u)


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (box((2.0, 1.0), (4, 3)), r"belongs to another mesh: it has 15 vertices, this one 20\. Pass the mesh"),
        (MESH.with_degree(2), r"belongs to another mesh: it has 15 nodes, this one 45"),
        (box((4.0, 1.0), (4, 2)), r"belongs to another mesh: 12 vertices \(3, 4, 5, 6, 7, \.\.\.\) of 15 have other coordinates"),
        (box((2.0, 1.0), (4, 2), "quadrilaterals"), r"belongs to another mesh: it has triangles, this one quadrilaterals"),
        (ElementMesh(MESH.p, MESH.t[[1, 0, 2]]), r"belongs to another mesh: 16 of its 16 elements are not in this mesh"),
    ],
)  # fmt: skip
def test_another_mesh_is_refused(mesh, message, tmp_path):
    path = write_vtu(tmp_path / "body.vtu", moving(MESH)[0], [])
    with pytest.raises(StvkError, match=message):
        read_state(path, mesh)


def test_removed_elements_are_reported(tmp_path):
    fields, (_, u, _) = Fields(MESH, LAW), moving(MESH)
    fields.leave_out([0, 5])
    path = write_vtu(tmp_path / "torn.vtu", fields.at(u))
    with pytest.warns(StvkWarning, match=r"the state of a body from which 2 of 16 elements were removed. The new body has all"):
        assert np.array_equal(read_state(path, MESH)[0], u)


def test_other_files_are_refused(tmp_path):
    now = moving(MESH)[0]
    (tmp_path / "cut.vtu").write_text("<VTKFile>")
    (tmp_path / "cut.pvd").write_text("<VTKFile")
    (tmp_path / "empty.pvd").write_text("<VTKFile></VTKFile>")
    (tmp_path / "notes.txt").write_text("u = 0")
    good = write_vtu(tmp_path / "good.vtu", now, [])
    text = good.read_bytes()
    (tmp_path / "other.vtu").write_bytes(text.replace(b"displacement", b"deplacement_"))
    for name, time, message in (
        ("missing.vtu", None, r"path = .*missing\.vtu: there is no such file; expected the \.vtu or \.pvd file of a run"),
        ("cut.vtu", None, r"cut\.vtu cannot be read"),
        ("cut.pvd", None, r"cut\.pvd is not a series of results"),
        ("empty.pvd", None, r"empty\.pvd lists no states"),
        ("notes.txt", None, r"notes\.txt is not a file of states; expected a \.vtu or \.pvd file"),
        ("good.vtu", 0.5, r"time = 0\.5, but .*good\.vtu has one state and no time"),
        ("good.vtu", "end", r"time = 'end'; expected a finite time or load factor"),
        (
            "other.vtu",
            None,
            r"has no displacements; expected a result of this package. Its fields are \['deplacement_', 'velocity'\]",
        ),
    ):
        with pytest.raises(StvkError, match=message):
            read_state(tmp_path / name, MESH, time)


def pulled(**more):
    system = System(MESH, LAW, fixed={"left": "xy"}, prescribed={"right": {"x": 0.1}})
    return solve_static(system, steps=4, quiet=True, **more)


def kicked(until, **more):
    system = System(MESH, LAW, fixed={"left": "xy"})
    v0 = np.tile([0.0, 0.05], MESH.nv)
    v0[system.supports.held] = 0
    return simulate(system, EnergyMomentum(dt=0.1), until=until, v0=v0, quiet=True, **more)


def test_a_checkpoint_of_a_motion_holds_its_last_state(tmp_path):
    run = kicked(0.4, checkpoint=tmp_path / "kept")
    for path, time in ((tmp_path / "kept", None), (tmp_path / "kept" / "motion.npz", None), (tmp_path / "kept", 0.4)):
        u, v = read_state(path, MESH, time)
        assert np.array_equal(u, run.u) and np.array_equal(v, run.v)
    with pytest.raises(StvkError, match=r"no state at time = 0\.2: of its 1 states from 0\.4 to 0\.4"):
        read_state(tmp_path / "kept", MESH, 0.2)


def test_a_checkpoint_of_a_path_holds_each_of_its_states(tmp_path):
    path = pulled(checkpoint=tmp_path / "kept")
    u, v = read_state(tmp_path / "kept", MESH)
    assert np.array_equal(u, path.u) and v is None and len(path.history) > 2
    for step in path.history:
        assert np.array_equal(read_state(tmp_path / "kept", MESH, step.t)[0], step.u)


def test_checkpoints_of_another_mesh_and_other_folders_are_refused(tmp_path):
    kicked(0.1, checkpoint=tmp_path / "kept")
    for mesh, message in (
        (box((2.0, 1.0), (4, 3)), r"belongs to another mesh: it has 15 vertices and 16 elements, this one 20 and 24"),
        (MESH.scaled(1.001), r"belongs to another mesh: its vertices or its elements differ"),
    ):
        with pytest.raises(StvkError, match=message):
            read_state(tmp_path / "kept", mesh)
    (tmp_path / "none").mkdir()
    with pytest.raises(StvkError, match=r"is not a checkpoint: it has neither motion\.npz nor state_\*\.npz"):
        read_state(tmp_path / "none", MESH)
    file = tmp_path / "kept" / "motion.npz"
    file.write_bytes(file.read_bytes()[:-200])
    with pytest.raises(StvkError, match=r"motion\.npz cannot be read as a motion of skfem-stvk: it is incomplete"):
        read_state(tmp_path / "kept", MESH)


def test_a_checkpoint_without_its_mesh_or_its_time_is_refused(tmp_path):
    kicked(0.1, checkpoint=tmp_path / "kept")
    file = tmp_path / "kept" / "motion.npz"
    header, arrays = read_archive(file, MotionCheckpoint.known, "")
    changes = [("the mesh", "it does not identify its mesh"), ("t", r"state\.t: Field required")]
    for name, why in changes:
        other = copy.deepcopy(header)
        del (other["record"]["state"] if name == "t" else other["problem"]["numbers"])[name]
        write_archive(file, other, arrays)
        with pytest.raises(StvkError, match=rf"motion\.npz is damaged: {why}\. Use another file of the run"):
            read_state(tmp_path / "kept", MESH)
