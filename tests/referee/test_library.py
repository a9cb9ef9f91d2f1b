"""Shared libraries in C and C++ are judged in a process of their own: right ones pass, and every fault has a clear finding."""

import os
import re
import shutil
import subprocess
import sys
import tracemalloc
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from bodies import box

from skfem_stvk import StVK, StvkError, verify
from skfem_stvk.referee.against import library_candidate
from skfem_stvk.referee.peers.library import LONGEST_CALL, SharedLibrary
from skfem_stvk.referee.peers.process import KEPT, AnsweringProcess
from skfem_stvk.referee.results import CheckOutcome
from skfem_stvk.scenes.commands.main import main

DOCS = Path(__file__).parents[2] / "docs" / "candidate"
MESH = box(1)
TERMS = [StVK(young=1e5, poisson=0.3)]
MINE = {role: f"mine_{name}" for role, name in {"body": "body", "energy": "W", "force": "F", "tangent": "K"}.items()}


def needed(program):
    """Return the path of a program, or skip the test by its name."""
    found = shutil.which(program)
    if found is None:
        pytest.skip(f"there is no {program}")
    return found


def built(file, source, *flags, compiler="cc"):
    """Compile a shared library without warnings, and return its path."""
    command = [needed(compiler), "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", f"-I{DOCS}", "-o", file, source, *flags]
    subprocess.run(command, check=True, capture_output=True)
    return file


@pytest.fixture(scope="module")
def libraries(tmp_path_factory):
    """Return the paths of the library of the docs, without and with its planted fault."""
    folder = tmp_path_factory.mktemp("libraries")
    right = built(folder / "libmine.so", DOCS / "stvk.c")
    return right, built(folder / "libfault.so", DOCS / "stvk.c", "-DFAULT")


def options(functions):
    return [word for role, name in functions.items() for word in (f"--{role}", name)]


