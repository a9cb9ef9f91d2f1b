"""Studies of membranes against closed forms: a flat disc under a dead load, and a wrinkling sheet in shear."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import skfem
from scipy.spatial import Delaunay

from skfem_stvk import BodyForce, ElementMesh, StVK, System, solve_static
from skfem_stvk.arguments import Array
from skfem_stvk.results import Fields

from ..study import Study

YOUNG, POISSON, THICKNESS = 1e6, 0.3, 1e-3
#: Hencky's number at a Poisson's ratio of 0.3.
HENCKY = 0.6534
#: Loads `q a/(E h)`. Slopes and strains are not small at the last one.
LOADS, FINE = (1e-7, 1e-3, 1e-1, 10.0), 1e-6
SHEARS, CELLS = (0.05, 0.2, 0.4), 6


def clamped_disc(quick: bool) -> Iterable[Study]:
    """Yield the studies of a flat disc clamped at its rim, without initial tension, under a transverse dead load (Hencky)."""
    rows, wrong = [], []
    for degree in (1, 2):
        sizes = ((2, 3, 4) if quick else (2, 3, 4, 5)) if degree == 1 else (1, 2, 3)
        errors = [abs(deflection(n, degree, FINE) - 1) for n in sizes]
        order = float(np.log2(errors[-2] / errors[-1]))
        shown = [f"{error:.2e}" for error in errors] + [""] * (4 - len(errors))
        rows.append((f"{degree}", *shown, f"{order:.2f}"))
        if errors[-1] > 5e-3 or (degree == 1 and order < 1.5):
            wrong.append(f"degree {degree}: error {errors[-1]:.1e}, order {order:.2f}")
    yield Study(
        f"A flat disc under a transverse dead load, q a/(E h) = {FINE:g}: error of its deflection",
        "the deflection of the centre converges to Hencky's 0.6534 a (q a/(E h))^(1/3) under refinement",
        ("degree", "coarsest", "finer", "finer", "finest", "order"),
        tuple(rows),
        tuple(wrong),
        ("scikit-fem's circle; each mesh halves the edges. Hencky's number has 4 digits, a relative error of 1e-4",),
    )
    ratios = [deflection(4, 1, load) for load in LOADS]
    limit = ratios[0]
    apart = [abs(ratio / limit - 1) for ratio in ratios]
    yield Study(
        "The same disc under larger loads: deflection divided by Hencky's",
        "Hencky's solution assumes small slopes and strains; under a dead load it is correct to 1e-3 up to q a/(E h) = 0.1",
        tuple(f"q a/(E h) = {load:g}" for load in LOADS),
        (tuple(f"{ratio:.4f}" for ratio in ratios),),
        () if apart[2] < 1e-3 < apart[-1] else (f"ratios = {ratios}",),
        ("linear triangles of one mesh, with the same error of the mesh in all values",),
    )


def deflection(n: int, degree: int, load: float) -> float:
    """Return the deflection of the centre of the unit disc divided by Hencky's."""
    circle = skfem.MeshTri.init_circle(n)
    flat = ElementMesh(np.concatenate([circle.p, np.zeros((1, circle.p.shape[1]))]), circle.t).with_degree(degree)
    edges = len(circle.boundary_facets())
    r = np.hypot(flat.p[0], flat.p[1])
    rim = np.flatnonzero(r > np.cos(np.pi / edges) - 1e-9)
    assert len(rim) == degree * edges
    p = flat.p.copy()
    p[:, rim] /= r[rim]
    mesh = ElementMesh(p, flat.t, element=flat.element)
    q = load * YOUNG * THICKNESS
    sheet: list[Any] = [StVK(young=YOUNG, poisson=POISSON, thickness=THICKNESS), BodyForce((0.0, 0.0, q / THICKNESS))]
    result = solve_static(System(mesh, sheet, fixed={tuple(rim.tolist()): "xyz"}), quiet=True)
    middle = int(np.argmin(np.hypot(p[0], p[1])))
    return float(result.u.reshape(-1, 3)[middle, 2]) / (HENCKY * load ** (1 / 3))


