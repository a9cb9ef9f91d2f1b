"""Lint, format, types, import layers and the structure of the package are checked by tests."""

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from skfem_stvk.terms import TERMS

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize(
    "arguments",
    [
        ["-m", "ruff", "check", "."],
        ["-m", "ruff", "format", "--check", "."],
        ["-m", "mypy"],
        ["-c", "from importlinter.cli import lint_imports_command as lint; lint()"],
    ],
    ids=["lint", "format", "types", "layers"],
)
def test_the_house_is_in_order(arguments):
    done = _python(arguments)
    assert done.returncode == 0, done.stdout + done.stderr


def _python(arguments):
    return subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True)


@pytest.mark.slow
def test_type_checkers_know_the_public_names_and_no_others():
    """A user's program is typed: classes, functions with arguments even if a file has the same name, and the version."""
    program = """
import skfem_stvk
from skfem_stvk import StVK, modes, simulate
from skfem_stvk.results import Series
skfem_stvk.StVK(young=1.0, poisson=0.3), skfem_stvk.__version__.split("."), Series, modes(None, 2)
reveal_type(StVK(young=1.0, poisson=0.3))
simulate(nothing=1)
from skfem_stvk import Nobody
"""
    done = _python(["-m", "mypy", "--config-file=", "--ignore-missing-imports", "-c", program])
    wrong = [line for line in done.stdout.splitlines() if line.startswith("<string>") and ": error:" in line]
    assert 'Revealed type is "skfem_stvk.terms.laws.stvk.StVK"' in done.stdout, done.stdout + done.stderr
    assert {line.split(":")[1] for line in wrong} == {"5", "7", "8"} and 'Argument 1 to "modes"' in wrong[0], wrong
    assert 'no attribute "Nobody"' in wrong[-1], wrong


def test_importing_the_package_imports_no_optional_package():
    optional = "('matplotlib', 'gmsh', 'h5py', 'jinja2', 'hypothesis')"
    code = f"import sys; from skfem_stvk import *; print([m for m in {optional} if m in sys.modules])"
    done = _python(["-c", code])
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


def test_no_module_is_named_like_a_public_name():
    import skfem_stvk

    modules = {path.stem for path in (ROOT / "skfem_stvk").glob("*") if path.stem != "__init__"}
    assert not modules & set(skfem_stvk.__all__)


def test_public_names_are_documented():
    import skfem_stvk

    for name in skfem_stvk.__all__:
        assert getattr(skfem_stvk, name).__doc__, name


def test_no_test_returns_before_it_asserts():
    """Parameters are selected in place of skips, and examples of Hypothesis are assumed."""
    returns = [
        f"{path.name}:{node.lineno}"
        for path, tree in trees("tests")
        for test in ast.walk(tree)
        if isinstance(test, ast.FunctionDef) and test.name.startswith("test_")
        for node in own_nodes(test)
        if isinstance(node, ast.Return)
    ]
    assert not returns


def test_random_numbers_have_seeds():
    """Every generator is made from a seed, and none is NumPy's or Python's global one."""
    unseeded = [
        f"{path.name}:{node.lineno}: {ast.unparse(node)}"
        for folder in ("tests", "validation", "skfem_stvk")
        for path, tree in trees(folder)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and is_unseeded(ast.unparse(node.func), node)
    ]
    assert not unseeded


def test_generators_without_seeds_are_seen():
    unseeded = ["np.random.default_rng()", "default_rng()", "numpy.random.rand(3)", "random.random()", "make().default_rng()"]
    seeded = ["np.random.default_rng(3)", "rng().random()", "rng.random(3)"]
    calls = {code: ast.parse(code, mode="eval").body for code in unseeded + seeded}
    assert [code for code, call in calls.items() if is_unseeded(ast.unparse(call.func), call)] == unseeded


def is_unseeded(name, call):
    if name.split(".")[-1] in ("default_rng", "Random", "RandomState"):
        return not (call.args or call.keywords)
    return "(" not in name and name.rpartition(".")[0] in ("np.random", "numpy.random", "random")


@cache
def trees(folder):
    return [(path, ast.parse(path.read_text(encoding="utf-8"))) for path in sorted((ROOT / folder).rglob("*.py"))]


def own_nodes(function):
    """Yield the nodes of a function's syntax tree, without those of functions and classes within it."""
    for node in ast.iter_child_nodes(function):
        if not isinstance(node, ast.FunctionDef | ast.Lambda | ast.ClassDef):
            yield node
            yield from own_nodes(node)


def test_ci_runs_the_readmes_test_command():
    lines = [line.strip() for line in (ROOT / "README.md").read_text().splitlines()]
    (command,) = [line for line in lines if "python -m pytest" in line and "-m slow" not in line]
    (second,) = [line.split(" # ")[0].rstrip() for line in lines if "-m slow" in line]
    assert command in (ROOT / ".ci" / "run").read_text().splitlines() and any(line.startswith(".ci/all ") for line in lines)
    assert command.replace("python -m pytest -n auto", second) in (ROOT / ".ci" / "all").read_text().splitlines()


