"""Fixtures of the tests of commands on scenes."""

import os
import signal
import subprocess
import sys
from contextlib import suppress

import pytest


@pytest.fixture
def started():
    """Return a function that starts `skfem-stvk COMMAND PATH ...`. After the test, also if it failed, all processes are killed."""
    processes = []

    def start(command, path, *options):
        arguments = [sys.executable, "-m", "skfem_stvk.scenes.commands", command, str(path), *options]
        process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
        processes.append(process)
        return process

    yield start
    for process in processes:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
