"""Programs that tests run on several ranks."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

#: Environment of a rank: one thread, and Open MPI's permission to run as root, which containers do.
OF_RANKS = {
    "OMP_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "PYTHONPATH": os.pathsep.join(str(path) for path in (Path(__file__).parents[2], Path(__file__).parents[1])),
}


def mpiexec():
    """Return the launcher of the environment's MPI; skip the test if there is none, or fail where CI is set."""
    beside = Path(sys.executable).with_name("mpiexec")
    found = str(beside) if beside.exists() else shutil.which("mpiexec")
    missing = "" if found else "mpiexec"
    try:
        import h5py  # noqa: F401
        import mpi4py  # noqa: F401
        import pymetis  # noqa: F401
    except ImportError as error:
        missing = str(error)
    if missing:
        (pytest.fail if os.environ.get("CI") else pytest.skip)(f"no ranks here: {missing}; pip install 'skfem-stvk[mpi-wheel]'")
    return found


@pytest.fixture(scope="session")
def on_ranks(tmp_path_factory):
    """Function that runs a program on `n` ranks and returns the finished process.

    The program is a path, or the text of one. `check` says whether the process must succeed, `module` whether mpi4py's hook is
    installed, and `command` replaces the Python program.
    """

    def run(n, program, *arguments, check=True, module=True, command=None, timeout=240, **environment):
        if command is None:
            if "\n" in str(program):
                path = tmp_path_factory.mktemp("program") / "program.py"
                path.write_text(str(program))
                program = path
            command = [sys.executable, *(["-m", "mpi4py"] if module else []), str(program), *map(str, arguments)]
        line = [mpiexec(), "--oversubscribe", "-n", str(n), *command]
        done = subprocess.run(line, env={**os.environ, **OF_RANKS, **environment}, capture_output=True, text=True, timeout=timeout)
        assert not check or done.returncode == 0, done.stdout[-5000:] + done.stderr[-5000:]
        return done

    return run
