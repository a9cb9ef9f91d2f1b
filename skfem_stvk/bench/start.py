"""How long it takes until W, F and K can be computed."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

from ..errors import StvkError
from ..system import System
from .case import Case
from .results import OURS, Benchmark
from .timing import Seconds, threads

TIMES = 3
CALLS: dict[str, Callable[[System, Any], Any]] = {"W+F": System.energy_and_force, "K": System.tangent}
FIRST_USE = """
from time import perf_counter
import numpy as np, skfem
from skfem_stvk import StVK, System
begin = perf_counter()
body = System(skfem.MeshTet().refined(1), StVK(young=1.0, poisson=0.3))
u = np.zeros(body.ndofs)
body.energy_and_force(u), body.tangent(u), body.product(u, u)
print(perf_counter() - begin)
"""


def time_setup(results: Benchmark, case: Case) -> None:
    """From arrays to the first W and F, and to the first K, less the time of one such call: the best of three, on one thread."""
    with threads(1):
        for quantity, call in CALLS.items():
            ours = results.best(case.name, OURS, quantity)
            if ours is None:
                continue
            taken = []
            for _ in range(TIMES):
                begin = perf_counter()
                call(System((case.mesh.p, case.mesh.t), case.term), case.u)
                taken.append(perf_counter() - begin - 1e-9 * ours * case.mesh.nt)
            results.add(case, OURS, f"setup of {quantity}", Seconds(min(taken), float(np.median(taken)), TIMES))


def first_use() -> float:
    """Time [s] of the first W, F, K and K v of tetrahedra in double precision, all compiled anew by a new process.

    Raises
    ------
    StvkError
        if that process fails.
    """
    with TemporaryDirectory() as folder:
        settings = os.environ | {"NUMBA_CACHE_DIR": folder}
        done = subprocess.run([sys.executable, "-c", FIRST_USE], env=settings, capture_output=True, text=True, check=False)
    if done.returncode:
        raise StvkError(f"The first use in a new process failed: {done.stderr.strip()[-300:]}")
    return float(done.stdout)