def test_the_library_of_the_docs_passes_and_its_planted_fault_is_named(libraries, part, capsys):
    run = ["verify", "part.vtu", "--young", "1e5", "--poisson", "0.3", *options(MINE), "--library"]
    assert main([*run, str(libraries[0]), "--out", "report"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    line = f"candidate: mine_body, mine_W, mine_F, mine_K of {libraries[0]}, in a process of its own with one thread"
    assert line in out and "0 failed, 0 could not run" in out and "mine_W" in (part / "report" / "report.html").read_text()
    assert main([*run, str(libraries[1])]) == 1
    assert "lambda doubled: your lambda is 2.000 x, your mu 1.000 x" in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_a_product_takes_the_place_of_a_tangent_and_each_element_has_its_material(libraries):
    """The body has two materials. Its K is judged by products alone."""
    functions = {"body": "mine_body", "product": "mine_Kv"}
    mesh = box(2)
    half = np.arange(mesh.nt) < mesh.nt // 2
    terms = [StVK(young=1e5, poisson=0.3, region=np.flatnonzero(half)), StVK(young=2e3, poisson=0.4, region=np.flatnonzero(~half))]
    for file, passed in zip(libraries, (True, False), strict=True):
        with library_candidate(file, functions, mesh, terms) as (candidate, _):
            report = verify(mesh, terms, candidate=candidate, quiet=True)
        agreed = [result for result in report.results if result.check == "agreement" and result.subject == "candidate"]
        assert report.passed == passed and {r.quantity for r in agreed if r.outcome.value != "not applicable"} == {"K"}


FAULTY = r"""
#include "candidate.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>
enum { N = 24 };
static int64_t ids[N], bodies;
static double values[N];
static volatile int forever = 1;
static double *volatile nowhere;
int body(int64_t nv, int32_t d, const double *X, int64_t nt, int32_t n, const int64_t *t, const double *E, const double *nu) {
    (void)X, (void)nt, (void)n, (void)t, (void)E, (void)nu;
    bodies++;
    return nv * d == N ? 0 : 7;
}
int stretched(const double *u, double *F) {          /* crashes at large displacements alone */
    double size = 0;
    for (int i = 0; i < N; i++) size += fabs(u[i]), F[i] = 0;
    if (size > 3) *nowhere = 1;
    return 0;
}
int crashes(const double *u, double *F) { (void)u, (void)F; puts("lost"); fflush(stdout); *nowhere = 1; return 0; }
int aborts(const double *u, double *F) { (void)u, (void)F; abort(); }
int leaves(const double *u, double *F) { (void)u, (void)F; exit(3); }
int loops(const double *u, double *F) { (void)u; while (forever) F[0] = 1; return 0; }
static void start_child(void) {                        /* it would outlive its parent, and keep the pipes open */
    if (fork() == 0) { sleep(20); fclose(fopen("outlived", "w")); _exit(0); }
}
int forks(const double *u, double *F) { start_child(); return aborts(u, F); }
int forks_and_loops(const double *u, double *F) { start_child(); return loops(u, F); }
int floods(const double *u, double *F) {
    for (int i = 0; i < 2000000; i++) puts("a line of fifty characters, of two million of them");
    puts("the last words"), fflush(stdout);
    return aborts(u, F);
}
int returns(const double *u, double *F) { (void)u, (void)F; return -2; }
int forgets(const double *u, double *F) { for (int i = 0; i < N; i++) if (i != 5) F[i] = u[i]; return 0; }
int adds(const double *u, double *F) { for (int i = 0; i < N; i++) F[i] += u[i]; return 0; }
int overruns(const double *u, double *F) { for (int i = 0; i <= N; i++) F[i] = u[i % N]; return 0; }
int underruns(const double *u, double *F) { for (int i = -1; i < N; i++) F[i] = u[(i + N) % N]; return 0; }
int spoils(const double *u, double *F) { for (int i = 0; i < N; i++) F[i] = 0; ((double *)u)[3] += 1; return 0; }
int nans(const double *u, double *F) { for (int i = 0; i < N; i++) F[i] = i == 5 ? sqrt(-1 - u[i] * u[i]) : u[i]; return 0; }
int energy(const double *u, double *W) { *W = u[0] + 100 * bodies; return 0; }
int blank(const double *u, double *W) { (void)u, (void)W; return 0; }
static int triplets(int64_t n, int64_t *count, const int64_t **r, const int64_t **c, const double **v) {
    for (int i = 0; i < N; i++) ids[i] = i, values[i] = i + 1;
    *count = n, *r = ids, *c = ids, *v = values;
    return 0;
}
#define TANGENT(name) int name(const double *u, int64_t *count, const int64_t **r, const int64_t **c, const double **v)
TANGENT(diagonal) { (void)u; return triplets(N, count, r, c, v); }
TANGENT(negative) { (void)u; return triplets(-5, count, r, c, v); }
TANGENT(unset) { (void)u, (void)r, (void)c, (void)v, (void)count; return 0; }
TANGENT(huge) { (void)u; return triplets(INT64_MAX, count, r, c, v); }
TANGENT(beyond) { (void)u; return triplets(200000000, count, r, c, v); }
TANGENT(null) { (void)u; triplets(N, count, r, c, v); *c = NULL; return 0; }
TANGENT(from_one) { (void)u; triplets(N, count, r, c, v); for (int i = 0; i < N; i++) ids[i]++; return 0; }
TANGENT(below) { (void)u; triplets(N, count, r, c, v); ids[7] = -1; return 0; }
TANGENT(empty) { (void)u, (void)r, (void)c, (void)v; *count = 0; return 0; }
"""


@pytest.fixture(scope="module")
def faulty(tmp_path_factory):
    """Return the path of a library with many faulty functions."""
    folder = tmp_path_factory.mktemp("faulty")
    (folder / "faulty.c").write_text(FAULTY)
    return built(folder / "libfaulty.so", folder / "faulty.c", "-Wno-missing-prototypes", "-Wno-array-bounds", "-lm")


FORCES = {
    "crashes": r"crashes: the process of the library has ended, with SIGSEGV: lost\.",
    "aborts": "aborts: .* has ended, with SIGABRT: it printed nothing",
    "leaves": "leaves: .* has ended, with exit code 3",
    "returns": "returns returned -2; expected 0, which means success",
    "forgets": r"forgets left 1 of 24 entries of F unset, the first of them \[5\]",
    "adds": r"adds left 24 of 24 entries of F unset.*Before the call F is not zero",
    "overruns": "overruns wrote outside of F, which has 24 entries",
    "underruns": "underruns wrote outside of F",
    "spoils": "spoils changed u, which is const",
}
TANGENTS = {
    "negative": "negative set count = -5; expected the number of its triplets, from 0",
    "unset": "unset set count = -1",
    "huge": "huge set count = 9223372036854775807",
    "beyond": "beyond: .* has ended, with SIG",
    "null": "null set count = 24 and left columns NULL",
    "from_one": r"from_one set rows\[23\] = 24, and 1 of 24 rows are out of range; expected 0 to 23: d \* node \+ comp",
    "below": r"below set rows\[7\] = -1",
}


@pytest.mark.few(6)
@pytest.mark.parametrize(
    ("role", "name", "words"),
    [("force", *row) for row in FORCES.items()]
    + [("tangent", *row) for row in TANGENTS.items()]
    + [("energy", "blank", r"blank left 1 of 1 entries of W unset"), ("product", "nothing", "has no function nothing. .* extern")],
)
def test_every_fault_is_an_error_that_names_the_function(role, name, words, faulty):
    of = {"energy": "energy", "force": "internal_force"}.get(role, "tangent")
    with pytest.raises(StvkError, match=words), SharedLibrary(faulty, {"body": "body", role: name}) as library:
        getattr(library.candidate(MESH, 1e5, 0.3), of)(np.zeros(24))


def test_a_call_after_a_crash_gets_a_new_process_and_the_crash_is_not_repeated(faulty):
    with SharedLibrary(faulty, {"body": "body", "energy": "energy", "force": "crashes"}) as library:
        model, u = library.candidate(MESH, 1e5, 0.3), np.full(24, 2.0)
        with pytest.raises(StvkError, match="with SIGSEGV"):
            model.internal_force(u)
        assert model.energy(u) == 102.0
        process = library._process
        with pytest.raises(StvkError, match="with SIGSEGV"):
            model.internal_force(u)
        assert library._process is process and model.energy(u) == 102.0


def test_values_and_bodies_arrive_as_they_are(faulty):
    """Without a function of the body none is called. Two bodies take turns, and each call of one has its own body set."""
    u = np.arange(24.0)
    with SharedLibrary(faulty, {"energy": "energy", "tangent": "diagonal"}) as library:
        model = library.candidate(MESH, 1e5, 0.3)
        assert model.energy(u + 3) == 3.0 and not hasattr(model, "internal_force")
        assert (model.tangent(u).toarray() == np.diag(u + 1)).all()
    with SharedLibrary(faulty, {"body": "body", "energy": "energy", "tangent": "empty"}) as library:
        first, second = (library.candidate(MESH, 1e5, 0.3) for _ in range(2))
        assert [model.energy(u) for model in (second, second, first, second)] == [200.0, 200.0, 300.0, 400.0]
        assert first.tangent(u).nnz == 0
        with pytest.raises(StvkError, match="body returned 7; expected 0"):
            library.candidate(box(2), 1e5, 0.3)


def test_a_crash_in_one_state_is_a_finding_with_function_and_state_and_ends_nothing_else(faulty):
    with library_candidate(faulty, {"body": "body", "force": "stretched"}, MESH, TERMS) as (candidate, _):
        report = verify(MESH, TERMS, candidate=candidate, quiet=True)
    results = [result for result in report.results if result.subject == "candidate" and result.check == "agreement"]
    outcomes = {result.state: result.outcome.value for result in results if result.quantity == "F"}
    crashed = {state for state, outcome in outcomes.items() if outcome == "could not run"}
    assert len(outcomes) == 8 and outcomes["rest"] == "passed" and "100 % stretch" in crashed
    (line,) = re.findall(
        r"could not run ([^:]*): [^:]* raised StvkError: stretched: .*? ended, with SIGSEGV", " ".join(str(report).split())
    )
    assert all(state in line or "more states" in line for state in crashed) and "F) of candidate in" in line and "rest" not in line


def test_an_endless_loop_is_ended_and_called_three_times_at_most(faulty, monkeypatch):
    with library_candidate(faulty, {"body": "body", "force": "loops", "energy": "energy"}, MESH, TERMS) as (candidate, _):
        ask = AnsweringProcess.ask

        def shorter(process, question, seconds):
            return ask(process, question, 0.2 if str(question["role"]) == "force" else seconds)

        monkeypatch.setattr(AnsweringProcess, "ask", shorter)
        report = verify(MESH, TERMS, candidate=candidate, quiet=True)
    results = [result for result in report.results if result.subject == "candidate"]
    endless = [r for r in results if "loops: the process of the library gave no answer within 0.2 s, and was ended" in r.reason]
    assert len({result.state for result in endless if result.check == "agreement"}) == 3
    assert any("loops was not called: 3 calls before took longer than" in result.reason for result in results)
    assert any(result.quantity == "W" and result.measured is not None for result in results)


@pytest.mark.parametrize(
    ("name", "seconds", "words"),
    [("forks", 60.0, "has ended, with SIGABRT"), ("forks_and_loops", 0.5, "gave no answer within 0.5 s, and was ended")],
)
def test_a_child_of_the_process_is_ended_with_it(name, seconds, words, faulty, part, monkeypatch):
    """A child that a library leaves behind would keep the pipe of the answers open, so that the referee waits for it."""
    with SharedLibrary(faulty, {"force": name}) as library, pytest.raises(StvkError, match=words):
        monkeypatch.setattr("skfem_stvk.referee.peers.library.LONGEST_CALL", seconds)
        library.candidate(MESH, 1e5, 0.3).internal_force(np.zeros(24))
    assert not (part / "outlived").exists()


def test_of_a_long_output_the_end_is_kept(faulty):
    with SharedLibrary(faulty, {"force": "floods"}) as library:
        process, model = library._process, library.candidate(MESH, 1e5, 0.3)
        tracemalloc.start()
        try:
            with pytest.raises(StvkError, match=r"with SIGABRT: .* the last words"):
                model.internal_force(np.zeros(24))
            assert tracemalloc.get_traced_memory()[1] < 2**20
        finally:
            tracemalloc.stop()
    assert len(process._said) == KEPT


def test_nan_in_one_entry_is_a_finding_with_its_place(faulty):
    with library_candidate(faulty, {"body": "body", "force": "nans"}, MESH, TERMS) as (candidate, _):
        report = verify(MESH, TERMS, candidate=candidate, quiet=True)
    failed = [result for result in report.failures("candidate") if result.check == "agreement"]
    assert len(failed) == 16 and all(result.worst["dof"] == 5 for result in failed)
    assert "no finite values" in report.named.smallest


def test_the_process_has_one_thread(tmp_path, faulty, monkeypatch):
    """A library of OpenMP would read its number of threads from the environment of its process."""
    (tmp_path / "threads.c").write_text(
        "#include <stdlib.h>\n#include <string.h>\n"
        'static int of(const char *name) { const char *n = getenv(name); return n && !strcmp(n, "1"); }\n'
        'int energy(const double *u, double *W) { *W = of("OMP_NUM_THREADS") && of("OPENBLAS_NUM_THREADS"); return u[0] != 0; }\n'
    )
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    file = built(tmp_path / "libthreads.so", tmp_path / "threads.c")
    with SharedLibrary(file, {"energy": "energy"}) as library:
        assert library.candidate(MESH, 1e5, 0.3).energy(np.zeros(24)) == 1.0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["--library", "libnone.so", "--energy", "W"],
            "library = libnone.so; expected a shared library, but there is no such file",
        ),
        (["--library", "part.vtu", "--energy", "W"], r"part.vtu cannot be loaded: .*(header|file).* Expected a shared library for"),
        (["--library", "part.vtu", "--body", "b"], "expected the name of at least one of its functions: energy, force, tangent"),
        (["--library", "part.vtu", "--tangent", "K", "--product", "Kv"], "with a tangent and a product; expected one of them"),
        (["--library", "part.vtu", "--energy", "W", "--against", "mujoco"], "--library with --against; expected one candidate"),
        (["--energy", "W", "--force", "F"], "--energy, --force without --library"),
        (["--library", "part.vtu", "--results", "x"], "--library(, a mesh)? with --results|--young"),
    ],
)
def test_unusable_libraries_and_options_are_refused(arguments, words, part, capsys):
    assert main(["verify", "part.vtu", "--young", "1e5", "--poisson", "0.3", *arguments]) == 2
    assert re.search(words, " ".join(capsys.readouterr().err.split()))


