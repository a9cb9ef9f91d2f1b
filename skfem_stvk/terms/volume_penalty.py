"""Energy of the volume of elements, against inversion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..arguments import Array, Quantity, choice, own
from ..edges import Assembly
from ..edges.assembly import refuse_inside_out
from ..edges.penalty import BARRIER_IS_INFINITE, PENALTY, PenaltyStiffness
from ..errors import MaterialError, name_ids
from ..materials.material import check_length, constant
from ..mesh import ElementMesh
from .body import Body
from .volume_energies import ENERGIES


@dataclass(frozen=True, eq=False)
class VolumePenalty:
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
    per_element: ClassVar[bool] = True

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

    def bind(self, body: Body | ElementMesh, dtype: DTypeLike = np.float64) -> Assembly:
        """Return the penalty of a body; a mesh alone has thickness or area 1, and requires a stiffness.

        Parameters
        ----------
        body
            Body, or its mesh alone.
        dtype
            Type of results and of stored numbers, float64 or float32.
        """
        body = body if isinstance(body, Body) else Body(body, [])
        mesh = body.mesh
        elements, k = mesh.elements(self.region), self.moduli(body)
        stiffness = PenaltyStiffness(k * body.section[elements], ENERGIES[self.kind].number)
        return PENALTY(mesh.p, mesh.t[:, elements], stiffness, body.quadrature, dtype, elements=mesh.element_numbers[elements])

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
        bare = elements[modulus == 0]
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
            for inverted or flat elements, where the "barrier" is infinite.
        """
        energy = ENERGIES[self.kind]
        if self.kind == "barrier" and e.min() <= -1:
            refuse_inside_out(1 + e, elements, BARRIER_IS_INFINITE)
        return energy.density(e), energy.slope(e)
