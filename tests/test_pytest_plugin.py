"""The plugin of pytest, in the package that docs/testing.md makes: in a folder of its own, found as an installed plugin is."""

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
TUTORIAL = (ROOT / "docs" / "testing.md").read_text()


def test_the_plugin_imports_nothing_before_it_is_used():
    """Each run of pytest in the environment imports it: its own lines take a millisecond."""
    code = (
        "import sys, pytest; before = set(sys.modules); import skfem_stvk.pytest_plugin; print(sorted(set(sys.modules) - before))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.strip() == "['skfem_stvk', 'skfem_stvk.pytest_plugin']", done.stderr


def test_the_wheel_holds_the_plugin_and_says_that_it_is_one():
    assert PROJECT["project"]["entry-points"]["pytest11"] == {"skfem_stvk.pytest_plugin": "skfem_stvk.pytest_plugin"}
    assert PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["only-include"] == ["skfem_stvk"]


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """The folder of the tutorial's package; beside it what an installed distribution has of the plugin."""
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
    """What pytest says in the package, its exit code, and JUnit's cases by their names."""
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
    code, said, cases = run(package, "-m", "stvk")  # which leaves the other out
    assert code == 0 and "warning" not in said, said
    kinds = {"triangles", "tetrahedra"}, {"tetrahedra", "quadratic triangles", "quadrilaterals"}
    models = {f"{name}[{kind}]" for name, some in zip(NAMES, kinds, strict=True) for kind in some}
    assert set(cases) == models | {"test_the_law_alone"}
    for case in cases.values():
        (value,) = [p.get("value") for p in case.iter("property") if p.get("name") == "skfem-stvk"]
        assert re.match(r"passed: \d+ passed", value)


def test_the_plugin_that_is_named_and_the_installed_one_are_one(package):
    """Two of them would add the option --stvk-report twice, and no test would run."""
    code, said, cases = run(package, "-p", "skfem_stvk.pytest_plugin", "-k", "law_alone")
    assert code == 0 and list(cases) == ["test_the_law_alone"], said


def test_its_failures_say_what_is_wrong_where_junit_shows_it(package):
    """Lambda doubled as in the tutorial; and a model whose message would break the file."""
    module = package / "src" / "softbody" / "__init__.py"
    right = module.read_text()
    module.write_text(right.replace("self.lam = young", "self.lam = 2 * young").replace("log = np.log", "log = boom(); np.log"))
    module.write_text(module.read_text() + '\n\ndef boom():\n    raise RuntimeError("\\x1b[31m ]]> \\0 <b>")\n')
    try:
        code, said, cases = run(package, "-k", "tetrahedra", "--stvk-report=reports")
    finally:
        module.write_text(right)
    assert code == 1
    told = {name: next(case.iter("failure")) for name, case in cases.items()}
    stvk, other = (told[f"{name}[tetrahedra]"] for name in NAMES)
    assert stvk.get("message").startswith("skfem_stvk.testing.Inconsistent: Body is not consistent: ")
    assert "lambda doubled: your lambda is 2.000 x, your mu 1.000 x" in stvk.get("message")
    assert "agreement, F of candidate against scikit-fem" in stvk.text and stvk.text in said
    assert "pytest_plugin.py:" not in said and "testing.py:" not in said  # the frames that fail are those of the tests
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


def test_a_mark_that_is_mistaken_is_said(package):
    body = "    stvk_referee.assert_law(energy=lambda F: 0.0)\n"
    tests = [f"\n\n@pytest.mark.stvk({mark})\ndef test_{i}(stvk_referee):\n{body}" for i, mark in enumerate(MISTAKEN)]
    module = package / "tests" / "test_mark.py"
    module.write_text("import pytest\n" + "".join(tests))
    try:
        code, said, cases = run(package, "-k", "test_mark")
    finally:
        module.unlink()
    assert code == 1 and "TypeError" not in said
    for i, words in enumerate(MISTAKEN.values()):
        (failure,) = cases[f"test_{i}"].iter("failure")
        assert words in failure.get("message")


def test_a_report_that_cannot_be_written_is_said_before_the_tests(package):
    (package / "a file").write_text("")
    paths = [str(package / "src"), str(package / "site"), str(ROOT)]
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")} | {"PYTHONPATH": os.pathsep.join(paths)}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--stvk-report=a file/reports", "tests"]
    done = subprocess.run(command, cwd=package, env=environment, capture_output=True, text=True)
    assert done.returncode == 4 and "--stvk-report=a file/reports: no reports can be written there" in done.stderr
    assert "Traceback" not in done.stderr and "passed" not in done.stdout