@pytest.mark.skipif(sys.platform != "linux", reason="a file of Linux")
def test_a_library_for_another_processor_is_refused(libraries, part, capsys):
    content = bytearray(libraries[0].read_bytes())
    content[18] = {0xB7: 0x3E}.get(content[18], 0xB7)  # the machine in the header of ELF: AArch64, or x86-64 there
    (part / "libother.so").write_bytes(content)
    assert main(["verify", "part.vtu", "--young", "1e5", "--poisson", "0.3", "--library", "libother.so", "--energy", "mine_W"]) == 2
    assert "libother.so cannot be loaded: " in " ".join(capsys.readouterr().err.split())


def test_a_library_whose_start_crashes_is_refused(tmp_path):
    (tmp_path / "start.c").write_text("#include <stdlib.h>\n__attribute__((constructor)) static void start(void) { abort(); }\n")
    file = built(tmp_path / "libstart.so", tmp_path / "start.c")
    with pytest.raises(StvkError, match=r"libstart.so: the process of the library has ended, with SIGABRT"):
        SharedLibrary(file, {"energy": "W"})


def commands_of_the_workflow():
    """Return the commands that install the package, and those that build and check the library."""
    commands = re.findall(r"^ +- run: (.*)$", (DOCS / "verify.yml").read_text(), re.MULTILINE)
    assert len(commands) == 5
    return commands[:2], commands[2:]


