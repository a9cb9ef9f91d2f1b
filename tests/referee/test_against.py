"""`verify` judges installed codes, codes in other environments and users' functions, and reports their errors."""

import io
import re
import subprocess
import sys
import tracemalloc
from importlib import metadata
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from bodies import box, sheet

from skfem_stvk import StVK, StvkError, System, verify
from skfem_stvk.referee.against import peer_candidate
from skfem_stvk.referee.peers import PEERS, available, lame, load
from skfem_stvk.referee.peers.elsewhere import Elsewhere
from skfem_stvk.referee.reference import ReferenceStVK, isotropic_tensor
from skfem_stvk.scenes.commands.main import main

MESH = box(1)
YOUNG, POISSON = 1e5, 0.3
CONSTANTS = ["--young", "1e5", "--poisson", "0.3"]


def judged(name, **given):
    with peer_candidate(name, MESH, YOUNG, POISSON, **given) as (candidate, line):
        return verify(MESH, young=YOUNG, poisson=POISSON, candidate=candidate, quiet=True), line


@pytest.fixture(autouse=True)
def without_compiler(monkeypatch):
    """Disable NGSolve's compiler."""
    monkeypatch.setattr("skfem_stvk.referee.peers.ngsolve.shutil.which", lambda program: None)


@pytest.mark.parametrize("name", [name for name in PEERS if PEERS[name].version() is not None])
def test_an_installed_peer_passes(name, part, capsys):
    assert main(["verify", "part.vtu", *CONSTANTS, "--against", PEERS[name].module.upper()]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert f"candidate: {name}" in out and "known differences: " in out


class OldFlex:
    """Stand-in for MuJoCo's flex with the force for `factor` times lambda."""

    def __init__(self, p, t, factor):
        lam, mu = lame(YOUNG, POISSON)
        lam = factor * lam
        young, poisson = mu * (3 * lam + 2 * mu) / (lam + mu), lam / (2 * (lam + mu))
        self._body = ReferenceStVK(p, t, isotropic_tensor(young, poisson, 3, condensed=False))

    def internal_force(self, u):
        return self._body.internal_force(u)


@pytest.mark.parametrize(("version", "factor"), [("3.17.0", 2.0), ("4.0.0", 1.0)])
def test_a_version_with_a_known_error_is_still_judged(version, factor, part, capsys, monkeypatch):
    """The benchmark refuses the version, but `verify` runs it, and F fails the checks that depend on lambda."""

    def made(self, p, t, young, poisson, *, any_version=False):
        from skfem_stvk.referee.peers import require

        self.version = require("MuJoCo", any_version).__version__
        self._flex = OldFlex(p, t, factor)

    old = ModuleType("mujoco")
    old.__version__ = version
    monkeypatch.setitem(sys.modules, "mujoco", old)
    peer = load("MuJoCo")
    monkeypatch.setattr(peer, "__init__", made)
    monkeypatch.setattr(peer, "internal_force", lambda self, u: self._flex.internal_force(u))
    if factor != 1:
        with pytest.raises(StvkError, match=r"Expected mujoco 4\.0 or later, got 3\.17\.0"):
            peer(MESH.p, MESH.t, YOUNG, POISSON)
    assert main(["verify", "part.vtu", *CONSTANTS, "--against", "mujoco", "--out", "report"]) == (1 if factor != 1 else 0)
    assert "<th>candidate</th><td>MuJoCo" in (part / "report" / "report.html").read_text()
    out = " ".join(capsys.readouterr().out.split())
    assert f"candidate: MuJoCo {version}, F; known differences" in out and "Releases before 4.0 take lambda twice" in out
    assert ("lambda doubled: your lambda is 2.000 x, your mu 1.000 x" in out) == (factor != 1)
    if factor != 1:
        report, _ = judged("mujoco")
        assert report.named.names == ["lambda doubled"]
        assert {(r.check, r.quantity) for r in report.failures("candidate")} == {("agreement", "F"), ("closed forms", "P")}


USERS = """
import numpy as np
from skfem_stvk.referee.reference import ReferenceStVK, isotropic_tensor
class Mine:
    def __init__(self, p, t, young, poisson, factor=1.0):
        self.body, self.factor = ReferenceStVK(p, t, isotropic_tensor(young, poisson, 3, condensed=False)), factor
    def energy(self, u): return self.body.energy(u)
    def internal_force(self, u): return self.factor * self.body.internal_force(u)
def wrong(p, t, young, poisson): return Mine(p, t, young, poisson, factor=2.0)
def spoiling(p, t, young, poisson):
    mine = Mine(p.copy(), t.copy(), young, poisson)
    p *= np.nan; t *= 0
    return mine
def raising(p, t, young, poisson): raise KeyError("no such thing")
def leaving(p, t, young, poisson): raise SystemExit(3)
def empty(p, t, young, poisson): return None
number = 3
"""


def test_a_users_function_makes_a_candidate(part, capsys):
    (part / "users_own_code.py").write_text(USERS)
    run = ["verify", "part.vtu", *CONSTANTS, "--against"]
    assert main([*run, "users_own_code.py:Mine"]) == 0
    assert main([*run, "users_own_code:spoiling"]) == 0
    assert "candidate: the result of users_own_code:spoiling" in capsys.readouterr().out
    assert main([*run, "users_own_code:wrong"]) == 1
    out = " ".join(capsys.readouterr().out.split())
    assert "failed agreement, F of candidate" in out and "Fault This explains" in " ".join(out.split())
    for function, words in {
        "raising": "raised KeyError: 'no such thing'",
        "leaving": "raised SystemExit: 3",
        "empty": "users_own_code:empty returned None; expected an object with at least one of energy",
        "number": "there is no function 'number'",
        "Mein": "Did you mean 'Mine'?",
    }.items():
        assert main([*run, f"users_own_code:{function}"]) == 2
        assert words in " ".join(capsys.readouterr().err.split())
    (part / "broken_code.py").write_text("import nothing_of_this_name")
    for name, words in {
        "broken_code:f": "No module named 'nothing_of_this_name'",
        "no_file.py:f": "no_file.py is not a Python file",
        "abaqus": "known: 'DOLFINx', 'FElupe'",
        ":f": "expected module:function",
        "f:": "known: 'DOLFINx', 'FElupe'",
        "mujoco:a:b": "expected no function for MuJoCo: only JAX and PyTorch",
    }.items():
        assert main([*run, name]) == 2
        assert words in " ".join(capsys.readouterr().err.split())


def stand_in(name):
    """Return a stand-in for JAX or PyTorch with the required functions, which uses complex-step derivatives."""

    def gradient(f):
        def of(u, *others):
            values = np.empty(u.shape)
            for at in np.ndindex(u.shape):
                moved = u.astype(complex)
                moved[at] += 1e-30j
                values[at] = f(moved, *others).imag / 1e-30
            return values

        return of

    def hessian(f):
        def of(u, *others):
            values = np.empty(2 * u.shape)
            for at in np.ndindex(u.shape):
                ends = []
                for sign in (-1, 1):
                    moved = u.copy()
                    moved[at] += sign * 1e-5
                    ends.append(gradient(f)(moved, *others))
                values[at] = (ends[1] - ends[0]) / 2e-5
            return values

        return of

    def vmap(f):
        return lambda *arrays: np.array([f(*row) for row in zip(*arrays, strict=True)])

    calls = {"grad": gradient, "hessian": hessian, "vmap": vmap}
    if name == "JAX":
        config, known = SimpleNamespace(update=lambda key, value: None), {"numpy": np, "jit": lambda f: f}
        return SimpleNamespace(__version__="0.0", config=config, **known, **calls)
    return SimpleNamespace(__version__="0.0", func=SimpleNamespace(**calls), from_numpy=lambda array: array)


def density(F):
    lam, mu = lame(YOUNG, POISSON)
    E = (F.T @ F - np.eye(3)) / 2
    return lam / 2 * E.trace() ** 2 + mu * (E * E).sum()


def doubled(F):
    return density(F) + lame(YOUNG, POISSON)[0] / 2 * ((F.T @ F).trace() / 2 - 1.5) ** 2


@pytest.mark.parametrize("name", ["JAX", "PyTorch"])
def test_an_energy_density_is_differentiated_by_a_library(name, monkeypatch):
    """W and F of the stand-in are exact, K has finite differences; a density with lambda doubled gives another energy."""
    monkeypatch.setitem(sys.modules, PEERS[name].module, stand_in(name))
    body, u = System(MESH, StVK(young=YOUNG, poisson=POISSON)), 0.1 * np.random.default_rng(0).standard_normal(MESH.p.size)
    peer = load(name)
    for law in (None, density):
        model = peer(MESH.p, MESH.t, YOUNG, POISSON, density=law)
        assert model.energy(u) == pytest.approx(body.energy(u), rel=1e-13)
        force = body.internal_force(u)
        assert np.abs(model.internal_force(u) - force).max() < 1e-13 * np.abs(force).max()
    K = body.tangent(u)
    assert abs(model.tangent(u) - K).max() < 1e-8 * abs(K).max()
    wrong = peer(MESH.p, MESH.t, YOUNG, POISSON, density=doubled)
    assert wrong.energy(u) > 1.01 * body.energy(u)


def test_a_density_is_found_by_its_name(part, monkeypatch):
    (part / "users_density.py").write_text("def W(F): return (F * F).sum()")
    monkeypatch.setitem(sys.modules, "torch", stand_in("PyTorch"))
    with peer_candidate("torch:users_density.py:W", MESH, YOUNG, POISSON) as (on, line):
        assert line.startswith("users_density.py:W in PyTorch 0.0") and on(MESH).energy(np.zeros(24)) == pytest.approx(3.0, rel=0.2)


def test_peers_refuse_elements_that_are_not_in_their_row():
    with pytest.raises(StvkError, match="the mesh has triangles in 2D; expected tetrahedra in 3D"):
        peer_candidate("mujoco", sheet(1), YOUNG, POISSON).__enter__()
    with pytest.raises(StvkError, match=r"quadratic tetrahedra in 3D; .*--degree 1"):
        peer_candidate("ngsolve", MESH.with_degree(2), YOUNG, POISSON).__enter__()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--against", "mujoco"], "--against needs --young"),
        (["--young", "nan", "--poisson", "0.3", "--against", "mujoco"], "young = nan; expected finite values"),
        (["--young", "1", "--poisson", "0.5", "--against", "mujoco"], "poisson .*; expected values in"),
        ([*CONSTANTS, "--python", "python3"], "--python needs --against"),
        ([*CONSTANTS, "--against", "felupe", "--quadrature", "exact"], "--quadrature with --against"),
        ([*CONSTANTS, "--against", "felupe", "--results", "x"], "--against with --results|--young"),
        ([*CONSTANTS, "--against", "math:sin", "--python", "python3"], "--python is for peers"),
        ([*CONSTANTS, "--against", "mujoco", "--python", "no/python"], "'no/python' cannot be run"),
    ],
)
def test_conflicting_options_are_refused(arguments, words, part, capsys):
    assert main(["verify", *([] if arguments[0] == "--against" else ["part.vtu"]), *arguments]) == 2
    assert re.search(words, " ".join(capsys.readouterr().err.split()))


