"""Results are bitwise the same from run to run.

Results are the same up to rounding for any number of threads, which may change at any time.
"""

import multiprocessing
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
import pytest
from bodies import BODIES, MESHES, box, state
from kernels.parts import in_parts
from system.shared_by_threads import CASES, measure

from skfem_stvk import Anisotropic, StVK, System
from skfem_stvk.kernels import threads as kernel_threads
from skfem_stvk.system.pattern import Pattern

SOME = ["tetrahedra, two regions", "tetrahedra, anisotropic", "membrane, isotropic", "cable, fibres"]
needs_two = pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="this machine has one core")


@pytest.fixture
def threads(monkeypatch):
    """Return the function that sets the number of threads, for meshes of any size."""
    before = numba.get_num_threads()
    monkeypatch.setattr(kernel_threads, "SMALLEST_PART", 1)
    yield numba.set_num_threads
    numba.set_num_threads(before)


def results(body, u, v):
    W, F, K = body.linearize(u)
    return [np.array([body.energy(u), W]), body.internal_force(u), F, body.tangent(u).data, K.data, body.product(u, v)]


def assert_close(one, other, limit=1e-14):
    for a, b in zip(one, other, strict=True):
        assert np.abs(a).max() > 1e-3
        assert np.abs(a - b).max() <= limit * np.abs(a).max()


@pytest.mark.parametrize("n", [1, pytest.param(2, marks=needs_two)])
@pytest.mark.parametrize("name", SOME)
def test_results_are_the_same_to_the_last_bit_from_run_to_run(name, n, threads):
    mesh, terms = BODIES[name]
    u, v = state(mesh), state(mesh, seed=9)
    threads(n)
    body = System(mesh, terms)
    first = results(body, u, v)
    for _ in range(5):
        body.tangent(-2 * u)
        body.product(-2 * u, v)
        for a, b in zip(first, results(body, u, v), strict=True):
            assert np.array_equal(a, b)
    for a, b in zip(first, results(System(mesh, terms), u, v), strict=True):
        assert np.array_equal(a, b)


@needs_two
def test_meshes_that_are_large_enough_are_shared(threads, monkeypatch):
    monkeypatch.setattr(kernel_threads, "SMALLEST_PART", 2000)
    mesh = box(9)
    u, v = state(mesh), state(mesh, seed=9)
    for term in (StVK(young=2.0, poisson=0.3), StVK(Anisotropic(np.diag([3.0, 4, 5, 1, 2, 3]) + 0.5))):
        found, shares = [], []
        for n in (1, 2):
            threads(n)
            body = System(mesh, term)
            found.append(results(body, u, v))
            shares.append(body.memory()["shares of threads"])
        assert_close(*found)
        assert shares[0] == 0 and shares[1] > 16 * mesh.nt


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own(monkeypatch):
    in_parts(monkeypatch, 3)
    mesh, terms = BODIES["tetrahedra, isotropic"]
    body, u = System(mesh, terms), state(mesh)
    F = body.internal_force(u)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert np.array_equal(pool.apply_async(body.internal_force, (u,)).get(timeout=300), F)


