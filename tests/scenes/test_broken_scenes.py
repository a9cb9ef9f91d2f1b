"""Each broken scene gets a message with the key, the line, the error and a suggestion."""

import os
import re

import pytest

from skfem_stvk.errors import SceneError, name_known
from skfem_stvk.kernels.threads import threads
from skfem_stvk.scenes.commands.main import main
from skfem_stvk.scenes.scene import Scene
from skfem_stvk.scenes.source import SceneSource
from skfem_stvk.terms import TERMS

GOOD = """units = "SI"

[mesh]
type = "box"
size = [2.0, 1.0, 1.0]
cells = [4, 2, 2]

[places]
edge = { type = "plane", point = [0, 0, 0], normal = [0, 0, 1] }
half = { type = "box", low = [0, 0, 0], high = [1, 1, 1] }

[materials.steel]
model = "isotropic"
young = 210e9
poisson = 0.3
density = 7850

[[terms]]
type = "stvk"
material = "steel"

[[terms]]
type = "gravity"
g = [0, 0, -9.81]

[[terms]]
type = "traction"
on = "right"
traction = [0, 0, -2e6]

[fixed]
left = "xyz"

[analysis]
type = "dynamic"
integrator = "energy-momentum"
dt = 1e-4
until = 2e-4

[output]
file = "beam.pvd"
probes = { tip = [2, 1, 1] }
reactions = { wall = "left" }
plots = ["tip", "ledger"]

[expect]
tip.z = { value = 0, atol = 1 }
"""


