"""The pytest plugin works in the package of docs/tutorials/referee-in-ci.md, in a folder of its own with the plugin installed."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
NAMES = "test_st_venant_kirchhoff", "test_neo_hookean"
TUTORIAL = (ROOT / "docs" / "tutorials" / "referee-in-ci.md").read_text()


def test_the_plugin_imports_nothing_before_it_is_used():
    """The plugin imports no other module; every run of pytest in the environment imports it."""
    code = (
        "import sys, pytest; before = set(sys.modules); import skfem_stvk.pytest_plugin; print(sorted(set(sys.modules) - before))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.strip() == "['skfem_stvk', 'skfem_stvk.pytest_plugin']", done.stderr


def test_the_wheel_contains_the_plugin_and_its_entry_point():
    assert PROJECT["project"]["entry-points"]["pytest11"] == {"skfem_stvk.pytest_plugin": "skfem_stvk.pytest_plugin"}
    assert PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["only-include"] == ["skfem_stvk"]


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """Return the folder of the tutorial's package, with the metadata that an installed distribution has of the plugin."""
    folder = tmp_path_factory.mktemp("downstream")
    files = re.findall(r"^`([\w/.]+)`:\n\n```python\n(.*?)^```", TUTORIAL, re.DOTALL | re.MULTILINE)
    assert len(files) == 2
    for name, text in files:
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_text(text)
    installed = folder / "site" / "skfem_stvk_plugin-0.dist-info"
    installed.mkdir(parents=True)
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: skfem-stvk-plugin\nVersion: 0\n")
    (installed / "entry_points.txt").write_text("[pytest11]\nskfem_stvk.pytest_plugin = skfem_stvk.pytest_plugin\n")
    return folder


def run(folder, *options):
    """Run pytest in the package; return its exit code, its output, and JUnit's cases by name."""
    paths = [str(folder / "src"), str(folder / "site"), str(ROOT)]
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")} | {"PYTHONPATH": os.pathsep.join(paths)}
    command = [sys.executable, "-m", "pytest", "-q", "--strict-markers", "-p", "no:cacheprovider", "--rootdir=.", "tests"]
    command += ["--junitxml=junit.xml", *options]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    return (
        done.returncode,
        done.stdout + done.stderr,
        {c.get("name"): c for c in ElementTree.parse(folder / "junit.xml").iter("testcase")},
    )


def test_the_tutorials_package_passes(package):
    (package / "tests" / "test_other.py").write_text("def test_that_fails():\n    assert False\n")
    code, output, cases = run(package, "-m", "stvk")  # deselects the other test
    assert code == 0 and "warning" not in output, output
    kinds = {"triangles", "tetrahedra"}, {"tetrahedra", "quadratic triangles", "quadrilaterals"}
    models = {f"{name}[{kind}]" for name, some in zip(NAMES, kinds, strict=True) for kind in some}
    assert set(cases) == models | {"test_the_law_alone"}
    for case in cases.values():
        (value,) = [p.get("value") for p in case.iter("property") if p.get("name") == "skfem-stvk"]
        assert re.match(r"passed: \d+ passed", value)


def test_a_plugin_named_on_the_command_line_is_the_installed_plugin(package):
    """The plugin is registered once; a second registration would add --stvk-report twice and no test would run."""
    code, output, cases = run(package, "-p", "skfem_stvk.pytest_plugin", "-k", "law_alone")
    assert code == 0 and list(cases) == ["test_the_law_alone"], output


def test_junit_shows_the_cause_of_each_failure(package):
    """JUnit's messages name a doubled lambda, and an exception text with control characters leaves the file valid."""
    module = package / "src" / "softbody" / "__init__.py"
    right = module.read_text()
    module.write_text(right.replace("self.lam = young", "self.lam = 2 * young").replace("log = np.log", "log = boom(); np.log"))
    module.write_text(module.read_text() + '\n\ndef boom():\n    raise RuntimeError("\\x1b[31m ]]> \\0 <b>")\n')
    try:
        code, output, cases = run(package, "-k", "tetrahedra", "--stvk-report=reports")
    finally:
        module.write_text(right)
    assert code == 1
    failures = {name: next(case.iter("failure")) for name, case in cases.items()}
    stvk, other = (failures[f"{name}[tetrahedra]"] for name in NAMES)
    assert stvk.get("message").startswith("skfem_stvk.testing.Inconsistent: Body is not consistent: ")
    assert "lambda doubled: your lambda is 2.000 x, your mu 1.000 x" in stvk.get("message")
    assert "agreement, F of candidate against scikit-fem" in stvk.text and stvk.text in output
    assert "pytest_plugin.py:" not in output and "testing.py:" not in output  # the frames that fail are those of the tests
    assert "raised RuntimeError: \\x1b[31m ]]> \\x00 <b>" in other.text
    folders = [package / "reports" / f"tests-test_softbody.py-{name}-tetrahedra-1" for name in NAMES]
    reports = [json.loads((folder / "report.json").read_text()) for folder in folders]
    assert [report["header"]["seed"] for report in reports] == [0, 1]  # the argument of the mark
    assert all((folder / "report.html").stat().st_size > 1000 for folder in folders)


MISTAKEN = {
    "yuong=1e5": "The mark stvk has yuong; expected arguments of assert_law by name: energy, stress,",
    "1e5": "The mark stvk has 100000.0; expected arguments",
    "seed=-1": "seed = -1",
}


def test_a_wrong_argument_of_the_mark_is_reported(package):
    body = "    stvk_referee.assert_law(energy=lambda F: 0.0)\n"
    tests = [f"\n\n@pytest.mark.stvk({mark})\ndef test_{i}(stvk_referee):\n{body}" for i, mark in enumerate(MISTAKEN)]
    module = package / "tests" / "test_mark.py"
    module.write_text("import pytest\n" + "".join(tests))
    try:
        code, output, cases = run(package, "-k", "test_mark")
    finally:
        module.unlink()
    assert code == 1 and "TypeError" not in output
    for i, words in enumerate(MISTAKEN.values()):
        (failure,) = cases[f"test_{i}"].iter("failure")
        assert words in failure.get("message")


def test_an_unwritable_report_folder_is_reported_before_the_tests(package):
    (package / "a file").write_text("")
    paths = [str(package / "src"), str(package / "site"), str(ROOT)]
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")} | {"PYTHONPATH": os.pathsep.join(paths)}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--stvk-report=a file/reports", "tests"]
    done = subprocess.run(command, cwd=package, env=environment, capture_output=True, text=True)
    assert done.returncode == 4 and "--stvk-report=a file/reports: no reports can be written there" in done.stderr
    assert "Traceback" not in done.stderr and "passed" not in done.stdout
