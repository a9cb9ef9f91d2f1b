"""Random bodies and states, and properties that hold for all of them.

Hypothesis chooses kinds and sizes, which it can shrink, and a seed. The seed determines coordinates, constants and displacements.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import skfem
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from skfem_stvk import (
    Anisotropic,
    BodyForce,
    ElementMesh,
    Gravity,
    InvertibleStVK,
    Isotropic,
    LinearElastic,
    NeoHookean,
    NodalLoad,
    StVK,
    StvkError,
    StvkWarning,
    System,
    TransverselyIsotropic,
    VolumePenalty,
)
from skfem_stvk.mesh.element import ELEMENTS
from skfem_stvk.referee.discretisation import Discretisation, Shape
from skfem_stvk.referee.judgement import Limits

from .contacts import Touch, check_contact, check_refusal, contact_of, touches, two_bodies, with_touch

SHAPES = ("single", "grid", "delaunay", "sliver", "far away")
MATERIALS = ("isotropic", "auxetic", "nearly incompressible", "by element", "anisotropic", "fibres", "two regions")
LAWS = ("stvk", "stvk", "stvk", "neo-hookean", "linear", "invertible", "with a penalty")
AMOUNTS = (0.0, 1e-9, 1e-3, 0.1, 1.0, 30.0)


@dataclass(frozen=True)
class Recipe:
    """Parameters of a body, its states and its contact."""

    k: int
    d: int
    degree: int
    boxes: bool
    shape: str
    size: int
    material: str
    law: str
    loads: tuple[str, ...]
    held: str
    amount: float
    seed: int
    touch: Touch | None = None


@st.composite
def recipes(draw: st.DrawFn, largest: int = 4) -> Recipe:
    """Draw all kinds of elements in all dimensions, from one to about a thousand elements."""
    k = draw(st.integers(1, 3))
    return Recipe(
        k=k,
        d=draw(st.integers(k, 3)),
        degree=draw(st.sampled_from((1, 1, 2))),
        boxes=k > 1 and draw(st.booleans()) and draw(st.booleans()),
        shape=draw(st.sampled_from(SHAPES)),
        size=draw(st.integers(1, largest)),
        material=draw(st.sampled_from(MATERIALS)),
        law=draw(st.sampled_from(LAWS)),
        loads=tuple(draw(st.lists(st.sampled_from(("gravity", "body force", "nodal")), max_size=2, unique=True))),
        held=draw(st.sampled_from(("nothing", "a node", "half"))),
        amount=draw(st.sampled_from(AMOUNTS)),
        seed=draw(st.integers(0, 2**32 - 1)),
    )


@st.composite
def touching(draw: st.DrawFn, largest: int = 3) -> Recipe:
    """Draw bodies that touch something."""
    return with_touch(draw(recipes(largest)), draw(touches()))


def made(recipe: Recipe, strain: float | None = None) -> System:
    """Return the body of a recipe. Its loads strain elements by about `strain`, or have unit size if `strain` is None.

    Raises an error of this package if the recipe describes no valid body.
    """
    rng = np.random.default_rng(recipe.seed)
    mesh, touch = mesh_of(recipe, rng), recipe.touch
    nodes: Sequence[int] = range({"nothing": 0, "a node": 1, "half": max(min(mesh.k, mesh.nv - 1), mesh.nv // 2)}[recipe.held])
    if touch is not None and touch.kind == "two bodies":
        mesh, nodes = two_bodies(touch, mesh), [*nodes, *(mesh.nv + i for i in nodes)]  # both are held
    fixed = {tuple(nodes): "xyz"[: mesh.d]} if nodes else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        terms = _terms(recipe, mesh, rng)
        contacts = [] if touch is None else [contact_of(touch, mesh, _young(terms[0]), np.random.default_rng([recipe.seed, 5]))]
        size = None if strain is None else strain * _resistance(System(mesh, terms))
        return System(mesh, [*terms, *_loads(recipe, mesh, rng, size), *contacts], fixed=fixed)


def mesh_of(recipe: Recipe, rng: np.random.Generator) -> ElementMesh:
    """Return a mesh: an element, a distorted grid, a Delaunay mesh of random points, a grid with a sliver, or far from 0."""
    k, n = recipe.k, 1 if recipe.shape == "single" else recipe.size
    simple = {
        1: skfem.MeshLine,
        2: skfem.MeshQuad if recipe.boxes else skfem.MeshTri,
        3: skfem.MeshHex if recipe.boxes else skfem.MeshTet,
    }
    grid = simple[k].init_tensor(*[np.linspace(0, 1, n + 1)] * k)
    p, t = grid.p + 0.2 / n * rng.uniform(-1, 1, grid.p.shape), grid.t.astype(np.int64)
    if not recipe.boxes:
        if recipe.shape == "delaunay" and k > 1:
            p = rng.random((k, n**k + k + 1))
            t = Delaunay(p.T).simplices.T.astype(np.int64)
        if recipe.shape == "single":
            t = t[:, :1]
            p, t = p[:, np.unique(t)], np.searchsorted(np.unique(t), t)
        if recipe.shape == "sliver" and k > 1:
            p[:, t[0, 0]] = p[:, t[1:, 0]].mean(axis=1) + 10.0 ** -rng.uniform(1, 9) * rng.standard_normal(k)
        half = rng.random(t.shape[1]) < 0.5
        t[:2, half] = t[1::-1, half]
    p = 10.0 ** rng.uniform(-3, 3) * p
    if recipe.d > k:  # curved, not only embedded
        p = np.vstack([p, *(0.2 * np.sin(p.sum(axis=0) / np.ptp(p) * (1 + i)) * np.ptp(p) for i in range(recipe.d - k))])
    if recipe.shape == "far away":
        p = p + 10.0 ** rng.uniform(0, 5) * np.ptp(p)
    element = {2: "quadrilaterals", 3: "hexahedra"}.get(k, "") if recipe.boxes else ""
    mesh = ElementMesh(p, t, element=ELEMENTS[element]) if element else ElementMesh(p, t)
    return mesh.with_degree(2) if recipe.degree == 2 and not recipe.boxes else mesh


def _material(recipe: Recipe, n: int, rng: np.random.Generator) -> Any:
    E, density = 10.0 ** rng.uniform(0, 11), 1e3
    if recipe.material in ("anisotropic", "fibres"):
        frame = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        if recipe.material == "fibres":
            return TransverselyIsotropic(14 * E, E, 0.3, 0.4, 0.6 * E, frame=frame, density=density)
        a = rng.standard_normal((6, 6))
        return Anisotropic(E * (a @ a.T + 3 * np.eye(6)), frame=frame, density=density)
    nu = {"auxetic": -0.6, "nearly incompressible": 0.4999}.get(recipe.material, 0.3)
    return Isotropic(E * rng.uniform(0.5, 2, n) if recipe.material == "by element" else E, nu, density=density)


def _young(law: Any) -> float:
    """Return a Young's modulus of a law [Pa]; 1e6 if it has none."""
    return float(np.mean(getattr(law.material, "young", 1e6)))