# another environment


TOY = """
import sys
import numpy as np
from scipy.sparse import csr_matrix
from skfem_stvk.referee.peers import require

class FElupe:
    name = "FElupe"
    def __init__(self, p, t, young, poisson):
        self.version = "0.1"
        self.n = p.size
        print("this goes to standard error, and is no answer")
    def energy(self, u): return float(u @ u) / 2
    def internal_force(self, u):
        if u[0] == 7: raise ValueError("seven")
        if u[0] == 9: import time; time.sleep(60)
        if u[0] == 8: print("eight", file=sys.stderr); sys.stderr.flush(); import os; os._exit(5)
        return u.copy()
    def tangent(self, u): return csr_matrix(np.eye(self.n))
"""


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """Create a package with another FElupe for the other process, and return a function that starts it."""
    import skfem_stvk.referee.peers.process as module

    there = Path(module.__file__).parents[2]
    package = ("__init__.py", "__init__.pyi", "arguments.py", "errors.py", "npz.py", "referee/__init__.py")
    for part in (*package, *(f"referee/peers/{name}.py" for name in ("__init__", "process", "elsewhere"))):
        (tmp_path / "referee" / "peers").mkdir(parents=True, exist_ok=True)
        (tmp_path / part).write_text((there / part).read_text())
    (tmp_path / "referee" / "peers" / "felupe.py").write_text(TOY)
    monkeypatch.setattr(module, "__file__", str(tmp_path / "referee" / "peers" / "process.py"))
    return lambda: Elsewhere(sys.executable, "FElupe", MESH.p, MESH.t, YOUNG, POISSON)


