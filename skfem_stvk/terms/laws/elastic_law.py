"""Base of all laws of elasticity on elements: a material on a region, thickness or area, mass; and their response at points."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from copy import copy
from dataclasses import InitVar, dataclass, field
from functools import partial
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ...arguments import Array, Quantity, Specification, choice, own, shown
from ...edges import Assembly
from ...edges.elements import Frames
from ...edges.materials import FramedMaterial, Hypothesis, Isotropic, Material
from ...edges.materials.material import check_length, constant
from ...edges.stiffness import IsotropicStiffness, LawInFrames, StoredLaw, flat_of
from ...edges.topology import in_lanes
from ...errors import MaterialError
from ...kernels import fields_at_points as point_kernels
from ...mesh import ElementMesh
from ..body import Body
from ..term import Deformation, PointResponse, Term

Law = TypeVar("Law", bound="ElasticLaw")

#: A smaller stretch counts as zero.
FLAT = 1e-9
#: Parameters of all laws and networks on elements.
OfMaterial = Annotated[Material | None, Quantity(None, "Name of its material.")]
OfRegion = Annotated[str | NDArray[Any] | None, Quantity(None, "Elements it is on; by default all.")]
OfPlane = Annotated[str | None, Quantity(None, "Of elements in the plane; by default plane strain.", values=("strain", "stress"))]
OfThickness = Annotated[ArrayLike | None, Quantity("length", "Of elements in the plane and surfaces; by default 1.", gt=0)]
OfArea = Annotated[ArrayLike | None, Quantity("area", "Cross-section of segments; by default 1.", gt=0)]


@dataclass(frozen=True, eq=False)
class ElasticLaw(Specification, Term):
    """Law on the elements of a region, a specification without a mesh; for the parameters see `StVK`.

    Raises
    ------
    MaterialError
        if a constant is missing, specified twice or out of range; when it is bound, if it does not fit the mesh.
    """

    per_element = True
    is_law: ClassVar[bool] = True
    has_mass: ClassVar[bool] = True

    material: OfMaterial = None
    region: OfRegion = None
    plane: OfPlane = None
    thickness: OfThickness = None
    area: OfArea = None
    young: InitVar[ArrayLike | None] = None
    poisson: InitVar[ArrayLike | None] = None
    density: InitVar[ArrayLike | None] = None
    simplices: Annotated[
        str | ArrayLike | None,
        Quantity(
            None,
            "Elements of its own on the nodes of the mesh: a boundary or lines by name, or the nodes of each, from 0: "
            "[[0, 5], [5, 9]] are two segments.",
        ),
    ] = field(default=None, kw_only=True)

    def __post_init__(self, young: ArrayLike | None, poisson: ArrayLike | None, density: ArrayLike | None) -> None:
        if self.material is None:
            if young is None:
                raise MaterialError("A material is missing: give young= and poisson=, or a material such as Orthotropic(...).")
            object.__setattr__(self, "material", Isotropic(young, poisson, density=density))
        elif not isinstance(self.material, Material):
            raise MaterialError(f"material is of type {type(self.material).__name__}; expected Isotropic, Orthotropic, ...")
        elif any(value is not None for value in (young, poisson, density)):
            raise MaterialError("young, poisson and density are shorthand for an Isotropic material; got a material as well.")
        if self.plane is not None:
            choice("plane", self.plane, ("strain", "stress"), MaterialError)
        for name in ("thickness", "area"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, constant(getattr(self, name), name, low=0.0))
        if self.simplices is not None and self.region is not None:
            raise MaterialError(
                f"Got region = {shown(self.region)} and simplices; expected one of them: a region selects elements of the mesh, "
                "and simplices are the term's own elements."
            )
        own(self)

    def on(self: Law, region: NDArray[Any] | None) -> Law:
        """Return the same law on the elements of a region, instead of its own simplices."""
        law = copy(self)
        object.__setattr__(law, "simplices", None)
        object.__setattr__(law, "region", region)
        return law

    def hypothesis(self, mesh: ElementMesh) -> Hypothesis:
        if self.simplices is not None:
            raise MaterialError(
                f"{type(self).__name__} has simplices of its own; expected a law on the elements of a mesh. A System connects "
                "both: System(points, terms)."
            )
        for name, k in (("plane", 2), ("thickness", 2), ("area", 1)):
            if getattr(self, name) is not None and mesh.k != k:
                simplices = "triangles" if k == 2 else "segments"
                raise MaterialError(f"{name} is for {simplices}; the mesh has {mesh.kind}. Leave it out.")
        if mesh.k == 3:
            return Hypothesis.SOLID
        if mesh.k == 1:
            return Hypothesis.UNIAXIAL_STRESS
        if mesh.d == 3 and self.plane == "strain":
            raise MaterialError("Triangles in space are membranes, always in plane stress; leave plane out.")
        return Hypothesis.PLANE_STRESS if mesh.d == 3 or self.plane == "stress" else Hypothesis.PLANE_STRAIN

    def bind(self, body: Body | ElementMesh, dtype: DTypeLike = np.float64) -> Any:
        body = body if isinstance(body, Body) else Body(body, [])
        mesh, elements, hourglass = body.mesh, body.mesh.elements(self.region), body.quadrature.hourglass
        t = mesh.t if self.region is None else mesh.t[:, elements]
        n, hourglass_stiffness = t.shape[1], None
        if hourglass is not None:
            hourglass_stiffness = np.broadcast_to(hourglass / 16 * self.confined_modulus(mesh, n) * self.section(mesh, n), n)
        ids = mesh.element_numbers[elements]
        return self.assembly(mesh.p, t, self.stiffness(mesh), body.quadrature, dtype, hourglass_stiffness, elements=ids)

    @property
    def assembly(self) -> type[Assembly]:
        """Class of the law on a body, with what it can do in addition to W, F and K (`edges.bound_laws`)."""
        return Assembly

    @abstractmethod
    def stiffness(self, mesh: ElementMesh) -> StoredLaw:
        """Return the law of the kernels, with its stored numbers of each element of the region.

        Parameters
        ----------
        mesh
            Mesh of the body.
        """

    def lame(self, mesh: ElementMesh, hypothesis: Hypothesis | None = None) -> tuple[Array, Array]:
        """Return `lam` and `mu` (n,) times section under a hypothesis, by default that of the elements.

        MaterialError if the material is not isotropic, or does not fit the elements.
        """
        if not isinstance(self.material, Isotropic):
            raise MaterialError(
                f"{type(self).__name__}: material = {type(self.material).__name__}(...); expected Isotropic. Give young= and "
                "poisson=, or use StVK, which takes any material."
            )
        n, hypothesis = len(mesh.elements(self.region)), hypothesis or self.hypothesis(mesh)
        self.material.check(n, hypothesis)
        section = self.section(mesh, n)
        lam, mu = (np.broadcast_to(value * section, n) for value in self.material.lame(hypothesis))
        return lam, mu

    def mass(self, mesh: ElementMesh, sizes: NDArray[np.float64]) -> NDArray[np.float64]:
        assert self.material is not None
        if self.material.density is None:
            region = f" on {self.region!r}" if isinstance(self.region, str) else ""
            given = self if isinstance(self.material, Isotropic) else self.material
            raise MaterialError(
                f"The material{region} has no density. Give it one: {type(given).__name__}(..., density=...) [kg/m^3]."
            )
        return sizes * self.section(mesh, len(sizes)) * np.asarray(self.material.density)

    def confined_modulus(self, mesh: ElementMesh, n: int) -> NDArray[np.float64]:
        """Return `lam + 2 mu` [Pa] within the simplices' own dimensions. For anisotropic materials return the largest of `C_1111,
        C_2222, C_3333` in material axes.
        """
        assert self.material is not None
        hypothesis = self.hypothesis(mesh)
        self.material.check(n, hypothesis)
        if isinstance(self.material, Isotropic):
            lam, mu = self.material.lame(hypothesis)
            return lam + 2 * mu
        assert isinstance(self.material, FramedMaterial)
        return np.asarray(np.diagonal(self.material.stiffness(), axis1=-2, axis2=-1)[..., :3].max(axis=-1))

    def section(self, mesh: ElementMesh, n: int) -> NDArray[np.float64]:
        name, value = {1: ("area", self.area), 2: ("thickness", self.thickness)}.get(mesh.k, ("", None))
        section = np.asarray(1.0 if value is None else value)
        check_length(section, n, name)
        return section


for _shorthand in ("young", "poisson", "density"):  # remove class defaults, so that term.young raises; use term.material
    delattr(ElasticLaw, _shorthand)


def stress_and_density(stiffness: LawInFrames, at: Deformation) -> tuple[Array, Array]:
    """Return the stress (n, 3, 3) [Pa] and the energy density (n,) of a law that is a function of strain (`response_to_strain`)."""
    M, (n, _, k) = 2 * embedded(at.strain), at.gradient.shape
    S, W = np.empty((n, 3, 3)), np.empty(n)
    point_kernels.stress_by_strain(_at_points(stiffness, k, n), k, M, W, S)
    return S, W


def response_of_stretches(at: Deformation, material: Isotropic, kind: Callable[..., Any], *, green: bool = False) -> PointResponse:
    """Return the response of a law of principal stretches: `S = V diag(p/s) V'`, infinite where a stretch vanishes.

    `kind` makes the law from its numbers and `flat`. In plane stress, the strain across the elements is that of Hooke's law of the
    `material` between elongations or, if `green`, between Green-Lagrange strains.
    """
    n, d, k = at.gradient.shape
    lam, mu = (np.broadcast_to(value, n) for value in material.lame(at.hypothesis))
    flat = flat_of(k, d)
    law = IsotropicStiffness(lam, mu, partial(kind, flat=None if at.hypothesis is Hypothesis.PLANE_STRAIN else flat))
    Q, h, V = np.zeros((n, 3, 3)), np.zeros((n, 3, 3)), np.empty((n, 3, 3))
    p, W = np.empty((n, 3)), np.empty(n)
    e: Array = np.empty((n, 3))
    Q[:, :k, :d], h[:, :k, :d] = np.swapaxes(at.axes, 1, 2), np.swapaxes(at.gradient, 1, 2)
    point_kernels.response_to_stretches(_at_points(law, k, n), flat, Q, h, W, e, p, V)
    none = np.abs(1 + e) < FLAT
    infinite = none.any(axis=1)
    pull = np.where(infinite[:, None], 0, p / np.where(none, 1, 1 + e))
    strain = embedded(at.strain)
    if at.hypothesis.condensed:
        within = np.trace(at.strain, axis1=1, axis2=2) if green else e.sum(axis=1)
        across = material.strain_across((k * lam + 2 * mu) * within)[:, None, None] * np.eye(3 - k)
        strain[:, k:, k:] = across if green else green_strain_of(across)
    return PointResponse(strain, (V * pull[:, None]) @ np.swapaxes(V, 1, 2), W, infinite)


def embedded(tensor: Array) -> Array:
    """Return the tensors (n, k, k) within elements as new tensors (n, 3, 3), zero across."""
    solid = np.zeros((len(tensor), 3, 3))
    solid[:, : tensor.shape[1], : tensor.shape[2]] = tensor
    return solid


def green_strain_of(e: Array) -> Array:
    """Return the Green-Lagrange strains `e + e e/2` of elongations `U - I` (n, m, m); -1/2 where no positive stretch is left."""
    values, axes = np.linalg.eigh(e)
    values = np.maximum(values, -1.0)
    return np.asarray((axes * (values * (1 + values / 2))[:, None]) @ np.swapaxes(axes, 1, 2))


def _at_points(stiffness: LawInFrames, k: int, n: int) -> Any:
    """Return the law of the kernels with its numbers at n points, per unit of rest volume, in the axes of the elements."""
    Ri = np.repeat(np.array([1.0, 0.0, 0.0, k > 1, 0.0, k > 2])[:, None], n, axis=1)
    frames = Frames(k, np.broadcast_to(np.eye(k), (n, k, k)), Ri, np.ones(n), None)
    return stiffness.law(in_lanes(np.concatenate([Ri, stiffness.stored(frames, np.arange(n, dtype=np.int32))])).ravel())
