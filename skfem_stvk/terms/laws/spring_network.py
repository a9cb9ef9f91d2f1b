"""Springs along the edges of simplices, and rules for their stiffness from a material."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import InitVar, dataclass
from functools import partial
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ...arguments import Array, Quantity, array, choice, own
from ...edges.materials import Hypothesis, Isotropic, Material
from ...edges.network import HookeanNetwork
from ...edges.topology import edge_topology
from ...errors import MaterialError, StvkWarning, name_ids, warn
from ...mesh import ElementMesh, MeshLike
from ...mesh.element import LOCAL_EDGES
from ...mesh.geometry import Geometry
from ..body import Body
from ..term import Term
from .elastic_law import OfArea, OfMaterial, OfPlane, OfRegion, OfThickness
from .stvk import StVK

#: Springs that are negative by less than this fraction of the stiffness are zero within rounding.
ROUNDED = 1e-12
#: Tolerance for equal Poisson's ratios.
NEAR = 1e-3


@dataclass(frozen=True, eq=False)
class SpringNetwork(Term):
    """Hookean springs along the edges of linear simplices: `W = sum 1/2 k_i (l_i - L_i)^2`, `L_i` the length at rest.

    A spring network is not the same as the elastic body that it approximates. Springs alone can only have a Poisson's ratio of 1/4
    (in plane stress 1/3), and on most elements only approximately. `compare_networks` reports the difference. The stiffness `k` of
    an edge is the sum over the elements around it, of size `V` (thickness and cross-section included) and with edges of length
    `l`::

        "least-squares"    not negative, and as near to the element's stiffness at rest as such springs can be (Frobenius norm)
        "edge-diagonal"    2 L_ii l_i^2, `L` the coefficients of the edge form: its first sum alone, to first order
        "van-gelder"       E V/l^2                                                   Van Gelder (1998)
        "lloyd"            sqrt(3)/4 E h of triangles, 2 sqrt(2)/25 E l of tetrahedra    Lloyd, Szekely, Harders (2007)
        "triangular"       as "edge-diagonal", and `gamma_ij (l_i - L_i) (l_j - L_j)` with `gamma_ij = 2 L_ij l_i l_j` for the pairs
                           of edges of each triangle: exact to first order              Delingette (2008)

    Damping along the springs is `simulate(..., damping=EdgeDamping(tau))`: dashpots with `c = tau k` [N s/m] parallel to the
    springs, with the force `c (v_a - v_b) . n` along `n` on each end. Rigid motions, including rotations, meet no resistance.

    Parameters
    ----------
    material
        Material as in `StVK`, for the stiffness, the mass, and the usual stiffness of a `VolumePenalty`. "van-gelder" and "lloyd"
        require an isotropic material.
    rule
        Rule for the stiffness, by its name above.
    stiffness
        Stiffness `k` [N/m] of each edge instead of a rule, not negative: in scikit-fem's order of `mesh.edges`, for triangles
        `mesh.facets`. For a region, in this order among the edges of its elements. No material is needed then. It stays as long as
        an element around the edge does.
    region, plane, thickness, area
        Arguments of `StVK`, as there.
    young, poisson, density
        Shorthand for `material=Isotropic(young, poisson, density=density)`. The mass is that of the elements, lumped as that of
        `StVK`.

    Raises
    ------
    MaterialError
        as `StVK`; if `rule` is unknown or combined with `stiffness`; when it is bound, for elements other than linear
        simplices, for rules that do not apply to them or to the material, and for a `stiffness` that is negative, not finite,
        or of another length.
    RegionError
        when it is bound, if the region is not in the mesh.

    Notes
    -----
    Sources of the rules: Van Gelder (1998); Lloyd, Szekely, Harders (2007); Delingette (2008).

    Examples
    --------
    >>> import numpy as np, skfem
    >>> from skfem_stvk import System
    >>> mesh = skfem.MeshTri().refined(1)
    >>> springs = SpringNetwork(young=1.0, poisson=1 / 3, plane="stress", rule="van-gelder")
    >>> springs.constants(mesh).round(3)[:4]
    array([0.5, 0.5, 0.5, 0.5])
    >>> u = 0.01 * mesh.p.ravel("F")                     # 1 % larger: a spring of length l has 1/2 k (0.01 l)^2
    >>> System(mesh, springs).energy(u) > 0
    True
    """

    has_mass: ClassVar[bool] = True

    material: OfMaterial = None
    rule: Annotated[str | None, Quantity(None, "How their stiffness is made.", values=tuple(RULES), otherwise="least-squares")] = (
        None
    )
    stiffness: ArrayLike | None = None
    region: OfRegion = None
    plane: OfPlane = None
    thickness: OfThickness = None
    area: OfArea = None
    young: InitVar[ArrayLike | None] = None
    poisson: InitVar[ArrayLike | None] = None
    density: InitVar[ArrayLike | None] = None

    def __post_init__(self, young: ArrayLike | None, poisson: ArrayLike | None, density: ArrayLike | None) -> None:
        if self.stiffness is None:
            if self.material is None and young is None:
                raise MaterialError("A material is missing: give young= and poisson=, material=, or the stiffness= of each edge.")
            rule = "least-squares" if self.rule is None else choice("rule", self.rule, RULES, MaterialError)
            object.__setattr__(self, "rule", rule)
        else:
            if self.rule is not None:
                raise MaterialError("rule= is for springs whose stiffness is made from the material; got stiffness= as well.")
            k = array("stiffness", self.stiffness, (None,), "one value [N/m] per edge", MaterialError, "edge")
            if len(bad := np.flatnonzero(k < 0)):
                raise MaterialError(
                    f"stiffness is negative in {name_ids(bad, 'edge')}, first value {k[bad[0]]:g}; expected k >= 0."
                )
            if self.material is None and young is None:
                if poisson is not None:
                    raise MaterialError("poisson is of no use without young. Leave it out, or give both.")
                object.__setattr__(self, "material", Material(density=density))
                density = None
        law = StVK(self.material, self.region, self.plane, self.thickness, self.area, young=young, poisson=poisson, density=density)
        for name in ("material", "thickness", "area"):
            object.__setattr__(self, name, getattr(law, name))
        own(self)

    @property
    def per_element(self) -> bool:
        """Whether the stiffness of the springs is a sum over elements, that is, made by a rule."""
        return self.stiffness is None

    @property
    def law(self) -> StVK:
        """The elastic body that the springs approximate, which supplies their mass."""
        return StVK(self.material, self.region, self.plane, self.thickness, self.area)

    def mass(self, mesh: ElementMesh, sizes: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.law.mass(mesh, sizes)

    def section(self, mesh: ElementMesh, n: int) -> NDArray[np.float64]:
        return self.law.section(mesh, n)

    def confined_modulus(self, mesh: ElementMesh, n: int) -> NDArray[np.float64]:
        return np.zeros(n) if type(self.material) is Material else self.law.confined_modulus(mesh, n)

    def edges(self, mesh: MeshLike) -> NDArray[np.int32]:
        """Return the vertices `a < b` (2, ne) of the springs, in the order of `stiffness`.

        Parameters
        ----------
        mesh
            Mesh of the body.
        """
        return edge_topology(self._simplices(ElementMesh.of(mesh)))[0]

    def constants(self, mesh: MeshLike) -> Array:
        """Return the stiffness `k` (ne,) of the springs [N/m], in the order of `edges`.

        For "triangular" the stiffness of the pairs is not included.

        Parameters
        ----------
        mesh
            Mesh of the body.

        Raises
        ------
        MaterialError, RegionError
            as `bind`.
        """
        return self._springs(ElementMesh.of(mesh)).own

    def elements_held_in_shape(self, mesh: ElementMesh) -> NDArray[np.int64]:
        sprung = self._springs(mesh).own > 0
        return np.asarray(mesh.elements(self.region))[sprung[edge_topology(self._simplices(mesh))[1]].all(axis=0)]

    def bind(self, body: Body | ElementMesh, dtype: DTypeLike = np.float64) -> HookeanNetwork:
        mesh = body.mesh if isinstance(body, Body) else body
        whole = self._springs(mesh)
        # both springs of each pair have a stiffness
        used = np.arange(len(whole.own)) if whole.pairs.size else np.flatnonzero(whole.own)
        if not mesh.space.comm.any(len(used) > 0):
            raise MaterialError("The stiffness of all springs is zero; expected that of some to be positive.")
        own, edges = whole.own[used], whole.edges[:, used]
        without_elements = partial(self._without_elements, mesh, used)
        return HookeanNetwork(mesh.p, edges, whole.pairs, own, whole.between, dtype=dtype, remaining=without_elements)

    def _without_elements(self, mesh: ElementMesh, used: NDArray[Any], removed: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return the stiffness of the `used` springs, and of pairs, without the removed elements `removed` (n,) of the region."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StvkWarning)  # bind has warned already
            springs = self._springs(mesh, ~removed)
        return springs.own[used], springs.between

    def _springs(self, mesh: ElementMesh, retained: NDArray[np.bool_] | None = None) -> Springs:
        """Return the springs; a rule uses only the retained elements `retained` (n,). Other edges, and edges of no element, have no
        stiffness.
        """
        t = self._simplices(mesh)
        edges, t2e = edge_topology(t)
        ne, none = edges.shape[1], np.empty((2, 0), dtype=np.int32)
        if self.stiffness is not None:
            k = np.asarray(self.stiffness)
            if len(k) != ne:
                raise MaterialError(
                    f"stiffness has {len(k)} values; expected one for each of the {ne} edges of its region, in scikit-fem's order: "
                    "that of edges(mesh)."
                )
            around = np.bincount(t2e.ravel(), None if retained is None else np.tile(retained, len(t2e)), ne)
            return Springs(edges, none, k * (around > 0), np.empty(0))
        rest = Rest.of(mesh, t, self)
        part = np.ones(t.shape[1]) if retained is None else retained.astype(float)
        k = np.bincount(t2e.ravel(), weights=(RULES[self.rule or ""](rest).T * part).ravel(), minlength=ne)
        if self.rule != "triangular":
            return Springs(edges, none, k, np.empty(0))
        i, j = np.triu_indices(len(t2e), 1)  # two edges share at most one triangle
        return Springs(edges, np.stack([t2e[i], t2e[j]]).reshape(2, -1), k, (rest.stiffness[:, i, j].T * part).ravel())

    def _simplices(self, mesh: ElementMesh) -> NDArray[np.int32]:
        """Return the vertices (k + 1, n) of the simplices of the region."""
        if not mesh.element.is_linear_simplex:
            raise MaterialError(
                f"SpringNetwork: springs lie along the edges of linear simplices; the mesh has {mesh.kind}. Take degree=1, or "
                "simplices in place of boxes."
            )
        return mesh.t[:, mesh.elements(self.region)]


class Springs(NamedTuple):
    """Springs (ne,) with vertices `edges` (2, ne) and stiffness `own` [N/m]; `between` (n,) is the stiffness of `pairs` (2, n) of
    them.
    """

    edges: NDArray[np.int32]
    pairs: NDArray[np.int32]
    own: Array
    between: Array


class Rest(NamedTuple):
    """Data of simplices at rest for the rules.

    Attributes
    ----------
    lengths
        (n, m) lengths of their edges [m].
    stiffness
        (n, m, m) `A_ij = 2 L_ij l_i l_j` [N/m]: their energy is `1/2 e' A e` for small elongations `e` of their edges.
    crossed
        (n, m, m) `d_i . d_j`, with `d_i` the derivative of the length of edge `i` by all vertices: the element has the stiffness
        `sum A_ij d_i d_j'`, a spring along edge `i` has `k_i d_i d_i'`.
    volumes
        (n,) volumes [m^3].
    section
        (n,) factor from their size to their volume: thickness [m], area [m^2] or 1.
    hypothesis
        Components of strain or stress that vanish across them.
    young, poisson
        (n,) Young's modulus [Pa] and Poisson's ratio; empty where the material has none.
    """

    lengths: Array
    stiffness: Array
    crossed: Array
    volumes: Array
    section: Array
    hypothesis: Hypothesis
    young: Array
    poisson: Array

    @classmethod
    def of(cls, mesh: ElementMesh, t: NDArray[np.int32], springs: SpringNetwork) -> Rest:
        """Return the data of the rules for the simplices `t` (k + 1, n)."""
        n, law = t.shape[1], springs.law
        L = law.coefficients(mesh)
        a, b = np.array(LOCAL_EDGES[mesh.k]).T
        P = (mesh.p.T[t[a]] - mesh.p.T[t[b]]).transpose(1, 0, 2)
        lengths = np.linalg.norm(P, axis=2)
        directions = P / lengths[:, :, None]
        ends = np.eye(mesh.k + 1)[a] - np.eye(mesh.k + 1)[b]
        section = np.broadcast_to(law.section(mesh, n), n)
        return cls(
            lengths,
            2 * L * lengths[:, :, None] * lengths[:, None, :],
            ends @ ends.T * (directions @ np.swapaxes(directions, 1, 2)),
            Geometry(mesh.p, t).volume * section,
            section,
            law.hypothesis(mesh),
            *_young_and_poisson(springs.material, n),
        )


def _young_and_poisson(material: Material | None, n: int) -> tuple[Array, Array]:
    """Return both as (n,); empty if the material has none."""
    if not isinstance(material, Isotropic):
        return np.empty(0), np.empty(0)
    poisson = np.empty(0) if material.poisson is None else np.broadcast_to(material.poisson, n)
    return np.broadcast_to(material.young, n), poisson


def _edge_diagonal(rest: Rest) -> Array:
    return np.asarray(np.diagonal(rest.stiffness, axis1=1, axis2=2))


def _triangular(rest: Rest) -> Array:
    if rest.lengths.shape[1] != 3:
        raise MaterialError('rule = "triangular" is for triangles. For tetrahedra use EdgeNetwork, which has the pairs of edges.')
    return _edge_diagonal(rest)


def _van_gelder(rest: Rest) -> Array:
    return np.asarray(_young(rest, "van-gelder")[:, None] * rest.volumes[:, None] / rest.lengths**2)


def _lloyd(rest: Rest) -> Array:
    """Return the stiffness by their two formulas, with each edge's own length where the elements are not regular."""
    young, m = _young(rest, "lloyd")[:, None], rest.lengths.shape[1]
    if m == 1:
        raise MaterialError('rule = "lloyd" is for triangles and tetrahedra. For segments use another rule; all give E A/l.')
    solid = m == 6
    fits = rest.hypothesis is not Hypothesis.PLANE_STRAIN
    bad = np.flatnonzero(np.abs(rest.poisson - (1 / 4 if solid else 1 / 3)) > NEAR) if fits else np.arange(len(young))
    if len(bad):
        only = "nu = 1/4 in tetrahedra" if solid else 'nu = 1/3 in triangles in plane stress (plane="stress")'
        warn(f'SpringNetwork: rule = "lloyd" is for {only}, and {name_ids(bad, "element")} of the region are treated as such.')
    if solid:
        return np.asarray(2 * np.sqrt(2) / 25 * young * rest.lengths)
    return np.broadcast_to(np.sqrt(3) / 4 * young * rest.section[:, None], rest.lengths.shape)


