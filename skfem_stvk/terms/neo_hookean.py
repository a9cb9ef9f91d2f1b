"""Neo-Hookean material on a region of the mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..edges.stiffness import Frames, StoredLaw
from ..errors import MaterialError, name_ids
from ..kernels.neo_hookean import NeoHookeanLaw, NeoHookeanSheet
from ..materials import Hypothesis, Isotropic
from ..mesh import ElementMesh
from .elastic_law import ElasticLaw

#: What messages say of elements with `J <= 0`.
BARRIER = (
    "the energy of NeoHookean is infinite. Start from a state that is not inside out, and keep steps below step_limit(u, v); or take "
    "StVK with a VolumePenalty of another kind than barrier, which pushes such elements back."
)


@dataclass(frozen=True, eq=False)
class NeoHookean(ElasticLaw):
    """Elastic body with strain energy `W = integral of mu/2 (I1 - 3 - 2 ln J) + lam/2 (J - 1)^2`: it does not give way when it is
    crushed, as St. Venant-Kirchhoff does, and no element turns inside out.

    `I1 = tr F'F`, `J = det F`. At small strain it is `StVK` of the same constants; under pressure it stiffens.

    Parameters
    ----------
    material : `Isotropic`, with a Poisson's ratio in [0, 1/2).
    region, plane, thickness, young, poisson, density : as in `StVK`. In plane stress, and of surfaces in space, the thickness is
        stretched so that no stress is left across.

    Raises
    ------
    MaterialError
        as `StVK`; if the material is not isotropic or expands sideways when it is stretched; when it is bound, for segments.
    RegionError
        when it is bound, if the region is not in the mesh.
    StateError
        by whatever is asked of the system, with the ids, for elements that are inside out or flat.

    >>> import numpy as np, skfem
    >>> from skfem_stvk import System
    >>> mesh = skfem.MeshTet().refined(1)
    >>> cube = System(mesh, NeoHookean(young=1.0, poisson=0.3))
    >>> u = -0.6 * (mesh.p * [[0], [0], [1]]).ravel("F")    # two fifths as high
    >>> round(cube.energy(u), 4), cube.smallest_volume_ratio(u)
    (0.4006, 0.4)
    """

    resists_inversion: ClassVar[bool] = True

    def stiffness(self, mesh: ElementMesh) -> StoredLaw:
        """The law of the kernels, and what it stores of each element of the region."""
        material, elements = self.material, mesh.elements(self.region)
        hypothesis, n = self.hypothesis(mesh), len(elements)
        if not isinstance(material, Isotropic):
            raise MaterialError(
                f"NeoHookean is for Isotropic materials; got {type(material).__name__}. Take StVK, whose stiffness may have directions."
            )
        if hypothesis is Hypothesis.UNIAXIAL_STRESS:
            raise MaterialError("NeoHookean is for solids and surfaces; the mesh has segments. Take StVK for cables and bars.")
        material.check(n, hypothesis)
        material.check(n, Hypothesis.SOLID)
        lam, mu = (np.broadcast_to(value * self.section(mesh, n), n) for value in material.lame(Hypothesis.SOLID))
        if (bad := elements[lam < 0]).size:
            raise MaterialError(
                f"{name_ids(bad, 'element')}: Poisson's ratio below 0, with which the energy of NeoHookean falls without bound as "
                "elements grow. Take StVK."
            )
        return NeoHookeanStiffness(lam, mu, hypothesis.condensed)


class NeoHookeanStiffness:
    """Lame constants times section, (n,) each, and whether stress vanishes across."""

    moduli, barrier = 2, BARRIER

    def __init__(self, lam: Array, mu: Array, condensed: bool) -> None:
        self.lam, self.mu, self.law = lam, mu, NeoHookeanSheet if condensed else NeoHookeanLaw

    def stored(self, at: Frames, elements: NDArray[np.int32]) -> Array:
        """`mu` and `lam` times the size, and the orientation, 0 of surfaces in space."""
        axes = at.axes
        orientation = np.sign(np.linalg.det(axes)) if axes.shape[1] == axes.shape[2] else np.zeros(len(axes))
        return np.stack([at.size * self.mu[elements], at.size * self.lam[elements], orientation])