def _terms(recipe: Recipe, mesh: ElementMesh, rng: np.random.Generator) -> list[Any]:
    law = {"neo-hookean": NeoHookean, "linear": LinearElastic, "invertible": InvertibleStVK}.get(recipe.law, StVK)
    if recipe.material == "two regions" and mesh.nt > 1:
        half = mesh.nt // 2
        regions = np.arange(half), np.arange(half, mesh.nt)
        return [law(_material(recipe, len(ids), rng), region=ids) for ids in regions]
    terms: list[Any] = [law(_material(recipe, mesh.nt, rng))]
    return [*terms, VolumePenalty(1e3, kind="quadratic")] if recipe.law == "with a penalty" else terms


def _loads(recipe: Recipe, mesh: ElementMesh, rng: np.random.Generator, size: float | None) -> list[Any]:
    """Return loads of about `size` on each node [N], or unit loads if `size` is None."""
    volume = _volume_of_nodes(mesh)
    g, f, q = (1.0, 1.0, 1.0) if size is None else (size / (1e3 * volume), size / volume, size)
    makers = {
        "gravity": lambda: Gravity(g * rng.standard_normal(mesh.d)),
        "body force": lambda: BodyForce(f * rng.standard_normal(mesh.d)),
        "nodal": lambda: NodalLoad([mesh.nv - 1], q * rng.standard_normal(mesh.d)),
    }
    return [makers[name]() for name in recipe.loads]


