"""Ctrl-C takes effect at the end of a step."""

import os
import signal
import threading

import numpy as np
import pytest
import skfem

from skfem_stvk import Gravity, Interrupted, StVK, System, Traction, VelocityVerlet, simulate, solve_static
from skfem_stvk.solvers.newton.outcome import finishing_steps

TRIES = pytest.mark.parametrize("presses", [1, 2])


def press(times=1):
    for _ in range(times):
        os.kill(os.getpid(), signal.SIGINT)


def strip(*loads):
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 4, 9), np.linspace(0, 1, 3))
    fixed = {lambda x: x[0] == 0: "xy"}
    return System(mesh, [StVK(young=1e5, poisson=0.3, density=1000.0), *loads], fixed=fixed)


@TRIES
def test_ctrl_c_ends_a_motion_after_the_step_and_a_second_one_at_once(tmp_path, presses):
    pressed = []

    def interrupt_once(t, u):
        if t > 2.5e-3 and not pressed:
            pressed.append(t)
            press(presses)

    body = strip(Gravity(g=(0, -9.81)))
    with finishing_steps(), pytest.raises(Interrupted) as caught:
        simulate(body, VelocityVerlet(dt=1e-3), until=0.1, remove=interrupt_once, checkpoint=tmp_path / "kept", quiet=True)
    t = caught.value.run.t  # if Ctrl-C is pressed again, the run is at the last accepted state
    assert t == pytest.approx(3e-3) if presses == 1 else t < 3e-3
    on = simulate(body, until=0.02, checkpoint=tmp_path / "kept", resume=True, remove=lambda t, u: None, quiet=True)
    whole = simulate(strip(Gravity(g=(0, -9.81))), VelocityVerlet(dt=1e-3), until=0.02, remove=lambda t, u: None, quiet=True)
    assert on.u.tobytes() == whole.u.tobytes()


@TRIES
def test_ctrl_c_ends_a_path_after_the_next_state(presses):
    asked = []

    def pull(t):
        if 0.3 < t < 0.95 and not asked:
            asked.append(t)
            press(presses)
        return (0.0, -1e3 * t)

    body = strip(Traction(lambda x: x[0] == 4, pull))  # evaluated at 0 and 1 when the load is bound
    with finishing_steps(), pytest.raises(Interrupted) as caught:
        solve_static(body, steps=5, quiet=True)
    found = caught.value.result
    assert 0.2 <= found.t < 1
    assert len(found.history) == (2 if presses == 1 else 1)


def test_the_signal_handler_is_restored_and_unchanged_in_other_threads():
    before = signal.getsignal(signal.SIGINT)
    with finishing_steps():
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before
    seen = []

    def elsewhere():
        with finishing_steps():
            seen.append(signal.getsignal(signal.SIGINT))

    other = threading.Thread(target=elsewhere)
    other.start()
    other.join()
    assert seen == [before]
