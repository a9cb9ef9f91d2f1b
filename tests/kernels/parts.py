"""Small meshes in several parts, and records of kernel calls."""

import sys
from contextlib import contextmanager

from skfem_stvk.kernels import threads


def in_parts(monkeypatch, n):
    """Divide work into `n` parts from now on, independently of the number of threads; some parts of a tiny mesh are empty."""
    monkeypatch.setattr(threads, "SMALLEST_PART", 1)
    monkeypatch.setattr(threads.parallel, "_get_num_threads", lambda: n, raising=False)


@contextmanager
def kernels_run():
    """Yield the set of names of kernels that Python has called; numba reports them to Python's profilers."""
    modules = [module for name, module in sys.modules.items() if name.startswith("skfem_stvk.kernels.")]
    codes = [value.py_func.__code__ for module in modules for value in vars(module).values() if hasattr(value, "py_func")]
    known, ran = {(code.co_filename, code.co_name) for code in codes}, set()

    def note(code):
        if (code.co_filename, code.co_name) in known:
            ran.add(code.co_name)

    # numba reports calls to `sys.monitoring` from Python 3.12 on, and to profilers before
    with (_monitored if sys.version_info >= (3, 12) else _profiled)(note):
        yield ran


@contextmanager
def _profiled(note):
    """Call `note` with the code of each function called within the context, with `sys.setprofile`."""
    before = sys.getprofile()
    sys.setprofile(lambda frame, event, argument: note(frame.f_code) if event == "call" else None)
    try:
        yield
    finally:
        sys.setprofile(before)


@contextmanager
def _monitored(note):
    """Call `note` with the code of each function called within the context, with `sys.monitoring`."""
    monitoring, tool = sys.monitoring, sys.monitoring.PROFILER_ID
    monitoring.use_tool_id(tool, "kernels")
    monitoring.register_callback(tool, monitoring.events.PY_START, lambda code, offset: note(code))
    monitoring.set_events(tool, monitoring.events.PY_START)
    try:
        yield
    finally:
        monitoring.set_events(tool, 0)
        monitoring.free_tool_id(tool)