# the house of files


@cache
def package():
    """Return the syntax trees of the package by the name of their module."""
    paths = sorted((ROOT / "skfem_stvk").rglob("*.py"))
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for path in paths]
    return {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in zip(names, paths, strict=True)}


FOLDERS = {".".join(path.parent.relative_to(ROOT).parts) for path in (ROOT / "skfem_stvk").rglob("__init__.py")}


def imported(module):
    """Yield the modules of the package that a module imports, at its top, within functions, or for types alone."""
    for node in ast.walk(package()[module]):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in package())
        elif isinstance(node, ast.ImportFrom):
            parts = module.split(".") if module in FOLDERS else module.split(".")[:-1]
            base = (
                ".".join([*parts[: len(parts) + 1 - node.level], *([node.module] if node.module else [])])
                if node.level
                else node.module
            )
            for alias in node.names:
                yield f"{base}.{alias.name}" if f"{base}.{alias.name}" in package() else base


def test_no_two_files_import_each_other():
    """No cycle of imports exists, including imports for types and imports within functions."""
    numbers = {module: number for number, module in enumerate(package())}
    arrows = [(numbers[a], numbers[b]) for a in package() for b in imported(a) if b in package() and a != b]
    graph = csr_matrix((np.ones(len(arrows)), np.transpose(arrows)), shape=(len(package()),) * 2)
    _, label = connected_components(graph, directed=True, connection="strong")
    assert len(arrows) > 500
    assert [
        [module for module in package() if label[numbers[module]] == one] for one in np.flatnonzero(np.bincount(label) > 1)
    ] == []


def test_a_class_name_has_one_meaning():
    names = [(node.name, module) for module, tree in package().items() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    meanings = {name: [module for other, module in names if other == name] for name, _ in names if name[0] != "_"}
    assert {name: modules for name, modules in meanings.items() if len(modules) > 1} == {}


def test_functions_have_at_most_six_positional_parameters():
    """Kernels are exempt, because they take bare arrays. More parameters elsewhere indicate a missing options object."""
    many = {}
    for module, tree in package().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and not module.startswith("skfem_stvk.kernels"):
                names = [argument.arg for argument in (*node.args.posonlyargs, *node.args.args)]
                if len(names) - (names[:1] in (["self"], ["cls"])) > 6:
                    many[f"{module}.{node.name}"] = names
    assert many == {}


def test_the_package_has_few_files():
    """Code that changes together is in one file."""
    assert 100 < len(package()) <= 350


def test_a_file_name_says_one_thing():
    names = [module.rpartition(".")[2] for module in package() if module not in FOLDERS]
    assert {name: names.count(name) for name in names if names.count(name) > 1} == {}


def test_tests_mirror_the_rooms():
    """Each folder of tests is named like a room, or a part of one; the others test studies and extensions."""
    rooms = {module.partition(".")[2].replace(".", "/") for module in FOLDERS}
    folders = {str(path.parent.relative_to(ROOT / "tests")) for path in (ROOT / "tests").rglob("test_*.py")}
    assert folders - rooms - {".", "validation", "validation/bench"} == set()


def test_lines_are_at_most_132_characters_long():
    """Printed output and tables on pages are exempt."""
    folders = [ROOT / folder for folder in ("skfem_stvk", "tests", "validation", "docs")]
    files = [*ROOT.glob("*.md"), *(path for folder in folders for kind in ("*.py", "*.md") for path in folder.rglob(kind))]
    long = [
        f"{path.relative_to(ROOT)}:{number}"
        for path in files
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if len(line) > 132 and not (path.suffix == ".md" and line.startswith(("|", "    ")))
    ]
    assert len(files) > 500 and long == []


def strings(tree):
    """Yield all strings that are not docstrings, including those within f-strings."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    docs = {
        id(node.body[0].value) for node in ast.walk(tree) if isinstance(node, documented) and isinstance(node.body[0], ast.Expr)
    }
    return [n for n in ast.walk(tree) if isinstance(n, ast.Constant) and isinstance(n.value, str) and id(n) not in docs]


def test_messages_say_what_they_got():
    came = [
        f"{module}:{s.lineno}"
        for module, tree in package().items()
        for s in strings(tree)
        if re.search(r"\bcame\b(?! from)", s.value)
    ]
    assert came == []


#: Names of all laws and loads.
LAWS = {term.__name__ for term in TERMS.values()}


def test_laws_and_loads_are_asked_for_what_they_can_do_and_not_for_their_type():
    """Their own folder is exempt, and so are the referee's claims on St. Venant-Kirchhoff's law."""
    asked = [
        f"{module}:{node.lineno}: {ast.unparse(node)}"
        for module, tree in package().items()
        if module.split(".")[1:2] not in (["terms"], ["referee"])
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and ast.unparse(node.func) == "isinstance"
        and LAWS & set(re.findall(r"\w+", ast.unparse(node.args[1])))
    ]
    assert asked == []
