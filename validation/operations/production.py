"""Operation counts of the package's own kernels, from uncompiled runs with counted numbers.

`python -m validation.operations.production`, with NUMBA_DISABLE_JIT=1 in the environment, prints the counts as JSON. `production()`
runs this command.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
import skfem

from skfem_stvk import ElementMesh, StVK, System
from skfem_stvk.kernels import element_assembly as elements
from skfem_stvk.kernels.lanes import LANES

from .counting import Tally, counted, plain

#: Relative tolerance between the results of a kernel with counted numbers and with plain numbers.
AGREEMENT = 1e-12


class Count(NamedTuple):
    """Operations per element: of F, and of K including F."""

    name: str
    F: float
    K: float


def production() -> list[Count]:
    """Return the operations of each kind of element."""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-m", __spec__.name], env=environment, capture_output=True, text=True, check=True)
    return [Count(*row) for row in json.loads(done.stdout.splitlines()[-1])]


def counts() -> Iterator[Count]:
    """Yield the counts for `production`; must run in a process without compilation."""
    for name, mesh, options in _meshes():
        system = System(mesh, StVK(young=2.0, poisson=0.3), **options)
        u = 0.1 * np.random.default_rng(0).standard_normal((mesh.nv, 3))
        [term] = system.bound_terms
        found = [
            _counted_call("energy_and_force", partial(term.energy_and_force, u, np.zeros_like(u))),
            _counted_call("linearize", partial(system.linearize, u.ravel())),
        ]
        full = -(-mesh.nt // LANES) * LANES  # elements that only fill the last block of lanes are computed as well
        yield Count(name, *(operations / full for operations in found))


def _meshes() -> Iterator[tuple[str, ElementMesh, dict[str, Any]]]:
    """Yield distorted elements of each kind. Except for hexahedra, their number fills whole blocks of lanes."""
    line, rng = np.linspace(0, 1, 3), np.random.default_rng(1)
    tets = ElementMesh.of(skfem.MeshTet.init_tensor(line, line, line))
    boxes = ElementMesh.of(skfem.MeshHex.init_tensor(line, line, line))

    def moved(mesh: ElementMesh, amount: float) -> ElementMesh:
        return replace(mesh, p=mesh.p + amount * rng.uniform(-1, 1, mesh.p.shape))

    tets, boxes = moved(tets, 0.05), moved(boxes, 0.05)
    yield "tetrahedra", tets, {}
    yield "quadratic tetrahedra", tets.with_degree(2), {}
    yield "quadratic tetrahedra, curved", moved(tets.with_degree(2), 0.01), {}
    yield "hexahedra", boxes, {}
    yield "hexahedra, one point", boxes, {"quadrature": "one-point", "hourglass": 0.05}


def _counted_call(kernel: str, call: Callable[[], Any]) -> int:
    """Return the operations of a kernel within a call. The kernel also runs with plain numbers, and both results must agree."""
    right, tally = getattr(elements, kernel), Tally()

    def both(begin: int, end: int, *arguments: Any) -> Any:
        in_numbers = [_with(argument, lambda array: counted(array, tally)) for argument in arguments]
        right(begin, end, *in_numbers)
        result = right(begin, end, *arguments)
        for given, numbers in zip(arguments, in_numbers, strict=True):
            if isinstance(given, np.ndarray) and given.dtype.kind == "f" and given.size:
                assert np.abs(plain(numbers) - given).max() <= AGREEMENT * max(1.0, np.abs(given).max())
        return result

    with patch.object(elements, kernel, both):
        call()
    assert tally.operations, kernel
    return tally.operations


def _with(argument: Any, change: Callable[[Any], Any]) -> Any:
    """Return an argument of a kernel with `change` applied to its arrays of real numbers, also within tuples."""
    if isinstance(argument, tuple):
        return type(argument)(*(_with(field, change) for field in argument))
    return change(argument) if isinstance(argument, np.ndarray) and argument.dtype.kind == "f" else argument


if __name__ == "__main__":
    print(json.dumps(list(counts())))
