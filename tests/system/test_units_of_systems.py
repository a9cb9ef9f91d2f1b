"""Units of a system name values in plots, tables and messages, and convert none."""

import re

import numpy as np
import pytest
import skfem

from skfem_stvk import (
    BackwardEuler,
    ContactError,
    Friction,
    Gravity,
    MaterialError,
    MeshContact,
    RigidContact,
    RigidPlane,
    Scene,
    Simulation,
    StVK,
    StvkError,
    StvkWarning,
    SupportError,
    System,
    VelocityVerlet,
    modes,
    simulate,
    solve_static,
)
from skfem_stvk.results import animate
from skfem_stvk.results.vtu import write_mesh
from skfem_stvk.scenes.commands.main import main
from skfem_stvk.solvers.runs.ledger import Ledger, unit_of
from skfem_stvk.solvers.state_files import read_state
from skfem_stvk.units import UNITS

STEEL = {"young": 2.1e5, "poisson": 0.3, "density": 7.85e-9}


def beam(**options):
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 100, 9), np.linspace(0, 10, 3)).with_defaults()
    given = {"units": "mm-N-MPa"} | options
    return System(mesh, [StVK(**STEEL), Gravity([0, -9810.0])], **({"fixed": {"left": "xy"}} | given))


def texts(figure):
    labels = [words.get_text() for axes in figure.axes for words in (axes.xaxis.label, axes.yaxis.label)]
    return [*labels, *(words.get_text() for words in figure.texts)]


def test_no_number_is_converted():
    given, si = solve_static(beam(), quiet=True), solve_static(beam(units="SI"), quiet=True)
    assert given.u.tobytes() == si.u.tobytes() and given.state["von_mises"].tobytes() == si.state["von_mises"].tobytes()
    assert given.reaction().by_node.tobytes() == si.reaction().by_node.tobytes()


def test_pictures_and_texts_of_a_state_name_the_units():
    result = solve_static(beam(), quiet=True)
    found = texts(result.plot())
    assert "von Mises stress [MPa]" in found and "x [mm]" in found
    assert "displacement [mm]" in texts(result.plot("displacement"))
    assert re.search(r"resultant .* N, moment .* N mm about", repr(result.reaction()))
    assert repr(result.system).endswith("2 term(s), mm-N-MPa") and repr(beam(units="SI")).endswith("term(s)")
    assert " t at 27 vertices" in repr(result.system.mass())
    assert "kHz" in repr(modes(beam(units="mm-kg-ms"), 1))


def test_motions_name_the_units(tmp_path, capfd):
    run = simulate(beam(), BackwardEuler(dt=1e-4), until=3e-4, save=tmp_path / "a.pvd", every=1, probes={"tip": [4]})
    assert re.search(r"kinetic \S+ mJ   strain \S+ mJ", capfd.readouterr().out)
    found = texts(run.ledger.plot())
    assert {"energy [mJ]", "linear\nmomentum [t mm/s]", "displacement\nof tip [mm]", "time [s]"} <= set(found)
    assert "J]" not in " ".join(found).replace("mJ]", "") and Ledger(["time"]).units.name == "SI"
    assert "von Mises stress [MPa]" in texts(run.plot())
    assert run.message.startswith("reached t = 0.0003 s") and "ms" in moved(beam(units="mm-kg-ms")).message
    drawn = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("skfem_stvk.solvers.dynamics.run.animate", lambda *given, **options: drawn.append(options))
        run.animate(tmp_path / "a.gif", "von_mises")
    assert drawn == [{"label": "von Mises stress [MPa]", "length_unit": "mm", "shapes": run._shapes}]
    animate([(0.0, run.state), (1.0, run.state)], tmp_path / "b.gif")


