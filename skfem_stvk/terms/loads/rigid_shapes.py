"""Rigid shapes that bodies touch: planes, spheres, cylinders and boxes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arguments import Quantity, Specification, flag, number, points
from ...errors import ContactError, StvkError
from ...kernels import contact_penalty as kernels


class RigidShape(Specification, ABC):
    """Rigid shape. Its `kind` and `numbers` are those of `kernels.contact`.

    Attributes
    ----------
    d
        Dimension of the space: the number of components of its points.
    """

    error: ClassVar[type[StvkError]] = ContactError
    kind: ClassVar[int]
    vectors: ClassVar[tuple[str, ...]]  # names of the fields with one component per dimension
    positions: ClassVar[tuple[str, ...]]  # those of points

    def __post_init__(self) -> None:
        for name, vector in points(self.name, {name: getattr(self, name) for name in self.vectors}, ContactError).items():
            object.__setattr__(self, name, vector)

    @property
    def d(self) -> int:
        return len(getattr(self, self.vectors[0]))

    @property
    def name(self) -> str:
        """Name in messages."""
        return type(self).__name__

    @property
    def thickness(self) -> float:
        """Smallest width of the shape [m]; infinity if it has no other side."""
        return np.inf

    @abstractmethod
    def numbers(self) -> NDArray[np.float64]:
        """Return the numbers of the shape for the kernels."""

    def displaced(self, by: ArrayLike) -> RigidShape:
        """Return the shape displaced by components (d,) [m]."""
        shape: Any = self  # a dataclass
        return replace(shape, **{name: tuple(np.add(getattr(self, name), by).tolist()) for name in self.positions})

    def _unit_vector(self, name: str) -> tuple[float, ...]:
        given = getattr(self, name)
        length = float(np.linalg.norm(given))
        if not length > 0:
            raise ContactError(f"{self.name}: {name} = {given}; expected a direction, not all zero.")
        return given if abs(length - 1) < 1e-15 else tuple((np.array(given) / length).tolist())

    def _positive(self, name: str) -> float:
        return number(f"{self.name}: {name}", getattr(self, name), "a positive length", 0.0, error=ContactError)

    def _packed(
        self, position: ArrayLike, direction: ArrayLike = (), radius: float = 0.0, inside: bool = False
    ) -> NDArray[np.float64]:
        packed = np.zeros(kernels.COUNT)
        packed[: self.d] = position
        packed[kernels.DIRECTION : kernels.DIRECTION + np.size(direction)] = direction
        packed[kernels.RADIUS], packed[kernels.SIGN] = radius, -1.0 if inside else 1.0
        return packed


@dataclass(frozen=True)
class RigidPlane(RigidShape):
    """Plane; in two dimensions a line. The body is on the side of the normal.

    Parameters
    ----------
    point
        (d,) coordinates of a point of the plane [m].
    normal
        (d,) direction towards the body, of any length.

    Raises
    ------
    ContactError
        for components that are not finite, and for a normal of zeros.

    Examples
    --------
    >>> RigidPlane((0, 0, 0), (0, 0, 2)).normal
    (0.0, 0.0, 1.0)
    """

    kind, vectors, positions = kernels.PLANE, ("point", "normal"), ("point",)
    point: Annotated[tuple[float, ...], Quantity("length", "A point of the plane.", components=True)]
    normal: Annotated[tuple[float, ...], Quantity(None, "Direction towards the body, of any length.", components=True)]

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "normal", self._unit_vector("normal"))

    def numbers(self) -> NDArray[np.float64]:
        return self._packed(self.point, self.normal)


@dataclass(frozen=True)
class RigidSphere(RigidShape):
    """Sphere; in two dimensions a disc.

    Parameters
    ----------
    centre
        (d,) coordinates of the centre [m].
    radius
        Radius [m].
    inside
        Whether the body is inside.

    Raises
    ------
    ContactError
        for components that are not finite, and for a radius that is not positive.

    Examples
    --------
    >>> RigidSphere((0, 0, 2), 1.0).d
    3
    """

    kind, vectors, positions = kernels.SPHERE, ("centre",), ("centre",)
    centre: Annotated[tuple[float, ...], Quantity("length", "The centre.", components=True)]
    radius: Annotated[float, Quantity("length", "Radius.", gt=0)]
    inside: Annotated[bool, Quantity(None, "Whether the body is inside.")] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "radius", self._positive("radius"))
        object.__setattr__(self, "inside", flag(f"{self.name}: inside", self.inside, ContactError))

    @property
    def thickness(self) -> float:
        return np.inf if self.inside else 2 * self.radius

    def numbers(self) -> NDArray[np.float64]:
        return self._packed(self.centre, (), self.radius, self.inside)


@dataclass(frozen=True)
class RigidCylinder(RigidShape):
    """Cylinder without ends, in space.

    Parameters
    ----------
    point
        (3,) coordinates of a point of the axis [m].
    axis
        (3,) direction of the axis, of any length.
    radius
        Radius [m].
    inside
        Whether the body is inside.

    Raises
    ------
    ContactError
        for components that are not finite, an axis of zeros or in the plane, and a radius that is not positive.

    Examples
    --------
    >>> RigidCylinder((0, 0, 0), (0, 3, 0), 0.5).axis
    (0.0, 1.0, 0.0)
    """

    kind, vectors, positions = kernels.CYLINDER, ("point", "axis"), ("point",)
    point: Annotated[tuple[float, ...], Quantity("length", "A point of the axis.", components=True)]
    axis: Annotated[tuple[float, ...], Quantity(None, "Direction of the axis, of any length.", components=True)]
    radius: Annotated[float, Quantity("length", "Radius.", gt=0)]
    inside: Annotated[bool, Quantity(None, "Whether the body is inside.")] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.d != 3:
            raise ContactError(
                f"RigidCylinder: {self.d} components; expected three. In the plane take a RigidSphere, a disc there."
            )
        object.__setattr__(self, "axis", self._unit_vector("axis"))
        object.__setattr__(self, "radius", self._positive("radius"))
        object.__setattr__(self, "inside", flag(f"{self.name}: inside", self.inside, ContactError))

    @property
    def thickness(self) -> float:
        return np.inf if self.inside else 2 * self.radius

    def numbers(self) -> NDArray[np.float64]:
        return self._packed(self.point, self.axis, self.radius, self.inside)


@dataclass(frozen=True)
class RigidBox(RigidShape):
    """Box along the axes; in two dimensions a rectangle. The body is outside.

    Parameters
    ----------
    low, high
        (d,) smallest and largest coordinates [m].
    radius
        Radius of the rounded edges [m], at most half of the shortest side. Where points are deeper than the radius, the nearest
        face counts: the force jumps from one face to the next.

    Raises
    ------
    ContactError
        for components that are not finite, if `low` is not below `high`, and for a radius that does not fit.

    Examples
    --------
    >>> RigidBox((0, 0, 0), (2, 1, 1), radius=0.1).d
    3
    """

    kind, vectors, positions = kernels.BOX, ("low", "high"), ("low", "high")
    low: Annotated[tuple[float, ...], Quantity("length", "Smallest coordinates.", components=True)]
    high: Annotated[tuple[float, ...], Quantity("length", "Largest coordinates.", components=True)]
    radius: Annotated[float, Quantity("length", "Radius of the rounded edges.", ge=0)] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        sides = np.subtract(self.high, self.low)
        if not (sides > 0).all():
            raise ContactError(f"RigidBox: low = {self.low}, high = {self.high}; expected low below high along each axis.")
        most = float(sides.min()) / 2
        expected = f"0 to {most:g}, half of the shortest side"
        radius = number("RigidBox: radius", self.radius, expected, 0.0, most, closed=True, error=ContactError)
        object.__setattr__(self, "radius", radius)

    @property
    def thickness(self) -> float:
        return float(np.subtract(self.high, self.low).min())

    def numbers(self) -> NDArray[np.float64]:
        half = np.full(3, np.inf)
        half[: self.d] = np.subtract(self.high, self.low) / 2
        return self._packed(np.add(self.low, self.high) / 2, half, self.radius)


#: Shapes that scenes know, by their `type`.
SHAPES: dict[str, Any] = {"plane": RigidPlane, "sphere": RigidSphere, "cylinder": RigidCylinder, "box": RigidBox}
