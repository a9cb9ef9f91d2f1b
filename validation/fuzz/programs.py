"""Random programs: each call on one system must give bitwise the same result as on a fresh system."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse import issparse

from skfem_stvk import StvkError, System

from .bodies import Recipe, made, recipes, states

Call = Callable[[System, NDArray[Any], NDArray[Any]], Any]

#: Calls of a system at a state `u` with a direction `v`.
CALLS: dict[str, Call] = {
    "energy": lambda s, u, v: s.energy(u),
    "internal_force": lambda s, u, v: s.internal_force(u),
    "energy_and_force": lambda s, u, v: s.energy_and_force(u),
    "tangent": lambda s, u, v: s.tangent(u),
    "linearize": lambda s, u, v: s.linearize(u),
    "product": lambda s, u, v: s.product(u, v),
    "linear_operator": lambda s, u, v: s.linear_operator(u) @ v,
    "external_force": lambda s, u, v: s.external_force(u, 0.7),
    "potential": lambda s, u, v: s.potential(u, 0.7),
    "residual": lambda s, u, v: s.residual(u, 0.7),
    "jacobian": lambda s, u, v: s.jacobian(u, 0.7),
    "energies": lambda s, u, v: s.energies(u),
    "elastic_energies": lambda s, u, v: s.elastic_energies(u),
    "energy_along": lambda s, u, v: s.energy_along(u, v),
    "contact_force": lambda s, u, v: s.contact_force(u),
    "copied": lambda s, u, v: deepcopy(s).internal_force(u),
    "round_off": lambda s, u, v: s.round_off(u),
    "mass": lambda s, u, v: s.mass(),
    "inside_out": lambda s, u, v: s.inside_out(u),
    "step_limit": lambda s, u, v: s.step_limit(u, v),
    "smallest_volume_ratio": lambda s, u, v: s.smallest_volume_ratio(u),
    "smallest_stretch": lambda s, u, v: s.smallest_stretch(u),
    "memory": lambda s, u, v: (s.memory(), 0)[1],
    "repr": lambda s, u, v: repr(s),
    "wrong length": lambda s, u, v: s.energy(u[:-1]),
    "not a number": lambda s, u, v: s.internal_force(u * np.nan),
}


@st.composite
def programs(draw: st.DrawFn, drawn: Any = None) -> tuple[Recipe, list[tuple[str, int]]]:
    """Draw a body, by default a small one without contact, and calls with the indices of their states."""
    steps = st.tuples(st.sampled_from(sorted(CALLS)), st.integers(0, 2))
    return draw(recipes(largest=2) if drawn is None else drawn), draw(st.lists(steps, min_size=2, max_size=12))


def run_program(recipe: Recipe, steps: list[tuple[str, int]]) -> bool:
    """Make the calls one after the other on one system, and each on a fresh system, and compare the results.

    Returned arrays are overwritten between calls, so that a system that shares its own memory is found.
    """
    try:
        system = made(recipe)
    except StvkError:
        return False
    known: dict[tuple[str, int], Any] = {}
    for name, state in steps:
        if (name, state) not in known:
            known[name, state] = _result(made(recipe), recipe, name, state)[0]
        plain, returned = _result(system, recipe, name, state)
        assert plain == known[name, state], (
            f"{name} in state {state} after {steps}: {_short(plain)}; expected {_short(known[name, state])} of a fresh system"
        )
        _overwrite(returned)
    return True


def _result(system: System, recipe: Recipe, name: str, state: int) -> tuple[Any, Any]:
    """Return the result of a call as plain values and unchanged. For an error of this package, the plain value is its text."""
    u = states(recipe, system)[state]
    v = np.random.default_rng([recipe.seed, 3]).standard_normal(system.ndofs)
    before = u.tobytes(), v.tobytes()
    try:
        returned = CALLS[name](system, u, v)
        plain = _plain(returned)
    except StvkError as error:
        returned, plain = None, f"{type(error).__name__}: {error}"
    assert (u.tobytes(), v.tobytes()) == before, f"{name} changed its arguments"
    u[:], v[:] = np.nan, np.nan  # overwritten, because they belong to the caller
    return plain, returned


def _plain(value: Any) -> Any:
    if issparse(value):
        return value.indptr.tobytes(), value.indices.tobytes(), value.data.tobytes()
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if isinstance(value, tuple | list):
        return tuple(_plain(one) for one in value)
    if isinstance(value, dict):
        return tuple((key, _plain(one)) for key, one in value.items())
    if isinstance(value, float | np.floating):
        return np.float64(value).tobytes()
    return repr(value) if isinstance(value, int | str | bool | np.generic) or value is None else type(value).__name__


def _overwrite(value: Any) -> None:
    """Overwrite a returned value, because it belongs to the caller."""
    if issparse(value):
        value = value.data
    if isinstance(value, np.ndarray) and value.flags.writeable:
        value[...] = np.nan if value.dtype.kind == "f" else 0
    elif isinstance(value, tuple | list):
        for one in value:
            _overwrite(one)


def _short(plain: Any) -> str:
    return repr(plain)[:200]
