"""The C loop computes St. Venant-Kirchhoff's model, for constants of the whole body or of each element."""

import sys

import numpy as np
import pytest
from bodies import box, state

from skfem_stvk import Isotropic, StVK, StvkError, System
from validation.bench import control
from validation.bench.control import Control

LIMIT = 1e-12
MESH = box()
RNG = np.random.default_rng(8)
CONSTANTS = {"one": (1.0, 0.4), "of each element": (RNG.uniform(0.2, 3, MESH.nt), RNG.uniform(0.3, 2, MESH.nt))}


@pytest.fixture(params=CONSTANTS)
def models(request):
    if control.compiler() is None:
        pytest.skip("no C compiler is on the path")
    lam, mu = CONSTANTS[request.param]
    return Control(MESH.p, MESH.t, lam, mu), System(MESH, StVK(Isotropic.from_lame(lam, mu)))


@pytest.mark.parametrize("amount", [0.01, 0.5])
def test_the_control_agrees(models, amount):
    u = state(MESH, amount)
    ours, theirs = ([m.energy(u), m.internal_force(u), m.tangent(u)] for m in models)
    assert abs(ours[0] - theirs[0]) <= LIMIT * theirs[0]
    for mine, other in zip(ours[1:], theirs[1:], strict=True):
        assert mine.shape == other.shape
        assert abs(mine - other).max() <= LIMIT * abs(other).max()


def test_the_tangent_does_not_copy_its_values(models):
    K = models[0].tangent(state(MESH))
    assert K.format == "bsr" and np.shares_memory(K.data, models[0].tangent(state(MESH)).data)


def test_without_a_compiler_the_error_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    control._library.cache_clear()
    assert control.compiler() is None
    with pytest.raises(StvkError, match=r"No C compiler .* apt install gcc"):
        Control(MESH.p, MESH.t, 1.0, 1.0)


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in for a compiler is a shell script")
def test_a_compiler_that_fails_is_quoted(monkeypatch, tmp_path):
    broken = tmp_path / "gcc"
    broken.write_text("#!/bin/sh\necho 'out of luck' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    control._library.cache_clear()
    with pytest.raises(StvkError, match=r"could not compile control\.c: out of luck"):
        Control(MESH.p, MESH.t, 1.0, 1.0)
