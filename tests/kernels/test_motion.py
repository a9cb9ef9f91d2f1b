"""Sums over vertices and steps of explicit integrators: compiled and readable."""

import numpy as np
import pytest

from skfem_stvk.kernels import motion, readable


@pytest.mark.parametrize("d", [1, 2, 3])
def test_sums_agree_with_the_readable_ones(d):
    rng = np.random.default_rng(d)
    p, u, v = rng.standard_normal((d, 50)), rng.standard_normal((50, d)), rng.standard_normal((50, d))
    Mv = rng.random((50, 1)) * v
    sums, expected = np.empty(7), np.empty(7)
    motion.momenta(p, u, v, Mv, sums)
    readable.momenta(p, u, v, Mv, expected)
    assert np.abs(expected[0]) > 1 and sums == pytest.approx(expected, rel=1e-13, abs=1e-13)


def test_steps_agree_with_the_readable_ones():
    rng = np.random.default_rng(0)
    inverse, force, v, u = rng.random((4, 40))
    is_free = (rng.random(40) > 0.3).astype(np.int8)
    one, other = [v.copy(), u.copy()], [v.copy(), u.copy()]
    for module, (velocity, place) in ((motion, one), (readable, other)):
        module.push(inverse, force, 0.1, velocity)
        module.drift(is_free, velocity, 0.1, place)
    assert np.allclose(one, other, rtol=1e-15, atol=0) and not np.allclose(one[1], u)
    assert np.array_equal(one[1][is_free == 0], u[is_free == 0])