CONTACT = r'[[terms]]\ntype = "rigid-contact"\nshape = { type = "plane", point = [0, 0, -1], normal = [0, 0, 1] }'
#: Broken scenes: what is wrong, then edits of the good scene, "old => new", and the expected message.
CASES = r"""
a missing file of a rigid mesh
  [fixed] => [[terms]]\ntype = "mesh-contact"\ndistance = 0.01\nsecond = { type = "rigid-mesh", file = "table.stl" }\n\n[fixed]
    terms[3].second.file, line 34: the file table.stl does not exist; paths are relative to the scene file.
a second surface of an unknown type
  [fixed] => [[terms]]\ntype = "mesh-contact"\ndistance = 0.01\nsecond = { type = "rigid-mash", file = "table.stl" }\n\n[fixed]
    terms[3].second, line 34: got {'file': 'table.stl', 'type': 'rigid-mash'}; expected a name, coordinates [x, y, z], or a
    table with type = one of box, plane, nodes, rigid-mesh
a plane without a normal
  [fixed] => [[terms]]\ntype = "rigid-contact"\nshape = { type = "plane", point = [0, 0, 0] }\n\n[fixed]
    terms[3].shape.normal, line 33: is missing: Direction towards the body, of any length
a misspelt key of a shape
  [fixed] => [[terms]]\ntype = "rigid-contact"\nshape = { type = "sphere", center = [0, 0, 0], radius = 1 }\n\n[fixed]
    scene.toml has 2 errors: terms[3].shape.centre, line 33: is missing: The centre terms[3].shape.center, line 33: unknown
    key; did you mean 'centre'? Known here: centre, inside, radius, type.
a plane in two dimensions
  [fixed] => [[terms]]\ntype = "rigid-contact"\nshape = { type = "plane", point = [0, 0], normal = [0, 1] }\n\n[fixed]
    terms[3], line 31: RigidContact 'contact': its RigidPlane has 2 components; expected 3, as the mesh.
friction without a width
  [fixed] => <contact>\nfriction = { coefficient = 0.3 }\n\n[fixed]
    terms[3].friction, line 34: type = 'dynamic' needs slip_speed; add slip_speed = ...
a time without a motion
  [fixed] => <contact>\ntime = { type = "ramp", until = 1 }\n\n[fixed]
    terms[3].time, line 34: is the factor of motion, which is missing; add motion = [...], or remove it
a contact that is named as a probe
  [fixed] => <contact>\nname = "tip"\n\n[fixed]
    terms[3].name, line 34: 'tip' is also the name of a probe, a reaction, a result or a plot; choose another name
two contacts of one name
  [fixed] => <contact>\nname = "floor"\n\n<contact>\nname = "floor"\n\n[fixed]
    terms[4].name, line 39: 'floor' is also the name of another contact; choose another name
an expectation that is a number
  tip.z = { value = 0, atol = 1 } => tip.z = 3
    expect.tip.z, line 47: got 3; expected a table, such as z = {value = 3, rtol = 0.001}
a mesh of no kind
  type = "box"\nsize = [2.0 => size = [2.0
    mesh, line 3: the key 'type' is missing, which selects the kind: one of box, cylinder, bar, or file = the path of a mesh
    file
a skin on no boundary
  type = "gravity" => type = "stvk"\nmaterial = "steel"\nsimplices = "lef"\n\n[[terms]]\ntype = "gravity"
    terms[1], line 22: StVK 0: simplices = 'lef'; expected (k + 1, n) nodes, or the name of a boundary or of lines; known:
    'back', 'bottom', 'front', 'left', 'right', 'top'. Did you mean 'left'?
elements of different kinds
  type = "gravity" => type = "stvk"\nmaterial = "steel"\nsimplices = [[0, 1], [2]]\n\n[[terms]]\ntype = "gravity"
    terms[1], line 22: simplices = [[0, 1], [2]]; expected elements with as many nodes each.
a misspelt key
  poisson = 0.3 => poison = 0.3
    materials.steel.poison, line 15: unknown key; did you mean 'poisson'? Known here: density, model, poisson, young.
a misspelt table
  [materials.steel] => [material.steel]
    material, line 12: unknown key; did you mean 'materials'? Known here: analysis, expect, fixed, initial, materials, mesh,
    output, places, prescribed, reduced, solver, terms, threads, title, units.
a misspelt kind
  type = "gravity" => type = "gravitation"
    terms[1].type, line 23: 'gravitation' is not known here; did you mean 'gravity'? Known: <terms>.
a misspelt type key
  type = "traction" => tipe = "traction"
    terms[2].tipe, line 27: unknown key; did you mean 'type'? It selects the kind: one of <terms>
an unknown integrator
  energy-momentum => leapfrog
    analysis.integrator, line 36: 'leapfrog' is not known here. Known: forward-euler, velocity-verlet, linear-backward-euler,
    backward-euler, newmark, generalized-alpha, energy-momentum.
a number in quotes
  210e9 => "210e9"
    materials.steel.young, line 14: got '210e9'; expected a number without quotation marks
a number with its unit
  210e9 => 210 GPa
    scene.toml, line 14, column 13: expected newline or end of document after a statement. Numbers have a decimal point, no
    comma and no unit; text needs quotation marks; lists need [brackets]. young = 210 GPa ^
a comma in a number
  0.3 => 0,3
    scene.toml, line 15, column 12: expected newline or end of document after a statement. Numbers have a decimal point, no
    comma and no unit; text needs quotation marks; lists need [brackets]. poisson = 0,3 ^
a negative modulus
  210e9 => -210e9
    materials.steel.young, line 14: got -210000000000.0; expected a value greater than 0
a probe that is a number
  tip = [2, 1, 1] => tip = 3
    output.probes.tip, line 42: got 3; expected a name, coordinates [x, y, z], or a table with type = one of box, plane, nodes
poisson above a half in a solid
  0.3 => 0.6
    materials.steel.poisson, line 15: 0.6 is outside (-1, 1/2)
no material
  material = "steel"\n =>
    terms[0].material, line 18: is missing: Name of its material
an unknown material
  material = "steel" => material = "stele"
    terms[0].material, line 20: there is no [materials.stele]; known: 'steel'. Did you mean 'steel'?
a material that nothing uses
  [[terms]]\ntype = "stvk" => [materials.rubber]\nmodel = "isotropic"\nyoung = 1e6\npoisson = 0.4\n\n[[terms]]\ntype = "stvk"
    materials.rubber, line 18: no term has this material. Remove it, or name it in a term: material = ...
a material twice
  [[terms]]\ntype = "stvk" => [materials.steel]\nyoung = 1e6\n\n[[terms]]\ntype = "stvk"
    scene.toml, line 18, column 17: cannot declare ('materials', 'steel') twice. 'materials.steel' is already defined in line
    12: remove one of them. Each entry of a list of tables needs [[two brackets]]. [materials.steel] ^
no density
  density = 7850\n =>
    materials.steel, line 12: the density is missing, which motion, modes and gravity need. Add density = ...
an unknown place
  on = "right" => on = "rihgt"
    terms[2].on, line 28: there is no place 'rihgt'; known: 'back', 'bottom', 'edge', 'front', 'half', 'left', 'right', 'top'.
    Did you mean 'right'?
a wrong component
  left = "xyz" => left = "xyw"
    fixed.left, line 32: got 'xyw'; expected letters of components, such as "xyz" or "y"
an unknown region
  material = "steel" => material = "steel"\nregion = "boddy"
    terms[0].region, line 21: there is no region 'boddy': neither a subdomain of the mesh nor a box; known: 'half'.
a place without nodes
  [2, 1, 1] } => { type = "plane", point = [9, 0, 0], normal = [1, 0, 0] } }
    output.probes.tip, line 42: tip: none of the 45 vertices is in the plane through (9, 0, 0) with normal (1, 0, 0). The mesh
    has x[0] from 0 to 2, x[1] from 0 to 1, x[2] from 0 to 1.
a probe far outside
  [2, 1, 1] => [2000, 1, 1]
    output.probes.tip, line 42: tip: the node nearest to (2000, 1, 1) is 1998 away from it, at (2, 1, 1), and the mesh is 2
    large. Is the point in the units of the mesh?
two components of three
  g = [0, 0, -9.81] => g = [0, -9.81]
    terms[1].g, line 24: has 2 components; expected 3: x, y, z
cells of four dimensions
  [4, 2, 2] => [4, 2, 2, 2]
    mesh.cells, line 6: got [4, 2, 2, 2]; expected at most 3 items
no step
  dt = 1e-4\n =>
    analysis.dt, line 34: is missing; energy-momentum needs a time step
an end before the beginning
  until = 2e-4 => until = -1
    analysis.until, line 38: -1 is not after initial.t0 = 0
an option of another integrator
  dt = 1e-4 => dt = 1e-4\nrho = 0.8
    analysis.rho, line 38: is an option of generalized-alpha, not of energy-momentum; remove it
a solver for an explicit method
  integrator = "energy-momentum" => integrator = "velocity-verlet"
  [output] => [solver]\nname = "superlu"\n\n[output]
    solver.name, line 41: velocity-verlet solves no linear systems; remove this key
a file outside
  file = "beam.pvd" => file = "../beam.pvd"
    output.file, line 41: '../beam.pvd' is not a file name; expected a name without folders, such as 'body.pvd'
a file of an unknown kind
  file = "beam.pvd" => file = "beam.vtk"
    output.file, line 41: got 'beam.vtk'; expected a name that ends in .pvd (series of states) or .vtu (last state)
nothing to plot
  ["tip", "ledger"] => ["tpi", "ledger"]
    output.plots[0], line 44: unknown plot 'tpi'; known: 'ledger', 'tip', 'wall'. Did you mean 'tip'?
one name twice
  reactions = { wall => reactions = { tip
    output.reactions.tip, line 43: is also the name of a probe; rename one of them
a probe named energy
  probes = { tip => probes = { energy = "right", tip
    output.probes.energy, line 42: is also the name of a result or plot; choose another name
a probe named critical
  probes = { tip => probes = { critical = "right", tip
    output.probes.critical, line 42: is also the name of a result or plot; choose another name
a probe named total_energy
  probes = { tip => probes = { "total_energy" = "right", tip
    output.probes.total_energy, line 42: probe 'total_energy'; expected another name: the ledger has columns of this name that
    are no displacements.
a probe named reaction wall
  probes = { tip => probes = { "reaction wall" = "right", tip
    output.probes."reaction wall", line 42: probe 'reaction wall'; expected another name: the ledger has columns of this name
    that are no displacements.
a reaction named as a plot
  reactions = { wall => reactions = { ledger = "left", wall
    output.reactions.ledger, line 43: is also the name of a result or plot; choose another name
an expectation of nothing
  tip.z => tpi.z
    expect.tpi.z, line 47: there is no result 'tpi.z'; known: 'blow_ups', 'displacement.largest', 'energy.closure',
    'energy.dissipated', 'energy.external', 'energy.kinetic', 'energy.potential', 'energy.removed', 'energy.strain',
    'energy.total', 'energy_gained', 'steps', 'stress.largest', 'time', 'tip.x', 'tip.y', 'tip.z', 'volume_ratio.smallest',
    'wall.x', 'wall.y', 'wall.z'. Did you mean 'tip.z'?
a list of reactions
  reactions = { wall = "left" } => reactions = ["left", "a b"]
  plots = ["tip", "ledger"] =>
    output.reactions, line 43: got ['left', 'a b']; expected a table, such as reactions = {left = "left", "a b" = "a b"}
the symbol of a constant
  density = 7850 => rho = 7850
    materials.steel.rho, line 16: unknown key; did you mean 'density'? Known here: density, model, poisson, young.
an expectation without a tolerance
  , atol = 1 =>
    expect.tip.z, line 47: give either rtol or atol, the largest difference
a missing mesh file
  type = "box"\nsize = [2.0, 1.0, 1.0]\ncells = [4, 2, 2] => file = "bracket.msh"
    mesh.file, line 4: the file bracket.msh does not exist; paths are relative to the scene file.
held and moved
  left = "xyz" => left = "xyz"\n\n[prescribed]\nleft = { x = 0.1 }
    prescribed.left, line 35: Both fixed and prescribed: x of 9 vertices (0, 1, 2, 15, 16, ...). Do locations share an edge or
    a corner? Leave the component out of one of them, or name other nodes: [places] some = { type = "nodes", ids = [...] }.
moved in two ways
  left = "xyz" => left = "x"\n\n[prescribed]\nright = { y = 0.1 }\ntop = { y = 0.2 }\nback = { x = 0.1 }
    scene.toml has 2 errors: prescribed.top, line 36: Prescribed twice, with different displacements at t = 0.333: y of 3
    vertices (14, 29, 44). Do locations share an edge or a corner? Leave the component out of one of them. prescribed.back,
    line 37: Both fixed and prescribed: x of 3 vertices (30, 31, 32). Do locations share an edge or a corner? Leave the
    component out of one of them, or name other nodes: [places] some = { type = "nodes", ids = [...] }.
moved at once
  left = "xyz" => left = "yz"\n\n[prescribed]\nleft = { x = 0.1 }
    prescribed, line 34: 9 vertices (0, 1, 2, 15, 16, ...): u0 differs from the supports at t0 = 0 s by up to 0.1 m. In
    dynamics constants do not ramp. Give them a time, such as time = { type = "ramp", until = 0.1 }, or start from an
    equilibrium: [initial] file = "static.vtu".
nothing moves it
  [[terms]]\ntype = "gravity"\ng = [0, 0, -9.81]\n\n[[terms]]\ntype = "traction"\non = "right"\ntraction = [0, 0, -2e6]\n\n =>
    terms, line 18: Nothing moves the body: no load, nothing prescribed, u0 and v0 zero. Add a term such as type = "gravity",
    or [initial] velocity = [...] or file = "...".
more unknowns than memory
  [output] => [reduced]\nsize = 20000\n\n[output]
    reduced.size, line 41: size = 20000 needs about 373,456,015,175 MB, 1,000 MB are allowed: there are r^4/24 coefficients,
    six times as many while they are made, and the fields. Take fewer unknowns.
more modes than there are
  [output] => [reduced]\nmodes = 300\nderivatives = false\n\n[output]
    reduced.modes, line 41: modes = 300; expected a number from 1 to 108, that of the free degrees of freedom.
nothing holds it
  type = "dynamic"\nintegrator = "energy-momentum"\ndt = 1e-4\nuntil = 2e-4 => type = "static"
  plots = ["tip", "ledger"] => plots = ["tip"]
  left = "xyz" => left = "x"
  reactions = { wall = "left" }\n =>
    fixed, line 31: Not held: the body of 45 vertices has 3 rigid modes left, translation along y, translation along z,
    rotation about the x axis. Fix more components ([fixed] place = "xyz"), prescribe them ([prescribed] place = { x = 0.0 }),
    or add a term of type = "elastic-foundation". To join parts, merge the vertices of their common faces.
unknown units
  "SI" => "si"
    units, line 1: 'si' is not known here; did you mean 'SI'? Known: SI, mm-N-MPa, mm-kg-ms, mm-g-ms, cm-g-s, um-kg-s,
    in-lbf-s.
too many threads
  units = "SI" => units = "SI"\nthreads = 1000
    threads, line 2: 1000; expected at most <threads>, the number of threads of this process, which NUMBA_NUM_THREADS sets
a bracket that is not closed
  [4, 2, 2] => [4, 2, 2
    scene.toml, line 8, column 1: unclosed array. A comma or a bracket is missing before this. [places] ^
yes for true
  [expect] => checkpoint = yes\n\n[expect]
    scene.toml, line 46, column 14: invalid value. Write true. checkpoint = yes ^
a name of the mesh taken
  edge = => left =
    places.left, line 9: the mesh has a boundary or a node set of the same name; rename the place.
a table of times that falls
  traction = [0, 0, -2e6] => traction = [0, 0, -2e6]\ntime = { type = "table", times = [1, 0], factors = [0, 1] }
    terms[2], line 26: Table: times do not ascend after 1 entry (0). Sort them, with their factors; for a jump give two times
    that are near each other.
one point of tetrahedra
  cells = [4, 2, 2] => cells = [4, 2, 2]\nquadrature = "one-point"
    quadrature = "one-point" is for hexahedra, and quadrilaterals in the plane; the mesh has tetrahedra in 3D: linear
    simplices have one point anyway. Leave it out.
plane stress of a solid
  material = "steel" => material = "steel"\nplane = "stress"
    terms[0], line 18: plane is for triangles; the mesh has tetrahedra in 3D. Leave it out.
triangles in space
  cells = [4, 2, 2] => cells = [4, 2, 2]\nelement = "triangles"
    mesh, line 3: element = 'triangles'; known: 'hexahedra', 'tetrahedra'.
"""


