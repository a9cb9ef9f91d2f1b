"""Neo-Hookean material on a region of the mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...edges.assembly import refuse_inside_out
from ...edges.bound_laws import BoundEnergyOfStrain
from ...edges.elements import Frames
from ...edges.materials import Hypothesis, Isotropic
from ...edges.stiffness import LawInFrames, StoredLaw
from ...errors import MaterialError, name_ids
from ...kernels.neo_hookean_law import NeoHookeanLaw, NeoHookeanSheet
from ...mesh import ElementMesh
from ..term import Deformation, PointResponse
from .elastic_law import ElasticLaw, embedded, stress_and_density

#: End of messages about elements with `J <= 0`.
INFINITE_ENERGY = (
    "the energy of NeoHookean is infinite. Start from a state without inverted elements, and keep steps below step_limit(u, v); or "
    "take StVK with a VolumePenalty of another kind than barrier, which pushes such elements back."
)


@dataclass(frozen=True, eq=False)
class NeoHookean(ElasticLaw):
    """Elastic body with strain energy `W = integral of mu/2 (I1 - 3 - 2 ln J) + lam/2 (J - 1)^2`, which resists crushing.

    `I1 = tr F'F`, `J = det F`. The law does not soften under compression, as St. Venant-Kirchhoff's does, and no element becomes
    inverted. At small strain the law is `StVK` with the same constants; under pressure it stiffens.

    Parameters
    ----------
    material
        Isotropic material, with a Poisson's ratio in [0, 1/2).
    region, plane
        Arguments of `StVK`, as there.
    thickness
        Thickness of surfaces at rest [m], as in `StVK`. In plane stress, and for surfaces in space, the thickness changes so that
        the stress across vanishes.
    area
        Cross-section of segments, to which this law does not apply; an argument of all laws.
    young, poisson, density, simplices
        Arguments of `StVK`, as there.

    Raises
    ------
    MaterialError
        as `StVK`; if the material is not isotropic or expands sideways when it is stretched; when it is bound, for segments.
    RegionError
        when it is bound, if the region is not in the mesh.
    StateError
        by all evaluations of the system, with the ids, for elements that are inverted or flat.

    Notes
    -----
    The stress is `P = mu (F - F^-T) + lam (J - 1) J F^-T`. A block between walls that is pressed to `s` times its height has the
    stress `mu (s - 1/s) + lam (s - 1)`, which grows without limit. In plane stress and for surfaces in space, the thickness is
    stretched by `l`, the positive root of `mu (l^2 - 1) + lam (j l - 1) j l = 0`, where `j` is the ratio of areas.

    The tangent is exact and symmetric. For the positive semi-definite tangent (`kept=TENSILE`) `mu` is raised to `|c|` times an
    upper bound of `1/(s_i s_j)`, with `c = mu - lam (J - 1) J`. No eigenvalues are computed. At rest and under uniform expansion
    this changes nothing. The tangent is stiffer than a projected one, so that solves take some more iterations.

    `EnergyMomentum` uses a discrete gradient of the energy (Gonzalez 2000): the stress of the mean strain, corrected along the
    change of strain. If the energies of both states differ by no more than round-off, the correction is omitted. Line searches
    evaluate the energy at each length, because it is not a polynomial of degree four as for `StVK`.

    Examples
    --------
    >>> import numpy as np, skfem
    >>> from skfem_stvk import System
    >>> mesh = skfem.MeshTet().refined(1)
    >>> cube = System(mesh, NeoHookean(young=1.0, poisson=0.3))
    >>> u = -0.6 * (mesh.p * [[0], [0], [1]]).ravel("F")    # two fifths as high
    >>> round(cube.energy(u), 4), cube.smallest_volume_ratio(u)
    (0.2947, 0.4)
    """

    resists_inversion: ClassVar[bool] = True
    has_response = True
    assembly = BoundEnergyOfStrain

    def stiffness(self, mesh: ElementMesh) -> StoredLaw:
        hypothesis = self.hypothesis(mesh)
        if hypothesis is Hypothesis.UNIAXIAL_STRESS:
            raise MaterialError("NeoHookean is for solids and surfaces; the mesh has segments. Take StVK for cables and bars.")
        lam, mu = self.lame(mesh, Hypothesis.SOLID)
        if (bad := mesh.element_numbers[mesh.elements(self.region)[lam < 0]]).size:
            raise MaterialError(
                f"{name_ids(bad, 'element')}: Poisson's ratio below 0, with which the energy of NeoHookean falls without bound as "
                "elements grow. Take StVK."
            )
        return NeoHookeanStiffness(lam, mu, hypothesis.condensed)

    def response(self, at: Deformation) -> PointResponse:
        assert isinstance(self.material, Isotropic)
        (n, d, k), (lam, mu) = at.gradient.shape, self.material.lame(Hypothesis.SOLID)
        lam, mu, strain = np.broadcast_to(lam, n), np.broadcast_to(mu, n), embedded(at.strain)
        M = 2 * strain[:, :2, :2]
        x = M[:, 0, 0] + M[:, 1, 1] + np.linalg.det(M)
        J = np.linalg.det(at.axes + at.gradient) / np.linalg.det(at.axes) if k == d else np.sqrt(np.maximum(1 + x, 0))
        if (J <= 0).any():
            refuse_inside_out(J, at.elements, INFINITE_ENERGY)
        condensed = at.hypothesis.condensed
        if condensed:
            strain[:, 2, 2] = thickening(lam, mu, np.sqrt(1 + x), x) / 2
        stress, density = stress_and_density(NeoHookeanStiffness(lam, mu, condensed), at)
        return PointResponse(strain, stress, density, np.zeros(n, dtype=bool))


class NeoHookeanStiffness(LawInFrames):
    """Lame constants times section, (n,) each, and whether stress vanishes across."""

    moduli = 2
    infinite_energy = INFINITE_ENERGY

    def __init__(self, lam: Array, mu: Array, condensed: bool) -> None:
        self.lam, self.mu, self.law = lam, mu, NeoHookeanSheet if condensed else NeoHookeanLaw

    def stored(self, at: Frames, elements: NDArray[np.int32]) -> Array:
        """Return `mu` and `lam` times the size, and the orientation, which is 0 for surfaces in space."""
        axes = at.axes
        orientation = np.sign(np.linalg.det(axes)) if axes.shape[1] == axes.shape[2] else np.zeros(len(axes))
        return np.stack([at.size * self.mu[elements], at.size * self.lam[elements], orientation])


def thickening(lam: Array, mu: Array, j: Array, x: Array) -> Array:
    """Return `l^2 - 1` for the stretch `l` across at which the stress there vanishes, for the ratio of areas `j` and `x = j^2 - 1`.

    `l` solves mu (l^2 - 1) + lam (j l - 1) j l = 0; its positive root is `l = 1 + d`.
    """
    both = mu + lam * j * j
    root = np.sqrt((lam * j) ** 2 + 4 * mu * both)
    d = -2 * lam * j * x / (1 + j) / (2 * both - lam * j + root)
    return np.asarray(d * (2 + d))
