"""Arguments of damping are checked, and kinds of damping add up."""

import dataclasses

import numpy as np
import pytest

from skfem_stvk import StvkError
from skfem_stvk.solvers.dynamics.damping import EdgeDamping, Rayleigh, damping_factors


@pytest.mark.few
@pytest.mark.parametrize("value", [-1e-9, np.nan, np.inf, "0.1", None, np.ones(2), 1j])
@pytest.mark.parametrize(
    ("make", "name"),
    [(lambda x: Rayleigh(alpha=x), "alpha"), (lambda x: Rayleigh(beta=x), "beta"), (EdgeDamping, "tau")],
    ids=["alpha", "beta", "tau"],
)
def test_factors_must_be_nonnegative_numbers(make, name, value):
    with pytest.raises(StvkError, match=rf"{name} = .*; expected a number \[.*s\], not negative"):
        make(value)


def test_damping_is_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Rayleigh(0.1, np.float64(0.2)).alpha = 3.0


@pytest.mark.parametrize(
    ("damping", "factors"),
    [
        (None, (0, 0, 0)),
        ([], (0, 0, 0)),
        (Rayleigh(1.0, 2.0), (1, 2, 0)),
        (EdgeDamping(3), (0, 0, 3)),
        ((EdgeDamping(3.0), Rayleigh(alpha=1.0), Rayleigh(0.5, 2.0)), (1.5, 2, 3)),
    ],
)
def test_kinds_add_up(damping, factors):
    assert damping_factors(damping) == factors


@pytest.mark.parametrize("damping", [0.1, "Rayleigh", [0.1], Rayleigh, [[EdgeDamping(1.0)]]])
def test_other_objects_are_refused_as_damping(damping):
    with pytest.raises(StvkError, match=r"expected Rayleigh\(alpha=..., beta=...\), EdgeDamping\(tau\), or a list"):
        damping_factors(damping)
