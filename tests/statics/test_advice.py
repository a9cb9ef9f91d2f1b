"""Every end of Newton's method has advice."""

import pytest
import skfem

from skfem_stvk import StVK, System, Traction, solve_static
from skfem_stvk.mesh import box
from skfem_stvk.nonlinear.newton import End
from skfem_stvk.statics.message import advice_after


@pytest.mark.parametrize("end", [end for end in End if not end.converged])
def test_every_failure_has_advice(end):
    assert advice_after(end, System(skfem.MeshTet(), StVK(young=1.0, poisson=0.3))).endswith((".", "?"))


def test_a_load_that_is_far_too_large_for_the_modulus_makes_the_message_ask_for_units():
    """E = 70 (GPa) under a pressure in Pa inverts elements in the smallest step. A load of the size of E only needs another law."""

    def message(pull):
        terms = [StVK(young=70.0, poisson=0.33), Traction("right", (-pull, 0.0, 0.0))]
        return solve_static(
            System(box((1, 1, 1), (2, 2, 2)), terms, fixed={"left": "xyz"}), quiet=True, raise_on_failure=False
        ).message

    assert "at t = 0: elements would invert" in message(1.5e6) and "check the units of material, mesh and load" in message(1.5e6)
    assert "Stopped" in message(70.0) and "units" not in message(70.0)
