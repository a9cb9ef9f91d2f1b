"""The judges of hostile inputs agree with scikit-fem and detect planted errors."""

from dataclasses import replace

import numpy as np
import pytest
from bodies import MESHES, reference_of, state

from skfem_stvk import EnergyMomentum, StVK, VelocityVerlet
from validation.hostile import physics
from validation.hostile.case import Verdict, Wrong
from validation.hostile.extended_stvk import ExtendedStVK


@pytest.mark.few
@pytest.mark.parametrize("plane", [None, "stress"])
@pytest.mark.parametrize("name", MESHES)
def test_the_textbook_in_extended_precision_agrees_with_scikit_fem(name, plane):
    mesh, u = MESHES[name], state(MESHES[name])
    section = {1: {"area": 0.7}, 2: {"thickness": 0.7}}.get(mesh.k, {})
    flat = mesh.k == mesh.d == 2
    reference = reference_of(mesh, [StVK(young=2.0, poisson=0.3, plane=plane if flat else None, **section)])
    exact = ExtendedStVK(mesh, 2.0, 0.3, 0.7 if section else 1.0, condensed=flat and plane == "stress")
    F = reference.internal_force(u)
    assert abs(float(exact.energy(u)) / reference.energy(u) - 1) < 1e-14
    assert np.abs(exact.force(u).ravel() - F).max() < 1e-14 * np.abs(F).max()


@pytest.mark.parametrize("what", ["u", "load", "nan"])
def test_a_success_that_is_not_in_equilibrium_is_detected(tmp_path, what):
    at_rest = physics.at_rest(38, tmp_path)
    assert np.abs(at_rest.result.u).max() > 0.05
    physics.judge_at_rest(at_rest)
    u = at_rest.result.u
    planted = {
        "u": at_rest._replace(result=replace(at_rest.result, u=u * (1 + 1e-4))),
        "load": at_rest._replace(load=1.001 * at_rest.load),
        "nan": at_rest._replace(result=replace(at_rest.result, u=np.full_like(u, np.nan))),
    }
    with pytest.raises(Wrong) as caught:
        physics.judge_at_rest(planted[what])
    assert caught.value.verdict is Verdict.SILENT


@pytest.mark.parametrize(("seed", "kind"), [(10, VelocityVerlet), (35, EnergyMomentum)])
def test_a_wrong_motion_is_detected(tmp_path, seed, kind):
    solved = physics.in_motion(seed, tmp_path)
    assert isinstance(solved.result.integrator, kind) and np.abs(solved.result.u).max() > 0.03 * solved.body.unit
    physics.judge_in_motion(solved)
    with pytest.raises(Wrong):
        physics.judge_in_motion(solved._replace(result=replace(solved.result, u=1.01 * solved.result.u, v=1.01 * solved.result.v)))
