"""Cached machine code: damaged files are reported and deleted, and a full disk costs only compile time."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
import skfem
from numba.core.caching import FunctionCache
from numba.core.event import Listener, install_listener

from skfem_stvk import StvkWarning
from skfem_stvk.kernels import compiled
from skfem_stvk.kernels.simplex_topology import edges_of_simplices

ROOT = Path(__file__).parent.parent.parent
KERNEL = """
import numpy as np
from skfem_stvk.kernels.simplex_topology import lexicographic_order
assert lexicographic_order(np.array([[2, 0, 1]], dtype=np.int32), 3).tolist() == [1, 2, 0]
"""
NO_ROOM = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))\n"
#: One law stored in two ways, on linear simplices, with a table of points, and with mean gradients, in the order `kinds`.
LAWS = """
import numpy as np
from skfem_stvk.kernels.lanes import LANES, MeanPoints, Points
from skfem_stvk.kernels.st_venant_kirchhoff import GeneralLaw, IsotropicLaw
from skfem_stvk.kernels.element_assembly import energy_and_force
NUMBERS = {{IsotropicLaw: [1, 2], GeneralLaw: [3, 1, 1, 0, 0, 0, 3, 1, 0, 0, 0, 3, 0, 0, 0, 2, 0, 0, 2, 0, 2]}}
t, X = np.repeat(np.arange(4, dtype=np.uint32), LANES), np.array([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1.0])
means = np.repeat(np.eye(3), LANES).reshape(1, 3, 3, LANES)
for law, points in {kinds}:
    D = np.zeros((6 + len(NUMBERS[law]), LANES))
    D[[0, 3, 5], 0], D[6:, 0] = 1, NUMBERS[law]
    starts = np.array([0, D.size])
    table = None
    if points is Points:
        table = Points(np.eye(3)[None], np.ones(1), starts)
    if points is MeanPoints:
        table = MeanPoints(means, np.ones(1), starts, np.zeros((1, 3)), np.zeros((1, LANES)))
    W = energy_and_force(0, 1, t, t, table, law(D.ravel()), X, 0.1 * X, np.empty(0))
    assert abs(W - 0.75 * 0.21 * 5 * 0.21) < 1e-15, (law, points, W)
"""
KINDS = "(GeneralLaw, Points)", "(IsotropicLaw, None)", "(IsotropicLaw, MeanPoints)"


def messages_of(code, cache, **environment):
    """Return the standard error of a process with this cache, after checks that the process succeeded and printed nothing."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(ROOT), **environment}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    return done.stderr


