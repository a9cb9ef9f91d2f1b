"""`solve_static` on the coordinates of a basis equals the full solve if the basis has all modes.

No iteration evaluates the full body.
"""

from dataclasses import replace

import numpy as np
import pytest
from on_bases import OnModes, bar, column

from skfem_stvk import Gravity, Pressure, ReducedSystem, Stop, StvkError, Traction, solve_static


def tip(x):
    return x[0] > 1.99


GENTLE = (Traction(tip, (0.0, -4.0, 2.5)), Gravity((0.0, -0.3, 0.1)))
BODIES = {
    "dead loads": lambda: bar(loads=GENTLE),
    "prescribed": lambda: bar(prescribed={tip: {"x": -0.1, "y": lambda x, t: 0.5 * t * (1 + x[2])}}),
    "pressure": lambda: bar(Pressure(lambda x: x[1] < 1e-6, 4.0), loads=GENTLE),
    "functions of t": lambda: bar(loads=(Traction(tip, lambda t: (0.0, -4.0 * t**2, 9.0 * t)),)),
}


def largest(x):
    return float(np.abs(x).max())


@pytest.mark.parametrize("name", BODIES)
def test_with_all_modes_the_reduced_solve_is_the_full_one(name):
    body = BODIES[name]()
    full = solve_static(body, steps=3, quiet=True)
    reduced = solve_static(OnModes(body), steps=3, quiet=True)
    assert largest(full.u) > 0.05 and largest(reduced.u - full.u) < 1e-8 * largest(full.u)
    assert [step.t for step in reduced.history] == [step.t for step in full.history]
    assert abs(reduced.history.iterations - full.history.iterations) < len(full.history) + 1 and reduced.solver == "dense"
    for one, other in zip(reduced.history, full.history, strict=True):
        assert largest(one.u - other.u) < 1e-8 * largest(full.u)
        assert one.strain_energy == pytest.approx(other.strain_energy, rel=1e-8)
        assert one.potential == pytest.approx(other.potential, rel=1e-8, nan_ok=True)
        assert one.smallest_volume_ratio == pytest.approx(other.smallest_volume_ratio, rel=1e-6)
    np.testing.assert_allclose(reduced.reaction().resultant, full.reaction().resultant, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", BODIES)
def test_with_precomputed_coefficients_the_reduced_solve_is_the_full_one(name):
    body = BODIES[name]()
    free = body.ndofs - len(body.supports.held)
    full = solve_static(body, steps=3, quiet=True)
    reduced = solve_static(ReducedSystem(body, free, free, derivatives=False, quiet=True), steps=3, quiet=True)
    assert largest(reduced.u - full.u) < 1e-8 * largest(full.u)
    np.testing.assert_allclose(reduced.reaction().resultant, full.reaction().resultant, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("size", [4, 12])
def test_reactions_balance_the_loads_on_small_bases(size):
    """Reactions balance the loads on a basis of 4 modes.

    The residual at free nodes is transferred to the supports. Without the transfer a fifth of the load is missing.
    """
    body = BODIES["dead loads"]()
    full = solve_static(body, steps=2, quiet=True).reaction()
    result = solve_static(ReducedSystem(body, size, 6, quiet=True), steps=2, quiet=True)
    found = result.reaction()
    np.testing.assert_allclose(found.resultant, full.resultant, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(found.moment((0, 0, 0)), full.moment((0, 0, 0)), atol=0.02 * largest(full.moment((0, 0, 0))))
    bare = replace(result, projected=False).reaction()
    assert largest(bare.resultant - full.resultant) > 0.1 * largest(full.resultant)


@pytest.mark.parametrize("t", [0.0, 0.3, 1.0])
def test_prescribe_changes_only_the_prescribed_entries(t):
    """`prescribe` sets the prescribed displacements, on the mesh and on a basis, and leaves all free entries unchanged."""
    body = BODIES["prescribed"]()
    whole = OnModes(body)
    held = body.supports.held
    u, z = (np.random.default_rng(3).standard_normal(space.n) for space in (body.space, whole.space))
    there, on_basis = body.prescribe(u.copy(), t), whole.prescribe(z.copy(), t)
    np.testing.assert_array_equal(there[held], body.supports.values(t))
    np.testing.assert_array_equal(np.delete(there, held), np.delete(u, held))
    np.testing.assert_array_equal(on_basis[: whole.size], z[: whole.size])
    np.testing.assert_allclose(whole.space.expand(on_basis)[held], body.supports.values(t), atol=1e-14)
    assert largest(whole.space.expand(whole.state(there, t)) - there) < 1e-12 * largest(u)


def test_arc_length_reaches_the_same_displacement_at_the_same_load():
    body = BODIES["dead loads"]()
    stop = Stop(displacement=(tip, "y", -0.15))
    full, reduced = (solve_static(one, method="arc-length", stop=stop, quiet=True) for one in (body, OnModes(body)))
    assert reduced.t == pytest.approx(full.t, rel=1e-8) and largest(reduced.u - full.u) < 1e-8 * largest(full.u)


def test_the_error_falls_as_modes_are_added():
    body = bar(loads=(Traction(tip, (0.0, -0.3, 0.2)),))
    full = solve_static(body, steps=2, quiet=True)
    errors = [largest(solve_static(OnModes(body, n), steps=2, quiet=True).u - full.u) / largest(full.u) for n in (2, 12, 40, 70)]
    assert errors[0] > 3 * errors[1] and errors[-1] < 0.2 * errors[1] and errors[-1] < 2e-3


def test_a_bifurcation_and_its_mode_are_those_of_the_full_body():
    """A basis with all modes has the same bifurcation point as the full body, with the same mode on the mesh."""
    body, stop = column(60.0), Stop(load=1.0)
    found = [solve_static(one, steps=4, method="arc-length", stop=stop, quiet=True) for one in (body, OnModes(body))]
    full, reduced = (one.critical_points[0] for one in found)
    assert full.kind == reduced.kind == "bifurcation" and reduced.resolved
    assert reduced.t == pytest.approx(full.t, rel=1e-6) and found[0].status is found[1].status
    assert largest(reduced.mode - full.mode) < 1e-5 and largest(reduced.u - full.u) < 1e-6


@pytest.mark.filterwarnings("ignore::skfem_stvk.errors.StvkWarning")
def test_a_reduced_solve_without_equilibrium_ends_at_the_load_of_the_full_one():
    body = bar(loads=(Traction(tip, (-400.0, 0.0, 0.0)),))
    found = [solve_static(one, steps=8, quiet=True, raise_on_failure=False) for one in (body, OnModes(body))]
    assert [one.status.value for one in found] == ["stopped before the end"] * 2
    assert found[1].t == pytest.approx(found[0].t, rel=0.02)
    assert "invert" in found[1].message and not len(body.inside_out(found[1].u))


def test_iterations_do_not_evaluate_the_full_body(monkeypatch):
    """The number of evaluations of the full body is proportional to the number of states found, not to the number of iterations."""
    reduced = OnModes(bar(loads=GENTLE), 9)
    calls, names = [], ("energy", "internal_force", "energy_and_force", "inside_out", "step_limit", "smallest_volume_ratio")
    body, coefficients = reduced.body, {}
    for name in (*names, "tangent", "external_force"):
        method = getattr(body, name)
        monkeypatch.setattr(
            body, name, lambda *given, name=name, method=method, **more: (calls.append(name), method(*given, **more))[1]
        )
    inner = OnModes(bar(loads=GENTLE), 9)
    reduced.response = inner.response  # replaces precomputed coefficients
    reduced.external_force = lambda z, t: coefficients.setdefault("loads", inner.external_force(z, 1.0)) * t
    result = solve_static(reduced, steps=2, quiet=True)
    assert result.history.iterations > 7
    assert "tangent" not in calls and calls.count("step_limit") == 0
    assert len(calls) < 10 * (len(result.history) + 1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"solver": "superlu"}, "expected .auto. for a reduced system"),
        ({"checkpoint": "kept"}, "expected None for a reduced system"),
    ],
    ids=["solver", "checkpoint"],
)
def test_unsupported_options_of_a_reduced_solve_are_refused(options, message, tmp_path):
    options = {name: tmp_path / value if name == "checkpoint" else value for name, value in options.items()}
    with pytest.raises(StvkError, match=message):
        solve_static(OnModes(bar(loads=GENTLE), 3), quiet=True, **options)


