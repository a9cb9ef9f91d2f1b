"""Vectors belong to spaces and subspaces, and analyses multiply vectors only by methods of their spaces."""

import ast
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr

import skfem_stvk
from skfem_stvk import BackwardEuler, Gravity, StVK, System, simulate, solve_static
from skfem_stvk.space import Communicator, Entries, Space

RNG = np.random.default_rng(5)
V = RNG.standard_normal((12, 5))
SPACES = {
    "all": Space(12),
    "entries": Space(12).on(np.array([1, 4, 5, 11])),
    "coordinates": Space(12).spanned_by(V),
    "some coordinates": Space(12).spanned_by(V).on(slice(3)),
    "some entries of some": Space(12).on(np.array([1, 4, 5, 11])).on(np.array([0, 3])),
}


@pytest.mark.parametrize("name", SPACES)
def test_restricting_is_the_transpose_of_expanding(name):
    space = SPACES[name]
    x = RNG.standard_normal(space.n)
    f = RNG.standard_normal(len(space.expand(x)))
    assert space.dot(x, space.restrict(f)) == pytest.approx(float(space.expand(x) @ f), rel=1e-13)


@pytest.mark.parametrize("name", SPACES)
def test_a_few_entries_are_those_of_the_expanded_vector(name):
    space, x = SPACES[name], RNG.standard_normal(SPACES[name].n)
    some = np.array([3, 0, 1])
    np.testing.assert_allclose(space.entries(some)(x), space.expand(x)[some], rtol=1e-14)


def test_entries_have_their_numbers_in_the_full_space():
    assert SPACES["some entries of some"].numbers.tolist() == [1, 11] and SPACES["some coordinates"].numbers.tolist() == [0, 1, 2]


class OfTwoParts(Communicator):
    """Communicator of a body of two parts, of which this one is alone in its process."""

    divided = True


class Part(Space):
    """Part of a divided body that counts its last entries; another part adds 10 at each entry that both have."""

    owned = (slice(4, 12),)

    def share(self, f):
        f[:6] += 10
        return f


def test_subspaces_of_a_divided_body_share_and_count_what_the_body_does():
    some = Part(12, OfTwoParts()).on(np.array([1, 4, 7])).on(np.array([0, 2]))
    f = np.array([1.0, 2.0])
    assert some.share(f) is f and f.tolist() == [11, 2] and some.counted(np.ones(2)).tolist() == [0, 1]
    none = Part(12, OfTwoParts()).on(np.empty(0, dtype=int))
    assert none.share(np.empty(0)).size == 0 and none.counted(np.empty(0)).size == 0


@pytest.mark.parametrize("size", [1e-200, 1.0, 1e200])
def test_norms_do_not_overflow_or_underflow(size):
    assert Space(3).norm(size * np.array([3.0, 0.0, -4.0])) == pytest.approx(5 * size, rel=1e-15)


def test_random_vectors_depend_only_on_the_seed_and_the_numbers_of_their_entries():
    assert (Space(9).random() == Space(9).random()).all() and (Space(9).random(1) != Space(9).random()).all()
    some = np.array([7, 2, 5])
    assert np.array_equal(Space(9).on(some).random(1), Space(9).random(1)[some])


def test_random_vectors_are_normally_distributed():
    x = np.sort(Space(100_000).random(3))
    assert np.abs(ndtr(x) - (np.arange(len(x)) + 0.5) / len(x)).max() < 1.63 / len(x) ** 0.5  # Kolmogorov, Smirnov: 1 %
    assert abs(np.corrcoef(Space(100_000).random(3), Space(100_000).random(4))[0, 1]) < 0.01


@pytest.fixture
def counted(monkeypatch):
    """Return the number of calls of each method of a space, by name."""
    counts = {}

    def count(kind, name):
        method = getattr(kind, name)

        def counting(self, *arguments):
            counts[name] = counts.get(name, 0) + 1
            return method(self, *arguments)

        monkeypatch.setattr(kind, name, counting)

    for name in ("dot", "norm", "random"):
        count(Space, name)
    for name in ("expand", "restrict"):
        count(Entries, name)
    return counts


def body():
    import skfem

    mesh = skfem.MeshTet().refined(1).with_boundaries({"left": lambda x: x[0] == 0})
    return System(mesh, [StVK(young=1e5, poisson=0.3, density=1e3), Gravity(g=(1.0, 0, -9.81))], fixed={"left": "xyz"})


def test_statics_and_motion_use_the_operations_of_their_spaces(counted):
    result = solve_static(body(), steps=2, solver="superlu", quiet=True)
    iterations = sum(len(step.iterations) for step in result.history)
    assert counted["norm"] >= 3 * iterations and counted["expand"] >= iterations and counted["dot"] >= iterations
    counted.clear()
    run = simulate(body(), BackwardEuler(1e-2), until=0.03, quiet=True)
    assert counted["norm"] >= 5 * run.iterations and counted["expand"] >= run.iterations


#: NumPy's norms of arrays that are no vectors of a space: checked files, the size of a mesh, and a mode in a picture.
OTHERS = {("motion_checkpoint.py", "np.linalg.norm"), ("modes.py", "np.linalg.norm")}


@pytest.mark.parametrize("folder", ["newton", "statics", "dynamics"])
def test_analyses_use_no_product_norm_or_random_vector_of_numpy(folder):
    past = {"np.vdot", "np.dot", "np.inner", "np.linalg.norm", "np.random.default_rng"}
    for file in (Path(skfem_stvk.__file__).parent / "solvers" / folder).rglob("*.py"):
        tree = ast.parse(file.read_text())
        named = {ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        imported = {name.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for name in node.names}
        found = {(file.name, name) for name in (named & past) | (imported & {"dot", "norm"})}
        assert not found - OTHERS
