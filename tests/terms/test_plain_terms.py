"""Classes of users that inherit from no base class have its defaults, and what they define counts."""

import pickle
from copy import copy

import numpy as np
import pytest
from bodies import MESHES, state
from terms.toys import Contacts, Friction, Springs

from skfem_stvk import StVK, StvkError, System
from skfem_stvk.edges.bound_term import BoundElements, BoundTerm, bound
from skfem_stvk.terms.term import specified

MESH = MESHES["tetrahedra"]
PAIRS = np.array([[0, 1, 2], [5, 7, 9]])
U, V = (state(MESH, 0.2, seed).reshape(-1, 3) for seed in (1, 2))


class Quartic(Springs.Bound):
    """Springs that know their energy along a line, and the volumes of elements of another term."""

    def along(self, u, v):
        return np.zeros(5)

    def volume_ratios(self, u):
        return np.array([0.5, -0.1])


def test_a_plain_class_has_the_defaults_of_what_it_lacks():
    own = Springs(PAIRS, 3.0).bind(MESH)
    term, force, at_p, out = bound(own), np.zeros(U.shape), np.zeros(U.shape), np.zeros(U.shape)
    assert isinstance(term, BoundTerm) and not isinstance(own, BoundTerm) and term.nodes_paired is own.nodes_paired
    assert not (term.quartic or term.damped or term.removable or term.has_mean_force or term.pairs_change)
    assert term.mean_force(U, V, (0.2, 0.7), 0.25, force) == 0 and np.abs(force).max() > 1e-3
    own.energy_and_force(U + 0.25 * (V - U), at_p)
    assert np.array_equal(force, (0.2 + 0.7) * at_p)
    term.add_round_off(U, out)
    own.energy_and_force(U, at_p := np.zeros(U.shape))
    assert (out >= np.abs(at_p)).all() and out.max() > 1e-3
    with pytest.raises(StvkError, match=r"elements cannot be removed from it; expected a method without\(removed\)"):
        term.without(np.zeros(MESH.nt, dtype=bool))


def test_what_a_plain_class_defines_counts():
    term = bound(Quartic(Springs(PAIRS), MESH))
    assert term.quartic and isinstance(term, BoundElements) and term.smallest_volume_ratio(U) == -0.1
    assert term.step_limit(U, V) == np.inf == term.smallest_stretch(U)
    changing = bound(Contacts(PAIRS).bind(MESH))
    assert changing.pairs_change and changing.pattern_version == 0
    changing.take(PAIRS[:, :1])
    assert changing.pattern_version == 1 and changing.nodes_paired.shape == (2, 1)


@pytest.mark.parametrize("again", [copy, lambda term: pickle.loads(pickle.dumps(term))])
def test_copies_of_plain_classes_are_the_same(again):
    term = bound(Springs(PAIRS, 3.0).bind(MESH))
    assert again(term).energy_and_force(U) == term.energy_and_force(U) > 1e-3


def test_a_plain_specification_has_the_defaults_of_what_it_lacks():
    own, other = specified(Springs(PAIRS, mass_of_all=2.0)), specified(Friction([5, 6]))
    assert own.has_mass and not other.has_mass and own.mass(MESH, np.ones(4)).sum() == 2
    assert not (own.is_law or own.per_element or own.resists_inversion or own.external) and own.region is None
    assert own.section(MESH, 4) is None and own.stiffness == 1.0
    system = System(MESH, [StVK(young=1.0, poisson=0.3), own.given])
    assert system.terms[1] is own.given and system.elastic_names == ["StVK 0", "Springs 1"]
    with pytest.raises(StvkError, match="Got a term of type int; expected"):
        specified(3)
    with pytest.raises(StvkError, match="Got a term of type Springs; expected"):
        specified(Springs)
