"""The version has one value, classifiers name what was tried, and the workflow runs the tests of a clean checkout."""

import re
import sys
from pathlib import Path

import skfem_stvk

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PYTHON = "Programming Language :: Python :: 3."


def test_one_version_is_in_the_project_the_changelog_the_citation_and_the_installed_package():
    (citation,) = re.findall(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    changelog = re.findall(r"^## \[(.*?)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert citation == changelog[0] == skfem_stvk.__version__ == PROJECT["version"]


def test_classifiers_name_the_versions_of_python_and_the_system_that_were_tried():
    """CONTRIBUTING.md says on which versions the tests have run; all ran on Linux."""
    tried = re.search(r"Write for Python 3\.(\d+) to 3\.(\d+)", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
    minors = [int(one.removeprefix(PYTHON)) for one in PROJECT["classifiers"] if one.startswith(PYTHON)]
    assert minors == list(range(int(tried[1]), int(tried[2]) + 1)) and PROJECT["requires-python"] == f">=3.{minors[0]}"
    assert [one for one in PROJECT["classifiers"] if one.startswith("Operating System")] == ["Operating System :: POSIX :: Linux"]


def test_the_workflow_runs_the_tests_of_a_clean_checkout():
    workflow = (ROOT / ".github" / "workflows" / "tests.yml").read_text(encoding="utf-8")
    (version,) = re.findall(r'python-version: "(.*)"', workflow)
    assert "- run: .ci/run" in workflow and f"Programming Language :: Python :: {version}" in PROJECT["classifiers"]
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o111
