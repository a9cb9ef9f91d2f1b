"""Compilation happens once per machine and is reported; without a cache, kernels work all the same."""

import gc
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core.errors import TypingError

from skfem_stvk.kernels import compiled

ROOT = Path(__file__).parent.parent.parent
TWO_KERNELS = """
import numpy as np
from skfem_stvk.kernels.simplex_topology import lexicographic_order, expand
assert lexicographic_order(np.array([[2, 0, 1]], dtype=np.int32), 3).tolist() == [1, 2, 0]
expand(np.array([0, 1]), np.array([0], dtype=np.int32), 2)
"""


#: Seconds between the reports of a long compilation; the tests do not depend on the time that it takes.
REPORTS = "from skfem_stvk.kernels.compiled import FirstUse\nFirstUse.EVERY = float('{}')\n"


def ran(code, root=ROOT, **environment):
    """Return a process that runs Python code with the package in the folder `root`; variables that are None are removed."""
    given = {**os.environ, "PYTHONPATH": str(root)} | environment
    variables = {name: str(value) for name, value in given.items() if value is not None}
    done = subprocess.run([sys.executable, "-c", code], env=variables, cwd=root, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done


def run(code, cache):
    return ran(code, NUMBA_CACHE_DIR=cache)


def test_compiling_is_reported_once_and_done_once_per_machine(tmp_path):
    first, second = (run(REPORTS.format("inf") + TWO_KERNELS, tmp_path) for _ in range(2))
    (line,) = first.stderr.splitlines()
    assert line.startswith("skfem_stvk: compiling kernels for their first use") and "`skfem-stvk warm-up` compiles ahead" in line
    (folder,) = {file.parent for file in tmp_path.rglob("*.nbc")}
    assert f"they are stored in {folder}; " in line
    assert first.stdout == second.stdout == second.stderr == ""


def test_one_rank_of_several_reports_compiling(tmp_path, monkeypatch):
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    for rank, count in (("1", 0), ("0", 1)):
        monkeypatch.setenv("OMPI_COMM_WORLD_RANK", rank)
        assert run(TWO_KERNELS, tmp_path / rank).stderr.count("compiling kernels") == count


def test_a_long_first_use_reports_the_number_of_compiled_kernels(tmp_path):
    lines = run(REPORTS.format("0") + TWO_KERNELS, tmp_path).stderr.splitlines()
    assert [int(line.split()[1]) for line in lines[1:]] == [1, 2, 3] and all(
        " kernel" in line and "compiled" in line for line in lines[1:]
    )


def test_kernels_of_other_packages_are_compiled_without_a_message(tmp_path):
    code = "import numba, skfem_stvk.kernels.simplex_topology\nassert numba.njit(lambda x: x + 1)(1) == 2"
    assert run(code, tmp_path).stderr == ""


@pytest.fixture
def no_cache(monkeypatch):
    """Make the package behave as on a machine on which no folder can be written to."""
    monkeypatch.setattr(compiled, "cache_folder", lambda: None)
    monkeypatch.setattr(compiled.first_use, "on_disk", True)  # restored after the test


def test_without_a_cache_kernels_are_compiled_in_every_process(no_cache):
    def total(x):
        s = 0.0
        for i in range(len(x)):
            s += x[i]
        return s

    kernel = compiled.kernel(total)
    assert kernel(np.arange(5.0)) == 10.0
    assert kernel.stats.cache_path is None and kernel.nopython_signatures
    options = kernel.targetoptions
    assert options["fastmath"] == compiled.FASTMATH and options["nogil"] and options["error_model"] == "numpy"


def test_a_piece_that_python_calls_is_refused_and_kernels_call_it():
    @compiled.inlined
    def twice(x):
        return 2 * x

    @compiled.kernel
    def doubled(x):
        return twice(x)

    with pytest.raises(TypeError, match=r"twice is inlined into kernels, .* or twice\.py_func"):
        twice(1.0)
    assert doubled(1.5) == twice.py_func(1.5) == 3.0


def test_python_searches_for_cycles_again_after_a_kernel_is_compiled():
    @compiled.kernel
    def half(x):
        return x / 2

    assert half(1.0) == 0.5 and gc.isenabled()
    with pytest.raises(TypingError):
        half("text")
    assert gc.isenabled()
    gc.disable()
    try:
        assert half(np.float32(3.0)) == 1.5 and not gc.isenabled()
    finally:
        gc.enable()


# where machine code is stored

KERNEL = "import numpy as np\nfrom skfem_stvk.kernels.simplex_topology import expand\n"
KERNEL += "print(expand(np.array([0, 1]), np.array([0], dtype=np.int32), 2)[0].tolist())\n"
OWN = """
import numba, pathlib, sys
sys.path.insert(0, "{folder}")
from own import twice
assert twice(2.0) == 4.0 and twice.stats.cache_path == "{folder}/__pycache__" and not numba.config.CACHE_DIR
"""


def copied(folder):
    """Copy the sources of the package into a folder, and return the folder."""
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "skfem_stvk", folder / "skfem_stvk", ignore=ignored)
    return folder