def _volume_of_nodes(mesh: ElementMesh) -> float:
    """Return the approximate volume of a node, or its area or length."""
    return float(np.prod(np.sort(np.ptp(mesh.p, axis=1))[-mesh.k :])) / mesh.nv


def _resistance(system: System) -> float:
    """Return the approximate force on a node that strains the elements around it by one [N]."""
    K = system.tangent(np.zeros(system.ndofs))
    return float(np.median(K.diagonal()) * edge_length(system))


def edge_length(system: System) -> float:
    """Return the approximate length of an edge [m]."""
    return float(np.ptp(system.mesh.p) / max(1.0, system.mesh.nt ** (1 / system.mesh.k)))


def states(recipe: Recipe, system: System) -> list[NDArray[np.float64]]:
    """Return rest, a state with displacements of `amount` times the edge length, and a nearby third state."""
    rng = np.random.default_rng([recipe.seed, 1])
    u = recipe.amount * edge_length(system) * rng.standard_normal(system.ndofs)
    return [np.zeros(system.ndofs), u, 1.01 * u]


def check_body(recipe: Recipe) -> bool:
    """Check that W, F and K of a state are finite and consistent, or that an error of this package explains why not.

    The function returns whether there was a body to check.
    """
    try:
        system = made(recipe)
        u = states(recipe, system)[1]
        W, F, K = system.linearize(u)
    except StvkError as error:
        check_refusal(recipe.touch, error)
        return False
    assert np.isfinite(W) and np.isfinite(F).all() and np.isfinite(K.data).all(), "not a number"
    assert -1e-9 * max(abs(W), float(np.abs(F) @ np.abs(u))) <= W or recipe.law == "with a penalty", f"a negative energy: {W}"
    shape = Shape(system.mesh, Discretisation(system.mesh.element.name, None, 0.05))
    limit = 100 * Limits(shape, np.ones(system.mesh.nt)).of_body(u)
    sums, scale = np.abs(F.reshape(-1, system.mesh.d).sum(axis=0)).max(), float(np.abs(F).sum()) + _floor(system, K)
    assert sums <= limit * scale or (recipe.touch is not None and recipe.touch.is_rigid), f"forces of sum {sums:g} in {scale:g}"
    skew = abs(K - K.T)
    assert not skew.nnz or skew.max() <= limit * abs(K).max(), f"K is not symmetric: {skew.max():g}"
    v = np.random.default_rng([recipe.seed, 2]).standard_normal(system.ndofs)
    product, Kv = system.product(u, v), K @ v
    assert np.abs(product - Kv).max() <= limit * float((abs(K) @ np.abs(v)).max()), "the product is not that of the matrix"
    assert np.array_equal(F, system.internal_force(u)) or np.abs(F - system.internal_force(u)).max() <= limit * scale, "two forces"
    if recipe.touch is not None:
        check_contact(recipe.touch, system, u, v / np.abs(v).max(), edge_length(system), limit)
    elif recipe.law == "stvk":
        _check_derivatives(system, u, v, limit)
    return True


def _floor(system: System, K: Any) -> float:
    return float(abs(K).max() * np.ptp(system.mesh.p))


def _check_derivatives(system: System, u: NDArray[Any], v: NDArray[Any], limit: float) -> None:
    """Check F and K by the five-point stencil. The stencil is exact along a line because W is a quartic."""
    change = 0.1 * max(float(np.abs(u).max()), 1e-3 * float(np.ptp(system.mesh.p)))
    v = change * v
    weights = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}
    energies = [w * system.energy(u + s * v) for s, w in weights.items()]
    claimed = float(system.internal_force(u) @ v)
    assert abs(sum(energies) - claimed) <= limit * max(np.abs(energies).max(), abs(claimed)), "F is not the derivative of W"
    forces = np.array([w * system.internal_force(u + s * v) for s, w in weights.items()])
    error = np.abs(forces.sum(axis=0) - system.product(u, v)).max()
    assert error <= limit * np.abs(forces).max(), "K is not the derivative of F"
