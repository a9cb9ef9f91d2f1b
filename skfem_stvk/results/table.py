"""The fields that a result has, by name. A new field is one function and one row here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..arguments import shown
from ..errors import StvkError, name_known
from . import ellipticity, kinematics, stress
from .kinematics import Masked

if TYPE_CHECKING:
    from .state import State


@dataclass(frozen=True)
class Field:
    """What a field is: its name and unit, the shape of one element's value, whether that is a symmetric tensor, and its function."""

    name: str
    unit: str
    shape: tuple[int, ...]
    symmetric: bool
    of: Callable[[State], Masked]

    @property
    def words(self) -> str:
        """The name in words.

        >>> find("von_mises").words, find("pk1").words
        ('von Mises stress', 'first Piola-Kirchhoff stress')
        """
        return WORDS.get(self.name, self.name.replace("_", " "))


WORDS = {
    "green_strain": "Green-Lagrange strain",
    "pk2_stress": "second Piola-Kirchhoff stress",
    "pk1_stress": "first Piola-Kirchhoff stress",
    "cauchy_stress": "Cauchy stress",
    "von_mises_stress": "von Mises stress",
}
TENSOR = (3, 3)
#: Vectors of the vertices, by name, and their units.
VECTORS = {"displacement": "m", "velocity": "m/s"}
FIELDS = (
    Field("deformation_gradient", "-", TENSOR, False, kinematics.deformation_gradient),
    Field("green_strain", "-", TENSOR, True, kinematics.green_strain),
    Field("volume_ratio", "-", (), False, kinematics.volume_ratio),
    Field("principal_stretches", "-", (3,), False, kinematics.principal_stretches),
    Field("pk2_stress", "Pa", TENSOR, True, stress.pk2_stress),
    Field("pk1_stress", "Pa", TENSOR, False, stress.pk1_stress),
    Field("cauchy_stress", "Pa", TENSOR, True, stress.cauchy_stress),
    Field("von_mises_stress", "Pa", (), False, stress.von_mises_stress),
    Field("strain_energy_density", "J/m^3", (), False, stress.strain_energy_density),
    Field("smallest_acoustic_eigenvalue", "Pa", (), False, ellipticity.smallest_acoustic_eigenvalue),
)


def names() -> tuple[str, ...]:
    """The names of all fields.

    >>> names()[-3:]
    ('von_mises_stress', 'strain_energy_density', 'smallest_acoustic_eigenvalue')
    """
    return tuple(field.name for field in FIELDS)


def find(name: str, others: Iterable[str] = ()) -> Field:
    """The field of this name; those of stresses may leave `_stress` out. Messages name `others` too, which would have done.

    Raises
    ------
    StvkError
        if there is none, naming those that there are.

    >>> find("cauchy").name
    'cauchy_stress'
    >>> find("von_mieses")
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: There is no field 'von_mieses'; known: 'cauchy_stress', ... Did you mean 'von_mises_stress'? ...
    """
    for field in FIELDS if isinstance(name, str) else ():
        if name in (field.name, field.name.removesuffix("_stress")):
            return field
    known = name_known(name if isinstance(name, str) else "", (*others, *names()))
    raise StvkError(f"There is no field {shown(name)}; {known} Stresses go without '_stress' too.")


def find_all(given: Sequence[str]) -> list[Field]:
    """The fields of these names.

    Raises
    ------
    StvkError
        if it is no list of names, or one of them is unknown.
    """
    if not isinstance(given, list | tuple):
        raise StvkError(f"fields = {shown(given)}; expected a list of names of fields.")
    return [find(name) for name in given]