def test_machine_code_is_in_the_users_cache_folder_and_not_in_the_package(tmp_path):
    """An uninstalled package leaves no files behind, and functions of the user stay in their own cache."""
    root = copied(tmp_path / "installed")
    (tmp_path / "own.py").write_text("import numba\n\n@numba.njit(cache=True)\ndef twice(x):\n    return 2 * x\n")
    places = {"HOME": tmp_path / "home", "XDG_CACHE_HOME": None, "NUMBA_CACHE_DIR": None}
    done = ran(KERNEL + OWN.format(folder=tmp_path), root, **places)
    (folder,) = {file.parent for file in tmp_path.rglob("simplex_topology.*.nb[ci]")}
    assert folder.parent == tmp_path / "home" / ".cache" / "skfem-stvk" and str(folder) in done.stderr
    assert not [file for file in root.rglob("__pycache__/*") if file.suffix != ".pyc"]
    for name in ("XDG_CACHE_HOME", "NUMBA_CACHE_DIR"):
        ran(KERNEL, root, **places | {name: tmp_path / name})
        assert list((tmp_path / name / "skfem-stvk" / folder.name).glob("simplex_topology.*.nbc"))


def test_checkouts_of_one_version_do_not_load_the_kernels_of_each_other(tmp_path):
    """Two checkouts differ in one kernel and take turns; each compiles once and has its own result."""
    roots = copied(tmp_path / "one"), copied(tmp_path / "other")
    source = roots[1] / "skfem_stvk" / "kernels" / "simplex_topology.py"
    text = source.read_text()
    assert text.count("    indptr[0] = 0\n") == 1
    source.write_text(text.replace("    indptr[0] = 0\n", "    indptr[0] = 7\n"))
    done = [ran(KERNEL, root, NUMBA_CACHE_DIR=tmp_path / "cache") for root in (*roots, *roots)]
    assert [one.stdout for one in done] == ["[0, 2, 4]\n", "[7, 2, 4]\n"] * 2
    assert ["compiling" in one.stderr for one in done] == [True, True, False, False]


def test_files_of_other_source_or_other_types_are_not_loaded(tmp_path):
    """Processes that compile one kernel at the same time may choose the same name for their files."""
    file = compiled.CheckedFile(str(tmp_path), "kernel", "source")
    file.save("f8", "code")
    assert file.load("f8") == "code" and file.load("f4") is None
    (stored,) = tmp_path.glob("*.nbc")
    code = stored.read_bytes()
    for stamp, key in (("source", "f4"), ("other source", "f8")):
        other = compiled.CheckedFile(str(tmp_path), "kernel", stamp)
        other.save(key, "other code")
        assert other.load(key) == "other code"
        file_of_other = next(path for path in tmp_path.glob("*.nbc") if path.name == other._load_index()[key])
        file_of_other.write_bytes(code)
        assert other.load(key) is None


UNUSABLE = {
    "missing": lambda folder: folder / "file" / "folder",
    "a file": lambda folder: folder / "file",
    "full": lambda folder: "/dev/full",
}


@pytest.mark.few(1)
@pytest.mark.parametrize("home", UNUSABLE)
def test_an_unusable_home_costs_one_message_and_kernels_work(home, tmp_path):
    (tmp_path / "file").write_text("")
    places = {"HOME": UNUSABLE[home](tmp_path), "XDG_CACHE_HOME": None, "NUMBA_CACHE_DIR": None}
    done = ran(REPORTS.format("inf") + KERNEL, **places)
    (line,) = done.stderr.splitlines()
    assert done.stdout == "[0, 2, 4]\n" and "no cache folder is writable. Set NUMBA_CACHE_DIR to a writable folder" in line
    done = ran(KERNEL, **places | {"NUMBA_CACHE_DIR": tmp_path / "cache"})
    assert list((tmp_path / "cache").rglob("*.nbc"))


def test_without_a_home_no_folder_of_that_sign_is_made(monkeypatch, tmp_path):
    """Where the home is unknown, "~" remains in the path of the user's cache folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(compiled.numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(compiled, "user_cache_path", lambda *name, **options: Path("~/.cache/skfem-stvk"))
    assert compiled.cache_folder.__wrapped__() is None and not list(tmp_path.iterdir())
    monkeypatch.setattr(compiled.numba.config, "CACHE_DIR", "relative")
    assert compiled.cache_folder.__wrapped__().parent == tmp_path / "relative" / "skfem-stvk"


def test_checks_for_overflow_are_not_optimised_away():
    """The fast math flags do not include those that assume finite numbers."""
    assert not {"ninf", "nnan", "fast", "afn"} & set(compiled.FASTMATH)

    @compiled.kernel
    def ratio(a, b):
        return a / b if a == a else -1.0

    assert ratio(np.nan, 1.0) == -1.0 and ratio(1.0, 0.0) == np.inf


def test_kernels_run_as_plain_functions_where_numba_is_switched_off(tmp_path):
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", TWO_KERNELS], env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0 and done.stderr == "", done.stderr
