"""The machine, the packages and the command of a run, for reports and summaries."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterable, Mapping
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from .arguments import THREAD_LIMITS

#: Variables with the rank and the number of processes: of Open MPI's launcher, of MPICH's and Intel's, and of SLURM's srun.
LAUNCHERS = {"OMPI_COMM_WORLD_RANK": "OMPI_COMM_WORLD_SIZE", "PMI_RANK": "PMI_SIZE", "SLURM_PROCID": "SLURM_STEP_NUM_TASKS"}
PACKAGES = (
    "skfem-stvk",
    "scikit-fem",
    "numpy",
    "scipy",
    "numba",
    "meshio",
    "rich",
    "matplotlib",
    "jinja2",
    "pyamg",
    "filelock",
    "pydantic",
)


def versions(packages: Iterable[str] = PACKAGES) -> dict[str, str]:
    """Return the versions of Python and the packages; "not installed" for missing packages."""

    def installed(package: str) -> str:
        try:
            return version(package)
        except PackageNotFoundError:
            return "not installed"

    return {"python": platform.python_version()} | {package: installed(package) for package in packages}


def machine() -> dict[str, Any]:
    """Return the processor, number of cores, system, and settings that affect speed."""
    limits = [f"{name}={os.environ[name]}" for name in THREAD_LIMITS if name in os.environ]
    return {
        "system": platform.platform(),
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "threads": ", ".join(limits) or "not limited by the environment",
    }


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def launched() -> tuple[int, int]:
    """Return the rank of this process and the number of processes that a launcher of MPI started together.

    They are from the environment, (0, 1) without a launcher.
    """
    found = ((os.environ.get(rank, ""), os.environ.get(size, "")) for rank, size in LAUNCHERS.items())
    return next(((int(rank), int(size)) for rank, size in found if rank.isdecimal() and size.isdecimal()), (0, 1))


def write_machine(figure: Any, run: Mapping[str, Any] | None = None) -> None:
    """Write the processor and the date of a run in small print at the lower right of a figure that shows times.

    `run` has the entries `machine` and `date` of `circumstances`; without it, the run is of this machine and of today.
    """
    run = circumstances(()) if run is None else run
    figure.supxlabel(f"{run['machine']['processor']}, {run['date'][:10]}", size=6, x=0.99, ha="right")


def circumstances(packages: Iterable[str]) -> dict[str, Any]:
    """Return the date, command, versions and machine of a run."""
    return {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "versions": versions(packages),
        "machine": machine(),
    }
