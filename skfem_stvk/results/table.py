"""Fields of a result, by name.

A new field is one function, which takes a `Response` and returns values and a mask of missing ones, and one row of `FIELDS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, shown
from ..errors import StvkError, name_ids, name_known, warn
from ..terms.laws.elastic_law import embedded
from ..terms.laws.volume_penalty import ENERGIES
from ..units import UnitSystem
from .law_on_elements import adjugate, current_normals, dilation, elasticity, in_space
from .response import Masked, Response

WORDS = {
    "green_strain": "Green-Lagrange strain",
    "pk2_stress": "second Piola-Kirchhoff stress",
    "pk1_stress": "first Piola-Kirchhoff stress",
    "cauchy_stress": "Cauchy stress",
    "von_mises_stress": "von Mises stress",
}
TENSOR = (3, 3)
#: Values at nodes, by name, and their units.
NODAL = {"displacement": "m", "velocity": "m/s", "contact_force": "N", "contact_pressure": "Pa", "gap": "m"}

#: Number of nets of directions, and of directions in each; number of steps from the best of each net, and the longest step [rad].
NETS, DIRECTIONS, STEPS, LONGEST = 3, 60, 30, 0.3


def green_strain(state: Response) -> Masked:
    """Return the Green-Lagrange strain `E = (F'F - I)/2` (nt, 3, 3), on rest axes."""
    return state.globally(state.strain), state.without_strain


def deformation_gradient(state: Response) -> Masked:
    """Return the deformation gradient `F` (nt, 3, 3), from rest to current axes: `I + grad u` within, and the stretches across.

    In plane strain `F_33 = 1`. If the stress across vanishes, the columns across follow from `F'F = I + 2 E` and the current
    normals: `F_33 = sqrt(1 + 2 E_33)` without shear across. If `1 + 2 E_33 <= 0`, the law gives no thickness and `F` does not
    exist; such elements are masked, with a warning.
    """
    frames, k = state.point.frames, state.fields.mesh.k
    gradient = in_space(state.gradient)
    if k == 3:
        return gradient + np.eye(3), state.without_strain
    tangents = frames[..., :k] + gradient
    across, solid = _across(tangents, state)
    if len(thin := np.flatnonzero(~solid & ~state.without_strain)):
        warn(
            f"{name_ids(state.fields.mesh.element_numbers[thin], 'element')}: stretched so far that zero transverse stress leaves "
            "no thickness (1 + 2 E <= 0). F, J, principal stretches and Cauchy stress are masked there; pk2_stress, pk1_stress and "
            "green_strain are not. Check the units of loads and moduli."
        )
    F = tangents @ np.swapaxes(frames[..., :k], 1, 2) + across @ np.swapaxes(frames[..., k:], 1, 2)
    return F, state.without_strain | ~solid


def _across(tangents: Array, state: Response) -> tuple[Array, NDArray[np.bool_]]:
    """Return the images `f B + n U` (nt, 3, 3 - k) of the normals, and a mask where `U` exists.

    Here `B = (f'f)^-1 2 E_f3` and `U^2 = 1 + 2 E_33 - 2 E_3f B`.
    """
    k = tangents.shape[2]
    C = np.eye(3) + 2 * state.strain
    B, solved = _solve(np.swapaxes(tangents, 1, 2) @ tangents, C[:, :k, k:])
    squares, directions = np.linalg.eigh(C[:, k:, k:] - C[:, k:, :k] @ B)
    U = (directions * np.sqrt(np.maximum(squares, 0.0))[:, None]) @ np.swapaxes(directions, 1, 2)
    normals = current_normals(state.point.frames, tangents, state.fields.mesh.d)
    return tangents @ B + normals @ U, solved & (squares.min(axis=1) > 0)


def _solve(M: Array, right: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return `M^-1 right` and a mask where it exists, `M` of order 1 or 2; zero where `right` is zero, even if `M` is singular."""
    adjugate = np.ones_like(M) if M.shape[1] == 1 else M[:, ::-1, ::-1] * np.array([[1, -1], [-1, 1]])
    determinant, size = np.linalg.det(M), np.trace(M, axis1=1, axis2=2) ** M.shape[1]
    regular = determinant > np.finfo(float).eps ** 2 * size
    solution = adjugate @ right / np.where(regular, determinant, 1.0)[:, None, None]
    return np.where(regular[:, None, None], solution, 0.0), regular | ~right.any(axis=(1, 2))


