"""Energy of the volume of elements, against inversion; formulas of its kernels are in `kernels.volume_penalty`.

A kind of energy is a row of `ENERGIES` and a branch of `kernels.volume_penalty._find_energies`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import factorial
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ...arguments import Array, Quantity, choice, own
from ...edges import Assembly, Tensions
from ...edges.assembly import refuse_inside_out
from ...edges.elements import Quadrature, mean_frames
from ...edges.materials.material import check_length, constant
from ...edges.stiffness import StoredLaw
from ...edges.topology import KernelOrder
from ...errors import MaterialError, name_ids
from ...kernels import volume_energies as penalty_kernels
from ...kernels.rows import PairSlots, RowSlots
from ...kernels.threads import locked
from ...kernels.volume_energies import BARRIER, COMPRESSION, QUADRATIC
from ...mesh import ElementMesh
from ...mesh.points import base_vectors_at, determinants
from ..body import Body
from ..term import Term

#: End of messages about elements with `J <= 0`.
INFINITE_ENERGY = (
    "the barrier of a VolumePenalty is infinite. Start without inverted elements, and keep steps below step_limit(u, v); "
    'or take kind="compression" or "quadratic", which push such elements back.'
)


@dataclass(frozen=True)
class VolumeEnergy:
    """Energy density of the volume ratio for a stiffness of 1, as a function of `e = J - 1`, which is more accurate than `J`.

    Attributes
    ----------
    number
        Number of the energy in the kernels.
    density, slope, curvature
        Functions `psi`, `psi'` and `psi''` of `e`, as in `kernels.volume_penalty`.
    least
        Smallest stiffness over `lam + 2 mu` for which confined compression has no limit point.
    usual
        The default stiffness over `lam + 2 mu`. With the least stiffness, a cube with both ends constrained still buckles in
        crushing. With this one it is stable to 60 % (except "quadratic" at nu = 0; `docs/measurements/inversion.md`).
    infinite_energy
        End of the message about elements with `J <= 0`, if `psi` is infinite there; otherwise "".

    Notes
    -----
    In uniaxial strain `s` the nominal stress of a St. Venant-Kirchhoff material is `H/2 (s^3 - s)` with `H = lam + 2 mu`, and `J =
    s`. With the penalty it is `H/2 (s^3 - s) + k psi'(s)`, which rises with `s` for all `0 < s < 1` if::

        k/H >= least = max over s of (1 - 3 s^2) / (2 psi''(s))

        quadratic      1/2, at s = 0
        compression    c = (3 - sqrt(6))/2 = 0.27526, at s = 2 c/3, a double root: 4 c^2 - 12 c + 3 = 0
        barrier        0.025802..., at s = 0.40536...: the maximum has no closed form
    """

    number: int
    density: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    curvature: Callable[[Array], Array]
    least: float
    usual: float
    infinite_energy: str = ""


def _barrier_density(e: Array) -> Array:
    x = np.minimum(e, 0.0)
    return -(x**2) * np.log1p(x)


def _barrier_slope(e: Array) -> Array:
    x = np.minimum(e, 0.0)
    return -(2 * x * np.log1p(x) + x**2 / (1 + x))


def _barrier_curvature(e: Array) -> Array:
    e = np.minimum(e, 0.0)
    x = e / (1 + e)
    return -2 * np.log1p(e) - 4 * x + x**2


#: Energies by `VolumePenalty.kind`.
ENERGIES = {
    "quadratic": VolumeEnergy(QUADRATIC, lambda e: e**2 / 2, lambda e: e, np.ones_like, 1 / 2, 1.0),
    "compression": VolumeEnergy(
        COMPRESSION,
        lambda e: -(np.minimum(e, 0.0) ** 3) / 3,
        lambda e: -(np.minimum(e, 0.0) ** 2),
        lambda e: -2 * np.minimum(e, 0.0),
        (3 - 6**0.5) / 2,
        0.8,
    ),
    "barrier": VolumeEnergy(
        BARRIER, _barrier_density, _barrier_slope, _barrier_curvature, 0.02580234686556834, 0.15, INFINITE_ENERGY
    ),
}


@dataclass(frozen=True, eq=False)
class VolumePenalty(Term):
    """Resistance to the loss of volume: `W = integral of psi(J) dV` over elements at rest, `J` the ratio of their signed volumes.

    A St. Venant-Kirchhoff material softens in compression, and an inverted element has the same energy as its mirror image. With
    this term the element resists. `J` is 1 at rest for both orientations, and below zero for inverted elements::

        "barrier"        psi = -k (J - 1)^2 ln J for J < 1, otherwise 0    unbounded as J falls to 0; no state has J <= 0
        "compression"    psi = k/3 (1 - J)^3 for J < 1, otherwise 0        also for J <= 0
        "quadratic"      psi = k/2 (J - 1)^2                               also for J <= 0; against expansion as well

    All have two continuous derivatives. At rest "compression" and "barrier" change no stiffness; "quadratic" adds `k` to `lam`. The
    stress of the penalty is a pressure: the Cauchy stress is `psi'(J) I` within the elements' dimensions.

    In confined compression by 5, 10, 20 and 30 %, the usual stiffness adds to the stress: 2.5, 5.6, 14.5 and 29 % ("barrier"). It
    adds 4.3, 9.4, 22 and 40 % ("compression"), or 108, 117, 139 and 168 % ("quadratic").

    Parameters
    ----------
    stiffness
        Stiffness `k` [Pa], a number or one value per element of the region. By default the usual `c (lam + 2 mu)` of the material
        on each element: c = 0.15 ("barrier"), 0.8 ("compression"), 1 ("quadratic"). The least for which confined compression has no
        limit point is 0.025802, 0.27526 and 1/2. For anisotropic materials `lam + 2 mu` is the largest of `C_1111, C_2222, C_3333`
        in material axes.
    kind
        Kind of the energy. "barrier" keeps elements from inverting, whatever the load; "compression" also pushes inverted elements
        back.
    region
        Elements on which the penalty acts, as in `StVK`.

    Raises
    ------
    MaterialError
        if the stiffness is not positive or the kind unknown; when it is bound, for membranes and cables in space, which have no
        interior, for elements without an `StVK` to take the stiffness from, and for a number of values other than that of
        elements.
    RegionError
        when it is bound, if the region is not in the mesh.
    StateError
        by all evaluations of the system, with the ids, if "barrier" meets inverted or flat elements.

    Examples
    --------
    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> mesh = skfem.MeshTet().refined(1)
    >>> cube = System(mesh, [StVK(young=1.0, poisson=0.3), VolumePenalty(6.0, "compression")])
    >>> u = -0.5 * (mesh.p * [[0], [0], [1]]).ravel("F")    # half as high: J = 1/2
    >>> {name: round(energy, 4) for name, energy in cube.energies(u).items()}
    {'StVK 0': 0.0947, 'VolumePenalty 1': 0.25}
    """

    resists_inversion: ClassVar[bool] = True
    has_pressure: ClassVar[bool] = True
    per_element = True

    stiffness: Annotated[ArrayLike | None, Quantity("stress", "Stiffness; by default the usual part of the material's.", gt=0)] = (
        None
    )
    kind: Annotated[str, Quantity(None, "Of the energy.", values=tuple(sorted(ENERGIES)))] = "barrier"
    region: Annotated[str | NDArray[Any] | None, Quantity(None, "Elements it is on; by default all.")] = None

    def __post_init__(self) -> None:
        choice("VolumePenalty: kind", self.kind, ENERGIES, MaterialError)
        if self.stiffness is not None:
            object.__setattr__(self, "stiffness", constant(self.stiffness, "VolumePenalty: stiffness", low=0.0))
        own(self)

    def bind(self, body: Body | ElementMesh, dtype: DTypeLike = np.float64) -> BoundVolumePenalty:
        body = body if isinstance(body, Body) else Body(body, [])
        mesh = body.mesh
        elements, k = mesh.elements(self.region), self.moduli(body)
        stiffness = PenaltyStiffness(k * body.section[elements], ENERGIES[self.kind])
        return BoundVolumePenalty(
            mesh.p, mesh.t[:, elements], stiffness, body.quadrature, dtype, elements=mesh.element_numbers[elements]
        )

    def moduli(self, body: Body) -> Array:
        """Return the stiffness (n,) of the elements of the region [Pa].

        Parameters
        ----------
        body
            Body with its materials.

        Raises
        ------
        MaterialError, RegionError
            as `VolumePenalty`, when it is bound.
        """
        mesh = body.mesh
        if mesh.k < mesh.d:
            raise MaterialError(
                f"VolumePenalty: the mesh has {mesh.kind}, which have no inside and no outside. It is for tetrahedra and "
                "hexahedra, triangles and quadrilaterals in the plane and segments on a line."
            )
        elements = mesh.elements(self.region)
        if self.stiffness is not None:
            check_length(np.asarray(self.stiffness), len(elements), "VolumePenalty: stiffness")
            return np.broadcast_to(np.asarray(self.stiffness), elements.shape)
        modulus = body.confined_modulus[elements]
        bare = mesh.element_numbers[elements[modulus == 0]]
        if len(bare):
            raise MaterialError(
                f"VolumePenalty: {name_ids(bare, 'element')} without a material, which gives the default stiffness. Give "
                "stiffness= [Pa], or a region that has a material."
            )
        return ENERGIES[self.kind].usual * modulus

    def density_and_slope(self, e: Array, elements: NDArray[Any]) -> tuple[Array, Array]:
        """Return `psi` and `psi'` (n,) for a stiffness of 1 at `e = J - 1` of these elements.

        Parameters
        ----------
        e
            (n,) volume ratios minus 1.
        elements
            (n,) ids of the elements, for messages.

        Raises
        ------
        StateError
            for inverted or flat elements, if `psi` is infinite there ("barrier").
        """
        energy = ENERGIES[self.kind]
        if energy.infinite_energy and e.min(initial=0.0) <= -1:
            refuse_inside_out(1 + e, elements, energy.infinite_energy)
        return energy.density(e), energy.slope(e)


class PenaltyStiffness(StoredLaw):
    """Stored numbers of a `VolumePenalty`, and its kind: `W = sum of k V0 psi(J)` over the points of its elements.

    Parameters
    ----------
    stiffness
        (nt,) stiffness `k` times section [Pa] times 1, thickness or area, of elements that fill their space.
    energy
        The energy `psi`.
    """

    def __init__(self, stiffness: Array, energy: VolumeEnergy) -> None:
        self._stiffness, self.kind, self.infinite_energy = stiffness, energy.number, energy.infinite_energy

    def law(self, D: Array) -> Array:
        """Return the numbers themselves."""
        return D

    def numbers(self, p: Array, quadrature: Quadrature, order: KernelOrder, dtype: DTypeLike) -> Array:
        """Return `k V0` and `1/C0` (2, nq, nt) at each point, with the sign of `C0`. `V0` excludes the weights of a table of
        points.
        """
        t, stiffness, element = order.vertices[order.t], self._stiffness[order.elements], quadrature.element
        if element.is_linear_simplex:
            corners = p[:, t]
            C0 = np.linalg.det((corners[:, 1:] - corners[:, :1]).transpose(2, 1, 0))[None]
            return np.stack([stiffness * np.abs(C0) / factorial(len(p)), 1 / C0])
        if quadrature.hourglass is not None:  # the frame is the axes of space
            _, volumes = mean_frames(p, t, element)
            return np.stack([stiffness * volumes, np.ones_like(volumes)])[:, None]
        C0 = np.stack([determinants(base_vectors_at(p, t, element, xi[None]))[:, 0] for xi in quadrature.rule.points])
        return np.stack([stiffness * np.abs(C0), 1 / C0])


class BoundVolumePenalty(Assembly):
    """Volume penalty on the elements of a body."""

    @locked
    def add_round_off(self, u: Array, out: Array) -> None:
        """Add the absolute values of all summands of the force [N] at `u` to `out`, both (nv, d): times eps, its rounding error."""
        self.elements.gather(u)
        self.run(penalty_kernels.penalty_round_off, out, *self._arguments)

    @property
    def _arguments(self) -> tuple[int, int]:
        """Arguments of the kernels that other laws do not have."""
        assert isinstance(self.stored, PenaltyStiffness)
        return self.elements.k, self.stored.kind

    def _energies(self, force: Array | None) -> list[float]:
        return [W for W, _ in self.run(penalty_kernels.penalty_energy_and_force, force, *self._arguments)]

    def _linearize(self, to: PairSlots | RowSlots, kept: Tensions, force: Array | None) -> list[tuple[float, float]]:
        """Return energies and traces with the energy added to the trace, so that the trace shows an overflow of the part of `psi'`
        in K. That part is skew and has no diagonal; if it overflows, so does the energy.
        """
        found = self.run(penalty_kernels.penalty_linearize, force, *self._arguments, float(kept.negative), to=(to,))
        return [(W, trace + W) for W, _, trace in found]

    def check(self, found: list[Any]) -> None:
        """Refuse results of kernels, `J` or `(W, J, ...)` by part, with a `J` at which `psi` is not defined: all these are <= 0."""
        if min(one[1] if isinstance(one, tuple) else one for one in found) <= 0:
            self.refuse_inside_out()