def _young(rest: Rest, rule: str) -> Array:
    if not len(rest.young):
        raise MaterialError(f'rule = "{rule}" is for isotropic materials. Take "least-squares".')
    return rest.young


def _least_squares(rest: Rest) -> Array:
    """Return `k >= 0` (n, m) that minimise `|sum_i k_i d_i d_i' - sum_ij A_ij d_i d_j'|` in the Frobenius norm.

    The normal equations are `G k = r` with `G_ij = (d_i . d_j)^2` and `r_i = d_i' K d_i`. Springs with negative `k` are set to
    zero, and springs at zero that would reduce the norm are freed again. Each round changes all of them, for as many rounds as
    there are edges. Later rounds change only the first: Murty's rule (1974), which ends at the unique minimum.
    """
    C, A = rest.crossed, rest.stiffness
    G, r = C**2, np.einsum("nij,nij->ni", C @ A, C)
    n, m = r.shape
    k, used, active, size = np.zeros((n, m)), np.ones((n, m), dtype=bool), np.arange(n), np.abs(r).max(axis=1, keepdims=True)
    for round_ in range(2**m + m):
        own = used[active]
        both = own[:, :, None] & own[:, None, :]
        x = np.linalg.solve(np.where(both, G[active], np.eye(m)), np.where(own, r[active], 0.0)[:, :, None])
        slope = r[active] - (G[active] @ x)[:, :, 0]
        k[active] = np.maximum(x[:, :, 0], 0.0)
        wrong = np.where(own, x[:, :, 0], -slope) < -ROUNDED * size[active]
        if round_ >= m:
            wrong &= np.cumsum(wrong, axis=1) == 1
        used[active] ^= wrong
        active = active[wrong.any(axis=1)]
        if not len(active):
            break
    return k


#: The stiffness of the springs of each simplex (n, m) [N/m], by the name of the rule.
RULES: dict[str, Callable[[Rest], Array]] = {
    "least-squares": _least_squares,
    "edge-diagonal": _edge_diagonal,
    "van-gelder": _van_gelder,
    "lloyd": _lloyd,
    "triangular": _triangular,
}

for _shorthand in ("young", "poisson", "density"):  # remove class defaults, so that term.young raises; use term.material
    delattr(SpringNetwork, _shorthand)