def volume_ratio(state: Response) -> Masked:
    """Return the volume ratio `J = det F` (nt,), negative for inverted elements; the order of vertices does not matter.

    For membranes and cables in space the ratio is positive. In elements that wrinkle it is that of the material without its folds:
    a wrinkled one has its natural width, a slack one its volume at rest.
    """
    F, missing = state.value(deformation_gradient)
    J, mesh = np.linalg.det(F), state.fields.mesh
    if len(ids := state.fields.wrinkling):
        natural = np.sqrt(np.maximum(np.linalg.det(np.eye(3) + 2 * state.natural_strain[ids]), 0.0))
        J[ids] = np.where((J[ids] < 0) & (mesh.k == mesh.d), -natural, natural)
    return J, missing


def principal_stretches(state: Response) -> Masked:
    """Return the principal stretches (nt, 3), descending: roots of the eigenvalues of `F'F = I + 2 E`, never negative."""
    strains = np.linalg.eigvalsh(state.strain)[:, ::-1]
    missing = state.value(deformation_gradient)[1] if state.fields.mesh.k < 3 else state.without_strain
    return np.sqrt(np.maximum(1 + 2 * strains, 0.0)), missing


def pk2_stress(state: Response) -> Masked:
    """Return the second Piola-Kirchhoff stress (nt, 3, 3) [Pa], on rest axes: `S = C : E`, and `psi'(J) J (F'F)^-1` for a
    `VolumePenalty`. For `LinearElastic` it is `C : eps` with the small strain.

    Elements of a `VolumePenalty` with `J = 0` are masked, with a warning.
    """
    if len(lost := np.flatnonzero(state.shrunk)):
        _warn_of_shrunk(state, lost, "stress is infinite")
    return state.globally(state.stress), state.fields.without_term | state.shrunk


def pk1_stress(state: Response) -> Masked:
    """Return the first Piola-Kirchhoff (nominal) stress `P = F S` (nt, 3, 3) [Pa], force per rest area; not symmetric.

    `P` exists even where `F` is missing, since there is no stress across in that case.
    """
    S, missing = state.value(pk2_stress)
    return _carrying(state)[0] @ S, missing


