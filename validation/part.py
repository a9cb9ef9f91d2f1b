"""Mechanical part meshed by Gmsh, with half of its tetrahedra of negative orientation: agreement in every state."""

from __future__ import annotations

from rich.console import Console

from skfem_stvk import StVK, verify
from skfem_stvk.referee.report import rendered
from skfem_stvk.terminal import WIDTH

from .bench.meshes import bracket
from .meshes import FINE_SIZE

MATERIALS = [StVK(young=70e9, poisson=0.33, region="bracket"), StVK(young=5e6, poisson=0.45, region="bushing")]
LIMIT = 1e-13


def main() -> int:
    """Verify a Gmsh part of 26 000 tetrahedra; F and K agree to 1e-13 in every state."""
    report = verify(bracket(FINE_SIZE), MATERIALS)
    report.header["mesh"]["source"] = "bracket by Gmsh"
    console = Console(width=WIDTH, highlight=False)
    console.print(rendered(report))
    errors = {(r.quantity, r.state): r.measured for r in report.results if r.check == "agreement" and r.measured is not None}
    worst = max(error for (quantity, _), error in errors.items() if quantity in "FK")
    console.print(
        f"largest disagreement of F and K in {len({state for _, state in errors})} states: {worst:.1e} (expected at most {LIMIT:g})"
    )
    return 0 if report.passed and worst <= LIMIT else 1
