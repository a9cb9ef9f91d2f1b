"""Small meshes in several parts."""

from skfem_stvk.kernels import threads


def in_parts(monkeypatch, n):
    """Divide work into `n` parts from now on, independently of the number of threads; some parts of a tiny mesh are empty."""
    monkeypatch.setattr(threads, "SMALLEST_PART", 1)
    monkeypatch.setattr(threads.parallel, "_get_num_threads", lambda: n, raising=False)
