"""Loads before there is a body and on one, their times, and functions of position and time from user-supplied values."""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Sequence
from enum import Enum
from math import isfinite
from typing import Any, ClassVar, NamedTuple, TypeAlias, TypeGuard

import numpy as np

from ...arguments import Array, choice, number, own, real_array, shown
from ...edges import NodeBlocks
from ...edges.bound_term import Bound, PlainBound
from ...errors import LoadError, StateError, StvkError, name_ids
from ...mesh import ElementMesh
from ..body import Body
from ..term import TermOrLoad


class Assumed(Enum):
    """Assumption on which the stiffness of a contact is computed, in place of the state.

    APART       nothing touches: for K at rest
    TOUCHING    the whole surface touches: for stable steps, because a body may meet a shape before the next review of its step
    """

    APART = "apart"
    TOUCHING = "touching"


#: What the stiffness of a contact assumes: None for the state; with two states (nv, d), a contact adds twice the derivative of its
#: mean force between them by the second one.
Assumption: TypeAlias = Assumed | tuple[Array, Array] | None


class StepStart(NamedTuple):
    """Beginning of the step of an analysis, from which terms with history, such as friction, continue.

    Attributes
    ----------
    history
        Numbers (n,) of each term with history, in the order of the terms.
    in_time
        Whether the analysis is a motion in time; otherwise it is a path of equilibria.
    friction
        Factor of friction in the equation of the step.
    predicted
        Displacements (nv, d) whose force per slip friction has for all slips, in steps with one linear solve; otherwise None.
    """

    history: tuple[Array, ...]
    in_time: bool
    friction: float = 1.0
    predicted: Array | None = None


#: Masses on which gravity acts.
MASSES = "consistent", "lumped"


class Moment(NamedTuple):
    """The time at which terms are evaluated, the factor of all constants, and the step of the analysis.

    In statics `t` is the load factor, and constants ramp with it. In dynamics `t` is time and constants do not ramp: `Moment(t,
    1.0)`. There `mass` is that of the motion, "lumped" or "consistent", so that gravity acts on the masses in use. Friction acts
    only within a `step`. The stiffness of contacts is that of the state, or that of the assumption `contact`.

    >>> Moment.of(0.5)[:3], Moment.of(Moment(0.5, 1.0, "lumped"))[:3]
    ((0.5, 0.5, 'consistent'), (0.5, 1.0, 'lumped'))
    """

    time: float
    factor: float
    mass: str = "consistent"
    step: StepStart | None = None
    contact: Assumption = None

    @classmethod
    def of(cls, t: Time) -> Moment:
        """Return the moment itself, or that of a load factor."""
        return t if isinstance(t, Moment) else cls(t, t)

    @classmethod
    def checked(cls, t: Time) -> Moment:
        """Return the moment as `of` does, with finite numbers; raise StateError for anything else."""
        if type(t) is float and isfinite(t):
            return cls(t, t)  # the usual case of a user
        if type(t) is cls and type(t.time) is type(t.factor) is float and isfinite(t.time + t.factor) and t.mass in MASSES:
            return t  # the usual case of an analysis
        moment, expected = cls.of(t), "a finite load factor (in statics from 0 to 1) or time"
        time, factor = (number("t", one, expected, error=StateError) for one in moment[:2])
        mass = choice("The masses of a Moment", moment.mass, MASSES, StateError)
        return moment._replace(time=time, factor=factor, mass=mass)

    def assuming(self, contact: Assumption, friction: float = 1.0) -> Moment:
        """Return the moment with this assumption on contacts, and with this factor of friction in the equation of the step."""
        if contact is self.contact and (self.step is None or friction == self.step.friction):
            return self
        return self._replace(contact=contact, step=None if self.step is None else self.step._replace(friction=friction))


#: Moment at which nothing touches the body, for K at rest.
APART = Moment(0.0, 0.0, contact=Assumed.APART)
#: A load factor, or a moment.
Time: TypeAlias = float | Moment


