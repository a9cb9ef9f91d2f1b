"""The house stands: lint, format, types and layers, as claims like any other."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

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


def test_importing_the_package_imports_no_optional_package():
    code = "import sys, skfem_stvk; print([m for m in ('matplotlib', 'gmsh', 'h5py', 'jinja2', 'hypothesis') if m in sys.modules])"
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
    """Parameters are selected instead, and examples of Hypothesis assumed."""
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


def is_unseeded(name, call):
    if name.split(".")[-1] in ("default_rng", "Random", "RandomState"):
        return not (call.args or call.keywords)
    return "(" not in name and name.rpartition(".")[0] in ("np.random", "numpy.random", "random")


def trees(folder):
    for path in sorted((ROOT / folder).rglob("*.py")):
        yield path, ast.parse(path.read_text(encoding="utf-8"))


def own_nodes(function):
    """What stands in a function, but for functions within."""
    for node in ast.iter_child_nodes(function):
        if not isinstance(node, ast.FunctionDef | ast.Lambda | ast.ClassDef):
            yield node
            yield from own_nodes(node)


def test_ci_runs_the_readmes_test_command():
    (command,) = [line.strip() for line in (ROOT / "README.md").read_text().splitlines() if "python -m pytest" in line]
    assert command in (ROOT / ".ci" / "run").read_text().splitlines()
