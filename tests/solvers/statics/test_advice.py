"""Every end of Newton's method has advice."""

import pytest
import skfem

from skfem_stvk import RigidContact, RigidSphere, StVK, StvkWarning, System, Traction, solve_static
from skfem_stvk.mesh import box
from skfem_stvk.solvers.newton.newton import End
from skfem_stvk.solvers.statics.message import advice_after


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


def test_a_support_that_is_driven_through_a_contact_names_the_contact():
    ball = RigidContact(RigidSphere((0.5, 1.15), 0.05), name="ball")
    terms, moved = [StVK(young=1e5, poisson=0.3), ball], {"top": {"x": 0.0, "y": 0.5}}
    system = System(box((1, 1), (4, 4)), terms, fixed={"bottom": "xy"}, prescribed=moved)
    with pytest.warns(StvkWarning) as issued:
        result = solve_static(system, steps=1, quiet=True, raise_on_failure=False)
    assert "would pass through a contact ('ball')" in result.message and "invert" not in result.message
    texts = [str(one.message) for one in issued]
    assert len(texts) == 2 and any("deep in the shape" in text for text in texts) and any("0.1 m thin" in text for text in texts)
    assert 0.2 < result.t < 0.3  # the top meets the ball at t = 0.2


def test_a_load_of_1e100_is_reported_as_too_large():
    terms = [StVK(young=1e5, poisson=0.3), Traction("right", (1e100, 0.0, 0.0))]
    system = System(box((1, 1, 1), (2, 2, 2)), terms, fixed={"left": "xyz"})
    message = solve_static(system, quiet=True, raise_on_failure=False).message
    assert "displacements grew without bound" in message and "Are units mixed up" in message


def test_a_support_that_moves_too_far_is_no_question_of_the_units_of_a_load():
    moved = {"top": {"y": -2e5}}
    system = System(box((1, 1), (4, 4)), StVK(young=1e5, poisson=0.3), fixed={"bottom": "xy"}, prescribed=moved)
    message = solve_static(system, quiet=True, raise_on_failure=False).message
    assert "at t = 0: elements would invert" in message and "load is carried" not in message