def _carrying(state: Response) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return `F` and `J` that map stresses to the deformed body, and a mask where they do not exist.

    The stress of linear elasticity refers to the undeformed body, so all its measures are equal.
    """
    F, _ = state.value(deformation_gradient)
    J, missing = state.value(volume_ratio)
    linear = state.fields.linear
    return np.where(linear[:, None, None], np.eye(3), F), np.where(linear, 1.0, J), missing & ~linear


def cauchy_stress(state: Response) -> Masked:
    """Return the Cauchy (true) stress `F S F'/|J|` (nt, 3, 3) [Pa], force per current area, on current axes. For `LinearElastic` it
    is that of the small strain.

    `|J|` is used so that tension stays tension in inverted elements. Elements with `J = 0` are masked, with a warning.
    """
    F, J, missing = _carrying(state)
    S, without = state.value(pk2_stress)
    missing = missing | without
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        stress = F @ S @ np.swapaxes(F, 1, 2) / np.abs(J)[:, None, None]
    infinite = ~np.isfinite(stress).all(axis=(1, 2))
    if len(lost := np.flatnonzero(infinite & ~missing)):
        _warn_of_shrunk(state, lost, "the Cauchy stress is infinite")
    stress[infinite] = 0.0
    return stress, missing | infinite


def _warn_of_shrunk(state: Response, ids: NDArray[np.int64], what: str) -> None:
    warn(
        f"{name_ids(state.fields.mesh.element_numbers[ids], 'element')}: shrunk to zero volume (J = 0), so that {what}; it is "
        "masked there. Check that the solve converged, and that no prescribed displacements move vertices to the same point."
    )


def von_mises_stress(state: Response) -> Masked:
    """Return the von Mises stress `sqrt(3/2 s : s)` (nt,) [Pa], `s` the deviator of the Cauchy stress."""
    stress, missing = state.value(cauchy_stress)
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    return np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2))), missing


def strain_energy_density(state: Response) -> Masked:
    """Return the strain energy per rest volume (nt,) [J/m^3], summed over the terms: `1/2 E : C : E`, and `psi(J)` of a
    `VolumePenalty`.
    """
    return state.energy_density, state.fields.without_term


def smallest_acoustic_eigenvalue(state: Response) -> Masked:
    """Return the smallest eigenvalue (nt,) [Pa] of the acoustic tensor `Q(N)` over all unit `N`.

    A plane wave `a cos(N . X - w t)` has `rho w^2 = a . Q(N) a > 0`. Where the eigenvalue is not positive, strong ellipticity is
    lost, and results depend on the mesh, however fine it is.

    The best of sampled directions are improved by gradient steps (Barzilai, Borwein, 1988). An isotropic solid at rest has `mu`.
    Elements in no term or in another law than StVK are masked, and membranes and cables in space, which wrinkle when compressed.
    """
    fields, lowest, tiny = state.fields, np.full(state.fields.mesh.nt, np.inf), np.finfo(float).tiny
    masked = fields.without_term | (fields.mesh.k < fields.mesh.d)
    for part in fields.parts:
        masked[part.elements] |= part.law.has_response or part.law.small_strain
    form = acoustic_form(state) if not masked.all() else np.zeros((len(lowest), 1, 1, 1, 1))
    for directions in np.random.default_rng(0).standard_normal((NETS, DIRECTIONS, form.shape[1])):
        N = directions[np.argmin([np.linalg.eigvalsh(form @ N @ N)[:, 0] / (N @ N) for N in directions], axis=0)]
        before = slope_before = np.zeros_like(N)
        for _ in range(STEPS):
            N = N / np.linalg.norm(N, axis=1, keepdims=True)
            along = form @ N[:, None, None, :, None]
            q, a = np.linalg.eigh((along.swapaxes(3, 4) @ N[:, None, None, :, None])[..., 0, 0])
            slope = np.einsum("nikJ,ni,nk->nJ", along[..., 0], a[:, :, 0], a[:, :, 0]) - q[:, :1] * N
            turn = np.abs(((N - before) * (slope - slope_before)).sum(axis=1))
            step = ((N - before) ** 2).sum(axis=1) / np.maximum(turn, tiny)
            step = np.minimum(step, LONGEST / np.maximum(np.linalg.norm(slope, axis=1), tiny))
            lowest, before, slope_before, N = np.minimum(lowest, q[:, 0]), N, slope, N - step[:, None] * slope
    return lowest, masked


def acoustic_form(state: Response) -> Array:
    """Return the form (nt, k, k, k, k) of elements that fill their space, with `Q_ik = form_ikJL N_J N_L` for the acoustic tensor::

        Q(N) = (N . S N) I + F [N . C . N] F' + psi'' n n'        [N . C . N]_MN = C_MJNL N_J N_L        n = cof F N

    The last term is that of `VolumePenalty`.
    """
    fields, k = state.fields, state.fields.mesh.k
    C, F = np.zeros((fields.mesh.nt, k, k, k, k)), np.eye(3) + embedded(state.gradient)
    for part in fields.parts:
        share = (part.section / fields.section[part.elements])[:, None, None, None, None]
        C[part.elements] += share * elasticity(part.law.material, part.hypothesis, state.point.frames[part.elements], k)
    cofactors, F = np.swapaxes(adjugate(F), 1, 2)[:, :k, :k], F[:, :k, :k]
    form = np.einsum("niM,nMJNL,nkN->nikJL", F, C, F, optimize=True)
    form += np.einsum("ik,nJLMN,nMN->nikJL", np.eye(k), C, state.strain[:, :k, :k], optimize=True)
    for penalty in fields.volume_parts:
        n, e = cofactors[penalty.elements], dilation(state.gradient[penalty.elements])
        psi = penalty.stiffness * ENERGIES[penalty.term.kind].curvature(e)
        form[penalty.elements] += np.einsum("n,niJ,nkL->nikJL", psi, n, n)
    return np.asarray((form + np.swapaxes(form, 3, 4)) / 2)


@dataclass(frozen=True)
class Field:
    """Field with its name and unit, the shape of one element's value, whether that is a symmetric tensor, and its function."""

    name: str
    unit: str
    shape: tuple[int, ...]
    symmetric: bool
    of: Callable[[Response], Masked]

    @property
    def words(self) -> str:
        """The name in words.

        >>> find("von_mises").words, find("pk1").words
        ('von Mises stress', 'first Piola-Kirchhoff stress')
        """
        return WORDS.get(self.name, self.name.replace("_", " "))