@pytest.mark.parametrize(("units", "m", "Pa", "J"), [("mm-N-MPa", "mm", "MPa", "mJ"), ("SI", "m", "Pa", "J")])
def test_files_name_the_units(units, m, Pa, J, tmp_path):
    """VTK reads the units of arrays; meshio, which does not know them, reads the same numbers. Numbers without a unit have none."""
    pytest.importorskip("vtk")
    from vtkmodules.vtkCommonCore import vtkDataArray
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    body = beam(units=units)
    run = simulate(body, BackwardEuler(dt=1e-4), until=2e-4, save=tmp_path / "a.pvd", probes={"tip": [4]}, quiet=True)
    head = (tmp_path / "a.csv").read_text().splitlines()[0].split(",")
    mass = UNITS[units].symbol("mass")
    assert head[:2] == ["time [s]", f"kinetic_energy [{J}]"] and {"inside_out", f"tip x [{m}]"} < set(head)
    assert {f"linear_momentum_x [{mass} {m}/s]", f"angular_momentum_z [{mass} {m}^2/s]"} < set(head)
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(tmp_path / "a_0001.vtu"))
    reader.Update()
    grid = reader.GetOutput()
    for data in (grid.GetPointData(), grid.GetCellData()):
        arrays = [data.GetArray(i) for i in range(data.GetNumberOfArrays())]
        found = {array.GetName(): array.GetInformation().Get(vtkDataArray.UNITS_LABEL()) for array in arrays}
        known = {"displacement": m, "velocity": f"{m}/s"} if data is grid.GetPointData() else {}
        assert found == known | {
            "cauchy_stress": Pa,
            "von_mises_stress": Pa,
            "green_strain": None,
            "volume_ratio": None,
        }
    assert grid.GetPoints().GetData().GetInformation().Get(vtkDataArray.UNITS_LABEL()) == m
    u, v = read_state(tmp_path / "a.pvd", body.mesh)
    assert u.tobytes() == run.u.tobytes() and v is not None and v.tobytes() == run.v.tobytes()


def test_columns_of_contacts_are_forces():
    names = ["time", "contact floor x", "reaction wall x", "tip x", "kinetic_energy", "inside_out"]
    found = texts(Ledger(names, np.random.default_rng(0).normal(size=(2, 6))).plot())
    assert {"contact floor [N]", "reaction wall [N]", "displacement\nof tip [m]"} <= set(found)
    assert [unit_of(name) for name in names] == ["s", "N", "N", "m", "J", ""]


@pytest.mark.parametrize("units", ["mm-kg-ms", "SI"])
def test_errors_name_the_units(units):
    """Missing densities and widths of friction, contacts that are too wide, ends in the past."""
    density, length, velocity, force = (UNITS[units].symbol(one) for one in ("density", "length", "velocity", "force"))
    mesh, law = skfem.MeshTet().refined(1), StVK(young=2.1e5, poisson=0.3)
    for call in (lambda body: body.mass(), lambda body: simulate(body, VelocityVerlet(), until=1.0, quiet=True)):
        with pytest.raises(MaterialError, match=rf"no density.*\[{re.escape(density)}\]"):
            call(System(mesh, law, units=units))
    with pytest.raises(MaterialError, match=rf"\[{re.escape(density)}\]"):
        System(mesh, [law, Gravity([0, 0, -9.81])], units=units)
    with pytest.raises(ContactError, match=rf"distance = 5 {length}; .* 0.5 {length} between"):
        System(mesh, [law, MeshContact(None, distance=5.0)], units=units)
    floor = RigidContact(RigidPlane((0, 0, -1), (0, 0, 1)), friction=Friction(0.3, slip_length=1.0))
    with pytest.raises(ContactError, match=rf"slip_speed=... \[{velocity}\]"):
        simulate(System(mesh, [StVK(**STEEL), floor], units=units), BackwardEuler(0.1), until=1.0, quiet=True)
    sim = Simulation(beam(units=units), BackwardEuler(0.1), pushed=["right"])
    with pytest.raises(StvkError, match=rf"components of the total force \[{force}\]"):
        sim.step(right=(1.0,))


def moved(system):
    return simulate(system, BackwardEuler(dt=1e-4), until=2e-4, quiet=True)


