"""Shortcuts of referee tests: forces in 50 digits are computed once per body and state, and timings take the least time."""

import pickle

import pytest

from skfem_stvk.referee.checks import precision
from skfem_stvk.referee.exact import ExactStVK

#: Energy and force of a body in a state, computed once.
KNOWN = {}


@pytest.fixture(autouse=True)
def frugal(monkeypatch):
    made, computed = ExactStVK.__init__, ExactStVK.energy_and_force

    def make(self, p, t, tensor, how=None, control=None):
        self.key = p.shape, p.tobytes(), t.tobytes(), how, pickle.dumps((tensor, control))
        made(self, p, t, tensor, how, control)

    def energy_and_force(self, u):
        key = self.key, u.tobytes()
        if key not in KNOWN:
            KNOWN[key] = computed(self, u)
        energy, force = KNOWN[key]
        return energy, force.copy()

    monkeypatch.setattr(ExactStVK, "__init__", make)
    monkeypatch.setattr(ExactStVK, "energy_and_force", energy_and_force)
    monkeypatch.setattr(precision, "SECONDS", 0.0)