def test_the_workflow_installs_the_package_from_a_checkout_at_one_address(tmp_path):
    (clone, install), _ = commands_of_the_workflow()
    assert (clone.count("ADDRESS"), install) == (1, "pip install ../skfem-stvk")
    if not (DOCS.parents[1] / ".git").exists():
        pytest.skip("the sources are not a checkout")
    (tmp_path / "mine").mkdir()
    subprocess.run(
        clone.replace("ADDRESS", DOCS.parents[1].as_uri()).split(), cwd=tmp_path / "mine", check=True, capture_output=True
    )
    assert 'name = "skfem-stvk"' in (tmp_path / "skfem-stvk" / "pyproject.toml").read_text()


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """Run the commands of the workflow on a copy of the docs' folder, except the installation, and return the folder."""
    needed("cmake"), needed("ctest"), needed("c++")
    tools = [
        str(Path(tool).parent) for tool in (sys.executable, *map(shutil.which, ("cmake", "ctest", "c++", "sh")))
    ]  # no other Python
    folder = tmp_path_factory.mktemp("user") / "candidate"
    shutil.copytree(DOCS, folder)
    command = folder.parent / "skfem-stvk"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m skfem_stvk.scenes.commands "$@"\n')
    command.chmod(0o755)
    path = os.pathsep.join([str(folder.parent), *tools])
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(DOCS.parents[1])}
    if find_spec("pybind11") is not None:
        environment["pybind11_DIR"] = import_module("pybind11").get_cmake_dir()
    _, commands = commands_of_the_workflow()
    outputs = [subprocess.run(one.split(), cwd=folder, env=environment, capture_output=True, text=True) for one in commands]
    assert [done.returncode for done in outputs] == [0, 0, 0], outputs
    return folder / "build"