def test_a_peer_in_another_process_gives_the_same_results(toy):
    u = np.arange(24.0)
    with toy() as peer:
        assert (peer.name, peer.version, peer.methods) == ("FElupe", "0.1", ["energy", "internal_force", "tangent"])
        assert peer.energy(u) == u @ u / 2 and (peer.internal_force(u) == u).all()
        assert (peer.tangent(u).toarray() == np.eye(24)).all() and not hasattr(peer, "hessian")
        u[0] = 7
        with pytest.raises(StvkError, match="ValueError: seven"):
            peer.internal_force(u)
        assert peer.energy(u) == u @ u / 2
        u[0] = 8
        with pytest.raises(StvkError, match=r"has ended, with exit code 5: .*eight"):
            peer.internal_force(u)
        with pytest.raises(StvkError, match="has ended"):
            peer.energy(u)


def test_a_process_that_does_not_answer_is_ended(toy, monkeypatch):
    with toy() as peer:
        monkeypatch.setattr("skfem_stvk.referee.peers.elsewhere.LONGEST_ANSWER", 0.5)
        with pytest.raises(StvkError, match=r"gave no answer within 0\.5 s, and was ended"):
            peer.internal_force(np.full(24, 9.0))
        with pytest.raises(StvkError, match="has ended"):
            peer.energy(np.zeros(24))


