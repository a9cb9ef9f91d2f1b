"""Commands of the referee, and the output of their results."""

from __future__ import annotations

import argparse
import os
import shlex
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import RenderableType

from ...arguments import path
from ...errors import StvkError
from ...mesh import ElementMesh, embedded_mesh, read_mesh
from ...referee.against import library_candidate, peer_candidate
from ...referee.implementations import users_function
from ...referee.law import verify_law
from ...referee.law_readings import MEASURES, ORDERS, TANGENTS
from ...referee.peers import PEERS
from ...referee.peers.library import ROLES
from ...referee.read_back import folders_of_results, verify_results
from ...referee.report import Report, rendered
from ...referee.self_test import self_test
from ...referee.vectors import PUBLISHED, export_vectors, published_vectors
from ...referee.verification import verify
from ...terminal import BAD_INPUT, DONE, NOT_PASSED, WIDTH, console, printable
from ...terms import StVK

#: Materials of the embedded mesh: a bracket of aluminium with a bushing of rubber; Poisson's ratios give lambda != mu.
EMBEDDED = [StVK(young=70e9, poisson=0.33, region="bracket"), StVK(young=5e6, poisson=0.45, region="bushing")]

#: Functions of a library in words.
HELP = {
    "energy": "strain energy W",
    "force": "internal force F",
    "tangent": "tangent K, as triplets",
    "product": "product of K with a vector, in place of --tangent",
}

#: Options of a candidate.
CANDIDATES = ("against", "python", "library", "body", *ROLES)