def sheared_sheet(quick: bool) -> Iterable[Study]:
    """Yield the study of a sheet in space with a sheared rim. The sheet wrinkles and has tension only along the wrinkles."""
    rows, wrong = [], []
    for shear in SHEARS[:2] if quick else SHEARS:
        E1, slope = tension_field(shear)
        wanted = YOUNG * E1
        for degree in (1, 2):
            body, u = sheared(shear, degree, True)
            plain, v = sheared(shear, degree, False)
            stress = _principal(body, u)
            pull, both = shear_force(body, body.internal_force(u)), shear_force(plain, plain.internal_force(v))
            clamp = shear_force(plain, clamped(plain, v)) if degree == 1 else np.nan
            closed = 2 * YOUNG * THICKNESS * E1 * slope
            off = float(np.abs(stress[:, 1:] - [0.0, wanted]).max()) / wanted
            least = float(_principal(plain, v)[:, 0].min()) / wanted
            figures = (f"{wanted:.6g}", f"{off:.1e}", f"{pull / closed - 1:.1e}", f"{both / closed:.3f}", f"{clamp / closed:.3f}")
            rows.append((f"{shear:g}", f"{degree}", *figures, f"{least:.3f}"))
            if off > 1e-8 or abs(pull / closed - 1) > 1e-8 or least > -0.1:
                wrong.append(
                    f"shear {shear:g}, degree {degree}: error of the stress {off:.1e}, of the force {pull / closed - 1:.1e}"
                )
    yield Study(
        "A wrinkling sheet in shear: stress along the wrinkles [Pa], and shear force",
        "stress and force agree with a tension field, S = E E1, to 1e-8; without wrinkling the sheet has compression",
        ("shear", "degree", "E E1", "off", "force off", "without: force", "clamped: force", "without: least stress"),
        tuple(rows),
        tuple(wrong),
        (
            "unequal triangles in space, the whole rim sheared, inner nodes perturbed; forces divided by the closed form",
            "clamped: forces of the edges of StVK in tension, without the edges in compression",
        ),
    )


def tension_field(shear: float) -> tuple[float, float]:
    """Return the largest principal strain `E1` of a simple shear, and its derivative with respect to the shear."""
    half, root = shear**2 / 4, np.sqrt(shear**4 / 16 + shear**2 / 4)
    return float(half + root), float(shear / 2 + (shear**3 / 4 + shear / 2) / (2 * root))


def shear_force(body: System, force: Array) -> float:
    """Return the shear force [N] that does the work of the forces (ndofs,) when the shear of the sheet of height 1 increases."""
    return float(body.mesh.p[1] @ force.reshape(-1, 3)[:, 0])


def sheared(shear: float, degree: int, wrinkling: bool) -> tuple[System, Array]:
    """Return the sheet and its displacements in equilibrium."""
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.linspace(0, 2, 2 * CELLS + 1), np.linspace(0, 1, CELLS + 1))
    p = np.stack([x.ravel(), y.ravel()])
    inner = (p[0] > 0) & (p[0] < 2) & (p[1] > 0) & (p[1] < 1)
    p[:, inner] += 0.25 / CELLS * rng.uniform(-1, 1, (2, int(inner.sum())))
    corners = Delaunay(p.T).simplices.T
    (a, b, c) = p[:, corners].transpose(1, 0, 2)
    areas = (b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0]
    mesh = ElementMesh(np.concatenate([p, np.zeros((1, p.shape[1]))]), corners[:, np.abs(areas) > 1e-9]).with_degree(degree)
    x, y = mesh.p[0], mesh.p[1]
    rim = np.flatnonzero((x < 1e-9) | (x > 2 - 1e-9) | (y < 1e-9) | (y > 1 - 1e-9))
    law = StVK(young=YOUNG, poisson=POISSON, thickness=THICKNESS, wrinkling=wrinkling)
    u0 = np.zeros((mesh.nv, 3))
    u0[:, 0] = shear * y
    body = System(mesh, law, prescribed={tuple(rim.tolist()): {"x": shear * y[rim], "y": 0.0, "z": 0.0}})
    if not wrinkling:  # the flat state under compression, which is unstable
        return body, u0.ravel()
    inside = np.setdiff1d(np.arange(mesh.nv), rim)
    u0[inside] += 0.01 / CELLS * rng.uniform(-1, 1, (len(inside), 3))
    result = solve_static(body, u0=u0.ravel(), t0=1.0 - 1e-9, steps=1, rtol=1e-11, quiet=True)
    return body, result.u


def clamped(body: System, u: Array) -> Array:
    """Return the nodal forces (ndofs,) [N] of the edges in tension."""
    term: Any = body.bound_terms[0]
    form, x = term.form, u.reshape(-1, 3)
    pull = np.maximum(form.tensions(x), 0)[:, None] * (form.P + form.differences(x))
    force = np.zeros(x.shape)
    np.add.at(force, form.edges[0], pull)
    np.add.at(force, form.edges[1], -pull)
    return force.ravel()


def _principal(body: System, u: Array) -> Array:
    """Return the principal second Piola-Kirchhoff stresses (nt, 3) [Pa], ascending."""
    return np.asarray(np.linalg.eigvalsh(Fields.of(body).at(u)["pk2_stress"]))