@pytest.mark.slow
def test_the_workflow_builds_the_library_and_its_test_passes(build):
    page = (build / "report" / "report.html").read_text()
    assert "mine_body, mine_W, mine_F, mine_K of" in page and "libmine" in page


@pytest.mark.slow
def test_the_module_of_pybind11_is_a_candidate(build, monkeypatch):
    """A Python program as on the page checks it, and another lambda is named."""
    pytest.importorskip("pybind11")
    monkeypatch.syspath_prepend(str(build))
    mine = import_module("mine_python").Mine
    for poisson, passed in ((0.3, True), (0.35, False)):

        def candidate(mesh, poisson=poisson):
            return mine(mesh.p.T, mesh.t.T, np.full(mesh.nt, 1e5), np.full(mesh.nt, poisson))

        report = verify(MESH, young=1e5, poisson=0.3, candidate=candidate, quiet=True)
        assert report.passed == passed and report.counts[CheckOutcome.COULD_NOT_RUN] == 0


def test_the_page_names_all_functions_and_limits_of_the_interface():
    page, header = (DOCS.parent / "how-to" / "c-libraries.md").read_text(), (DOCS / "candidate.h").read_text()
    assert re.findall(r"int (\w+)\(", header) == [*MINE.values(), "mine_Kv"]
    assert all(name in page for name in [*MINE.values(), "mine_Kv", f"within {LONGEST_CALL:g} s"])
    assert all(file.name in page for file in DOCS.iterdir())
