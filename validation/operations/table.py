"""Tables of the study: operations per entity, operations per mesh, and the published claims."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from skfem_stvk.terminal import WIDTH, grid

from .algorithms import ALGORITHMS, LINEAR
from .body import Body
from .claims import verdicts
from .costs import LAM, MU, costs, operations
from .meshes import meshes
from .production import production

Costs = dict[tuple[str, str], NDArray[np.int64]]

#: Column headings of the tables by mesh.
SHORT = {
    "F": {
        "edges": "edges",
        "Total Lagrangian": "TL",
        "Total Lagrangian, matrix B": "TL, B",
        "O'Brien-Hodgins": "OH",
        "Picinbono": "Pic.",
    },
    "K": {"edges": "edges", "edges, pair by pair": "by pairs", "Total Lagrangian": "TL", "Total Lagrangian, matrix B": "TL, B"},
}


def show(quick: bool) -> int:
    """Print the tables. The exit code is 0 if counts on a whole mesh agree with the sums over its entities."""
    console = Console(width=WIDTH, highlight=False)
    bodies = {name: Body(mesh, LAM, MU) for name, mesh in meshes(quick).items()}
    found = {(a.quantity, a.name): costs(a) for a in (*ALGORITHMS, LINEAR)}
    console.print(_entities(found))
    for quantity in "FK":
        console.print(_by_mesh(quantity, found, bodies))
    console.print(_claims(found, bodies))
    console.print(_own())
    whole = "box 4^3" if quick else "bracket"
    same = all(operations(a, bodies[whole]) == found[a.quantity, a.name] @ bodies[whole].entities for a in ALGORITHMS)
    console.print(f"counted on the whole {whole}: {'the same numbers' if same else 'NUMBERS DIFFER from the sums over entities'}")
    return 0 if same else 1


def _entities(found: Costs) -> Table:
    numbers = ("vertex", "edge", "face", "tetrahedron")
    table = grid("Operations (additions and multiplications) for each entity", "of", "algorithm", *numbers, right=numbers)
    for (quantity, name), cost in found.items():
        table.add_row(quantity, name, *(str(c) if c else "" for c in cost))
    return table


def _by_mesh(quantity: str, found: Costs, bodies: dict[str, Body]) -> Table:
    names = SHORT[quantity]
    others = [name for name in names if not name.startswith("edges")]
    sizes = ["edges ", "TSEPs", "tets"]
    ratios = [f"of {names[name]}" for name in others]
    columns = [*sizes, *names.values(), *ratios]
    table = grid(f"Operations of {quantity} for each tetrahedron", "mesh", *columns, right=tuple(columns))
    for mesh, body in bodies.items():
        each = {name: found[quantity, name] @ body.entities / body.nt for name in names}
        row = [str(n) for n in (body.edges.shape[1], body.pairs, body.nt)]
        row += [f"{each[name]:.0f}" for name in names] + [f"{each['edges'] / each[name]:.0%}" for name in others]
        table.add_row(mesh, *row)
    return table


def _own() -> Table:
    title = "Operations of the package's own kernels per element, including W and gathering; K includes F"
    table = grid(title, "element", "F", "K", right=("F", "K"))
    for name, F, K in production():
        table.add_row(name, f"{F:.0f}", f"{K:.0f}")
    return table


def _claims(found: Costs, bodies: dict[str, Body]) -> Table:
    table = grid("Ratios of operations of two algorithms", "", "of", "against", "claimed", "tetrahedron", "largest", "holds on")
    entities = {name: body.entities for name, body in bodies.items()}
    for claim, ratios, holds in verdicts(found, entities):
        first, last = next(iter(ratios.values())), list(ratios.values())[-1]
        where = "none" if not holds else "all" if len(holds) == len(ratios) else ", ".join(holds)
        table.add_row(
            claim.quantity, claim.of, claim.against, f"{claim.low:.0%} - {claim.high:.0%}", f"{first:.0%}", f"{last:.0%}", where
        )
    return table
