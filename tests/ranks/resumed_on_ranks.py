"""Run by `mpiexec -n N python -m mpi4py resumed_on_ranks.py WHAT FOLDER ...`: analyses on ranks, each with its files in a folder.

Each analysis writes its series, its checkpoint and `NAME.npz` with the last state of the whole body. WHAT is "whole", "resumed",
"full" (the disk of rank 1 during the path), or "killed" (the last rank during a motion).
"""

import errno
import io
import os
import sys
from pathlib import Path

import numpy as np
import skfem

from skfem_stvk import (
    ElasticFoundation,
    LinearBackwardEuler,
    StVK,
    System,
    Traction,
    VelocityVerlet,
    simulate,
    solve_static,
)

#: Integrators by name, with linear solves that are exact enough to compare divisions of a body.
MOTIONS = {
    "verlet": VelocityVerlet(dt=1e-4),
    "euler": LinearBackwardEuler(dt=1e-3, rtol=1e-12),
    "found": VelocityVerlet(),
}
STEPS, SAVED = 12, 5


def plate():
    """Return a mesh of 144 tetrahedra."""
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 3, 7), np.linspace(0, 1, 3), np.linspace(0, 1, 3))
    return mesh.with_boundaries({"bottom": lambda x: x[2] == 0, "top": lambda x: x[2] == 1, "end": lambda x: x[0] == 3})


def system_on(mesh):
    """Return a plate on a rigid ground, so that each part of it is held."""
    terms = [StVK(young=1e5, poisson=0.3, density=1000.0), Traction("top", (300.0, 0, -500.0)), ElasticFoundation("end", 1e4)]
    return System(mesh, terms, fixed={"bottom": "xyz"})


def path(system, folder, **options):
    """Return a static solve of four states, with its files in a folder."""
    return solve_static(system, steps=6, rtol=1e-12, save=folder / "path.pvd", checkpoint=folder / "path", quiet=True, **options)


def motion(system, name, folder, until=STEPS, **options):
    """Return a motion of some steps, with its files in a folder."""
    dt = MOTIONS[name].dt or 1e-2
    if not options.get("resume"):
        options |= {"integrator": MOTIONS[name], "probes": {"A": "top", "B": [17]}, "reactions": {"C": "bottom"}}
    save, checkpoint = folder / f"{name}.pvd", folder / name
    return simulate(system, until=until * dt, save=save, every=4, checkpoint=checkpoint, quiet=True, **options)


def on_ranks(folder, what):
    """Run the analyses of the command line."""
    from mpi4py import MPI

    from skfem_stvk.ranks import distribute, gathered

    system, rank, size = system_on(distribute(plate())), MPI.COMM_WORLD.rank, MPI.COMM_WORLD.size

    def write(name, result, **more):
        u = gathered(system.space, result.u)
        if rank == 0:
            np.savez(folder / f"{name}.npz", u=u, **more)

    if what == "full":
        on_writing(rank == 1, "_state_00002", fill_disk)
    if what != "killed":
        write("path", path(system, folder, resume=what == "resumed"))
    for name in MOTIONS:
        run = motion(system, name, folder, SAVED if what == "killed" else STEPS, resume=what == "resumed")
        write(name, run, ledger=run.ledger.rows())
    if what == "killed":
        on_writing(rank == size - 1, "_motion", die)
        motion(system, "verlet", folder, resume=True)


def die():
    """End this rank as a signal would."""
    os._exit(9)


def fill_disk():
    """Raise the error of a full disk."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def on_writing(here, text, fault):
    """Let a fault occur while this rank writes the file of its part of a checkpoint."""
    write = np.savez

    def faulty(file, **arrays):
        if here and isinstance(file, io.IOBase) and Path(file.name).name.startswith(".rank") and text in file.name:
            file.write(b"half a file")
            fault()
        write(file, **arrays)

    np.savez = faulty


if __name__ == "__main__":
    for each in range(1, len(sys.argv), 2):
        on_ranks(Path(sys.argv[each + 1]), sys.argv[each])
