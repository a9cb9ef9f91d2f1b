"""Arrays of simplices in blocks of lanes, as the kernels read them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..kernels.simplices import LANES


def in_lanes(rows: NDArray[Any]) -> NDArray[Any]:
    """(blocks, m LANES) of the columns of `rows` (m, n); the last column stands again in what is left over of the last block."""
    m, n = rows.shape
    blocks = -(-n // LANES)
    padded = np.pad(rows, ((0, 0), (0, blocks * LANES - n)), mode="edge")
    return np.ascontiguousarray(padded.reshape(m, blocks, LANES).transpose(1, 0, 2)).reshape(blocks, m * LANES)


def out_of_lanes(blocks: NDArray[Any], n: int) -> NDArray[Any]:
    """(m, n) rows that `in_lanes` put into blocks."""
    m = blocks.shape[1] // LANES
    return blocks.reshape(-1, m, LANES).transpose(1, 0, 2).reshape(m, -1)[:, :n]