def test_states_are_saved_on_the_mesh(tmp_path):
    body = BODIES["dead loads"]()
    result = solve_static(OnModes(body, 8), steps=2, quiet=True, save=tmp_path / "path.pvd", fields=["von_mises_stress"])
    assert len(list(tmp_path.glob("*.vtu"))) == len(result.history)
    assert result.state["von_mises_stress"].shape == (body.mesh.nt,)


@pytest.mark.filterwarnings("ignore::skfem_stvk.errors.StvkWarning")
@pytest.mark.parametrize("fault", ["a lift that is forgotten", "the sign of the loads", "a tangent of another state"])
def test_faults_are_caught(fault):
    body = BODIES["prescribed"]()
    full = solve_static(body, steps=3, quiet=True)
    reduced = OnModes(body)
    if fault == "a lift that is forgotten":
        reduced.columns[:, -1] = 0
    elif fault == "the sign of the loads":
        loads = reduced.external_force
        reduced.external_force = lambda z, t: -loads(z, t)
    else:
        response = reduced.response
        reduced.response = lambda z: (*response(z)[:2], response(0 * z)[2])
    result = solve_static(reduced, steps=3, quiet=True, raise_on_failure=False)
    assert largest(result.u - full.u) > 1e-3 * largest(full.u) or result.history.iterations > 2 * full.history.iterations
