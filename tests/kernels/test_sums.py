"""Compiled sums show entries that are not finite."""

import numpy as np
import pytest

from skfem_stvk.kernels import node_blocks as blocks


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_sum_is_finite_if_and_only_if_all_entries_are(dtype):
    x = np.random.default_rng(0).standard_normal(1000).astype(dtype)
    assert blocks.total(x) == pytest.approx(x.astype(np.float64).sum(), rel=1e-12) and blocks.total(x[:0]) == 0
    for bad in (np.nan, np.inf, -np.inf):
        for place in (0, 17, 999):
            y = x.copy()
            y[place], y[500] = bad, -bad
            assert not np.isfinite(blocks.total(y))
