"""Test vectors are correctly rounded and complete, and `verify_results` judges results computed from them."""

import re
import shutil
import subprocess
import zipfile
from fractions import Fraction
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from bodies import MESHES, box, sheet

from skfem_stvk import (
    Anisotropic,
    EdgeNetwork,
    ElementMesh,
    MaterialError,
    StVK,
    StvkError,
    System,
    export_vectors,
    published_vectors,
    verify_results,
)
from skfem_stvk.referee import vectors as module
from skfem_stvk.referee.exact import ExactStVK
from skfem_stvk.referee.read_back import folders_of_results
from skfem_stvk.referee.vectors import LAYOUT, PUBLISHED, RESULTS, Vectors, read_vectors
from skfem_stvk.results.array_files import write_npz, write_text
from skfem_stvk.scenes.commands.main import main
from validation.vectors import FOLDER, made

DOCS = Path(__file__).parents[2] / "docs"
SIMPLICES = ("tetrahedron", "block", "membrane")


@pytest.fixture(scope="module")
def published():
    return {name: published_vectors(name) for name in PUBLISHED}


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_vectors_are_reproduced_bit_for_bit(name, published, monkeypatch):
    """In the published states, new vectors equal the published vectors bit for bit; other machines may draw other states."""
    monkeypatch.setattr(module, "named_states", lambda *given: published[name].states)
    assert made(name).arrays["digest"] == published[name].arrays["digest"]
    assert sum(file.stat().st_size for file in FOLDER.glob("*.npz")) < 400_000


def exactly(vectors, s):
    """Return W, F and K of tetrahedra, computed in fractions from E and nu."""
    X, u = (np.vectorize(Fraction, otypes=[object])(vectors.arrays[name]) for name in ("nodes", "u"))
    u = u[s].reshape(X.shape)
    W, F, K = Fraction(0), np.full(u.size, Fraction(0)), np.full((u.size, u.size), Fraction(0))
    one = np.array([[Fraction(int(i == j)) for i in range(3)] for j in range(3)])
    for nodes, E, nu in zip(*(vectors.arrays[name] for name in ("elements", "young", "poisson")), strict=True):
        E, nu = Fraction(float(E)), Fraction(float(nu))
        lam, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
        a, b, c = X[nodes[1:]] - X[nodes[0]]
        det = a @ np.cross(b, c)
        g = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)]) / det
        g = np.vstack([-g.sum(axis=0), g])
        G = one + u[nodes].T @ g
        E = (G.T @ G - one) / 2
        S = lam * np.trace(E) * one + 2 * mu * E
        V, dofs = abs(det) / 6, (3 * nodes[:, None] + np.arange(3)).ravel()
        W += V * (S * E).sum() / 2
        F[dofs] += V * (g @ S @ G.T).ravel()
        q, B = g @ G.T, G @ G.T
        blocks = [
            [
                V * ((lam * np.outer(q[i], q[j]) + mu * np.outer(q[j], q[i]) + mu * (g[i] @ g[j]) * B) + (g[i] @ S @ g[j]) * one)
                for j in range(4)
            ]
            for i in range(4)
        ]
        K[np.ix_(dofs, dofs)] += np.block(blocks)
    return float(W), F.astype(float), K.astype(float)