def test_derived_systems_keep_their_units():
    body = beam()
    assert body.without([0]).units is UNITS["mm-N-MPa"] and body.made_of["units"] == "mm-N-MPa"


def test_unknown_units_are_refused():
    with pytest.raises(StvkError, match=r"units = .mm-N-Mpa.; known: .* Did you mean .mm-N-MPa.\?"):
        beam(units="mm-N-Mpa")


def test_a_large_soft_body_in_si_gets_a_question():
    (text,) = beam(units="SI", hourglass=None).implausible()
    assert text.startswith("material 0: young = 210000 Pa is unusual for a body of 100 m") and '"mm-N-MPa"' in text
    for usual in (
        System(skfem.MeshTri().scaled(100.0), StVK(young=2.1e11, poisson=0.3)),
        System(skfem.MeshTri().scaled(0.1), StVK(young=2.1e5, poisson=0.3)),
        beam(),
    ):
        assert usual.implausible() == []


@pytest.mark.parametrize(("units", "time", "length"), [("mm-kg-ms", "ms", "mm"), ("SI", "s", "m")])
def test_messages_on_steps_and_jumps_name_the_units(units, time, length):
    body = beam(units=units)
    with pytest.warns(StvkWarning, match=rf"t = 0 {time}: the step dt = 1 {time} is above the critical one, \S+ {time} \(safe"):
        run = simulate(body, VelocityVerlet(1.0), until=30.0, quiet=True, raise_on_failure=False)
    assert f"The step was 1 {time} (critical step " in run.message and (time == "s") == bool(re.search(r"\d s\b", run.message))
    with pytest.raises(SupportError, match=rf"t0 = 0 {time} by up to 0.1 {length}\. In dynamics"):
        simulate(beam(units=units, fixed={}, prescribed={"left": {"x": 0.1}}), VelocityVerlet(), until=1.0, quiet=True)
    sim = Simulation(body, VelocityVerlet(1e-7), t0=2.0)
    assert repr(sim).startswith(f"Simulation at t = 2 {time}, 0 steps")
    with pytest.raises(StvkError, match=rf"until = 1.0; expected a time after t = 2 {time}"):
        sim.step(until=1.0)


def test_headers_of_runs_ask_once(capfd):
    mesh = skfem.MeshTri().scaled(100.0).with_defaults()
    solve_static(System(mesh, StVK(young=2.1e5, poisson=0.3), fixed={"left": "xy"}, prescribed={"right": {"x": 0.1}}))
    assert capfd.readouterr().out.count("note: material 0: young = 210000 Pa is unusual") == 1


def test_scenes_ask_the_same_question():
    data = {
        "mesh": {"type": "box", "size": [100.0, 10.0], "cells": [4, 2]},
        "materials": {"steel": {"model": "isotropic", "young": 2.1e5, "poisson": 0.3}},
        "terms": [{"type": "stvk", "material": "steel"}],
        "analysis": {"type": "static"},
        "fixed": {"left": "xy"},
    }
    scene = Scene.of_data(data)
    (text,) = scene.implausible()
    assert text.startswith("materials.steel.young = 210000 Pa is unusual for a body of 100 m")
    scene = Scene.of_data(data | {"units": "mm-N-MPa"})
    assert scene.system().units is UNITS["mm-N-MPa"] and scene.implausible() == []


def test_info_takes_units(tmp_path, capsys):
    file = str(write_mesh(tmp_path / "beam.vtu", beam().mesh))
    given = ["info", file, "--young", "2.1e5", "--poisson", "0.3"]
    assert main(given) == 0 and "--young = 210000 Pa is unusual" in capsys.readouterr().out
    assert main([*given, "--density", "7.85e-9", "--units", "mm-N-MPa"]) == 0
    out = capsys.readouterr().out
    assert "E = 210000 MPa" in out and "no problem was found" in out and re.search(r"mass\s+7.85e-06 t", out)