def cases():
    """Return the edits and the message of each broken scene."""
    text = CASES.replace("<contact>", CONTACT).replace("<terms>", ", ".join(TERMS)).replace("<threads>", str(threads()))
    for what, lines in re.findall(r"^(\S.*)\n((?: .*\n)+)", text, re.MULTILINE):
        edits = re.findall(r"^  (\S.*?) => ?(.*)$", lines, re.MULTILINE)
        yield pytest.param(edits, " ".join(re.findall(r"^    (.*)", lines, re.MULTILINE)), id=what)


def broken(folder, edits):
    """Write the scene with these edits, in which backslash n is a line break, and return its path."""
    text = GOOD
    for old, new in edits:
        assert old.replace(r"\n", "\n") in text
        text = text.replace(old.replace(r"\n", "\n"), new.replace(r"\n", "\n"), 1)
    path = folder / "scene.toml"
    path.write_text(text)
    return path


def words(text):
    """Return the text with single spaces and without line breaks."""
    return re.sub(r"\s+", " ", text).strip()


def test_the_scene_is_good_before_it_is_broken(tmp_path):
    assert Scene.read(broken(tmp_path, [])).solve(quiet=True).exit_code == 0


@pytest.mark.parametrize(("edits", "message"), list(cases()))
def test_a_broken_scene_gets_its_message(edits, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    broken(tmp_path, edits)
    assert main(["solve", "scene.toml", "--quiet"]) == 2
    err = re.sub(r"^skfem_stvk: .* kernels? .*\n", "", capsys.readouterr().err, flags=re.MULTILINE)  # notes on first use
    assert words(err).removeprefix("error ").removeprefix("scene.toml: ") == message
    assert "Traceback" not in err
    assert [path.name for path in tmp_path.iterdir() if path.name not in ("scene.toml", "scene")] == []


def test_a_missing_file_with_a_similar_name_in_its_folder_gets_a_hint(tmp_path):
    (tmp_path / "bracket2.msh").touch()
    broken(tmp_path, [('type = "box"\nsize = [2.0, 1.0, 1.0]\ncells = [4, 2, 2]', 'file = "bracket.msh"')])
    with pytest.raises(SceneError, match=r"Did you mean 'bracket2\.msh'"):
        _ = Scene.read(tmp_path / "scene.toml").built


def test_all_errors_are_reported_together_in_the_order_of_lines(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    wrong = [
        ("[2.0, 1.0, 1.0]", "[2.0, -1.0, nan]"),
        ("0.3", "2"),
        ("7850", "0"),
        ("dt = 1e-4", "dtt = 1e-4"),
        ("value = 0", "value = true"),
    ]
    broken(tmp_path, wrong)
    assert main(["solve", "scene.toml"]) == 2
    err = capsys.readouterr().err
    lines = [int(number) for number in re.findall(r"line (\d+)", err)]
    assert len(lines) >= 5 and lines == sorted(lines)


def test_an_error_in_a_set_value_names_its_setting(tmp_path, capsys):
    path = str(broken(tmp_path, []))
    for setting, message in (
        ("analysis.dt=0", "analysis.dt, from --set analysis.dt=0: got 0; expected a value greater than 0"),
        ("terms[7].g=[0,0,1]", "--set terms[7].g=[0,0,1]: terms has 3 entries, counted from 0; expected a number below 3, not 7."),
        ("terms.1.g=1", "terms is not a table, so it has no key '1'; entries of a list need a number, as in terms[1]"),
        ("terms.g=1", "terms is not a table, so it has no key 'g'; entries of a list need a number, as in terms[0].g"),
        (f"mesh.cells=[4, -1{400 * '0'}]", f"got -1{36 * '0'}...{39 * '0'}; expected a value greater than or equal to 1"),
        ("analysis.dt", "expected KEY=VALUE"),
        ("analysis.dt=[1", "unclosed array"),
        ("analysis.dt=0.1\nuntil=5", "has several lines with keys; expected one value"),
        ("analysis.dt=0.1\n[output]\nevery = 3", "has several lines with keys; expected one value"),
        (".analysis.dt=1", "'.analysis.dt' is not a key"),
        ("terms.[0].g=1", "'terms.[0].g' is not a key"),
        ("output.plots=['tpi']", "output.plots[0], from --set output.plots=['tpi']: unknown plot"),
        ("terms[-1].on=3", "terms[2].on, from --set terms[-1].on=3: got 3"),
        ("matrials.steel.young=1", "matrials, from --set matrials.steel.young=1: unknown key; did you mean 'materials'?"),
        (
            "materials.steel.young=soft",
            "materials.steel.young, from --set materials.steel.young=soft: got 'soft'; expected a number",
        ),
    ):
        assert main(["solve", path, "--set", setting]) == 2
        assert message in words(capsys.readouterr().err), setting


def test_files_that_are_not_scenes_are_refused(tmp_path, capsys):
    (tmp_path / "empty.toml").write_text("")
    (tmp_path / "mesh.msh").write_bytes(b"$MeshFormat\n\0\0")
    (tmp_path / "ascii.msh").write_bytes(b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n")
    (tmp_path / "latin.toml").write_bytes("title = 'Träger'".encode("latin-1"))
    for name, message in (
        ("empty.toml", "is empty. `skfem-stvk init --type static"),
        ("mesh.msh", "is not a text file; expected a scene, which names its mesh"),
        ("ascii.msh", "is a mesh of Gmsh; expected a scene, which names its mesh: [mesh] file = 'ascii.msh'. `skfem-stvk init"),
        ("latin.toml", "line 1: byte 0xe4 is not UTF-8"),
        ("missing.toml", "There is no file"),
        (".", "is a folder; expected a scene file"),
    ):
        assert main(["solve", str(tmp_path / name)]) == 2
        assert message in words(capsys.readouterr().err), name


#: Text that is appended to a good scene, and the expected message.
TOO_MUCH = {
    "tables in tables": ("x = " + 60 * "{a = " + "1" + 60 * "}" + "\n", "nested too deep; expected at most 50 levels"),
    "lists in lists": ("x = " + 900 * "[" + 900 * "]" + "\n", "nested too deep"),
    "a header of many parts": ("[expect." + 900 * "a." + "a]\n", "a key has more than 50 parts between dots"),
    "a key of many parts": (100_000 * "a." + "a = 1\n", "a key has more than 50 parts between dots"),
    "many terms": (100_000 * "[[terms]]\n", "a table or list has 100003 entries; expected at most 5000"),
    "many materials": ("".join(f"[materials.m{n}]\n" for n in range(20_000)), "a table or list has 20001 entries; expected"),
    "many plots": (f"[places.there]\nnodes = {20_000 * ['a']}\n", "a table or list has 20000 entries; expected at most 5000"),
}


@pytest.mark.parametrize("name", TOO_MUCH)
def test_an_excessively_large_scene_is_refused_quickly(name, tmp_path, capsys):
    text, message = TOO_MUCH[name]
    path = broken(tmp_path, [])
    path.write_text(path.read_text() + text)
    assert main(["solve", str(path)]) == 2
    assert message in words(capsys.readouterr().err)


def test_many_numbers_and_many_dots_in_comments_are_legal(tmp_path):
    path = broken(tmp_path, [])
    dots, ids = f"# {80 * '.'} {80 * 'A sentence. '}\n", [n / 10 for n in range(20_000)]
    path.write_text(dots + path.read_text() + f"[prescribed]\ntimes = {ids}\n")
    with pytest.raises(SceneError, match=r"prescribed\.times"):
        Scene.read(path)


def test_data_and_settings_that_are_nested_too_deep_are_refused():
    data = {"value": 1.0}
    for _ in range(900):
        data = {"a": data}
    with pytest.raises(SceneError, match="nested too deep"):
        Scene.of_data({"expect": data})
    with pytest.raises(SceneError, match=r"--set a\.a.*: the key has more than 50 parts"):
        SceneSource.of({}).changed([100_000 * "a." + "a=1"])


@pytest.mark.parametrize("setting", ["title=\udcff", "places.\udcff.type=plane", "title=a\0b"])
def test_settings_that_are_no_text_are_refused(setting, tmp_path, capsys):
    """Bytes that are no UTF-8 are half pairs in the arguments of a command; no file could hold them."""
    (tmp_path / "scene.toml").write_text(GOOD)
    for command in ("solve", "sweep", "info"):
        assert main([command, str(tmp_path / "scene.toml"), "--set", setting]) == 2
        printed = capsys.readouterr()
        assert "bytes that are no UTF-8, or a zero byte; expected text" in " ".join((printed.err + printed.out).split())
    with pytest.raises(SceneError, match="zero byte"):
        Scene.read(tmp_path / "scene.toml", [setting])
    assert [file.name for file in tmp_path.iterdir()] == ["scene.toml"]
    assert Scene.read(tmp_path / "scene.toml", ["title=größer \U0001f600"]).sections.title == "größer \U0001f600"


def test_a_message_about_a_wrong_name_lists_at_most_a_hundred_known_names():
    """A message names the first hundred known names and the number of the others."""
    complaint = name_known("k", (f"p{n}" for n in range(5_000)))
    assert "'p1087' and 4900 more" in complaint and len(complaint) < 1000


@pytest.mark.parametrize("name", ["pipe", "zero"])
def test_a_pipe_and_an_endless_device_are_refused(name, tmp_path, capsys):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    assert main(["solve", str(tmp_path / name)]) == 2
    assert "cannot be read: it is not a regular file" in words(capsys.readouterr().err)


@pytest.mark.parametrize("name", [300 * "y", 5_000 * "y", "half a pair \ud800"])
def test_impossible_file_names_are_refused(name, tmp_path, capsys):
    path = broken(tmp_path, [])
    for arguments in (
        [name + ".toml"],
        [str(path), "--out", name],
        [str(path), "--set", f'mesh={{file="{name}.msh"}}'],
        [str(path), "--set", f'initial.file="{name}.vtu"'],
        [str(path), "--set", f'output.file="{name}.vtu"'],
    ):
        if "ud800" not in ascii(name) or "--set" not in arguments:  # not valid TOML
            assert main(["solve", *arguments, "--quiet"]) == 2
            assert re.search(r"= .*; expected the (path|name) of a", words(capsys.readouterr().err)), arguments


def test_windows_line_ends_and_a_byte_order_mark_are_legal(tmp_path):
    path = tmp_path / "windows.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert Scene.read(path).sections.analysis.type == "dynamic"
