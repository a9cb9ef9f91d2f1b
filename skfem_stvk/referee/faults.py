"""Planted faults: models with one fault each, with a body on which the fault has an effect.

They verify that each check can fail. Each fault has occurred in practice or is easily made. `self_test` runs all checks on all
faults.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any

import numpy as np
import skfem

from ..edges import TENSILE
from ..edges.materials import Anisotropic
from ..mesh import ElementMesh
from ..mesh.element import ELEMENTS
from ..system import System
from ..terms import StVK
from . import element_model as strains
from . import faulty_elements as elements
from . import faulty_systems as systems

Terms = Sequence[StVK]


@dataclass(frozen=True)
class Fault:
    """Planted fault.

    Attributes
    ----------
    description
        The fault, and where it has occurred.
    make
        Function that returns a faulty model for a mesh and terms like those of its body.
    body
        Name of the body in `bodies()` on which the fault has an effect.
    named
        Name of the hypothesis by which a report names the fault, or "" if there is none.
    """

    description: str
    make: Callable[[ElementMesh, Terms], Any]
    body: str = "isotropic"
    named: str = ""


@dataclass(frozen=True)
class FaultBody:
    """Small body of the self-test: mesh, terms, and options of its elements."""

    mesh: ElementMesh
    terms: list[StVK]
    options: dict[str, Any] = field(default_factory=dict)


@cache
def bodies() -> dict[str, FaultBody]:
    """Return the bodies of the self-test by name. They have unequal edges, both orientations, lambda != mu and nu != 0."""
    rng = np.random.default_rng(12)
    box = _shaken(skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 3)] * 3), rng)
    half = rng.random(box.t.shape[1]) < 0.5
    box.t[:2, half] = box.t[1::-1, half]
    tets, left = ElementMesh(box.p, box.t), np.arange(box.t.shape[1] // 2)
    right = np.setdiff1d(np.arange(tets.nt), left)
    root, frames = rng.standard_normal((6, 6)), np.linalg.qr(rng.standard_normal((tets.nt, 3, 3)))[0]
    quadratic = tets.with_degree(2)
    p = quadratic.p.copy()
    p[:, tets.nv :] += 0.02 * rng.uniform(-1, 1, (3, quadratic.nv - tets.nv))
    hexes = _shaken(skfem.MeshHex.init_tensor(*[np.linspace(0, 1, 3)] * 3), rng)
    isotropic = [StVK(young=2.0, poisson=0.3)]
    return {
        "isotropic": FaultBody(tets, isotropic),
        "two materials": FaultBody(tets, [StVK(young=2.0, poisson=0.45, region=left), StVK(young=1.0, poisson=0.2, region=right)]),
        "a material per element": FaultBody(
            tets, [StVK(young=rng.uniform(1, 3, tets.nt), poisson=rng.uniform(0.1, 0.45, tets.nt))]
        ),
        "frames": FaultBody(tets, [StVK(Anisotropic(root @ root.T + 3 * np.eye(6), frame=frames))]),
        "curved": FaultBody(ElementMesh(p, quadratic.t, element=quadratic.element), isotropic),
        "one point": FaultBody(
            ElementMesh(hexes.p, hexes.t, element=ELEMENTS["hexahedra"]), isotropic, {"quadrature": "one-point"}
        ),
    }


def _shaken(mesh: Any, rng: np.random.Generator) -> Any:
    """Return a copy of the mesh with its nodes displaced randomly by up to a tenth of their distance."""
    return type(mesh)(mesh.p + 0.05 * rng.uniform(-1, 1, mesh.p.shape), mesh.t.copy())


FAULTS: dict[str, Fault] = {
    "twice lambda": Fault(
        "lambda doubled, as MuJoCo 3.3 to 3.17 did in 3D; invisible at nu = 0",
        partial(systems.with_lame, lambda lam, mu: (2 * lam, mu)),
        named="lambda doubled",
    ),
    "half lambda": Fault("lambda halved", partial(systems.with_lame, lambda lam, mu: (lam / 2, mu)), named="lambda halved"),
    "plane-stress lambda": Fault(
        "2 lam mu/(lam + 2 mu), which is for plane stress, in 3D",
        partial(systems.with_lame, lambda lam, mu: (2 * lam * mu / (lam + 2 * mu), mu)),
        named="lambda of plane stress",
    ),
    "bulk modulus for lambda": Fault(
        "lam + 2/3 mu taken for lambda",
        partial(systems.with_lame, lambda lam, mu: (lam + 2 * mu / 3, mu)),
        named="bulk modulus for lambda",
    ),
    "half mu": Fault(
        "engineering shear strain used as the tensor's",
        partial(systems.with_lame, lambda lam, mu: (lam, mu / 2)),
        named="mu halved",
    ),
    "twice mu": Fault("2 G taken for mu", partial(systems.with_lame, lambda lam, mu: (lam, 2 * mu)), named="mu doubled"),
    "lambda and mu exchanged": Fault(
        "each constant is used as the other",
        partial(systems.with_lame, lambda lam, mu: (mu, lam)),
        named="lambda and mu exchanged",
    ),
    "engineering shear doubled": Fault(
        "shear strains and the shear modulus doubled",
        partial(elements.altered, partial(elements.with_shear, factor=2.0)),
        named="shear stresses doubled",
    ),
    "no half in E": Fault("E = F'F - I in energy, force and tangent", partial(systems.times, 4, 4, 4), named="W, F, K x 4"),
    "doubled stress": Fault("S = 2 C : E in force and tangent alone", partial(systems.times, 1, 2, 2), named="F, K x 2"),
    "doubled volume": Fault("|det|/3 instead of |det|/6 in W, F and K", partial(systems.times, 2, 2, 2), named="W, F, K x 2"),
    "deformed volume": Fault(
        "integrals over the deformed body", partial(elements.altered, elements.deformed_volume), named="volume of the deformed body"
    ),
    "signed volume": Fault(
        "elements of negative orientation count negatively",
        partial(elements.altered, elements.signed_volume),
        named="signed volumes",
    ),
    "linear strain": Fault("small-strain elasticity", systems.linear, named="linear strain"),
    "Biot strain": Fault(
        "U - I in W, from which F and K are derived",
        partial(elements.strained, strains.biot, strains.derivative_of_biot, True),
        named="Biot strain",
    ),
    "Biot strain in S": Fault(
        "U - I taken for E in every formula", partial(elements.strained, strains.biot, np.matmul, False), named="Biot strain"
    ),
    "corotated": Fault("R'F - I in W, from which F and K are derived", systems.corotated, named="Biot strain"),
    "Almansi strain": Fault(
        "(I - C^-1)/2 in W, from which F and K are derived",
        partial(elements.strained, strains.pulled_back_almansi, strains.derivative_of_almansi, True),
        named="Almansi strain",
    ),
    "Almansi strain in S": Fault(
        "(I - b^-1)/2 taken for E in every formula",
        partial(elements.strained, strains.almansi, np.matmul, False),
        named="Almansi strain",
    ),
    "b for C": Fault(
        "E from F F' instead of F'F in every formula",
        partial(elements.strained, strains.of_left_stretch, np.matmul, False),
        named="b for C",
    ),
    "S F for F S": Fault(
        "P = S F in the force, and K derived from it",
        partial(elements.strained, strains.green_lagrange, strains.stress_times_gradient, True),
        named="S F for F S",
    ),
    "P = S": Fault(
        "the second Piola-Kirchhoff stress taken for the first in the force, and K derived from it",
        partial(elements.strained, strains.green_lagrange, strains.second_piola, True),
        named="P = S",
    ),
    "F' S for F S": Fault(
        "P = F' S in the force, and K derived from it",
        partial(elements.strained, strains.green_lagrange, strains.transposed_gradient_times_stress, True),
        named="F' S for F S",
    ),
    "one tet skipped": Fault(
        "an element is left out", partial(elements.middle_element, partial(elements.counted, times=0.0)), named="one element x 0"
    ),
    "one tet twice": Fault(
        "an element is summed twice",
        partial(elements.middle_element, partial(elements.counted, times=2.0)),
        named="one element x 2",
    ),
    "no pairs": Fault(
        "the spring network: the diagonal of L alone",
        partial(systems.with_coefficients, systems.drop_pairs),
        named="edges without pairs",
    ),
    "no opposite pairs": Fault(
        "pairs of edges without a common vertex are left out",
        partial(systems.with_coefficients, systems.drop_opposite),
        named="no opposite pairs",
    ),
    "one wrong sign": Fault(
        "wrong sign of one opposite pair of one tetrahedron", partial(systems.with_coefficients, systems.flip_one_opposite)
    ),
    "one pair dropped": Fault(
        "one pair of edges of one tetrahedron is left out", partial(systems.with_coefficients, systems.drop_one_adjacent)
    ),
    "edges permuted": Fault(
        "the third and fourth edge exchanged in elements of negative orientation",
        partial(systems.with_coefficients, systems.permute_negative),
        named="edges permuted in mirrored elements",
    ),
    "no geometric term": Fault(
        "K without the edge tensions (initial stress)", systems.no_geometric_term, named="no initial stress in K"
    ),
    "sign of the geometric term": Fault(
        "the initial stress is subtracted from K",
        partial(elements.altered, lambda model: {"initial": -1.0}),
        named="sign of the initial stress in K",
    ),
    "Cauchy stress in K": Fault(
        "the initial stress in K is the Cauchy stress, not S",
        partial(elements.altered, lambda model: {"initial_from": strains.cauchy}),
        named="Cauchy stress for S in K",
    ),
    "no lambda in K": Fault(
        "lambda is left out in K, not in the stress", elements.without_lambda_in_tangent, named="no lambda in K"
    ),
    "geometric term in part": Fault(
        "K without initial stress in every third element",
        partial(elements.altered, elements.initial_stress_in_part),
        named="no initial stress in some elements",
    ),
    "geometric term clamped": Fault(
        "K with tensile edge tensions alone, passed off as exact",
        partial(systems.with_tangent, lambda body, u: body.jacobian(u, kept=TENSILE)),
        named="tensile edge tensions alone in K",
    ),
    "blocks transposed": Fault(
        "each block of K transposed", partial(systems.with_tangent, systems.blocks_transposed), named="blocks of K transposed"
    ),
    "K symmetrised wrongly": Fault(
        "the upper half mirrored with its diagonal",
        partial(systems.with_tangent, systems.symmetrised_wrongly),
        named="diagonal of K doubled",
    ),
    "upper half of K": Fault(
        "only the upper half is stored", partial(systems.with_tangent, systems.upper_half), named="upper half of K alone"
    ),
    "half a diagonal": Fault(
        "each entry of the diagonal is halved",
        partial(systems.with_tangent, systems.half_diagonal),
        named="diagonal of K halved",
    ),
    "wrong sign of K": Fault(
        "the derivative of the external instead of the internal force", partial(systems.times, 1, 1, -1), named="K x -1"
    ),
    "wrong sign of F": Fault("the force of the body on its surroundings", partial(systems.times, 1, -1, -1), named="F, K x -1"),
    "components first": Fault(
        "degrees of freedom component by component", systems.components_first, named="results component by component"
    ),
    "stale K": Fault("K of the previous call's state", systems.StaleTangent, named="K of the state before"),
    "K cached nearby": Fault(
        "K is cached while u is nearly the same",
        partial(systems.cached, ["tangent"], np.allclose),
        named="K cached while u is nearly the same",
    ),
    "K cached by norm": Fault(
        "K is cached while the norm of u is the same",
        partial(systems.cached, ["tangent"], lambda u, v: np.linalg.norm(u) == np.linalg.norm(v)),
        named="K cached while u is nearly the same",
    ),
    "F and K cached by text": Fault(
        "F and K are cached while u is printed alike",
        partial(systems.cached, ["internal_force", "tangent"], lambda u, v: str(u) == str(v)),
        named="F, K cached while u is nearly the same",
    ),
    "mesh in mm": Fault(
        "rest positions are multiplied by 1000, displacements are not",
        lambda mesh, terms: System(ElementMesh(1e3 * mesh.p, mesh.t, element=mesh.element), terms),
        named="mesh in mm",
    ),
    "displacements in mm": Fault(
        "displacements are multiplied by 1000, rest positions are not",
        partial(systems.displaced, lambda u: 1e3 * u),
        named="u in mm",
    ),
    "stale rest shape": Fault("the mesh before its nodes were moved", systems.stale_rest_shape),
    "single precision": Fault(
        "sums in float32", lambda mesh, terms: System(mesh, terms, dtype=np.float32), named="single precision"
    ),
    "textbook cancellation": Fault("F from squared lengths of positions", systems.FromPositions),
    "wrong origin": Fault("displacements relative to a node, in part", systems.wrong_origin),
    "NaN at inversion": Fault(
        "values are not a number if an element is inverted", systems.nan_at_inversion, named="not a number at inversion"
    ),
    "NaN in one entry": Fault(
        "one entry of F is not a number, as in a damaged file",
        lambda mesh, terms: systems.disturbed(System(mesh, terms), force=lambda u: np.where(np.arange(len(u)) == 40, np.nan, 0.0)),
        named="one entry not a number",
    ),
    "inverted tets skipped": Fault(
        "an inverted element has neither energy nor force", partial(elements.altered, elements.inverted_skipped)
    ),
    "unsymmetric moduli": Fault(
        "C_1122 is wrong by 1 %, C_2211 is correct", partial(elements.altered, elements.unsymmetric_moduli)
    ),
    "lone force": Fault("a constant force on one vertex, such as a boundary term", systems.lone_force, named="a constant force"),
    "couple": Fault("two opposite forces that form a couple", systems.couple, named="a constant force"),
    "skew K": Fault("two entries of K are skew-symmetric", systems.skew_tangent),
    "sign of a node's force": Fault(
        "the force on one vertex has the wrong sign", systems.wrong_sign_of_one_force, named="force of one node x -1"
    ),
    "energy offset": Fault("a constant is added to the energy", systems.energy_offset, named="a constant energy"),
    "anchored": Fault("a weak spring from every vertex to its rest position; W, F and K are consistent", systems.anchored),
    "energy of position": Fault("the energy depends on the location of the body", systems.energy_of_position),
    "extra zero mode": Fault("one additional mode has no energy at rest", systems.extra_zero_mode),
    "materials shifted": Fault(
        "each element has its neighbour's material",
        partial(elements.altered, elements.shifted_materials),
        "a material per element",
        "materials of the next element",
    ),
    "materials exchanged": Fault(
        "two regions have each other's material", systems.exchanged_materials, "two materials", "lambda and mu by region"
    ),
    "twice lambda in a region": Fault(
        "lambda doubled in one of two regions",
        lambda mesh, terms: System(mesh, [systems.with_lame_of(terms[0], lambda lam, mu: (2 * lam, mu)), terms[1]]),
        "two materials",
        "lambda doubled",
    ),
    "frames transposed": Fault(
        "the rows of a frame are taken for material axes",
        partial(systems.frames, lambda frame: np.swapaxes(frame, -1, -2)),
        "frames",
        "frames transposed",
    ),
    "frames ignored": Fault(
        "material axes are taken for the global ones",
        partial(systems.frames, lambda frame: np.broadcast_to(np.eye(3), frame.shape)),
        "frames",
        "frames ignored",
    ),
    **{
        f"{given} for {meant}{' of a reflex angle' if full_turns else ''}": Fault(
            f"angles of frames in {given} are taken for {meant}{', from 180 to 360 degrees' if full_turns else ''}",
            partial(systems.frames, partial(systems.rotated_by, factor, full_turns)),
            "frames",
            f"{given} taken for {meant}",
        )
        for given, meant, factor in (("degrees", "radians", 180 / np.pi), ("radians", "degrees", np.pi / 180))
        for full_turns in (0, -1)
    },
    "Voigt order": Fault(
        "the matrix has its shears in the order 12, 13, 23", systems.voigt_order, "frames", "shears in the order 12, 13, 23"
    ),
    "one point dropped": Fault(
        "the last quadrature point is left out", partial(elements.altered, elements.point_dropped), "curved", "one point left out"
    ),
    "a wrong weight": Fault("the first weight is wrong by 1e-6", partial(elements.altered, elements.wrong_weight), "curved"),
    "one-point rule": Fault("integrals by the value at the centroid", elements.one_point, "curved", "one-point rule"),
    "midside nodes in a cycle": Fault(
        "the last three midside nodes are permuted in a cycle",
        partial(elements.altered, elements.midside_nodes_in_a_cycle),
        "curved",
        "nodes in another order",
    ),
    "midside nodes exchanged": Fault(
        "the last two midside nodes are exchanged, as between the orders of Gmsh and VTK",
        partial(elements.altered, elements.last_two_exchanged),
        "curved",
        "nodes in another order",
    ),
    "curved taken as straight": Fault(
        "gradients and weights are those of elements with straight edges",
        elements.straightened,
        "curved",
        "curved edges taken as straight",
    ),
    "no hourglass control": Fault("hourglass modes have no energy", elements.without_control, "one point", "no hourglass control"),
    "gradients at the centre": Fault(
        "gradients and volume of the centre instead of their means", elements.gradients_at_the_centre, "one point"
    ),
}
