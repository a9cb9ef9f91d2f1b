"""Fields at one state of a body: what displacements add to its `Fields`."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import shown
from ..errors import StateError, StvkError
from .kinematics import Array, Masked, displacement_gradient, strain_within
from .law import dilation, strain_and_stress, volume_stress
from .table import find

if TYPE_CHECKING:
    from .fields import Fields


class State:
    """Fields at displacements `u` (nv, d) [m]: `state[name]` by element, `state.at_nodes(name)` by node, each worked out when first asked for.

    Elements and nodes that have no value are masked (a `numpy.ma.MaskedArray`): elements in no term have no stress and, below three
    dimensions, no strain across. Where nothing is missing, a plain array comes.

    Attributes
    ----------
    v : (nv, d) velocities [m/s] of a body in motion, otherwise None.
    """

    def __init__(self, fields: Fields, u: Array, v: Array | None = None) -> None:
        self.fields, self.u, self.v = fields, u, v
        self._known: dict[str, Masked] = {}

    def __getitem__(self, name: str) -> Array:
        """(nt, ...) values by element of the field of this name, `results.names()` lists them.

        Raises
        ------
        StvkError
            if there is no such field.
        """
        return masked(*self.raw(name))

    def at_nodes(self, name: str, region: str | NDArray[Any] | None = None) -> Array:
        """(nv, ...) averages over the elements around each node, weighted by rest volume; with a `region`, over its elements only.

        Raises
        ------
        StvkError
            if there is no such field or region.
        """
        values, missing = self.raw(name)
        outside = np.ones(self.fields.mesh.nt, dtype=bool)
        outside[self.fields.mesh.elements(region)] = False
        return masked(*self.fields.average(values, missing | outside))

    def raw(self, name: str) -> Masked:
        """Values by element, finite everywhere, and which of them mean nothing."""
        field = find(name)
        if field.name not in self._known:
            self._known[field.name] = field.of(self)
        return self._known[field.name]

    @property
    def vectors(self) -> dict[str, Array]:
        """(nv, d) by name: the displacements, and the velocities if there are any."""
        return {"displacement": self.u} | ({} if self.v is None else {"velocity": self.v})

    @property
    def without_strain(self) -> NDArray[np.bool_]:
        """(nt,) whether an element has no strain: below three dimensions that across follows from the material."""
        missing = self.fields.without_term
        return missing if self.fields.mesh.k < 3 else np.zeros_like(missing)

    @cached_property
    def gradient(self) -> Array:
        """(nt, d, k) derivatives of the displacement along the simplices' axes."""
        return displacement_gradient(self.u, self.fields.mesh.t, self.fields.geometry.gradients)

    @property
    def strain(self) -> Array:
        """(nt, 3, 3) Green-Lagrange strain in the simplices' frames."""
        return self._response[0]

    @property
    def stress(self) -> Array:
        """(nt, 3, 3) second Piola-Kirchhoff stress in the simplices' frames [Pa]."""
        return self._response[1]

    @property
    def energy_density(self) -> Array:
        """(nt,) strain energy per rest volume [J/m^3]."""
        return self._response[2]

    @property
    def shrunk(self) -> NDArray[np.bool_]:
        """(nt,) whether the second Piola-Kirchhoff stress is infinite: that of a `VolumePenalty` on an element without volume, `J = 0`."""
        return self._response[3]

    @cached_property
    def _response(self) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """Strain, stress and energy density, the terms' added up by their sections; and where stress is infinite, 0 there.

        Raises
        ------
        StateError
            if they overflow.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            strain, stress, density, shrunk = self._added_up()
        if not np.isfinite(stress).all() or not np.isfinite(density).all():
            raise StateError(
                f"Stresses overflow at displacements of up to {np.abs(self.u).max():.1e}: did the step before diverge?"
            )
        return strain, stress, density, shrunk

    def _added_up(self) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        fields, k = self.fields, self.fields.mesh.k
        within = strain_within(self.gradient, fields.geometry.axes)
        strain, stress, density = np.zeros((len(within), 3, 3)), np.zeros((len(within), 3, 3)), np.zeros(len(within))
        for part in fields.parts:
            ids = part.elements
            E, S = strain_and_stress(part.material, part.hypothesis, within[ids], fields.frames[ids])
            share = part.section / fields.section[ids]
            strain[ids] += (part.section / fields.total_section[ids])[:, None, None] * E
            stress[ids] += share[:, None, None] * S
            density[ids] += share * (S * E).sum(axis=(1, 2)) / 2
        strain[:, :k, :k] = within
        shrunk = np.zeros(len(within), dtype=bool)
        for penalty in fields.volume_parts:
            ids, gradient = penalty.elements, self.gradient[penalty.elements]
            psi, slope = penalty.term.density_and_slope(dilation(gradient), ids)
            S, lost = volume_stress(penalty.stiffness * slope, gradient, penalty.held_across)
            stress[ids] += S
            density[ids] += penalty.stiffness * psi
            shrunk[ids] |= lost
        stress[shrunk] = 0
        return strain, stress, density, shrunk

    def globally(self, tensor: Array) -> Array:
        """A tensor (nt, 3, 3) of the simplices' frames in global axes."""
        frames, mesh = self.fields.frames, self.fields.mesh
        return tensor if mesh.k == mesh.d else frames @ tensor @ np.swapaxes(frames, 1, 2)


def checked_state(state: Any) -> State:
    """Refuses what is no state."""
    if not isinstance(state, State):
        raise StvkError(f"state = {shown(state)}; expected a state, such as result.state or Fields(mesh, terms).at(u).")
    return state


def masked(values: Array, missing: NDArray[np.bool_]) -> Array:
    """The values, masked where there are none; as they are if none is missing."""
    if not missing.any():
        return values
    mask = np.broadcast_to(missing.reshape(-1, *(1,) * (values.ndim - 1)), values.shape)
    result: Array = np.ma.MaskedArray(values, mask)
    return result
