"""`verify` compares a reduced body with its full body and finds planted faults.

Files restore a reduced body only for the body that it was made of.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from solvers.reduced.test_reduced_system import BODIES, LAW, cube, left, reduced_of, right, upright

from skfem_stvk import ReducedSystem, StVK, StvkError, System, Traction, verify


def failures(reduced):
    return {(result.check, result.quantity) for result in verify(reduced, quiet=True).failures()}


@pytest.mark.parametrize("name", ["held", "rotated", "quadratic", "with a penalty"])
def test_reduced_bodies_pass(name):
    report = verify(reduced_of(BODIES[name]()), quiet=True)
    assert report.passed, str(report)
    assert len(report.results) == 1 + 3 * 6


def altered(change):
    """Return a reduced body with changed coefficients of the quartic."""
    reduced = reduced_of(cube())
    inner = reduced.in_coordinates
    change(inner.coefficients, reduced)
    inner._known = {}
    return reduced


def test_a_wrong_coefficient_is_noticed():
    def change(T, reduced):
        T[np.argmax(np.abs(T))] *= 1 + 1e-6

    assert {("agreement", "W"), ("agreement", "F"), ("agreement", "K")} <= failures(altered(change))


def test_a_missing_cubic_part_is_noticed():
    """The check finds a missing cubic part: the coefficients with exactly one factor `x_0` are zero."""
    from kernels.readable_reduced import ordered

    def change(T, reduced):
        T[[indices.count(0) == 1 for indices in ordered(reduced.size + 1, 4)]] = 0

    assert ("agreement", "F") in failures(altered(change))


class AlteredResponse:
    """Reduced body with an altered response."""

    def __init__(self, reduced, response):
        self.__dict__.update(body=reduced.body, columns=reduced.columns, size=reduced.size, masses=reduced.masses, quartic=True)
        self._reduced, self._response = reduced, response

    def response(self, z):
        return self._response(*self._reduced.response(z))


FAULTS = {
    "a wrong factor in K": (lambda W, F, K: (W, F, 1.001 * K), ("derivatives", "K")),
    "a wrong factor in F": (lambda W, F, K: (W, 1.001 * F, K), ("derivatives", "F")),
    "K that is not symmetric": (lambda W, F, K: (W, F, K + 1e-6 * np.triu(K, 1)), ("symmetry", "K")),
    "another energy": (lambda W, F, K: (W + 1.0, F, K), ("agreement", "W")),
}


@pytest.mark.parametrize("name", FAULTS)
def test_wrong_responses_are_noticed(name):
    response, noticed = FAULTS[name]
    assert noticed in failures(AlteredResponse(reduced_of(cube()), response))


def test_a_basis_that_is_not_orthonormal_is_noticed():
    reduced = reduced_of(cube())
    stretched = AlteredResponse(reduced, lambda *response: response)
    stretched.columns = 1.001 * reduced.columns
    assert ("orthonormality", "V' M V") in failures(stretched)


def test_verify_refuses_options_that_a_reduced_body_defines():
    with pytest.raises(StvkError, match="young: a reduced body defines these"):
        verify(reduced_of(cube()), young=1.0)


def test_a_file_makes_the_same_body_again(tmp_path):
    body = BODIES["rotated"]()
    reduced = reduced_of(body)
    again = ReducedSystem.load(reduced.save(tmp_path / "body.npz"), BODIES["rotated"]())
    q = np.cos(np.arange(6.0))
    for one, other in zip(reduced.linearize(q, 0.3), again.linearize(q, 0.3), strict=True):
        assert np.array_equal(one, other)
    assert np.array_equal(reduced.displacements(q, 0.3), again.displacements(q, 0.3))


def test_a_file_serves_a_body_with_other_loads(tmp_path):
    file = reduced_of(cube()).save(tmp_path / "body.npz")
    assert ReducedSystem.load(file, cube(Traction(right, (1.0, 0, 0)))).external_force(np.zeros(6)).any()


OTHERS = {
    "elastic terms": lambda: System(upright(), StVK(young=2.1, poisson=0.3, density=1.5), fixed=[(left, "xyz")]),
    "mesh": lambda: System(upright(3), LAW, fixed=[(left, "xyz")]),
    "supports": lambda: System(upright(), LAW, fixed=[(left, "xyz"), (right, "y")]),
    "masses": lambda: System(upright(), StVK(young=2.0, poisson=0.3, density=1.6), fixed=[(left, "xyz")]),
}


@pytest.mark.parametrize("name", OTHERS)
def test_a_file_of_another_body_is_refused(name, tmp_path):
    file = reduced_of(cube()).save(tmp_path / "body.npz")
    with pytest.raises(StvkError, match=f"another problem: .*{name}.* changed"):
        ReducedSystem.load(file, OTHERS[name]())


def test_damaged_files_and_files_of_other_formats_are_refused(tmp_path):
    file = reduced_of(cube()).save(tmp_path / "body.npz")
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])
    with pytest.raises(StvkError, match="cannot be read as a reduced body"):
        ReducedSystem.load(file, cube())
    with pytest.raises(StvkError, match=r"does not end in \.npz"):
        ReducedSystem.load(tmp_path / "body.txt", cube())
    with pytest.raises(StvkError, match="body = "):
        ReducedSystem.load(file, SimpleNamespace())
