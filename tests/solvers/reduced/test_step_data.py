"""The text of a reduced body has all data of a step: the C program of the docs moves the body as this package does."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import skfem

from skfem_stvk import (
    ElementMesh,
    Gravity,
    LinearBackwardEuler,
    NeoHookean,
    Pressure,
    Rayleigh,
    ReducedSystem,
    StVK,
    StvkError,
    System,
    Traction,
)
from skfem_stvk.results import array_files
from skfem_stvk.solvers.dynamics import Simulation
from skfem_stvk.solvers.reduced.step_data import FIRST_LINE, LAYOUT

DOCS = Path(__file__).parents[3] / "docs"
PLACES = {"back": lambda x: x[0] < 1e-6, "grip": lambda x: x[0] > 1 - 1e-6, "tip": lambda x: x[1] > 1 - 1e-6}
LAW = StVK(young=1e5, poisson=0.3, density=1e3)
STEPS, DT, ALPHA, BETA, SPEED = 100, 0.01, 0.3, 2e-3, 0.4


def cube(n):
    return ElementMesh.of(skfem.MeshTet.init_tensor(*[np.linspace(0, 1, n + 1)] * 3))


def body_of(dimension=3, **supports):
    mesh = cube(3).with_boundaries(PLACES) if dimension == 3 else ElementMesh.of(skfem.MeshTri().refined(2)).with_boundaries(PLACES)
    loads = [Gravity((0.0, 0.0, -9.81)[-dimension:])]
    return System(mesh, [LAW, *loads], fixed={"back": "xyz"[:dimension]}, **supports)


BODIES = {
    "moved": lambda: body_of(prescribed={"grip": "xz"}),
    "prescribed": lambda: body_of(prescribed={"grip": {"y": 0.05}}),
    "in the plane": lambda: body_of(2, prescribed={"grip": "x"}),
    "free": lambda: body_of(),
}


@pytest.fixture(scope="module", params=[("cc", "-std=c99"), ("c++", "-xc++")], ids=["C", "C++"])
def program(request, tmp_path_factory):
    """Return the C program of the docs, compiled as C and as C++, with checks of its memory if the compiler has them."""
    name, language = request.param
    compiler = shutil.which(name)
    if compiler is None:
        pytest.skip(f"there is no compiler {name}")
    file = tmp_path_factory.mktemp("c") / "reduced"
    command = [compiler, "-O2", "-Wall", "-Wextra", "-Werror", language, "-o", file, DOCS / "reduced.c", "-lm"]
    if subprocess.run([*command, "-fsanitize=address,undefined", "-fno-sanitize-recover"], capture_output=True).returncode:
        subprocess.run(command, check=True, capture_output=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ASAN_OPTIONS", "detect_leaks=0")
        yield file


def by_program(program, file, force, speed=SPEED):
    numbers = (DT, STEPS, ALPHA, BETA, speed, "tip", *force)
    done = subprocess.run([program, file, *map(str, numbers)], capture_output=True, text=True, check=True)
    return np.array([line.split() for line in done.stdout.splitlines()], dtype=float)


@pytest.mark.parametrize("name", BODIES)
def test_the_c_program_moves_the_body_as_this_package_does(name, program, tmp_path):
    """After 100 steps of eq. 9 with dead loads, damping, a force and moving lifts, displacements agree to 1e-12."""
    body = BODIES[name]()
    reduced, force = ReducedSystem(body, size=12, modes=8, quiet=True), np.array([10.0, 40.0, -30.0])[: body.mesh.d]
    file, moved = reduced.save(tmp_path / "body.txt"), body.supports.moved
    at_rest = reduced.displacements(np.zeros(12))  # the lifts alone
    sim = Simulation(reduced, LinearBackwardEuler(dt=DT), pushed=["tip"], u0=at_rest, damping=Rayleigh(ALPHA, BETA))
    for step in range(STEPS):
        there = {"grip": np.full(len(moved["grip"].components), SPEED * DT * (step + 1))} if moved else {}
        sim.step(tip=force, **there)
    nodes = np.unique(body.mesh.boundaries["tip"])
    ours = sim.u.reshape(body.mesh.nv, -1)[nodes]
    theirs = by_program(program, file, force, SPEED if moved else 0.0)
    assert np.abs(theirs - ours).max() < 1e-12 * np.abs(ours).max() and np.abs(ours[:, 1]).max() > 1e-3


def test_another_coefficient_moves_the_c_program_elsewhere(program, tmp_path):
    file = ReducedSystem(BODIES["moved"](), size=6, modes=4, quiet=True).save(tmp_path / "body.txt")
    before, lines = by_program(program, file, (0, 0, -30)), file.read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("T real")) + 1 + 20
    lines[at] = str(1.001 * float(lines[at]))
    file.write_text("\n".join(lines))
    assert np.abs(by_program(program, file, (0, 0, -30)) - before).max() > 1e-9 * np.abs(before).max()


def test_the_c_program_reports_wrong_arguments(program, tmp_path):
    file = ReducedSystem(BODIES["free"](), size=3, modes=2, quiet=True).save(tmp_path / "body.txt")
    (tmp_path / "cut.txt").write_text(file.read_text()[:500])
    for arguments, words in (
        ([file], "usage"),
        ([file, "1", "1", "0", "0", "0", "nowhere", "0", "0", "0"], "no location nowhere"),
        ([file, "1", "1", "0", "0", "0", "tip", "0", "0"], "or not 3 forces"),
        ([tmp_path / "cut.txt", "1", "1", "0", "0", "0", "tip", "0", "0", "0"], "is not whole"),
        ([tmp_path / "none.txt", "1", "1", "0", "0", "0", "tip", "0", "0", "0"], "is not whole"),
    ):
        done = subprocess.run([program, *arguments], capture_output=True, text=True)
        assert done.returncode == 1 and words in done.stderr


def replaced(old, new):
    """Return a change of a text that replaces the first occurrence."""

    def change(text):
        assert old in text
        return text.replace(old, new, 1)

    return change


DAMAGED = {
    "negative size": (replaced("mass real 2 3 3", "mass real 2 -3 3"), "is not whole"),
    "huge size": (replaced("T real 1 35", "T real 1 99999999999999999999"), "is not whole"),
    "huge product": (replaced("mass real 2 3 3", "mass real 2 4000000000 4000000000"), "is not whole"),
    "negative rank": (replaced("mass real 2 3 3", "mass real -2 3 3"), "is not whole"),
    "high rank": (replaced("mass real 2 3 3", "mass real 9 3 3 3 3 3 3 3 3 3"), "is not whole"),
    "another type": (replaced("mass real 2", "mass text 2"), "is not whole"),
    "unknown type": (replaced("mass real", "mass float"), "is not whole"),
    "whole numbers": (replaced("mass real", "mass int"), "is not whole"),
    "another version": (replaced("reduced body 1", "reduced body 2"), "is not whole"),
    "too many arrays": (lambda text: text + "more real 1 0\n" * 40, "is not whole"),
    "end in the middle": (lambda text: text[: text.index("starts int") + 12], "is not whole"),
    "words at the end": (lambda text: text + "and so on\n", "is not whole"),
    "locations as numbers": (
        lambda text: text.replace("locations text 1 3\nback\ngrip\ntip", "locations int 1 3\n1\n2\n3"),
        "locations",
    ),
    "no unknowns": (replaced("size int 1 2\n3\n0", "size int 1 2\n-3\n6"), "size = -3 6"),
    "huge unknowns": (replaced("size int 1 2\n3", "size int 1 2\n1e300"), "is not whole"),
    "other unknowns": (replaced("size int 1 2\n3", "size int 1 2\n4"), "array rows of type real"),
    "one size": (replaced("size int 1 2\n3\n0", "size int 1 1\n3"), "array size of type int"),
    "fewer starts": (lambda text: re.sub(r"starts int 1 4\n\d+\n", "starts int 1 3\n", text), "array starts of type int"),
    "starts outside": (lambda text: re.sub(r"(starts int 1 4\n\d+\n\d+\n\d+)\n\d+", r"\1\n1000", text), "expected rows of nodes"),
    "starts below": (lambda text: re.sub(r"(starts int 1 4\n\d+\n\d+)\n\d+", r"\1\n-1", text), "expected rows of nodes"),
    "fewer loads": (lambda text: re.sub(r"loads real 1 3\n\S+", "loads real 1 2", text), "array loads of type real"),
    "fewer coefficients": (lambda text: re.sub(r"T real 1 35\n\S+", "T real 1 34", text), "array T of type real"),
}


@pytest.mark.parametrize("how", DAMAGED)
def test_the_c_program_refuses_a_damaged_text_before_it_uses_it(how, program, tmp_path):
    """Sizes and types that lead outside of the memory, in builds whose memory is checked."""
    text = ReducedSystem(body_of(prescribed=None), size=3, modes=2, quiet=True).save(tmp_path / "body.txt").read_text()
    change, words = DAMAGED[how]
    (tmp_path / "damaged.txt").write_text(change(text))
    assert (tmp_path / "damaged.txt").read_text() != text
    arguments = [tmp_path / "damaged.txt", "0.01", "1", "0", "0", "0", "tip", "0", "0", "0"]
    done = subprocess.run([program, *arguments], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (1, "") and words in done.stderr and "Sanitizer" not in done.stderr


BAD_NAMES = ["", " tip", "\ttip", "a\nb", "tip\n", "a\rb", "a\u2028b", "x" * 128, "ä" * 64, "\udcff", "a\0b"]


@pytest.mark.parametrize("name", BAD_NAMES)
def test_names_that_the_text_cannot_hold_are_refused(name, tmp_path):
    mesh = ElementMesh(cube(2).p, cube(2).t, node_sets={name: [0, 1]}, boundaries=cube(2).with_boundaries(PLACES).boundaries)
    reduced = ReducedSystem(System(mesh, [LAW], fixed={"back": "xyz"}), size=3, modes=2, quiet=True)
    with pytest.raises(StvkError, match=r"The name of a location is .* \(1 such\); expected one line of 1 to 127 bytes"):
        reduced.save(tmp_path / "body.txt")
    assert not list(tmp_path.iterdir())
    reduced.save(tmp_path / "body.npz")


def test_a_name_of_127_bytes_with_blanks_within_is_kept(tmp_path, program):
    name = "tip of a 'beam' " + "ä" * 55 + "b"
    mesh = ElementMesh(cube(2).p, cube(2).t, node_sets={name: [0, 1]}, boundaries=cube(2).with_boundaries(PLACES).boundaries)
    file = ReducedSystem(System(mesh, [LAW], fixed={"back": "xyz"}), size=3, modes=2, quiet=True).save(tmp_path / "body.txt")
    assert len(name.encode()) == 127
    done = subprocess.run(
        [program, file, "0.01", "1", "0", "0", "0", name, "0", "0", "1"], capture_output=True, text=True, check=True
    )
    assert len(done.stdout.splitlines()) == 2


@pytest.mark.parametrize(("units", "symbols"), [("SI", "m kg s N J"), ("mm-N-MPa", "mm t s N mJ")])
def test_the_text_has_its_units(units, symbols, tmp_path):
    mesh = cube(2).with_boundaries(PLACES)
    reduced = ReducedSystem(System(mesh, [LAW], fixed={"back": "xyz"}, units=units), size=3, modes=2, quiet=True)
    assert reduced.save(tmp_path / "body.txt").read_text().splitlines()[-6:] == ["units text 1 5", *symbols.split()]


def test_the_arrays_are_those_of_the_body(tmp_path, monkeypatch):
    """Every array of the layout is there, with its sizes, and `rows` give the displacements of named locations."""
    body = BODIES["moved"]()
    reduced = ReducedSystem(body, size=5, modes=4, quiet=True)
    monkeypatch.setattr(array_files, "FIRST_LINE", FIRST_LINE)
    arrays = array_files.read(reduced.save(tmp_path / "body.txt"), LAYOUT)
    assert list(arrays) == list(LAYOUT) and arrays["size"].tolist() == [5, 2]
    sizes = {"5": 5, "2": 2, "m": 7, "l": 2, "L": 3, "L+1": 4, "d": 3, "N": len(arrays["nodes"]), "n(n+1)(n+2)(n+3)/24": 330}
    assert {name: array.shape for name, array in arrays.items()} == {
        name: tuple(sizes[size] for size in one.sizes) for name, one in LAYOUT.items()
    }
    z = np.random.default_rng(3).standard_normal(7)
    u = (reduced.columns @ z).reshape(-1, 3)
    assert arrays["lifts"].tolist() == ["grip x", "grip z"] and arrays["locations"].tolist() == ["back", "grip", "tip"]
    for at, name in enumerate(arrays["locations"]):
        part = slice(*arrays["starts"][at : at + 2])
        nodes = arrays["nodes"][part]
        assert nodes.tolist() == np.unique(body.mesh.boundaries[name]).tolist()
        np.testing.assert_allclose(arrays["rows"][part] @ z, u[nodes], rtol=0, atol=1e-14 * np.abs(u).max())
        assert (arrays["positions"][part] == body.mesh.p.T[nodes]).all()
    np.testing.assert_allclose(arrays["mass"][:5, :5], np.eye(5), atol=1e-12)
    np.testing.assert_allclose(
        arrays["loads"], reduced.columns.T @ body.external_force(np.zeros(body.ndofs)), rtol=1e-12, atol=1e-12
    )
    np.testing.assert_allclose(arrays["stiffness"][:5, :5], reduced.tangent(np.zeros(5), 0.0), rtol=1e-12, atol=1e-6)


@pytest.mark.parametrize(
    ("terms", "words"),
    [
        (
            [NeoHookean(young=1e5, poisson=0.3, density=1e3)],
            "A term is no quartic; expected terms whose step does not need the mesh",
        ),
        ([LAW, Pressure("tip", 1.0)], "a load depends on time or displacements; expected constant dead loads"),
        ([LAW, Traction("tip", lambda x, t: t * np.ones((3, x.shape[1])))], "a load depends on time or displacements"),
    ],
)
def test_bodies_whose_steps_need_the_mesh_are_refused(terms, words, tmp_path):
    body = System(cube(2).with_boundaries(PLACES), terms, fixed={"back": "xyz"})
    with pytest.raises(StvkError, match=words):
        ReducedSystem(body, size=3, modes=2, quiet=True).save(tmp_path / "body.txt")
    assert not (tmp_path / "body.txt").exists()


def test_other_names_of_files_are_refused(tmp_path):
    reduced = ReducedSystem(BODIES["free"](), size=3, modes=2, quiet=True)
    with pytest.raises(StvkError, match=r"does not end in \.npz"):
        reduced.save(tmp_path / "body.csv")
    with pytest.raises(StvkError, match=r"does not end in \.npz"):
        ReducedSystem.load(reduced.save(tmp_path / "body.txt"), BODIES["free"]())


def test_the_page_contains_the_whole_layout():
    page = (DOCS / "reference" / "files.md").read_text()
    for name, one in LAYOUT.items():
        assert f"| `{name}` | {' x '.join(one.sizes)} | {one.unit} | {one.what} |" in page, name
    lines = len((DOCS / "reduced.c").read_text().splitlines())
    assert FIRST_LINE in page and f"in {lines} lines of C\nor C++" in page
