"""Comparison of the speed of two versions of the package: the same calls alternate in both, on the same machine.

    python validation/as_fast.py OTHER_CHECKOUT [--rounds 9]         in a checkout

Each round runs both versions one after the other, each in its own process, and takes the best of several repetitions of each call.
The table has the medians over the rounds, their ratio, and the quartiles of the ratios of single rounds. One thread. This copy of
the program runs in both, so it uses names that `skfem_stvk` exports and attributes that its pages document.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np


def calls() -> dict[str, tuple[int, Callable[[], Any]]]:
    """Return the timed calls by name: the number of repetitions in a round, and the call."""
    import skfem

    import skfem_stvk as stvk

    def body(n: int) -> stvk.System:
        mesh = skfem.MeshTet.init_tensor(*(np.linspace(0, s, s * n + 1) for s in (2, 1, 1)))
        mesh = mesh.with_boundaries({"left": lambda x: x[0] == 0, "right": lambda x: x[0] == 2})
        rubber, gravity = stvk.StVK(young=1e6, poisson=0.3, density=1e3), stvk.Gravity(g=(0, 0, -9.81))
        return stvk.System(mesh, [rubber, gravity], fixed={"left": "xyz"})

    found: dict[str, tuple[int, Callable[[], Any]]] = {}
    for n in (7, 16):
        system = body(n)
        u = 1e-3 / n * np.random.default_rng(0).standard_normal(system.ndofs) + 0.05 * system.mesh.p.ravel("F")
        K, force, operator = system.tangent(u), np.zeros(system.ndofs), system.linear_operator(u)
        size = f"{system.mesh.nt} tets"
        found |= {
            f"W and F, {size}": (60, partial(system.energy_and_force, u, out=force)),
            f"K, {size}": (25, partial(system.tangent, u, out=K)),
            f"W, F and K, {size}": (25, partial(system.linearize, u, out=K)),
            f"K v at a new u, {size}": (25, partial(new_product, system, u)),
            f"K v, {size}": (60, partial(operator.__matmul__, u)),
            f"K v without an operator, {size}": (25, partial(system.product, u, u)),
        }
    small, large = body(7), body(10)
    plate = skfem.MeshTri.init_tensor(np.linspace(0, 1, 61), np.linspace(0, 0.2, 13)).with_boundaries({"left": lambda x: x[0] == 0})
    rubber, gravity = stvk.StVK(young=1e7, poisson=0.4, density=1e3), stvk.Gravity(g=(0, -9.81))
    flag = stvk.System(plate, [rubber, gravity], fixed={"left": "xy"})

    def statics(system: stvk.System, solver: str, **options: Any) -> Callable[[], Any]:
        return lambda: stvk.solve_static(system, steps=2, solver=solver, quiet=True, **options)

    def motion(system: stvk.System, integrator: Any, until: float) -> Callable[[], Any]:
        return lambda: stvk.simulate(system, integrator, until=until, quiet=True)

    return found | {
        "system made": (3, lambda: body(7)),
        "statics, superlu, triangles": (3, statics(flag, "superlu")),
        "statics, block-jacobi-cg": (2, statics(small, "block-jacobi-cg")),
        "statics, amg-cg": (2, statics(large, "amg-cg")),
        "arc length, superlu, triangles": (2, statics(flag, "superlu", method="arc-length")),
        "velocity Verlet, 200 steps": (3, motion(small, stvk.VelocityVerlet(dt=1e-4), 0.02)),
        "backward Euler (linear), 10 steps": (3, motion(small, stvk.LinearBackwardEuler(dt=1e-2), 0.1)),
        "Newmark, 10 steps": (2, motion(small, stvk.Newmark(dt=1e-2), 0.1)),
        "energy-momentum, 10 steps": (2, motion(small, stvk.EnergyMomentum(dt=1e-2), 0.1)),
        "one step of velocity Verlet": (5, motion(flag, stvk.VelocityVerlet(dt=1e-5), 1e-5)),
    }


def new_product(system: Any, u: Any) -> Any:
    """Return K(u) u by a new operator."""
    return system.linear_operator(u) @ u


def measure() -> dict[str, float]:
    """Return the shortest time of each call [s]."""
    import numba

    numba.set_num_threads(1)
    found = {}
    for name, (repetitions, call) in calls().items():
        call()
        times = []
        for _ in range(repetitions):
            begin = perf_counter()
            call()
            times.append(perf_counter() - begin)
        found[name] = min(times)
    return found


def one_round(checkout: Path) -> dict[str, float]:
    """Return the times of the package of a checkout, measured in a separate process."""
    command = [sys.executable, "-W", "ignore", str(Path(__file__).resolve()), "--measure"]
    environment = os.environ | {"PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True, check=True)
    times: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return times


def main() -> int:
    """Measure this checkout, or compare it with another one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", nargs="?", metavar="OTHER_CHECKOUT")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--measure", action="store_true", help="print the seconds of each call once, as JSON")
    given = parser.parse_args()
    if given.measure or given.other is None:
        print(json.dumps(measure()))
        return 0
    folders = Path(given.other).resolve(), Path.cwd()
    rounds: list[list[dict[str, float]]] = [[one_round(folder) for folder in folders] for _ in range(given.rounds)]
    print(f"{'':36}{'before [ms]':>12}{'now [ms]':>12}{'now/before':>12}   quartiles of rounds   of the best")
    for name in rounds[0][0]:
        before, now = (np.array([pair[i][name] for pair in rounds]) for i in (0, 1))
        low, high = np.quantile(now / before, (0.25, 0.75))
        ratio = np.median(now) / np.median(before)
        medians = f"{1e3 * np.median(before):12.4g}{1e3 * np.median(now):12.4g}{ratio:12.3f}"
        print(f"{name:36}{medians}   {low:.3f} - {high:.3f}{now.min() / before.min():16.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
