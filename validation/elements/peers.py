"""K of quadratic tetrahedra by other codes, each called in its fastest way on one thread."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numba
import numpy as np
import skfem
from scipy.sparse import csr_matrix

from skfem_stvk import ElementMesh, StVK, System
from skfem_stvk.arguments import Array
from skfem_stvk.errors import StvkError
from skfem_stvk.referee.peers import load
from skfem_stvk.referee.peers.ngsolve import compiled, mesh_of
from skfem_stvk.referee.peers.peer import lame, require
from skfem_stvk.referee.reference import ReferenceStVK, isotropic_tensor

from ..bench.costs import best_and_median
from ..statics.study import Study

YOUNG, POISSON = 1e5, 0.3
CELLS, QUICK_CELLS = 14, 2
SECONDS, QUICK_SECONDS = 20.0, 0.05
#: Relative tolerance of `v' K(u) v` of linear fields between the codes.
AGREEMENT = 1e-10


def peers(quick: bool = False) -> Sequence[Study]:
    """Compare K of quadratic tetrahedra and its time between this package, scikit-fem, FElupe and NGSolve."""
    n, rng = QUICK_CELLS if quick else CELLS, np.random.default_rng(0)
    cubes = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)
    linear = ElementMesh(cubes.p + 0.1 / n * rng.uniform(-1, 1, cubes.p.shape), cubes.t)
    body = System(linear, StVK(young=YOUNG, poisson=POISSON), degree=2)
    mesh = body.mesh
    # linear in X, so that codes whose unknowns are not nodal values represent the same fields
    U, V = 0.2 * rng.standard_normal((2, 3, 3))
    u, v, K = (U @ mesh.p).T.ravel(), (V @ mesh.p).T.ravel(), body.tangent(np.zeros(body.ndofs))
    reference = ReferenceStVK(mesh.p, mesh.t, isotropic_tensor(YOUNG, POISSON, 3, False), mesh.element.name)
    ways: dict[str, Callable[[], tuple[csr_matrix, Array]]] = {
        "this package": lambda: (body.tangent(u, out=K), v),
        "scikit-fem": lambda: (reference.tangent(u), v),
    }
    missing = []
    try:
        felupe: Any = load("FElupe")(mesh.p, mesh.t, YOUNG, POISSON)
        ways["FElupe"] = lambda: (felupe.tangent(u), v)
    except StvkError:
        missing.append("FElupe")
    try:
        name, ngsolve = _by_ngsolve(linear, U, V)
        ways[name] = ngsolve
    except StvkError:
        missing.append("NGSolve")
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        found = {name: float(w @ (matrix @ w)) for name, (matrix, w) in ((name, way()) for name, way in ways.items())}
        taken = best_and_median(ways, QUICK_SECONDS if quick else SECONDS)
    finally:
        numba.set_num_threads(before)
    expected, ours = found["this package"], taken["this package"].best
    return [
        Study(
            f"K of {mesh.nt} quadratic tetrahedra by other codes",
            "all have the same K",
            ("code", "us per element", "over this package"),
            tuple((name, f"{1e6 * one.best / mesh.nt:.2f}", f"{one.best / ours:.1f} x") for name, one in taken.items()),
            tuple(
                f"{name}: v' K v = {value:.12g}; expected {expected:.12g}"
                for name, value in found.items()
                if not abs(value / expected - 1) <= AGREEMENT
            ),
            (f"best of several alternating calls, on one thread; not installed: {', '.join(missing) or 'none'}",),
        )
    ]


def _by_ngsolve(linear: ElementMesh, U: Array, V: Array) -> tuple[str, Callable[[], tuple[csr_matrix, Array]]]:
    """Return NGSolve's name, and a function that returns its K and the vector of `V X`.

    NGSolve's unknowns are values at vertices and, on edges, deviations from linear fields, which are zero for `U X` and `V X`.
    """
    ngsolve = require("NGSolve")
    space = ngsolve.VectorH1(mesh_of(ngsolve, linear.p, linear.t), order=2)
    F = ngsolve.Id(3) + ngsolve.Grad(space.TrialFunction())
    E = 0.5 * (F.trans * F - ngsolve.Id(3))
    lam, mu = lame(YOUNG, POISSON)
    density, with_compiler = compiled(lam / 2 * ngsolve.Trace(E) ** 2 + mu * ngsolve.InnerProduct(E, E))
    a, b = (5 - 5**0.5) / 20, (5 + 3 * 5**0.5) / 20
    four = ngsolve.IntegrationRule([(b, a, a), (a, b, a), (a, a, b), (a, a, a)], [1 / 24] * 4)
    form = ngsolve.BilinearForm(space)
    form += ngsolve.Variation(density * ngsolve.dx(intrules={ngsolve.ET.TET: four}))
    field = ngsolve.GridFunction(space)
    fields = []
    for A in (U, V):
        of_components = np.zeros((3, space.ndof // 3))
        of_components[:, : linear.nv] = A @ linear.p
        fields.append(of_components.ravel())
    field.vec.FV().NumPy()[:] = fields[0]

    def make() -> tuple[csr_matrix, Array]:
        form.AssembleLinearization(field.vec)
        values, columns, begin = (vector.NumPy() for vector in form.mat.CSR())
        return csr_matrix((values, columns, begin), shape=(space.ndof,) * 2), fields[1]

    return "NGSolve" if with_compiler else "NGSolve (no compiler)", make
