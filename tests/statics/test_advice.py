"""Every end of Newton's method has advice."""

import pytest
import skfem

from skfem_stvk import StVK, System
from skfem_stvk.nonlinear.newton import End
from skfem_stvk.statics.message import advice_after


@pytest.mark.parametrize("end", [end for end in End if not end.converged])
def test_every_failure_has_advice(end):
    assert advice_after(end, System(skfem.MeshTet(), StVK(young=1.0, poisson=0.3))).endswith((".", "?"))
