"""Costs of further calls of solvers, and of F and K under each law: one run, one thread."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from rich.table import Table

from skfem_stvk import Corotated, ElementMesh, InvertibleStVK, NeoHookean, StVK, System
from skfem_stvk.edges import TENSILE, WARPED
from skfem_stvk.system import Pattern

from .bench.costs import best_and_median

#: Compared laws; the first one is the unit.
LAWS = StVK, NeoHookean, Corotated, InvertibleStVK


def costs(meshes: Mapping[str, ElementMesh], term: StVK, seconds: float) -> Table:
    """Return a table of ns per tetrahedron of each call, and of multiples of W and F."""
    return _table("call", meshes, lambda mesh: calls(mesh, term), lambda name: "W and F", seconds)


def costs_of_laws(meshes: Mapping[str, ElementMesh], seconds: float) -> Table:
    """Return a table of ns per tetrahedron of F and K under each law, and of multiples of those of `StVK`."""
    return _table("law", meshes, calls_of_laws, lambda name: f"StVK: {name.split(': ')[1].removesuffix(', warped')}", seconds)


def _table(
    title: str,
    meshes: Mapping[str, ElementMesh],
    calls_on: Callable[[ElementMesh], Mapping[str, Callable[[], Any]]],
    unit_of: Callable[[str], str],
    seconds: float,
) -> Table:
    """Return a table of calls by meshes, each with its multiple of the call that is its unit."""
    table = Table(box=None, header_style="bold")
    table.add_column(title)
    for name, mesh in meshes.items():
        table.add_column(f"{name}, {mesh.nt} tets", justify="right")
    columns = []
    for mesh in meshes.values():
        best = {name: 1e9 * taken.best / mesh.nt for name, taken in best_and_median(calls_on(mesh), seconds).items()}
        columns.append({name: f"{ns:.0f} ns {ns / best[unit_of(name)]:5.2f} x" for name, ns in best.items()})
    for name in columns[0]:
        table.add_row(name, *(column[name] for column in columns))
    return table


def calls_of_laws(mesh: ElementMesh) -> dict[str, Callable[[], Any]]:
    """Return the calls by law and quantity, in a homogeneous state with strains of some per cent."""
    u = (mesh.p.T @ (0.05 * np.random.default_rng(0).standard_normal((3, 3)))).ravel()
    found: dict[str, Callable[[], Any]] = {}
    for law in LAWS:
        body, single = (System(mesh, law(young=2.6, poisson=0.3), dtype=dtype) for dtype in (np.float64, np.float32))
        K = body.tangent(u)
        found |= {
            f"{law.__name__}: F": partial(body.energy_and_force, u),
            f"{law.__name__}: F, single precision": partial(single.energy_and_force, u.astype(np.float32)),
            f"{law.__name__}: K": partial(body.tangent, u, K),
        }
        if law is Corotated:
            found[f"{law.__name__}: K, warped"] = partial(body.jacobian, u, out=K.copy(), kept=WARPED)
    return found


def calls(mesh: ElementMesh, term: StVK) -> dict[str, Callable[[], Any]]:
    """Return the calls by name, in a state with edges in tension and in compression."""
    assembly, rng = term.bind(mesh), np.random.default_rng(0)
    u, v = (amount * rng.standard_normal((mesh.nv, 3)) for amount in (0.1 * np.cbrt(np.ptp(mesh.p) ** 3 / mesh.nv), 1.0))
    force, diagonal = np.zeros_like(u), np.zeros((mesh.nv, 3, 3))
    pattern = Pattern(mesh.nv, 3, [assembly.nodes_paired])
    rows, data = assembly.rows(pattern), np.zeros(pattern.nnz)
    (_, exact), (_, clamped) = assembly.blocks(u), assembly.blocks(u, kept=TENSILE)
    return {
        "W and F": partial(assembly.energy_and_force, u, force),
        "W along a line": partial(assembly.along, u, v),
        "F between two states": partial(assembly.mean_force, u, u + 0.01 * v, (0.5, 0.5), 0.5, force),
        "damping of edges": partial(assembly.damping_force, u, v, force),
        "round-off of F": partial(assembly.add_round_off, u, force),
        "smallest ratio of volumes": partial(assembly.smallest_volume_ratio, u),
        "ratios of volumes": partial(assembly.volume_ratios, u),
        "K": partial(assembly.fill, u, rows, data, False),
        "K, clamped": partial(assembly.fill, u, rows, data, False, None, TENSILE),
        "K v: prepared": partial(assembly.blocks, u, None, exact),
        "K v: prepared, clamped": partial(assembly.blocks, u, None, clamped, TENSILE),
        "K v": partial(assembly.pairs.add_product, exact, v, force),
        "diagonal blocks of K": partial(assembly.pairs.add_diagonal, exact, diagonal),
    }
