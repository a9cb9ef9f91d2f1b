"""What solvers ask of the kernels beside W, F and K, and what it costs: one run, one thread."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from rich.table import Table

from skfem_stvk import ElementMesh, StVK
from skfem_stvk.bench.costs import best_and_median
from skfem_stvk.edges import TENSILE
from skfem_stvk.system import Pattern


def costs(meshes: Mapping[str, ElementMesh], term: StVK, seconds: float) -> Table:
    """ns per tetrahedron of each call, and how many times that of W and F."""
    table = Table(box=None, header_style="bold")
    table.add_column("asked")
    for name, mesh in meshes.items():
        table.add_column(f"{name}, {mesh.nt} tets", justify="right")
    columns = []
    for mesh in meshes.values():
        best = {name: 1e9 * taken.best / mesh.nt for name, taken in best_and_median(calls(mesh, term), seconds).items()}
        columns.append({name: f"{ns:.0f} ns {ns / best['W and F']:5.2f} x" for name, ns in best.items()})
    for name in columns[0]:
        table.add_row(name, *(column[name] for column in columns))
    return table


def calls(mesh: ElementMesh, term: StVK) -> dict[str, Callable[[], Any]]:
    """Calls by what is asked, in a state with edges in tension and in compression."""
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
