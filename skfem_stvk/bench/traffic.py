"""The memory limit: bytes that a call must read and write, and how fast this machine copies."""

from __future__ import annotations

from time import perf_counter

import numpy as np
from scipy.sparse import csr_matrix

from ..system import System

COPIED = 2**29  # [B]; more than a last-level cache


def least_bytes(body: System, K: csr_matrix) -> dict[str, int]:
    """Bytes that each quantity must read and write once, from the sizes of the arrays of a system that has made all of them.

    - W, F: the simplices (vertices, coefficients, coordinates), u and F;
    - K: the simplices with their edges' ids and u, the edges' blocks written and read again, the places in K, the values of K;
    - K v: the blocks and vertices of the edges, v and the result. To prepare: as K, up to writing the blocks;
    - one CSR product: values, columns and rows of K, v and the result.
    """
    parts, vector, value = body.memory(), body.ndofs * K.data.itemsize, K.data.itemsize
    edges = (K.nnz // 9 - body.mesh.nv) // 2
    blocks, prepare = 9 * value * edges, parts["simplices"] + parts["own edges"] + vector
    return {
        "W": parts["simplices"] + vector,
        "F": parts["simplices"] + 2 * vector,
        "W+F": parts["simplices"] + 2 * vector,
        "K": prepare + 2 * blocks + parts["rows of K"] + K.data.nbytes,
        "W+F+K": prepare + vector + 2 * blocks + parts["rows of K"] + K.data.nbytes,
        "K v: prepare": prepare + blocks,
        "K v": blocks + 8 * edges + 2 * vector,
        "CSR product": K.data.nbytes + K.indices.nbytes + K.indptr.nbytes + 2 * vector,
    }


def copy_bandwidth(size: int = COPIED) -> float:
    """Bytes read and written a second by one thread that copies an array of `size` bytes, at its best of five."""
    source, target = np.ones(size // 8), np.zeros(size // 8)
    taken = []
    for _ in range(5):
        begin = perf_counter()
        np.copyto(target, source)
        taken.append(perf_counter() - begin)
    return 2 * source.nbytes / min(taken)