DYING = """
import signal
from skfem_stvk import StvkError
from skfem_stvk.referee.peers import elsewhere, process
signal.signal(signal.SIGPIPE, signal.SIG_DFL)
process.START = "import os; os._exit(7)"
try:
    elsewhere.Elsewhere(sys.executable, "FElupe", np.zeros((3, 100_000)), np.zeros((4, 1), np.int32), 1.0, 0.3)
except StvkError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGPIPE")
def test_a_process_that_dies_is_reported_even_if_broken_pipes_kill():
    """The request is larger than a pipe's buffer, and SIGPIPE has its default action, as after `gmsh.initialize()`."""
    done = subprocess.run([sys.executable, "-c", f"import sys\nimport numpy as np\n{DYING}"], capture_output=True, text=True)
    assert done.returncode == 0 and "has ended, with exit code 7" in done.stdout, done


def test_a_process_that_dies_does_not_end_the_report(toy):
    with toy() as peer:
        peer.internal_force(np.zeros(24))
        peer._process.kill()
        report = verify(MESH, young=YOUNG, poisson=POISSON, candidate=peer, quiet=True)
    assert not report.passed and any("has ended" in result.reason for result in report.results)


def test_the_other_environment_needs_only_the_peers_of_this_package():
    """A process without scikit-fem, numba, meshio, rich and pydantic can list the peers and load one."""
    from skfem_stvk.referee.peers.process import START

    hidden = "import sys\nfor name in ('skfem', 'numba', 'meshio', 'rich', 'pydantic'): sys.modules[name] = None\n"
    folder = str(Path(sys.modules["skfem_stvk"].__file__).parent)
    code = hidden + START.replace(
        ".serve()", "; from skfem_stvk.referee.peers import available, load; print(list(available())); load('MuJoCo')"
    )
    done = subprocess.run([sys.executable, "-I", "-c", code, folder, "elsewhere"], capture_output=True, text=True)
    assert done.returncode == 0 and eval(done.stdout) == list(PEERS), done.stderr


@pytest.mark.parametrize(
    "words", ["yes", "head -c 8 /dev/zero | tr '\\0' '\\1'; yes", "printf '\\0\\0\\0\\0\\0\\0\\0\\5hello'; cat > /dev/null"]
)
def test_a_program_that_is_not_python_is_an_error(words, tmp_path):
    program = tmp_path / "program"
    program.write_text(f"#!/bin/sh\n{words}\n")
    program.chmod(0o755)
    with pytest.raises(StvkError, match=r"gave an invalid answer .* Check that it is a Python"):
        Elsewhere(program, "FElupe", MESH.p, MESH.t, YOUNG, POISSON)


def npz(save=np.savez, **arrays):
    """Return the bytes of an NPZ file."""
    file = io.BytesIO()
    save(file, **arrays)
    return file.getvalue()


def with_method(content, method):
    """Return the same NPZ file with another compression method of each member."""
    changed = bytearray(content)
    for head, offset in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        at = content.find(head)
        while at >= 0:
            changed[at + offset : at + offset + 2] = method.to_bytes(2, "little")
            at = content.find(head, at + 1)
    return bytes(changed)


PACKED = npz(np.savez_compressed, name=np.zeros(1000), version=np.array("1"), methods=np.array(["energy"]))
ANSWERS = {
    "no name": npz(version=np.array("1"), methods=np.array(["energy"])),
    "no methods": npz(name=np.array("a"), version=np.array("1")),
    "compressed": PACKED,
    "an unknown compression": with_method(npz(name=np.array("a")), 77),
    "corrupt compressed data": with_method(npz(name=np.array("a")), 8),
    "a header with one bit flipped": npz(name=np.zeros(10_000)).replace(b"{'descr'", b"z'descr'"),
    "objects": npz(name=np.array([None])),
}


def program_of(answer, folder, length=None):
    """Return a program that answers the first request with these bytes."""
    (folder / "answer").write_bytes((len(answer) if length is None else length).to_bytes(8, "big") + answer)
    program = folder / "program"
    program.write_text(f"#!/bin/sh\ncat {folder}/answer; cat > /dev/null\n")
    program.chmod(0o755)
    return program


