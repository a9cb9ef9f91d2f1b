"""Compiled sums over vertices and compiled steps of explicit integrators agree with the readable twins."""

import numpy as np
import pytest
from kernels import readable

from skfem_stvk.kernels import motion_updates as motion
from skfem_stvk.kernels import node_blocks as blocks


@pytest.mark.parametrize("d", [1, 2, 3])
def test_sums_agree_with_the_readable_ones(d):
    rng = np.random.default_rng(d)
    p, u, v = rng.standard_normal((d, 50)), rng.standard_normal((50, d)), rng.standard_normal((50, d))
    Mv = rng.random((50, 1)) * v
    sums, expected = np.empty(7), np.empty(7)
    motion.momenta(p, u, v, Mv, sums)
    readable.momenta(p, u, v, Mv, expected)
    assert np.abs(expected[0]) > 1 and sums == pytest.approx(expected, rel=1e-13, abs=1e-13)
    m, f = rng.random(50), rng.standard_normal(50 * d)
    sums, expected = np.empty(8), np.empty(8)
    motion.lumped_momenta(p, u.ravel(), v.ravel(), m, f, sums)
    readable.lumped_momenta(p, u.ravel(), v.ravel(), m, f, expected)
    assert np.abs(expected[7]) > 0.1 and sums == pytest.approx(expected, rel=1e-13, abs=1e-13)


def test_steps_agree_with_the_readable_ones():
    rng = np.random.default_rng(0)
    inverse, external, internal, v, u = rng.random((5, 40))
    one, other = [[v.copy(), u.copy(), np.zeros(40)] for _ in range(2)]
    for module, (velocity, place, a) in ((motion, one), (readable, other)):
        module.accelerate(inverse, external, internal, 0.05, a, velocity)
        module.kick_and_drift(a, 0.2, 0.3, velocity, place)
        module.push_and_drift(inverse, external, internal, 0.1, velocity, place)
    assert np.allclose(one, other, rtol=1e-14, atol=1e-16) and not np.allclose(one[1], u)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_sum_is_finite_if_and_only_if_all_entries_are(dtype):
    x = np.random.default_rng(0).standard_normal(1000).astype(dtype)
    assert blocks.total(x) == pytest.approx(readable.total(x.astype(np.float64)), rel=1e-12) and blocks.total(x[:0]) == 0
    for bad in (np.nan, np.inf, -np.inf):
        for place in (0, 17, 999):
            y = x.copy()
            y[place], y[500] = bad, -bad
            assert not np.isfinite(blocks.total(y))
