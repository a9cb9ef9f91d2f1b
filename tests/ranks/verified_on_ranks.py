"""Run by `mpiexec -n N python -m mpi4py verified_on_ranks.py OUT.json`: reports of `verify_on_ranks`, and its refusal.

For each body, whether it passed and the checks of the candidate that failed. The body of another law has a wrong Poisson's ratio.
"""

import json
import sys
from pathlib import Path

from bodies import EVERY_MESH
from mpi4py import MPI

from skfem_stvk import StVK, StvkError, System
from skfem_stvk.ranks import distribute, verify_on_ranks
from skfem_stvk.ranks import distributed_verification as verification


def report_of(mesh, law, verified):
    report = verify_on_ranks(System(distribute(mesh), law), mesh, verified, quiet=True)
    if report is None:
        return None
    failed = [result.check for result in report.results if result.outcome.name in ("FAILED", "COULD_NOT_RUN")]
    of_ranks = sum(result.subject == "candidate" for result in report.results)
    return {"passed": report.passed, "failed": failed, "results": of_ranks}


def main(out):
    law, other = StVK(young=1e5, poisson=0.3), StVK(young=1e5, poisson=0.31)
    found = {name: report_of(EVERY_MESH[name], law, law) for name in ("triangles", "quadratic triangles")}
    found["wrong"] = report_of(EVERY_MESH["triangles"], law, other)
    verification.MOST_VERIFIED = 10
    try:
        report_of(EVERY_MESH["triangles"], law, law)
    except StvkError as error:
        found["refused"] = str(error)
    if MPI.COMM_WORLD.rank == 0:
        Path(out).write_text(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1])