@pytest.mark.parametrize(("name", "s"), [("tetrahedron", 3), ("block", 4)])
def test_every_number_is_rounded_once(name, s, published):
    """W, F and K equal bit for bit the values in fractions, whose conversion to double is the only rounding."""
    vectors = published[name]
    W, F, K = exactly(vectors, s)
    assert (vectors.arrays["W"][s], vectors.arrays["F"][s].tolist()) == (W, F.tolist())
    u, model = vectors.arrays["u"][s], vectors.model()
    assert (model.tangent(u).toarray() == K).all()
    arrays = vectors.arrays
    blocks = [K.reshape(len(K) // 3, 3, -1, 3)[a, :, b] for a, b in arrays["K_node_pairs"]]
    assert (arrays["K_blocks"][s] == blocks).all()


@pytest.mark.parametrize("name", MESHES)
def test_the_coefficients_of_edges_and_pairs_equal_those_of_the_network(name):
    mesh = MESHES[name] if MESHES[name].nt < 60 else box(1)
    sections = {1: {"area": 0.2}, 2: {"thickness": 0.3, "plane": "stress"}}.get(mesh.k, {})
    law = StVK(young=2.0, poisson=0.3, **sections)
    arrays, network = export_vectors(mesh, law, quiet=True).arrays, EdgeNetwork.of(mesh, law)
    L = network.L.toarray()
    assert arrays["edges"].tolist() == network.edges.T.tolist()
    scale = np.abs(L).max()
    np.testing.assert_allclose(arrays["edge_coefficients"], np.diag(L), rtol=0, atol=1e-14 * scale)
    i, j = arrays["pairs"].T
    np.testing.assert_allclose(arrays["pair_coefficients"], L[i, j], rtol=0, atol=1e-14 * scale)
    L[i, j] = L[j, i] = 0
    assert np.abs(L - np.diag(np.diag(L))).max() == 0


def from_points(vectors, s):
    """Return W, F and K of an isotropic body from points, dN, R_inverse, volumes and lame only, as another program would."""
    a = vectors.arrays
    X, u = a["nodes"], a["u"][s].reshape(a["nodes"].shape)
    n, d = X.size, X.shape[1]
    W, F, K = 0.0, np.zeros_like(X), np.zeros((n, n))
    for e, q in np.ndindex(a["volumes"].shape):
        nodes, V, (lam, mu) = a["elements"][e], a["volumes"][e, q], a["lame"][e]
        g = a["dN"][q] @ a["R_inverse"][e, q]
        G, H = (X[nodes] - X[nodes[0]]).T @ g, (u[nodes] - u[nodes[0]]).T @ g
        E = (G.T @ H + H.T @ G + H.T @ H) / 2
        f = G + H
        S = lam * np.trace(E) * np.eye(len(E)) + 2 * mu * E
        W += V * (S * E).sum() / 2
        F[nodes] += V * g @ S @ f.T
        r, dofs = g @ f.T, (d * nodes[:, None] + np.arange(d)).ravel()
        k = lam * np.einsum("ai,bj->aibj", r, r) + mu * np.einsum("bi,aj->aibj", r, r)
        k += np.einsum("ab,ij->aibj", mu * g @ g.T, f @ f.T) + np.einsum("ab,ij->aibj", g @ S @ g.T, np.eye(d))
        K[np.ix_(dofs, dofs)] += V * k.reshape(len(dofs), -1)
    return W, F.ravel(), K


@pytest.mark.parametrize("name", ["curved", "hexahedra", "curved sheet"])
def test_points_and_triangles_suffice_for_other_elements(name, published, tmp_path):
    if name == "curved sheet":  # in space, where each element has its own axes
        flat = sheet(1).with_degree(2)
        bent = ElementMesh(np.vstack([flat.p, 0.2 * flat.p[0] * flat.p[1]]), flat.t, element=flat.element)
        vectors = export_vectors(bent, StVK(young=2.0, poisson=0.3, thickness=0.1), quadrature="exact", quiet=True)
    else:
        vectors = published[name]
    found = [from_points(vectors, s) for s in range(len(vectors.states))]
    pairs, d = vectors.arrays["K_node_pairs"], vectors.mesh.d
    blocks = [[K.reshape(-1, d, vectors.mesh.nv, d)[a, :, b] for a, b in pairs] for _, _, K in found]
    vectors.save(tmp_path)
    write_npz(
        tmp_path / "results.npz",
        {"W": np.array([W for W, _, _ in found]), "F": np.array([F for _, F, _ in found])} | {"K_blocks": np.array(blocks)},
    )
    report = verify_results(tmp_path)
    assert report.passed, str(report)
    assert {result.quantity for result in report.results if result.check == "agreement"} == {"W", "F", "K"}


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """Return the C program of the docs, compiled by the system's compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler, cc")
    file = tmp_path_factory.mktemp("c") / "vectors"
    subprocess.run([compiler, "-O2", "-Wall", "-Wextra", "-o", file, DOCS / "vectors.c"], check=True, capture_output=True)
    return file


def test_the_c_program_passes_and_a_missing_pair_fails(program, tmp_path, capsys):
    """W, F and K that the C program computes from L pass; a pair coefficient of zero fails."""
    assert main(["export", "--text", "--out", str(tmp_path)]) == 0
    for name in SIMPLICES:
        subprocess.run([program, tmp_path / name / "vectors.txt", tmp_path / name / "results.txt"], check=True)
    assert main(["verify", "--results", str(tmp_path), "--out", str(tmp_path / "reports")]) == 0
    out = capsys.readouterr().out
    assert out.count("PASSED: 49 passed, 0 failed") == 3 and "by vectors.c" in out
    assert (tmp_path / "reports" / "block" / "report.html").stat().st_size > 5_000
    text = (tmp_path / "block" / "vectors.txt").read_text()
    pair = text[text.index("pair_coefficients") :].splitlines()[1]
    (tmp_path / "block" / "other.txt").write_text(text.replace(f"\n{pair}\n", "\n0.0\n", 1))
    subprocess.run([program, tmp_path / "block" / "other.txt", tmp_path / "block" / "results.txt"], check=True)
    assert main(["verify", "--results", str(tmp_path / "block")]) == 1
    assert "NOT PASSED" in capsys.readouterr().out


def test_the_c_program_refuses_vectors_of_other_elements(program, published, tmp_path):
    published["hexahedra"].save(tmp_path, text=True)
    done = subprocess.run([program, tmp_path / "vectors.txt", tmp_path / "results.txt"], capture_output=True, text=True)
    assert done.returncode == 1 and "there is no edges" in done.stderr


def test_the_c_program_reports_unreadable_files(program, published, tmp_path):
    published["block"].save(tmp_path, text=True)
    whole = tmp_path / "vectors.txt"
    (tmp_path / "cut.txt").write_text(whole.read_text()[:3000])
    for given, words in (("cut.txt", "is not whole"), ("none.txt", "usage"), ("vectors.txt", "usage")):
        out = tmp_path / ("none/results.txt" if given == "vectors.txt" else "results.txt")
        done = subprocess.run([program, tmp_path / given, out], capture_output=True, text=True)
        assert done.returncode == 1 and words in done.stderr


def test_a_part_is_exported_and_judged_by_commands(tmp_path, capsys):
    import meshio

    mesh = box(1)
    meshio.Mesh(mesh.p.T, [("tetra", mesh.t.T)]).write(tmp_path / "part.vtu")
    arguments = [str(tmp_path / "part.vtu"), "--young", "1e5", "--poisson", "0.3", "--out", str(tmp_path / "v")]
    assert main(["export", "--text", *arguments]) == 0
    vectors, body = read_vectors(tmp_path / "v"), System(mesh, StVK(young=1e5, poisson=0.3))
    assert vectors.title == "part" and vectors.arrays["digest"] == read_vectors(tmp_path / "v" / "vectors.txt").arrays["digest"]
    readme = (tmp_path / "v" / "README.txt").read_text()
    assert all(f"\n{name} " in readme for name in vectors.arrays)
    u = vectors.arrays["u"]
    (tmp_path / "theirs").mkdir()
    write_text(tmp_path / "theirs" / "results.txt", {"F": np.array([body.internal_force(one) for one in u])})
    assert main(["verify", "--results", str(tmp_path / "theirs"), "--vectors", str(tmp_path / "v")]) == 0
    assert main(["verify", "--results", str(tmp_path / "theirs")]) == 2
    assert main(["export", *arguments, "--degree", "2", "--quadrature", "exact"]) == 0
    assert not (tmp_path / "v" / "vectors.txt").exists()  # the text of the other vectors is removed
    assert read_vectors(tmp_path / "v").arrays["points"].shape == (14, 3)
    assert main(["export", "--young", "1", "--out", str(tmp_path / "v")]) == 2
    assert main(["verify", "--results", str(tmp_path / "theirs"), "--young", "1"]) == 2
    assert main(["verify", "--vectors", str(tmp_path / "v")]) == 2


@pytest.mark.parametrize("mesh", [box(3), sheet(6), box(2).with_degree(2)], ids=lambda mesh: mesh.kind)
def test_the_sizes_of_the_files_are_said_before_anything_is_computed(mesh, tmp_path, capsys, monkeypatch):
    """The line is there when the first value is computed. The files are as large as it says, within 40 %."""
    said = []

    def first(*given):
        said.append(capsys.readouterr().out)
        return ExactStVK.energy_and_force(*given)

    monkeypatch.setattr(module, "ExactStVK", type("Watched", (ExactStVK,), {"energy_and_force": first}))
    folder = export_vectors(mesh, young=1e5, poisson=0.3).save(tmp_path, text=True)
    npz, text = map(float, re.findall(r"([\d.e+-]+) MB", said[0]))
    for size, name in ((npz, "vectors.npz"), (text, "vectors.txt")):
        assert 0.6 < (folder / name).stat().st_size / 1e6 / size < 1.4


def test_export_shows_progress_without_a_terminal(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("skfem_stvk.terminal.LINE_INTERVAL", 0.0)
    export_vectors(sheet(1), young=1e5, poisson=0.3)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 10 and re.fullmatch(r"export: 1 of 9, coefficients, [\d.e-]+ s", lines[1])
    assert re.fullmatch(r"export: 9 of 9, reflected random, [\d.e-]+ s", lines[9])
    export_vectors(sheet(1), young=1e5, poisson=0.3, quiet=True)
    assert capsys.readouterr().out == ""


def right(vectors, *names):
    return {name: vectors.arrays[name].copy() for name in names}


def judged(tmp_path, vectors, arrays):
    write_text(tmp_path / "results.txt", arrays)
    return verify_results(tmp_path, vectors)


def spoil(array, how):
    array = array.copy()
    if how == "off by 1e-11":
        array[4] *= 1 + 1e-11
    elif how == "NaN":
        array.reshape(len(array), -1)[2, 0] = np.nan
    elif how == "infinite":
        array.reshape(len(array), -1)[2, 0] = -np.inf
    else:
        array = -array
    return array


@pytest.mark.parametrize(
    ("name", "how"), list(product(("W", "F", "K_values", "K_blocks"), ("off by 1e-11", "NaN", "infinite", "sign")))
)
def test_a_wrong_value_fails(name, how, published, tmp_path):
    vectors = published["block"]
    assert judged(tmp_path, vectors, right(vectors, name)).passed
    report = judged(tmp_path, vectors, {name: spoil(vectors.arrays[name], how)})
    assert not report.passed and {r.quantity for r in report.failures("candidate") if r.check == "agreement"} == {name[0]}


@pytest.mark.few
@pytest.mark.parametrize("how", ["NaN", "infinite"])
@pytest.mark.parametrize("name", ["W", "F", "K_values", "K_blocks"])
@pytest.mark.parametrize("of", PUBLISHED)
def test_one_entry_of_a_file_that_is_not_a_number_is_named(of, name, how, published, tmp_path):
    """The report has the quantity, the degree of freedom and the state of the only entry that is not finite."""
    vectors = published[of]
    arrays = right(vectors, "W", "F", name)
    (one,) = judged(tmp_path, vectors, arrays | {name: spoil(vectors.arrays[name], how)}).named.explanations
    where = {"W": "", "F": " at dof 0 (node 0, x)"}.get(name, " in row 0, column 0")
    state = list(vectors.states)[2]
    assert one.name == "one entry not a number" and one.words.startswith(f"{name[0]} is not finite{where} in {state}; all other")


def test_some_states_in_another_order_are_enough(published, tmp_path):
    vectors = published["block"]
    some = [6, 1]
    arrays = {name: vectors.arrays[name][some] for name in ("states", "W", "F")} | right(vectors, "digest")
    report = judged(tmp_path, None, arrays)
    assert report.passed and {r.state for r in report.results} == {"small random strain", "large random"}
    arrays["states"] = arrays["states"][::-1]
    assert not judged(tmp_path, None, arrays).passed


@pytest.mark.parametrize("name", PUBLISHED)
def test_faults_of_results_are_named(name, published, tmp_path):
    """Faults get the same names as faults of candidates, although values are known only in the states of the vectors."""
    vectors = published[name]
    F, blocks = vectors.arrays["F"], vectors.arrays["K_blocks"]
    faults = {
        "F x -1": {"F": -F},
        "blocks of K transposed": {"K_blocks": np.swapaxes(blocks, 2, 3)},
        "results component by component": {"F": F.reshape(len(F), -1, vectors.mesh.d).swapaxes(1, 2).reshape(F.shape)},
        "a constant force": {"F": F + np.eye(F.shape[1])[2]},
    }
    for fault, arrays in faults.items():
        assert fault in judged(tmp_path, vectors, arrays).named.names
    right_ones = judged(tmp_path, vectors, right(vectors, "W", "F", "K_blocks"))
    assert right_ones.passed and right_ones.named is None


@pytest.mark.parametrize("name", [name for name in PUBLISHED if name != "membrane"])
def test_a_doubled_lambda_is_named_in_results(name, published, tmp_path):
    """A doubled lambda is named, also for two materials, by a fit to the states of the vectors."""
    vectors = published[name]
    E, nu = vectors.arrays["young"], vectors.arrays["poisson"]
    lam, mu = 2 * E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    body = System(vectors.mesh, StVK(young=mu * (3 * lam + 2 * mu) / (lam + mu), poisson=lam / (2 * (lam + mu))))
    report = judged(tmp_path, vectors, {"F": np.array([body.internal_force(u) for u in vectors.arrays["u"]])})
    assert report.named.names == ["lambda doubled"] and "your lambda is 2.000 x, your mu 1.000 x" in str(report)


@pytest.mark.few
@pytest.mark.parametrize("digits", ["float32", "%.7g", "%g"])
@pytest.mark.parametrize("name", PUBLISHED)
def test_single_precision_is_named_in_results(name, digits, published, tmp_path):
    """Single precision is named if one quantity or all quantities have it, and if only some states are given."""
    vectors = published[name]

    def rounded(array):
        return array.astype(np.float32).astype(float) if digits == "float32" else np.char.mod(digits, array).astype(float)

    all_three, some = right(vectors, "W", "F", "K_values"), [3, 4]
    for arrays in (
        {"F": rounded(all_three["F"])},
        {of: rounded(array) for of, array in all_three.items()},
        all_three | {"F": rounded(all_three["F"])},
        {"states": vectors.arrays["states"][some], "W": rounded(all_three["W"][some])},
    ):
        assert judged(tmp_path, vectors, arrays).named.names == ["single precision"]
    off = {"F": all_three["F"] * (1 + 1e-6 * np.cos(np.arange(all_three["F"].shape[1])))}
    assert judged(tmp_path, vectors, off).named.names == []


def test_values_that_are_not_finite_are_named_by_their_states(published, tmp_path):
    """States with NaN or infinity are named, and hypotheses explain only the finite values."""
    vectors = published["block"]
    F = vectors.arrays["F"].copy()
    F[[0, 3], [5, 6]] = np.nan, np.inf
    (line,) = judged(tmp_path, vectors, {"F": F}).named.lines()
    assert (
        "F has entries that are not finite in: rotated strained, rest. In the other states its values are correct to eight digits"
        in line
    )
    first, name, last = judged(tmp_path, vectors, {"F": 2 * F}).named.lines()
    assert first.startswith("This explains a part of it") and name.startswith("F x 2") and last.startswith("F has entries")
    F[[0, 3]] = vectors.arrays["F"][[0, 3]]
    F[-1] = np.nan
    assert judged(tmp_path, vectors, {"F": F}).named.names == ["not a number at inversion"]


def test_errors_without_an_explanation_are_reported_with_their_location(published, tmp_path):
    """Errors that no hypothesis explains are reported, also for a single state, the state of rest, and NaN."""
    vectors = published["block"]
    F = vectors.arrays["F"].copy()
    F[:, 5] *= 1.5
    assert judged(tmp_path, vectors, {"F": F}).named.lines()[0].startswith("No hypothesis explains the failure")
    rest = {"states": np.array(["rest"]), "F": np.ones((1, F.shape[1]))}
    report = judged(tmp_path, vectors, rest)
    assert not report.passed and report.named is not None
    assert judged(tmp_path, vectors, {"W": np.full(8, np.nan)}).named is not None


BAD = {
    "another file": ("hello\n", "the first line is 'skfem-stvk vectors 1'; got 'hello'"),
    "an empty file": ("", "got an empty file"),
    "truncated": ("skfem-stvk vectors 1\nW real 1 8\n1\n2\n3\n", "W has 3 values, expected 8.*before the file was whole"),
    "too many values": ("skfem-stvk vectors 1\nW real 1 2\n1 2 3\n", "W has 3 values, expected 2"),
    "a value left over": ("skfem-stvk vectors 1\nW real 1 2\n1 2\n3\n", "line 4: got '3'; expected an array"),
    "a huge size": ("skfem-stvk vectors 1\nW real 1 99999999999\n1\n", "expected 99999999999"),
    "a size beyond all": ("skfem-stvk vectors 1\nW real 1 " + "9" * 400 + "\n1\n", "expected an array"),
    "a negative size": ("skfem-stvk vectors 1\nW real 1 -1\n", "expected an array"),
    "another rank": ("skfem-stvk vectors 1\nW real 3 2\n1 2\n", "expected an array"),
    "an unknown type": ("skfem-stvk vectors 1\nW double 1 2\n1 2\n", "expected an array"),
    "an unknown name": ("skfem-stvk vectors 1\nw real 1 2\n1 2\n", "an array 'w'.*Did you mean 'W'"),
    "Fortran's D": ("skfem-stvk vectors 1\nW real 1 2\n1D0 2D0\n", "'1D0' is no real number"),
    "words": ("skfem-stvk vectors 1\nW real 1 2\n1 two\n", "'two' is no real number"),
    "twice": ("skfem-stvk vectors 1\nW real 1 1\n1\nW real 1 1\n1\n", "W is there twice"),
    "nothing": ("skfem-stvk vectors 1\n", "none of W, F"),
    "a text of two dimensions": ("skfem-stvk vectors 1\nstates text 2 1 1\nrest\n", "expected 1"),
    "other sizes": ("skfem-stvk vectors 1\nW real 1 2\n1 2\n", r"W has the sizes \(2,\); expected \(8,\)"),
    "a text for numbers": ("skfem-stvk vectors 1\nW text 1 2\n1\n2\n", "W is of type text; expected real"),
    "both K": ("skfem-stvk vectors 1\nK_values real 1 1\n1\nK_blocks real 1 1\n1\n", "both K_blocks and K_values"),
    "an unknown state": ("skfem-stvk vectors 1\nstates text 1 1\nrust\nW real 1 1\n0\n", "'rust'.*Did you mean 'rest'"),
    "a state twice": ("skfem-stvk vectors 1\nstates text 1 2\nrest\nrest\nW real 1 2\n0 0\n", "'rest' more than once"),
    "no state": ("skfem-stvk vectors 1\nstates text 1 0\nW real 1 0\n", "states is empty"),
    "another digest": ("skfem-stvk vectors 1\ndigest text 1 1\nabc\nW real 1 8\n0 0 0 0 0 0 0 0\n", "computed from other vectors"),
    "bytes": ("skfem-stvk vectors 1\n\x00\x01 real 1 1\n1\n", "there is an array"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_damaged_text_is_refused_with_the_reason(name, published, tmp_path):
    text, words = BAD[name]
    (tmp_path / "results.txt").write_text(text)
    with pytest.raises(StvkError, match=f"(?s){words}"):
        verify_results(tmp_path, published["block"])


def test_a_damaged_npz_is_refused(published, tmp_path):
    vectors, file = published["block"], tmp_path / "results.npz"
    np.savez(file, W=np.array([1, "a", None], dtype=object))
    with pytest.raises(StvkError, match="no NPZ file of numbers"):
        verify_results(tmp_path, vectors)
    np.savez(file, W=np.zeros(8, dtype=complex))
    with pytest.raises(StvkError, match="W is of complex128"):
        verify_results(tmp_path, vectors)
    file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(StvkError, match="no NPZ file"):
        verify_results(tmp_path, vectors)
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(
            "W.npy",
            b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (999999999999,), }".ljust(128) + b"\n",
        )
    with pytest.raises(StvkError, match=r"no NPZ file|memory"):
        verify_results(tmp_path, vectors)
    (tmp_path / "results.txt").write_text("skfem-stvk vectors 1\n")
    with pytest.raises(StvkError, match=r"both results\.npz and results\.txt"):
        verify_results(tmp_path, vectors)


def test_changed_and_missing_vectors_are_refused(published, tmp_path):
    published["block"].save(tmp_path, text=True)
    write_text(tmp_path / "results.txt", right(published["block"], "W"))
    (tmp_path / "vectors.npz").unlink()
    assert verify_results(tmp_path).passed
    text = (tmp_path / "vectors.txt").read_text()
    (tmp_path / "vectors.txt").write_text(text.replace("100000.0", "200000.0", 1))
    with pytest.raises(StvkError, match="has been changed since it was written"):
        verify_results(tmp_path)
    (tmp_path / "vectors.txt").write_text(text[: len(text) // 2])
    with pytest.raises(StvkError, match="values, expected"):
        verify_results(tmp_path)
    (tmp_path / "vectors.txt").write_text("skfem-stvk vectors 1\ntitle text 1 1\nx\n")
    with pytest.raises(StvkError, match="lacks digest, kind"):
        verify_results(tmp_path)
    (tmp_path / "vectors.txt").unlink()
    with pytest.raises(StvkError, match=r"results.txt has no digest.*--vectors"):
        verify_results(tmp_path)
    (tmp_path / "no").mkdir()
    with pytest.raises(StvkError, match="none of its folders has"):
        folders_of_results(tmp_path / "no")
    with pytest.raises(StvkError, match="is no folder"):
        folders_of_results(tmp_path / "results.txt")


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (StVK(Anisotropic(np.diag([4.0, 5, 6, 1, 2, 3]))), "isotropic"),
        ([StVK(young=1.0, poisson=0.3, region=[0, 1])], r"4 elements \(2, 3, 4, 5\): of no law"),
        ([StVK(young=1.0, poisson=0.3), StVK(young=1.0, poisson=0.3, region=[2])], r"1 element \(2\)"),
        ("steel", "'steel'; expected a material"),
    ],
)
def test_vectors_of_other_materials_are_refused(law, words):
    with pytest.raises(MaterialError, match=words):
        export_vectors(box(1), law, quiet=True)


def test_the_page_contains_the_whole_layout():
    page = (DOCS / "reference" / "test-vector-files.md").read_text()
    for name, field in LAYOUT.items():
        sizes = " x ".join(field.sizes)
        assert f"| `{name}` | {field.type} | {sizes} | {field.unit} | {field.what} |" in page, name
    assert all(f"`{name}`" in page for name in (*RESULTS, *PUBLISHED))


def test_vectors_are_read_as_they_were_written(tmp_path):
    vectors = export_vectors(sheet(1), young=2.0, poisson=0.3, quiet=True)
    vectors.save(tmp_path, text=True)
    for file in ("vectors.npz", "vectors.txt"):
        again = read_vectors(tmp_path / file)
        assert isinstance(again, Vectors) and list(again.arrays) == list(vectors.arrays)
        assert all((again.arrays[name] == array).all() for name, array in vectors.arrays.items())