FIELDS = (
    Field("deformation_gradient", "-", TENSOR, False, deformation_gradient),
    Field("green_strain", "-", TENSOR, True, green_strain),
    Field("volume_ratio", "-", (), False, volume_ratio),
    Field("principal_stretches", "-", (3,), False, principal_stretches),
    Field("pk2_stress", "Pa", TENSOR, True, pk2_stress),
    Field("pk1_stress", "Pa", TENSOR, False, pk1_stress),
    Field("cauchy_stress", "Pa", TENSOR, True, cauchy_stress),
    Field("von_mises_stress", "Pa", (), False, von_mises_stress),
    Field("strain_energy_density", "J/m^3", (), False, strain_energy_density),
    Field("smallest_acoustic_eigenvalue", "Pa", (), False, smallest_acoustic_eigenvalue),
)


def names() -> tuple[str, ...]:
    """Return the names of all fields.

    >>> names()[-3:]
    ('von_mises_stress', 'strain_energy_density', 'smallest_acoustic_eigenvalue')
    """
    return tuple(field.name for field in FIELDS)


def find(name: str, others: Iterable[str] = ()) -> Field:
    """Return the field of this name; names of stresses may omit `_stress`. Messages also list the accepted `others`.

    >>> find("cauchy").name
    'cauchy_stress'
    >>> find("von_mieses")
    Traceback (most recent call last):
    skfem_stvk.errors.StvkError: There is no field 'von_mieses'; known: 'cauchy_stress', ... Did you mean 'von_mises_stress'? ...
    """
    for field in FIELDS if isinstance(name, str) else ():
        if name in (field.name, field.name.removesuffix("_stress")):
            return field
    if isinstance(name, str) and name in NODAL:
        raise StvkError(
            f"There is no field {name!r} of elements. It has values at nodes: files contain it, and pictures show it, if the state "
            "has velocities or contacts."
        )
    known = name_known(name if isinstance(name, str) else "", (*others, *names()))
    raise StvkError(f"There is no field {shown(name)}; {known} Names of stresses may omit '_stress'.")


def find_all(given: Sequence[str]) -> list[Field]:
    """Return the fields of these names."""
    if not isinstance(given, list | tuple):
        raise StvkError(f"fields = {shown(given)}; expected a list of names of fields.")
    return [find(name) for name in given]


def labels_of_files(field: str, units: UnitSystem) -> dict[str, Any]:
    """Return the arguments of `animate` for files of a body in other units than SI, because files do not name their units.

    >>> from skfem_stvk.units import UNITS
    >>> labels_of_files("von_mises", UNITS["mm-N-MPa"])
    {'label': 'von Mises stress [MPa]', 'length_unit': 'mm'}
    """
    if units.name == "SI":
        return {}
    known = {name: (one.words, one.unit) for one in FIELDS for name in (one.name, one.name.removesuffix("_stress"))}
    words, unit = (known | {name: (name.replace("_", " "), unit) for name, unit in NODAL.items()}).get(field, (field, "-"))
    return {"label": words if unit == "-" else f"{words} [{units.of(unit)}]", "length_unit": units.of("m")}
