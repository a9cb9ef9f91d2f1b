"""Numbers by which a system is known again, so that what is on disk goes on with the system that it came from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..terms.load import Time
from .system import System

Array = NDArray[Any]

Signature = dict[str, list[float]]
#: Two systems are the same if their numbers are, but for rounding.
SAME = 1e-9


def signature(system: System, moments: Mapping[str, Time]) -> Signature:
    """Numbers that change with the mesh, the terms, the supports, and the loads and prescribed displacements at these moments, by name."""
    mesh = system.mesh
    shear = 0.01 * np.cos(np.arange(mesh.d**2).reshape(mesh.d, mesh.d))
    u = ((mesh.p.T - mesh.p.mean(axis=1)) @ shear).ravel()
    numbers: dict[str, Any] = {
        "the mesh": [mesh.nv, mesh.nt, *sums(mesh.p), *sums(mesh.t)],
        "the elastic terms": [system.energy(u), *sums(system.internal_force(u))],
        "the supports": [len(system.supports.held), *sums(system.supports.held)],
    }
    for name, moment in moments.items():
        numbers[f"the loads at {name}"] = sums(system.external_force(u, moment))
        numbers[f"prescribed displacements at {name}"] = sums(system.supports.values(moment))
    return {name: [float(value) for value in values] for name, values in numbers.items()}


def changed(old: Signature, new: Signature) -> list[str]:
    """What is not the same as it was, by name."""
    return [name for name in new if not _alike(old.get(name, []), new[name])]


def sums(values: Array) -> list[float]:
    """Two numbers, never near zero by cancellation, that change with each value, its sign and its place."""
    weights = 1.5 + np.cos(np.arange(values.size))
    size, balance = float(weights @ np.abs(values.ravel())), float(weights @ values.ravel())
    return [size, 2 + balance / size if size else 0.0]


def _alike(old: list[float], new: list[float]) -> bool:
    return len(old) == len(new) and np.allclose(old, new, rtol=SAME, atol=0.0)