def _add_body(parser: argparse.ArgumentParser, without: str) -> None:
    """Add the arguments of a mesh with one material; `without` describes the command without a mesh."""
    parser.add_argument("mesh", nargs="?", help=f"mesh file; by default {without}")
    parser.add_argument("--young", type=float, help="Young's modulus [Pa]")
    parser.add_argument("--poisson", type=float, help="Poisson's ratio")
    parser.add_argument(
        "--degree", type=int, help="degree of the shape functions of simplices, 1 or 2; by default that of the mesh"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the random states; 0 by default")


def verify_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `skfem-stvk verify`."""
    _add_body(parser, "a built-in bracket of two materials")
    parser.add_argument("--quadrature", help="exact, or one-point for quadrilaterals and hexahedra; by default the usual rule")
    parser.add_argument("--hourglass", type=float, help="coefficient of the hourglass control of one-point elements")
    parser.add_argument("--out", metavar="FOLDER", help="write report.json and report.html there")
    parser.add_argument(
        "--self-test",
        action="store_true",
        help="test the referee itself with planted faults, and print which check detects which fault",
    )
    parser.add_argument(
        "--against", metavar="CODE", help=f"check another code as well: {', '.join(PEERS)}, module:function, or jax:module:function"
    )
    parser.add_argument("--python", metavar="PATH", help="Python of another environment, which has the peer of --against")
    parser.add_argument(
        "--library", metavar="FILE", help="check a shared library in C or C++ as well, by the names of its functions:"
    )
    parser.add_argument("--body", metavar="NAME", help="its function that takes the mesh; left out if the library has the mesh")
    for role in ROLES:
        parser.add_argument(f"--{role}", metavar="NAME", help=f"its function of the {HELP[role]}")
    parser.add_argument(
        "--results", metavar="FOLDER", help="check results that another program computed from test vectors (export)"
    )
    parser.add_argument("--vectors", metavar="FOLDER", help="the vectors of --results, if they are in another folder")


def check(options: argparse.Namespace) -> int:
    """Compare W, F and K with scikit-fem's standard assembly, and check their invariants; exit code 0 if all passed."""
    if options.out is not None:
        refuse_unwritable(options.out)
    if options.self_test:
        return _check_the_referee(options)
    if options.results is not None:
        return _check_results(options)
    if options.vectors is not None:
        raise StvkError("--vectors needs --results; add --results FOLDER, the folder of the results that were computed from them.")
    mesh, terms = _body(options)
    options_of_elements = {name: getattr(options, name) for name in ("degree", "quadrature", "hourglass")}
    if options.against is None and options.python is not None:
        raise StvkError("--python needs --against; add --against NAME, one of " + ", ".join(PEERS) + ".")
    if options.against is not None and options.degree is not None:
        mesh, options_of_elements["degree"] = mesh.with_degree(options.degree), None
    with _candidate_of_option(options, mesh, terms) as (candidate, line):
        report = verify(mesh, terms, **options_of_elements, candidate=candidate, seed=options.seed)
    report.header["candidate"] = [line] if line else []
    report.header["mesh"]["source"] = "embedded bracket" if options.mesh is None else options.mesh
    return _print_report(report, options.out)


def _candidate_of_option(
    options: argparse.Namespace, mesh: ElementMesh, terms: list[StVK]
) -> AbstractContextManager[tuple[Any, str]]:
    """Return the peer of `--against` or the functions of `--library`, and a line on it; None without these options."""
    functions = {role: getattr(options, role) for role in ("body", *ROLES) if getattr(options, role) is not None}
    if options.library is not None:
        if options.against is not None:
            raise StvkError("--library with --against; expected one candidate. Check the other in a second run.")
        return library_candidate(options.library, functions, mesh, terms)
    if functions:
        raise StvkError(f"--{', --'.join(functions)} without --library; add --library FILE, the library of these functions.")
    if options.against is None:
        return nullcontext((None, ""))
    if options.young is None or options.poisson is None:
        raise StvkError("--against needs --young (Pa) and --poisson: other codes get one material everywhere.")
    if options.quadrature is not None:
        raise StvkError("--quadrature with --against: other codes use the usual rule. Leave --quadrature out.")
    return peer_candidate(options.against, mesh, options.young, options.poisson, options.python)


def _check_the_referee(options: argparse.Namespace) -> int:
    """Run the referee's own test."""
    _refuse_a_body(options, "--self-test: it uses small bodies of its own", "results", "vectors", *CANDIDATES)
    found = self_test(seed=options.seed)
    print_and_save(found.rendered, WIDTH, found.save, options.out, "self-test.json and self-test.html")
    return DONE if found.passed else NOT_PASSED


def _refuse_a_body(options: argparse.Namespace, option: str, *others: str) -> None:
    """Refuse a mesh, a material and options of elements, and others."""
    names = ("young", "poisson", "degree", "quadrature", "hourglass", *others)
    given = [f"--{name}" for name in names if getattr(options, name) is not None]
    given += ["a mesh"] if options.mesh is not None else []
    if given:
        raise StvkError(f"{', '.join(given)} with {option}. Leave them out.")


def _check_results(options: argparse.Namespace) -> int:
    """Judge results of test vectors, in a folder or in each of its folders."""
    _refuse_a_body(options, "--results: the vectors have a mesh and a material", *CANDIDATES)
    folders, passed = folders_of_results(options.results), True
    for folder in folders:
        vectors = None
        if options.vectors is not None:
            subfolder = Path(options.vectors) / folder.name
            vectors = subfolder if subfolder.is_dir() else options.vectors
        report = verify_results(folder, vectors)
        out = options.out if options.out is None or len(folders) == 1 else str(Path(options.out) / folder.name)
        passed = _print_report(report, out) == DONE and passed
    return DONE if passed else NOT_PASSED


def _print_report(report: Report, folder: str | None) -> int:
    """Write a report and print it; exit code 0 if all passed."""
    print_and_save(partial(rendered, report), WIDTH, report.save, folder, "report.json and report.html")
    return DONE if report.passed else NOT_PASSED


def verify_law_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `skfem-stvk verify-law`."""
    parser.add_argument("energy", nargs="?", help="module:function or file.py:function: the energy density W(F), one number")
    parser.add_argument("--stress", metavar="FUNCTION", help="module:function of the stress")
    parser.add_argument("--elasticity", metavar="FUNCTION", help="module:function of the tangent")
    parser.add_argument("--young", type=float, help="Young's modulus [Pa] of the claimed St. Venant-Kirchhoff law")
    parser.add_argument("--poisson", type=float, help="its Poisson's ratio")
    parser.add_argument("--plane", choices=("strain", "stress"), help="its hypothesis in two dimensions")
    parser.add_argument("--dimension", type=int, help="2 or 3; by default 3, or 2 with --plane")
    parser.add_argument("--measure", choices=MEASURES, help="stress measure; by default guessed")
    parser.add_argument("--tangent", choices=TANGENTS, help="kind of tangent; by default guessed")
    parser.add_argument("--voigt", choices=(*ORDERS, "12"), help="the order of shear in Voigt arrays; by default guessed")
    parser.add_argument(
        "--engineering", action=argparse.BooleanOptionalAction, help="a Voigt matrix acts on engineering shear; by default guessed"
    )
    parser.add_argument("--out", metavar="FOLDER", help="write report.json and report.html there")
    parser.add_argument("--seed", type=int, default=0, help="seed of the deformation gradients; 0 by default")


def check_law(options: argparse.Namespace) -> int:
    """Check a law without a mesh: energy density, stress and tangent, any subset; exit code 0 if all passed."""
    if options.out is not None:
        refuse_unwritable(options.out)
    claims = None
    if options.young is not None or options.poisson is not None:
        claims = StVK(young=options.young, poisson=options.poisson, plane=options.plane)
    elif options.plane is not None:
        raise StvkError("--plane needs a claimed law; add --young (Pa) and --poisson, or use --dimension 2.")
    named = {"energy": options.energy, "stress": options.stress, "elasticity": options.elasticity}
    functions: dict[str, Any] = {name: users_function(name, given) for name, given in named.items() if given is not None}
    how = {name: getattr(options, name) for name in ("dimension", "measure", "tangent", "voigt", "engineering", "seed")}
    report = verify_law(**functions, **how, claims=claims)
    return _print_report(report, options.out)


def export_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `skfem-stvk export`."""
    _add_body(parser, "the five published sets are written")
    parser.add_argument("--quadrature", help="exact; by default the usual rule")
    parser.add_argument("--text", action="store_true", help="write vectors.txt as well, three times as large as vectors.npz")
    parser.add_argument("--out", metavar="FOLDER", required=True, help="write the vectors there")


def export(options: argparse.Namespace) -> int:
    """Write test vectors for codes that are not Python: mesh, material, states, W, F and K in 50 digits, rounded once."""
    refuse_unwritable(options.out)
    if options.mesh is None:
        given = [f"--{name}" for name in ("young", "poisson", "degree", "quadrature") if getattr(options, name) is not None]
        if given:
            raise StvkError(
                f"{', '.join(given)} without a mesh: the published sets have their own. Add a mesh file, or leave them out."
            )
        folders = [published_vectors(name).save(Path(options.out) / name, options.text) for name in PUBLISHED]
    else:
        mesh, terms = _body(options)
        mesh = mesh if options.degree is None else mesh.with_degree(options.degree)
        title = "".join(c for c in Path(options.mesh).stem if c.isprintable())[:100]
        made = export_vectors(mesh, terms, quadrature=options.quadrature, title=title, seed=options.seed)
        folders = [made.save(options.out, options.text)]
    for folder in folders:
        print_line(f"vectors.npz{', vectors.txt' * options.text} and README.txt are in {folder}")
    return DONE


def bench_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `python -m validation bench`."""
    parser.add_argument("--quick", action="store_true", help="a shorter run")
    parser.add_argument("--out", metavar="FOLDER", help="folder of the results")


def name_the_benchmark(options: argparse.Namespace) -> int:
    """Print the command that runs the benchmark in a checkout of the project; exit code 2, as nothing is measured here."""
    quick, out = ["--quick"] * options.quick, [] if options.out is None else ["--out", options.out]
    print_line(shlex.join(["python", "-m", "validation", "bench", *quick, *out]))
    return BAD_INPUT


def _body(options: argparse.Namespace) -> tuple[ElementMesh, list[StVK]]:
    given = options.young is not None or options.poisson is not None
    if options.mesh is not None and not given:
        raise StvkError("A mesh needs a material: add --young (Pa) and --poisson, e.g. --young 70e9 --poisson 0.33.")
    terms = [StVK(young=options.young, poisson=options.poisson)] if given else EMBEDDED
    return embedded_mesh() if options.mesh is None else read_mesh(options.mesh), terms


Rendering = Callable[[int], RenderableType]


def print_and_save(rendering: Rendering, width: int, save: Callable[[str], object], folder: str | None, files: str) -> None:
    """Write results before anything is printed, as a closed pipe ends the program; errors of writing are raised after printing.

    Standard output is as wide as the terminal, or `width` if it is not a terminal.
    """
    failure = None
    try:
        if folder is not None:
            save(folder)
    except (StvkError, OSError) as error:
        failure = error
    out = console(width)
    out.print(rendering(out.width))
    if failure is not None:
        raise failure
    if folder is not None:
        print_line(f"{files} are in {folder}")


def print_line(text: str) -> None:
    """Print one line on standard output, for any width of the terminal."""
    console().print(printable(text), soft_wrap=True)


def refuse_unwritable(name: str) -> None:
    """Refuse, before the work, a folder that is not writable; do not make it yet."""
    folder = path("--out", name, "the path of a folder, which is made if it is missing")
    nearest = next(parent for parent in (folder.absolute(), *folder.absolute().parents) if parent.exists())
    if not nearest.is_dir():
        raise StvkError(f"--out {folder}: {nearest} is a file; expected a folder, which is made if it is missing.")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise StvkError(f"--out {folder}: {nearest} cannot be written to. Choose another folder, or change its permissions.")