@pytest.mark.parametrize("name", ANSWERS)
def test_a_malformed_answer_is_refused_with_a_readable_message(name, tmp_path):
    with pytest.raises(StvkError, match=r"gave an invalid answer .* Check that it is a Python"):
        Elsewhere(program_of(ANSWERS[name], tmp_path), "FElupe", MESH.p, MESH.t, YOUNG, POISSON)


def test_a_child_of_the_other_python_is_ended_with_it(tmp_path, monkeypatch):
    """A child that outlives its parent would keep the pipe of the answers open, so that the referee waits for it."""
    monkeypatch.chdir(tmp_path)
    program = tmp_path / "program"
    program.write_text("#!/bin/sh\n(sleep 20; touch outlived) &\nexit 3\n")
    program.chmod(0o755)
    with pytest.raises(StvkError, match="has ended, with exit code 3"):
        Elsewhere(program, "FElupe", MESH.p, MESH.t, YOUNG, POISSON)
    assert not (tmp_path / "outlived").exists()


@pytest.mark.parametrize("length", [2**33, 2**20 + 16 * MESH.p.size**2])
def test_an_answer_needs_no_more_memory_than_its_bytes(length, tmp_path):
    """A declared length, beyond the largest answer on this mesh or equal to it, allocates less than 4 MiB."""
    program = tmp_path / "program"
    program.write_text(f"#!{sys.executable}\nimport sys\nsys.stdout.buffer.write(({length}).to_bytes(8, 'big'))\n")
    program.chmod(0o755)
    tracemalloc.start()
    try:
        with pytest.raises(StvkError, match="expected at most" if length == 2**33 else "has ended"):
            Elsewhere(program, "FElupe", MESH.p, MESH.t, YOUNG, POISSON)
        assert tracemalloc.get_traced_memory()[1] < 2**22
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("python", ["a\0", "", "x" * 5000])
def test_an_invalid_path_is_refused(python):
    with pytest.raises(StvkError, match=r"python = .*; expected the path of another Python"):
        Elsewhere(python, "FElupe", MESH.p, MESH.t, YOUNG, POISSON)


def test_decreasing_row_pointers_are_an_error(toy, tmp_path):
    """Row pointers that SciPy's check accepts, because the last pointer is 0, are an error and crash no process."""
    file = tmp_path / "referee" / "peers" / "felupe.py"
    wrong = "K = csr_matrix(np.eye(self.n)); K.indptr[1], K.indptr[2:] = 10**7, 0; return K"
    file.write_text(file.read_text().replace("return csr_matrix(np.eye(self.n))", wrong))
    with toy() as peer, pytest.raises(StvkError, match="the row pointers of its matrix decrease"):
        peer.tangent(np.zeros(24))


def test_a_python_without_the_peer_is_an_error(monkeypatch):
    """A peer that this Python lacks (JAX, PyTorch or DOLFINx) is an error with its install command."""
    name = next(name for name, package in PEERS.items() if package.version() is None)
    with pytest.raises(StvkError, match=f"cannot be imported.*{available()[name].split()[0]}"):
        Elsewhere(sys.executable, name, MESH.p, MESH.t, YOUNG, POISSON)


def test_the_page_contains_every_row():
    page = " ".join((Path(__file__).parents[2] / "docs" / "measurements" / "peers.md").read_text().split())
    for name, of in PEERS.items():
        assert of.deviates and of.tried and of.elements, name
        known = f"Known to do otherwise: {of.deviates}.{' ' * bool(of.why)}{of.why} Judged: {of.tried}. `{of.install}`"
        assert f"- **{name}** (`--against {of.module}`): {of.gives} of {' and '.join(of.elements)}. {known}" in page, name


def test_no_package_under_the_gpl_is_a_dependency():
    """No required dependency has the GPL or is a peer; extras are optional."""
    lines = (Path(__file__).parents[2] / "pyproject.toml").read_text().split("dependencies = [")[1].split("]")[0]
    needed = re.findall(r'"([\w-]+)', lines)
    assert len(needed) > 10 and not set(needed) & {package.distribution for package in PEERS.values()}
    for name in needed:
        try:
            facts = metadata.metadata(name)
        except metadata.PackageNotFoundError:  # of another version of Python
            continue
        licence = [facts.get("License-Expression"), *(facts.get_all("Classifier") or [])]
        assert not re.search(r"\bA?GPL|General Public", " ".join(filter(None, licence))), name