#: A child of this process is killed while it holds the semaphore of numba's threads, which forks share.
KILLED = """
import multiprocessing, os, signal
multiprocessing.set_start_method("fork")
import numba, numpy as np
from numba.np.ufunc import parallel
from skfem_stvk import StVK, System
from skfem_stvk.kernels.threads import threads
from skfem_stvk.mesh import box
from skfem_stvk.scenes.run_scene import on_threads
body = System(box((1.0, 1.0, 1.0), (2, 2, 2)), StVK(young=2.0, poisson=0.3))
u = np.sin(np.arange(body.ndofs))
before = body.internal_force(u)
numba.set_num_threads(1)
assert threads() == 1
child = os.fork()
if not child:
    parallel._backend_init_process_lock.acquire()
    os.kill(os.getpid(), signal.SIGKILL)
os.waitpid(child, 0)
with on_threads(None):
    assert np.array_equal(body.internal_force(u), before) and body.tangent(u).nnz and threads() == 1
print("went on", flush=True)
os._exit(0)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_kernels_go_on_after_a_forked_process_was_killed_within_a_call():
    found = subprocess.run([sys.executable, "-c", KILLED], capture_output=True, text=True, timeout=120)
    assert found.stdout == "went on\n", found.stderr


@needs_two
def test_the_number_of_threads_is_that_of_numba_in_each_python_thread(threads):
    threads(1)
    assert kernel_threads.threads() == numba.get_num_threads() == 1
    with ThreadPoolExecutor(1) as pool:
        pool.submit(threads, 2).result()
        assert (pool.submit(kernel_threads.threads).result(), kernel_threads.threads()) == (2, 1)
    threads(2)
    assert kernel_threads.threads() == 2


def test_bodies_of_several_python_threads_do_not_disturb_each_other(monkeypatch):
    in_parts(monkeypatch, 3)
    cases = [(System(mesh, terms), state(mesh), state(mesh, seed=9)) for mesh, terms in map(BODIES.get, SOME)]
    wanted = [results(*case) for case in cases]
    with ThreadPoolExecutor(len(cases)) as pool:
        for _ in range(5):
            for one, other in zip(wanted, pool.map(lambda case: results(*case), cases), strict=True):
                assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.mark.few
@pytest.mark.parametrize("name", SOME)
@pytest.mark.parametrize(("first", "then"), [(1, 2), (2, 1), (2, 3), (5, 2), (1, 5)])
def test_the_number_may_change_between_any_two_calls(name, first, then, monkeypatch):
    mesh, terms = BODIES[name]
    u, v = state(mesh), state(mesh, seed=9)
    in_parts(monkeypatch, 1)
    W, F, K = System(mesh, terms).linearize(u)
    in_parts(monkeypatch, first)
    body = System(mesh, terms)
    operator, matrix = body.linear_operator(u), body.tangent(-u)
    body.product(-u, v)
    in_parts(monkeypatch, then)
    assert_close([K @ v], [operator @ v])  # prepared by `first` threads
    assert_close([K @ v], [body.product(u, v)])  # prepared again
    matrix = body.tangent(u, out=matrix)  # filled again
    assert_close([K.data], [matrix.data])
    in_parts(monkeypatch, first)
    assert_close([K @ v], [operator @ v])
    assert_close([K @ v], [body.product(u, v)])
    again = body.linearize(u, out=matrix)
    assert_close([np.array([W]), F, K.data], [np.array([again[0]]), again[1], again[2].data])


def test_work_is_shared_again_when_the_number_changes(monkeypatch):
    mesh, terms = BODIES["tetrahedra, isotropic"]
    body, shares = System(mesh, terms), []
    for n in (1, 3, 2, 3, 1):
        in_parts(monkeypatch, n)
        body.tangent(state(mesh))
        shares.append(body.memory()["shares of threads"])
    assert shares[0] == shares[4] == 0 < shares[2] < shares[1] == shares[3]


def test_threads_that_request_the_pattern_at_the_same_time_get_one(monkeypatch):
    """Threads that request the pattern at the same time get one pattern.

    A system with another pattern would refuse degrees of freedom of this system.
    """

    class Slow(Pattern):
        def __init__(self, *arguments):
            time.sleep(0.05)
            super().__init__(*arguments)

    monkeypatch.setattr("skfem_stvk.system.system.Pattern", Slow)
    body = System(MESHES["tetrahedra"], StVK(young=2.0, poisson=0.3))
    with ThreadPoolExecutor(4) as pool:
        assert len({id(found) for found in pool.map(lambda _: body.pattern, range(4))}) == 1


def test_python_threads_that_share_a_system_run_one_at_a_time():
    body = System(MESHES["tetrahedra"], StVK(young=2.0, poisson=0.3))
    states = [state(body.mesh, seed=seed) for seed in range(8)]
    wanted = [(body.energy(u), body.internal_force(u), body.tangent(u).data, body.product(u, u)) for u in states]
    with ThreadPoolExecutor(4) as pool:
        for _ in range(5):
            found = pool.map(lambda u: (body.energy(u), body.internal_force(u), body.tangent(u).data, body.product(u, u)), states)
            for one, other in zip(wanted, found, strict=True):
                assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.mark.few
@pytest.mark.parametrize("name", CASES)
def test_python_threads_that_share_an_object_get_what_one_thread_gets(name):
    found = measure(CASES[name], 0.3)
    assert found.calls >= 40 and found.wrong == 0, found