#: Damage to files of the cache: the suffix of the file, and a function that changes its bytes.
DAMAGE = {
    "an index cut off": ("nbi", lambda data: data[: len(data) // 2]),
    "an empty index": ("nbi", lambda data: b""),
    "code cut off": ("nbc", lambda data: data[: len(data) // 2]),
    "code with zeros at its end": ("nbc", lambda data: data[: len(data) // 2] + bytes(len(data) - len(data) // 2)),
    "code with one bit flipped": ("nbc", lambda data: data[:-1000] + bytes([data[-1000] ^ 1]) + data[-999:]),
}


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cache")
    messages_of(KERNEL, folder)
    return folder


@pytest.mark.few(2)
@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_cache_is_reported_deleted_and_compiled_again(damage, cache):
    suffix, change = DAMAGE[damage]
    (file,) = [file for file in cache.rglob(f"*.{suffix}") if file.name.startswith("simplex_topology.lexicographic_order")]
    whole = file.read_bytes()
    file.write_bytes(change(whole))
    words = messages_of(KERNEL, cache)
    assert (
        "is damaged" in words
        and "it is deleted and compiled again" in words
        and str(cache) in words
        and words.count("damaged") == 1
    )
    assert file.read_bytes() != change(whole)


@pytest.mark.slow
def test_laws_and_elements_find_their_cached_code_in_any_order(tmp_path):
    """Formulas are chosen by type; each type has its own code, and the second process compiles nothing."""
    assert "compiling" in messages_of(LAWS.format(kinds=f"[{', '.join(KINDS)}]"), tmp_path)
    assert messages_of(LAWS.format(kinds=f"[{', '.join(KINDS[::-1])}]"), tmp_path) == ""


def test_a_full_disk_is_reported_and_kernels_are_compiled(tmp_path):
    words = messages_of(NO_ROOM + KERNEL, tmp_path)
    assert "compiled kernels cannot be stored in" in words and "NUMBA_CACHE_DIR" in words and words.count("cannot be stored") == 1
    assert not [file for file in tmp_path.rglob("*") if file.is_file() and file.stat().st_size]


@pytest.mark.parametrize("given", ["0", "abc", "-3", "2.5", ""])
def test_an_invalid_number_of_threads_is_ignored_with_a_warning(given, monkeypatch):
    import skfem_stvk.kernels as kernels

    monkeypatch.setenv("NUMBA_NUM_THREADS", given)
    with pytest.warns(StvkWarning, match=f"NUMBA_NUM_THREADS = {given!r} is ignored; expected a whole number from 1"):
        kernels._usable_number_of_threads()
    assert "NUMBA_NUM_THREADS" not in os.environ


def test_the_package_is_imported_with_any_number_of_threads(tmp_path):
    assert "NUMBA_NUM_THREADS = '0' is ignored" in messages_of("from skfem_stvk import System", tmp_path, NUMBA_NUM_THREADS="0")
    assert (
        messages_of(
            "from skfem_stvk import System; import numba; assert numba.config.NUMBA_NUM_THREADS == 1",
            tmp_path,
            NUMBA_NUM_THREADS="1",
        )
        == ""
    )


@pytest.mark.parametrize(
    ("name", "edited", "again"),
    [
        ("motion_updates", "motion_updates", True),
        ("motion_updates", "compiled_cg", False),
        ("element_assembly", "lanes", True),
        ("element_assembly", "compiled_cg", False),
        ("rows", "laws", True),
    ],
)
def test_code_on_disk_is_keyed_by_its_source_files(name, edited, again, tmp_path, monkeypatch):
    """After an edit of one file, only kernels that contain its code are compiled again."""
    for file in Path(compiled.__file__).parent.glob("*.py"):
        (tmp_path / file.name).write_text(file.read_text())
    monkeypatch.setattr(compiled, "__file__", str(tmp_path / "compiled.py"))
    before = compiled.source_hash.__wrapped__(name)
    (tmp_path / f"{edited}.py").write_text((tmp_path / f"{edited}.py").read_text() + "# edited\n")
    assert (compiled.source_hash.__wrapped__(name) != before) is again


def test_ctrl_c_while_code_is_loaded_takes_effect_after_the_load(monkeypatch):
    """An interruption during the load ended the process now and then, because callbacks of LLVM lose exceptions."""
    whole = []

    def load(signature, target):
        signal.raise_signal(signal.SIGINT)
        whole.append(signature)

    monkeypatch.setattr(FunctionCache, "load_overload", lambda cache, *arguments: load(*arguments))
    cache = compiled.KernelCache(edges_of_simplices.py_func)
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        cache.load_overload("f8", None)
    assert whole == ["f8"] and signal.getsignal(signal.SIGINT) is before


def test_ctrl_c_while_llvm_compiles_takes_effect_afterwards():
    """In a callback of LLVM the interruption was lost, and the next call raised "no compiled object"."""
    whole = []

    class Pressed(Listener):
        def on_start(self, event):
            if event.data["name"].startswith("native_lowering "):
                signal.raise_signal(signal.SIGINT)
                whole.append(event.data["name"])

        def on_end(self, event):
            pass

    double = numba.njit(lambda x: 2 * x)
    with install_listener("numba:run_pass", Pressed()), pytest.raises(KeyboardInterrupt):
        double(1.0)
    assert len(whole) == 1 and double(1.5) == 3.0


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs timers that send signals")
def test_ctrl_c_is_not_lost_while_a_kernel_returns_arrays():
    """Ctrl-C raises KeyboardInterrupt at any time of the call.

    A Python function that machine code calls to make arrays would lose the interruption and raise SystemError at nearly every
    signal.
    """
    mesh = skfem.MeshTet().refined(1)
    t, pairs = np.ascontiguousarray(mesh.t, dtype=np.int32), np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
    edges_of_simplices(t, pairs, mesh.nvertices)
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        for number in range(1, 301):
            with pytest.raises(KeyboardInterrupt):
                while True:  # repeated, because a finaliser loses the interruption, too
                    signal.setitimer(signal.ITIMER_REAL, 1e-6 * number)
                    for _ in range(1000):
                        edges_of_simplices(t, pairs, mesh.nvertices)
    finally:
        signal.signal(signal.SIGALRM, before)
