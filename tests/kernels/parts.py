"""Small meshes in several parts, systems on the readable twins of the kernels, and records of kernel calls."""

import sys
from contextlib import contextmanager

from kernels import readable, readable_networks

from skfem_stvk.edges import assembly, bound_laws, elements, network, pairs, streaming, topology
from skfem_stvk.kernels import threads
from skfem_stvk.mesh import displacements, facets
from skfem_stvk.system import pattern
from skfem_stvk.terms.laws import response_at_points as at_points
from skfem_stvk.terms.laws import volume_penalty

#: Modules, and the kernels that they import by name.
BY_NAME = {
    elements: ("lexicographic_order", "frames", "frames_of_base_vectors"),
    network: ("lexicographic_order",),
    pairs: ("lexicographic_order",),
    streaming: ("assign_slots", "last_uses"),
    facets: ("edges_of_simplices",),
    topology: ("lexicographic_order", "numbers_by_first_use", "stars"),
    pattern: ("expand", "block_indices", "lexicographic_order", "stars"),
}


def in_parts(monkeypatch, n):
    """Divide work into `n` parts from now on, independently of the number of threads; some parts of a tiny mesh are empty."""
    monkeypatch.setattr(threads, "SMALLEST_PART", 1)
    monkeypatch.setattr(threads.parallel, "_get_num_threads", lambda: n, raising=False)


def on_twins(monkeypatch):
    """Replace compiled kernels by their readable twins from now on."""
    for name in ("element_kernels", "volume_kernels"):
        monkeypatch.setattr(assembly, name, readable)
    for name in ("element_kernels", "stretch_kernels"):
        monkeypatch.setattr(bound_laws, name, readable)
    monkeypatch.setattr(volume_penalty, "penalty_kernels", readable)
    monkeypatch.setattr(at_points, "point_kernels", readable)
    monkeypatch.setattr(network, "network_kernels", readable_networks)
    for module in (assembly, displacements, elements, network, pairs, pattern):
        monkeypatch.setattr(module, "block_kernels", readable)
    monkeypatch.setattr(streaming, "row_kernels", readable)
    for module, names in BY_NAME.items():
        for name in names:
            monkeypatch.setattr(module, name, getattr(readable, name))


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