class Value:
    """A load's value, or a prescribed displacement, as a function of position and time.

        t c         constants `c`: they ramp with the load factor (`Moment`)
        f(t)        a function of one argument
        f(x, t)     a function of two: reference coordinates `x` (d, n), and `t`

    Errors are raised for another shape, and for values that are not finite at t = 0 or 1. An array (d, d) for d points is refused,
    since rows and columns cannot be distinguished; a function of x returns values laid out like x. `constant` are the values that
    ramp, None for functions.

    Parameters
    ----------
    value
        A number or (d,) components; (n,) or (d, n) for one value at each of the n points, in their order; a tuple or list of
        d components, each a number or (n,); or a function that returns one of these.
    shape
        Shape of a value, () for a number, (d,) for components.
    x
        (d, n) points of the values, such as nodes.
    what
        The beginning of messages.
    error
        The class of errors.
    name
        Name of the user-supplied value, in messages.
    divided
        Whether the points are those of a part of a divided body, so that constants for each point are refused.

    Examples
    --------
    >>> x = np.array([[0.0, 1.0], [0.0, 0.0]])
    >>> Value((0, -2), (2,), x, "Traction").at(0.5)
    array([[ 0.],
           [-1.]])
    >>> Value(lambda x, t: (0, 1 - x[0]), (2,), x, "Traction").at(0.5)
    array([[0., 0.],
           [1., 0.]])
    """

    def __init__(
        self,
        value: Any,
        shape: tuple[int, ...],
        x: Array,
        what: str,
        error: type[StvkError] = LoadError,
        name: str = "",
        *,
        divided: bool = False,
    ) -> None:
        self._shape, self._x, self._what, self._error, self._divided = shape, x, what, error, divided
        self._function_name = f"the function {name}".rstrip()
        self._arguments = self._count_arguments(value) if callable(value) else 0
        self._function = value
        self.constant = None if self._arguments else self._values(value, name or "the value")
        for t in (0.0, 1.0):
            self.at(t)

    def at(self, t: Time) -> Array:
        """Return values at `t`: a number per point, (1,) or (n,), or components (d, 1) or (d, n). The 1 means the same value at all
        points.
        """
        moment = Moment.of(t)
        if self.constant is not None:
            return moment.factor * self.constant
        time = moment.time
        try:
            result = self._function(time) if self._arguments == 1 else self._function(self._x.copy(), time)
        except Exception as error:
            meaning = "t, a number" if self._arguments == 1 else f"x, of shape {self._x.shape}, and t"
            raise self._error(
                f"{self._what}: {self._function_name} failed at t = {time:g} with {type(error).__name__}: {error}. It gets "
                f"{meaning}."
            ) from error
        return self._values(result, f"what {self._function_name} returned at t = {time:g}")

    def _values(self, value: Any, source: str) -> Array:
        values = _stacked(value) if self._shape and isinstance(value, tuple | list) else real_array(value)
        if values is None:
            raise self._error(f"{self._what}: {source} is {shown(value)}; expected {self._expected}.")
        self._refuse_square(value, values.shape, source)
        if values.shape == self._shape:
            values = values[..., None]
        elif self._divided and self._arguments < 2:
            raise self._error(
                f"{self._what}: {source} has shape {values.shape}, values for each node of a body that is divided among ranks; "
                "expected one value, or a function of (x, t)."
            )
        wanted = (*self._shape, self._x.shape[1])
        if values.shape not in ((*self._shape, 1), wanted):
            hint = " Transpose it: values.T." if values.shape == wanted[::-1] else ""
            raise self._error(f"{self._what}: {source} has shape {values.shape}; expected {self._expected}.{hint}")
        if not np.isfinite(values).all():
            bad = np.flatnonzero(~np.isfinite(values).all(axis=tuple(range(len(self._shape)))))
            where = f" in {name_ids(bad, 'entry')}" if values.shape[-1] > 1 else ""
            raise self._error(f"{self._what}: {source} is not finite{where}.")
        return np.array(values)

    def _refuse_square(self, value: Any, shape: tuple[int, ...], source: str) -> None:
        """Refuse an array (d, d) for d points: neither axis is known to be that of components, and it is not laid out like `x`."""
        d = self._shape[0] if self._shape else 0
        if isinstance(value, tuple | list) or self._arguments == 2 or not 1 < d == self._x.shape[1] or shape != (d, d):
            return
        raise self._error(
            f"{self._what}: {source} has shape {shape}, and there are {d} components and {d} vertices: rows may be either. Give a "
            f"tuple of {d} components: tuple(values) if a row is a component, tuple(values.T) if a row is a vertex."
        )

    @property
    def _expected(self) -> str:
        n = self._x.shape[1]
        if self._shape:
            d = self._shape[0]
            return f"{d} components ({', '.join('xyz'[:d])}), or ({d}, {n}), one column for each of the {n} vertices there"
        return f"a number, or ({n},), one for each of the {n} vertices there"

    def _count_arguments(self, function: Any) -> int:
        try:
            parameters = inspect.signature(function).parameters.values()
        except (TypeError, ValueError) as error:
            raise self._error(
                f"{self._what}: cannot tell the arguments of {self._function_name}, {shown(function)}. Write it as lambda t: ... "
                "then."
            ) from error
        positional = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD) and p.default is p.empty]
        if len(positional) not in (1, 2):
            raise self._error(
                f"{self._what}: {self._function_name} has {len(positional)} arguments; expected one of t, or one of x and t: "
                "lambda x, t: ..."
            )
        if len(positional) == 1 and positional[0].name == "x":
            raise self._error(
                f"{self._what}: a function of one argument is a function of t, but this one calls it x. For a function of position "
                "write lambda x, t: ...; to ramp it, multiply by t."
            )
        return len(positional)


