"""Compilation happens once per machine and is reported; without a cache, kernels work all the same."""

import gc
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.errors import TypingError

from skfem_stvk.kernels import compiled

ROOT = Path(__file__).parent.parent.parent
TWO_KERNELS = """
import numpy as np
from skfem_stvk.kernels.topology import lexicographic_order, expand
assert lexicographic_order(np.array([[2, 0, 1]], dtype=np.int32), 3).tolist() == [1, 2, 0]
expand(np.array([0, 1]), np.array([0], dtype=np.int32), 2)
"""


def run(code, cache):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    return done


def test_compiling_is_reported_once_and_done_once_per_machine(tmp_path):
    first, second = run(TWO_KERNELS, tmp_path), run(TWO_KERNELS, tmp_path)
    assert first.stderr.count("skfem_stvk: compiling kernels for their first use") == 1
    assert "`skfem-stvk warm-up` compiles ahead" in first.stderr and "kernels compiled" not in first.stderr
    assert "compiling" not in second.stderr
    assert first.stdout == second.stdout == ""
    assert list(tmp_path.rglob("*.nbc"))


def test_one_rank_of_several_reports_compiling(tmp_path, monkeypatch):
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    for rank, count in (("1", 0), ("0", 1)):
        monkeypatch.setenv("OMPI_COMM_WORLD_RANK", rank)
        assert run(TWO_KERNELS, tmp_path / rank).stderr.count("compiling kernels") == count


def test_a_long_first_use_reports_the_number_of_compiled_kernels(tmp_path):
    early = "from skfem_stvk.kernels.compiled import FirstUse\nFirstUse.EVERY = 0.0\n"
    lines = run(early + TWO_KERNELS, tmp_path).stderr.splitlines()
    assert [int(line.split()[1]) for line in lines[1:]] == [1, 2, 3] and all(
        " kernel" in line and "compiled" in line for line in lines[1:]
    )


def test_kernels_of_other_packages_are_compiled_without_a_message(tmp_path):
    code = "import numba, skfem_stvk.kernels.topology\nassert numba.njit(lambda x: x + 1)(1) == 2"
    assert run(code, tmp_path).stderr == ""


@pytest.fixture
def no_cache(monkeypatch):
    """Make numba behave as on a machine on which no folder can be written to."""
    njit = numba.njit

    def refuse(*arguments, cache=False, **options):
        decorate = njit(*arguments, **options)

        def decorated(function):
            if cache:
                raise RuntimeError(f"cannot cache function {function.__name__!r}: no locator available for file 'x.py'")
            return decorate(function)

        return decorated

    monkeypatch.setattr(numba, "njit", refuse)
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


@pytest.mark.slow
def test_energies_are_computed_without_a_cache(tmp_path):
    code = """
import numba
njit = numba.njit
def refuse(*arguments, cache=False, **options):
    if cache:
        raise RuntimeError("cannot cache function: no locator available")
    return njit(*arguments, **options)
numba.njit = refuse
import skfem
from skfem_stvk import StVK, System
mesh = skfem.MeshTet()
print(System(mesh, StVK(young=1e5, poisson=0.3)).energy(0.01 * mesh.p.ravel("F")))
"""
    done = run(code, tmp_path)
    assert float(done.stdout) == pytest.approx(4.5 * 1e5 / 1.2 * 0.01005**2, rel=1e-12)
    assert done.stderr.count("compiling") == 1 and not list(tmp_path.rglob("*.nbc"))


def test_checks_for_overflow_are_not_optimised_away():
    """The fast math flags do not include those that assume finite numbers."""
    assert not {"ninf", "nnan", "fast", "afn"} & set(compiled.FASTMATH)

    @compiled.kernel
    def ratio(a, b):
        return a / b if a == a else -1.0

    assert ratio(np.nan, 1.0) == -1.0 and ratio(1.0, 0.0) == np.inf


def test_kernels_run_as_plain_functions_where_numba_is_switched_off(tmp_path):
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", TWO_KERNELS], env=environment, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0 and done.stderr == "", done.stderr
