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
    m, f = rng.random(50), rng.standard_normal((50, d))
    sums, expected = np.empty(8), np.empty(8)
    motion.lumped_momenta(p, u, v, m, f, sums)
    readable.lumped_momenta(p, u, v, m, f, expected)
    assert np.abs(expected[7]) > 0.1 and sums == pytest.approx(expected, rel=1e-13, abs=1e-13)


def test_steps_agree_with_the_readable_ones():
    rng = np.random.default_rng(0)
    inverse, force, v, u = rng.random((4, 40))
    one, other = [[v.copy(), u.copy(), np.zeros(40)] for _ in range(2)]
    for module, (velocity, place, a) in ((motion, one), (readable, other)):
        module.accelerate(inverse, force, 0.05, a, velocity)
        module.kick_and_drift(a, 0.2, 0.3, velocity, place)
        module.push_and_drift(inverse, force, 0.1, velocity, place)
    assert np.allclose(one, other, rtol=1e-14, atol=1e-16) and not np.allclose(one[1], u)