def check_constants(value: Any, what: str) -> None:
    """Refuse constants that are not finite numbers, before a mesh says how many are expected.

    >>> check_constants((0, 0, 10**400), "Gravity: g")
    Traceback (most recent call last):
    skfem_stvk.errors.LoadError: Gravity: g = (0, 0, 1000...); expected finite numbers, or a function of t or of (x, t).
    """
    if callable(value):
        return
    values = _stacked(value) if isinstance(value, tuple | list) else real_array(value)
    if values is None:
        raise LoadError(f"{what} = {shown(value)}; expected finite numbers, or a function of t or of (x, t).")
    bad = np.flatnonzero(~np.isfinite(values).all(axis=tuple(range(values.ndim - 1))))
    if len(bad):
        where = f" in {name_ids(bad, 'entry')}" if values.ndim and values.shape[-1] > 3 else ""
        raise LoadError(f"{what} is not finite{where}; expected finite numbers, or a function of t or of (x, t).")


def _stacked(components: Sequence[Any]) -> Array | None:
    """Return the components (d, ...), each a number or one value per point, as one array; None if a component is neither."""
    arrays = [real_array(component) for component in components]
    known = [array for array in arrays if array is not None]
    if not known or len(known) < len(arrays):
        return None
    if not any(array.ndim for array in known):  # takes a tenth of the time
        return np.array(known)
    try:
        return np.stack(np.broadcast_arrays(*known))
    except ValueError:  # components of different lengths
        return None


class BoundLoad(Bound, ABC):
    """Load on a body at displacements `u` (nv, d) and load factor or time `t`.

    Attributes
    ----------
    has_potential
        Whether its force is minus the gradient of a potential; otherwise its stiffness is not symmetric.
    dead
        Whether its force does not depend on the displacements: its potential is linear in `u`, and it has no stiffness.
    steady
        Whether the load is constant in time, that is, not a function.
    """

    has_potential: bool = True
    dead: bool = True
    steady: bool = True

    @abstractmethod
    def potential(self, u: Array, t: Time) -> float:
        """Return the potential [J] of the load at `u` (nv, d); the force is `-d potential/du`."""

    @abstractmethod
    def add_force(self, u: Array, t: Time, out: Array) -> None:
        """Add the external force [N] to `out` (nv, d)."""

    def add_blocks(self, u: Array, t: Time, blocks: NodeBlocks) -> None:
        """Add the blocks of `-d force/du` [N/m] at `u` (nv, d); a dead load has none."""


class PlainLoad(PlainBound, BoundLoad):
    """Load of a user's class that does not inherit from `BoundLoad`."""

    def potential(self, u: Array, t: Time) -> float:
        return float(self.of.potential(u, t))

    def add_force(self, u: Array, t: Time, out: Array) -> None:
        self.of.add_force(u, t, out)


def bound_load(load: Any) -> BoundLoad:
    """Return the load with all members of `BoundLoad`."""
    return load if isinstance(load, BoundLoad) else PlainLoad(load)


class Load(TermOrLoad, ABC):
    """A load without a mesh, usable in many systems; as a dataclass it copies its arguments."""

    external: ClassVar[bool] = True
    #: Name of the attribute with its values, for loads that are checked before a mesh exists.
    given_by: ClassVar[str] = ""
    #: Whether it requires densities of the materials.
    needs_density: ClassVar[bool] = False
    #: Whether `where` selects elements if the mesh is a surface in space.
    on_elements: ClassVar[bool] = False

    def __post_init__(self) -> None:
        own(self)
        if self.given_by:
            check_constants(getattr(self, self.given_by), f"{type(self).__name__}: {self.given_by}")

    @abstractmethod
    def bind(self, body: Body) -> BoundLoad:
        """Return the load on this body; raise RegionError or LoadError if it does not apply there."""

    def value(self, mesh: ElementMesh, x: Array, what: str, shape: tuple[int, ...] | None = None) -> Value:
        """Return its values at the nodes `x` (d, n) as a function of time; by default components. Messages begin with `what`."""
        given, divided = getattr(self, self.given_by), mesh.space.comm.divided
        return Value(given, (mesh.d,) if shape is None else shape, x, what, name=self.given_by, divided=divided)


def is_load(term: Any) -> TypeGuard[Load]:
    """Return whether a term is an external load: a `Load`, or an object with a true attribute `external`."""
    return bool(getattr(term, "external", False))
