"""The neo-Hookean law equals scikit-fem's form of the same energy and closed forms.

Tests also cover its clamped tangent and the refused arguments.
"""

import warnings

import numpy as np
import pytest
import skfem
from bodies import CURVED, MESHES, STRAIGHT, membrane, scikit_fem_of, sheet, state
from scipy.optimize import brentq
from skfem.helpers import ddot, grad, inv, transpose
from slow import slow

from skfem_stvk import (
    BackwardEuler,
    Corotated,
    EnergyMomentum,
    InvertibleStVK,
    Isotropic,
    MaterialError,
    NeoHookean,
    Newmark,
    Orthotropic,
    StateError,
    StVK,
    StvkWarning,
    System,
    TransverselyIsotropic,
    VelocityVerlet,
    simulate,
    solve_static,
)
from skfem_stvk.edges import NONE, TENSILE
from skfem_stvk.edges.elements import Quadrature
from skfem_stvk.mesh.points import base_vectors_at, rule_of, sizes_of
from skfem_stvk.results import Fields
from skfem_stvk.results.monitors import Monitors
from skfem_stvk.solvers.statics import Status
from skfem_stvk.terms import Body

EVERY = (
    {name: MESHES[name] for name in ("tetrahedra", "triangles", "membrane")}
    | {f"{name}, curved": mesh for name, mesh in CURVED.items() if mesh.k > 1}
    | {f"{name}, straight": mesh for name, mesh in STRAIGHT.items() if mesh.k > 1}
)
SOLID = [name for name, mesh in EVERY.items() if scikit_fem_of(mesh)]
SECTION = {1: {"area": 0.3}, 2: {"thickness": 0.3}, 3: {}}
BOXES = [name for name, mesh in EVERY.items() if mesh.element.shape.one_point and mesh.k == mesh.d]
RULES = [(name, "usual") for name in EVERY] + [(name, "one-point") for name in BOXES]
COMPILED = [
    slow(name, rule) if rule == "one-point" and name != "quadrilaterals, straight" else (name, rule) for name, rule in RULES
]


def law_on(mesh, plane=None):
    rng = np.random.default_rng(3)
    sheets = {"thickness": 0.3, "plane": plane} if mesh.k == 2 else {}
    return NeoHookean(young=rng.uniform(1, 4, mesh.nt), poisson=rng.uniform(0, 0.45, mesh.nt), **sheets)


def bound(mesh, rule="usual", plane=None, dtype=np.float64):
    hourglass = 0.1 if rule == "one-point" else None
    return law_on(mesh, plane).bind(Body(mesh, [], Quadrature.of(mesh.element, rule, hourglass)), dtype)


def crushed(mesh, amount=0.4, noise=0.1):
    """Return a compressed state (nv, d), in which an element or two are nearly flat and none is inverted."""
    return (noise * state(mesh) - amount * mesh.p.T.ravel()).reshape(-1, mesh.d)


def system(mesh, rule="usual", plane=None):
    more = {"hourglass": 0.1} if rule == "one-point" else {}
    return System(mesh, law_on(mesh, plane), quadrature=None if rule == "usual" else rule, **more)


def by_scikit_fem(mesh, u, rule):
    """Return W, F and K of the literal energy by scikit-fem, in the plane with zero strain across."""
    basis, (points, weights) = scikit_fem_of(mesh), rule_of(mesh.element, rule)
    basis = skfem.Basis(basis.mesh, basis.elem, quadrature=(points.T, weights))
    lam, mu = (np.broadcast_to(value * (0.3 if mesh.k == 2 else 1.0), mesh.nt)[:, None] for value in lame(mesh))
    F = grad(basis.interpolate(u.ravel())) + np.eye(mesh.d)[:, :, None, None]
    J, back = np.linalg.det(np.moveaxis(F, (0, 1), (2, 3))), transpose(inv(F))
    P = mu * (F - back) + lam * (J - 1) * J * back

    def energy(w):
        return mu / 2 * (ddot(F, F) - mesh.d - 2 * np.log(J)) + lam / 2 * (J - 1) ** 2

    def tangent(v, w, _):
        dF = grad(v)
        transposed = np.einsum("ij...,kj...,kl...->il...", back, dF, back)
        dP = mu * (dF + transposed) + lam * ((2 * J - 1) * J * ddot(back, dF) * back - (J - 1) * J * transposed)
        return ddot(dP, grad(w))

    K = skfem.BilinearForm(tangent).assemble(basis)
    return skfem.Functional(energy).assemble(basis), skfem.LinearForm(lambda v, _: ddot(P, grad(v))).assemble(basis), K


def lame(mesh):
    law = law_on(mesh)
    young, nu = law.material.young, law.material.poisson
    return young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 * (1 + nu))


@pytest.mark.few
@pytest.mark.parametrize("rule", ["usual", "exact"])
@pytest.mark.parametrize("name", SOLID)
def test_energy_force_and_tangent_are_those_of_scikit_fem(name, rule):
    mesh = EVERY[name]
    body = system(mesh, rule)
    for u in (0.3 * crushed(mesh, 0).ravel(), crushed(mesh, noise=0.03).ravel()):
        W, F, K = by_scikit_fem(mesh, u, rule)
        assert body.energy(u) == pytest.approx(W, rel=1e-12)
        assert np.abs(body.internal_force(u) - F).max() < 1e-12 * np.abs(F).max()
        assert abs(body.tangent(u) - K).max() < 1e-12 * abs(K).max()


@pytest.mark.few(3)
@pytest.mark.parametrize("name", EVERY)
def test_the_clamped_tangent_is_positive_semi_definite_under_strong_compression(name):
    mesh = EVERY[name]
    for rule in ("usual", *(["one-point"] if name in BOXES else [])):
        for plane in (None, "stress") if mesh.k == mesh.d == 2 else (None,):
            body = System(mesh, law_on(mesh, plane), quadrature=None if rule == "usual" else rule)
            for amount, noise in ((0.0, 0.1), (0.5, 0.03), (0.8, 0.01), (-2.0, 0.1)):
                u = crushed(mesh, amount, noise).ravel()
                exact = np.linalg.eigvalsh(body.tangent(u).toarray())
                for kept in (TENSILE, NONE):
                    values = np.linalg.eigvalsh(clamped(body, u, kept))
                    assert values[0] > -1e-12 * values[-1]
                    assert exact[0] > -1e-12 * exact[-1] or values[0] > exact[0] + 1e-3 * abs(exact[0])


def clamped(body, u, kept):
    x = u.reshape(-1, body.mesh.d)
    (term,) = body.bound_terms
    data = np.zeros(body.pattern.nnz)
    term.fill(x, term.rows(body.pattern), data, False, kept=kept)
    return body.pattern.matrix(data).toarray()


def test_the_clamped_tangent_is_exact_under_expansion():
    """The clamped tangent is exact at rest and under uniform expansion, where all bounds are exact.

    The clamped tangent differs from the exact one under uniform compression.
    """
    for mesh in (MESHES["tetrahedra"], MESHES["triangles"], MESHES["membrane"]):
        body = System(mesh, NeoHookean(young=2.0, poisson=0.2))
        for amount, same in ((0.0, True), (-0.1, True), (0.3, mesh.k < mesh.d and False)):
            u = -amount * mesh.p.T.ravel()
            exact = body.tangent(u).toarray()
            difference = np.abs(clamped(body, u, TENSILE) - exact).max() / np.abs(exact).max()
            assert (difference < 1e-13) == same, (mesh.kind, amount)


@pytest.mark.parametrize("plane", ["strain", "stress", "membrane"])
def test_sheets_have_the_thickness_with_zero_stress_across(plane):
    """W of sheets is the energy in space at the thickness stretch with zero stress across.

    A root finder gives that stretch. In plane strain the stretch is 1.
    """
    mesh = membrane(3) if plane == "membrane" else sheet(3)
    law = law_on(mesh, None if plane == "membrane" else plane)
    u = 0.15 * state(mesh) - 0.2 * mesh.p.T.ravel()
    x = u.reshape(-1, mesh.d).T
    total = 0.0
    rest = base_vectors_at(mesh.p, mesh.t, mesh.element, np.full((1, 2), 1 / 3))[:, 0]
    now = base_vectors_at(mesh.p + x, mesh.t, mesh.element, np.full((1, 2), 1 / 3))[:, 0]
    for P, p, lam, mu in zip(rest, now, *lame(mesh), strict=True):
        P, p = (a if a.shape[0] == 2 else a.T for a in (P, p))  # rows are base vectors
        C = np.linalg.inv(P @ P.T) @ (p @ p.T)
        j, area = np.sqrt(np.linalg.det(C)), np.sqrt(np.linalg.det(P @ P.T)) / 2

        def slope(a, j=j, lam=lam, mu=mu):
            return mu * (a - 1 / a) + lam * (j * a - 1) * j

        a = 1.0 if plane == "strain" else brentq(slope, 1e-3, 1e3, xtol=1e-15, rtol=1e-14)
        total += 0.3 * area * (mu / 2 * (np.trace(C) + a * a - 3 - 2 * np.log(j * a)) + lam / 2 * (j * a - 1) ** 2)
    assert System(mesh, law).energy(u) == pytest.approx(total, rel=1e-12)


@pytest.mark.few
@pytest.mark.parametrize("name", EVERY)
def test_small_strains_have_the_linear_response_of_the_same_constants(name):
    """Small strains have the linear response to the last digits: at a strain of 1e-9 the energy is of order 1e-18."""
    mesh = EVERY[name]
    ours, linear = system(mesh), System(mesh, StVK(law_on(mesh).material, thickness=law_on(mesh).thickness))
    K, v = linear.tangent(np.zeros(mesh.p.size)), state(mesh)
    assert abs(ours.tangent(0 * v) - K).max() < 1e-13 * abs(K).max()
    for size in (1e-6, 1e-9):
        W, F, Kv = ours.energy(size * v), ours.internal_force(size * v), K @ v
        assert pytest.approx(v @ Kv / 2, rel=10 * size + 1e-12) == W / size**2
        assert np.abs(F / size - Kv).max() < (30 * size + 1e-11) * np.abs(Kv).max()


@pytest.mark.parametrize("s", [0.02, 0.4, 0.8, 1.3, 5.0, 300.0])
def test_a_block_between_walls_has_the_stress_of_the_closed_form(s):
    """W and F of confined compression and stretch are those of `P = mu (s - 1/s) + lam (s - 1)`."""
    mesh = MESHES["tetrahedra"]
    u = ((s - 1) * mesh.p * [[0], [0], [1]]).T.ravel()
    body, lam, mu = System(mesh, NeoHookean(Isotropic.from_lame(1.5, 0.7))), 1.5, 0.7
    volume = sizes_of(mesh.p, mesh.t, mesh.element).sum()
    assert body.energy(u) / volume == pytest.approx(mu / 2 * (s * s - 1 - 2 * np.log(s)) + lam / 2 * (s - 1) ** 2, rel=1e-12)
    work = body.internal_force(u) @ (mesh.p * [[0], [0], [1]]).T.ravel()
    assert work / volume == pytest.approx(mu * (s - 1 / s) + lam * (s - 1), rel=1e-12)


def test_states_with_inverted_elements_are_refused_and_steps_avoid_them():
    mesh = MESHES["tetrahedra"]
    region = np.arange(5, mesh.nt)
    body = System(mesh, [StVK(young=1.0, poisson=0.3), NeoHookean(young=1.0, poisson=0.3, region=region)])
    assert body.resists_inversion
    u = np.zeros((mesh.nv, 3))
    element = mesh.t[:, 40]
    centre = mesh.p[:, element[1:]].mean(axis=1)
    u[element[0]] = 1.05 * (centre - mesh.p[:, element[0]])
    wrong = np.flatnonzero(body.bound_terms[0].volume_ratios(u) <= 0)
    assert 40 in wrong
    for call in (body.energy, body.internal_force, body.tangent, body.linearize):
        with pytest.raises(StateError, match=r"element.*\b40\b.* inverted or flat .*NeoHookean is infinite.*step_limit"):
            call(u.ravel())
    limit = body.step_limit(0 * u.ravel(), u.ravel())
    assert 0.5 < limit < 1 and np.isfinite(body.energy(0.999 * limit * u.ravel()))
    flat = sheet(2)
    mirrored = (flat.p * [[-2], [0]]).T.ravel()
    for plane in ("strain", "stress"):
        with pytest.raises(StateError, match="inverted or flat"):
            System(flat, NeoHookean(young=1.0, poisson=0.3, plane=plane)).energy(mirrored)


def test_other_materials_and_segments_are_refused_with_a_remedy():
    wood = Orthotropic(young=(9, 1, 1), poisson=(0.3, 0.3, 0.3), shear=(1, 1, 1))
    fibres = TransverselyIsotropic(
        young_axial=14.0, young_transverse=1.0, poisson_axial=0.3, poisson_transverse=0.4, shear_axial=0.6
    )
    for material in (wood, fibres):
        with pytest.raises(
            MaterialError, match=rf"NeoHookean: material = {type(material).__name__}\(\.\.\.\); expected Isotropic.*use StVK"
        ):
            System(MESHES["tetrahedra"], NeoHookean(material))
    for name in ("segments", "cable"):
        with pytest.raises(MaterialError, match=r"segments\. Take StVK"):
            System(MESHES[name], NeoHookean(young=1.0, poisson=0.3))
    n = MESHES["triangles"].nt
    poisson = np.full(n, 0.2)
    poisson[7] = -0.1
    with pytest.raises(MaterialError, match=r"element \(7\): .*below 0"):
        System(MESHES["triangles"], NeoHookean(young=1.0, poisson=poisson))
    with pytest.raises(MaterialError, match="poisson"):
        System(MESHES["triangles"], NeoHookean(young=1.0, poisson=0.6, plane="stress"))


SEGMENTS = {name: MESHES[name] for name in ("segments", "cable")}
#: Laws with their meshes, and whether they act in inverted elements.
STRESSED = [
    *((NeoHookean, name, False) for name in EVERY),
    *((law, name, True) for law in (Corotated, InvertibleStVK) for name in ("tetrahedra", "triangles", "membrane", *SEGMENTS)),
]


@pytest.mark.few(8)
@pytest.mark.parametrize(("law", "name", "inverts"), STRESSED)
def test_stresses_and_energy_densities_are_those_of_the_forces(law, name, inverts):
    """The virtual work of the first Piola-Kirchhoff stress is that of the forces, and the densities add up to the energy.

    A second law acts on the same elements.
    """
    mesh = (EVERY | SEGMENTS)[name]
    x = mesh.p.ravel("F")
    for plane in (None, "stress") if mesh.k == mesh.d == 2 else (None,):
        own = law(law_on(mesh).material, plane=plane, **SECTION[mesh.k])
        body = System(mesh, [own, StVK(young=0.5, poisson=0.2, plane=plane, **SECTION[mesh.k])])
        states = [crushed(mesh, 0.3, 0.03).ravel()]
        if inverts:
            states += [1e-6 * state(mesh), 0.5 * state(mesh) - 1.6 * x * (np.arange(len(x)) % mesh.d == 0)]
        for u in states:
            now, F, v = Fields.of(body).at(u), body.internal_force(u), state(mesh, seed=9)
            assert now["strain_energy_density"] @ now.fields.volume == pytest.approx(
                body.energy(u), rel=1e-3 if "curved" in name else 1e-11
            )
            if mesh.element.is_linear_simplex:
                H = np.zeros((mesh.nt, 3, 3))
                H[:, : mesh.d, : mesh.d] = displacement_gradient_in_space(mesh, v)
                power = (now["pk1_stress"] * H).sum(axis=(1, 2)) @ now.fields.volume
                assert power == pytest.approx(F @ v, abs=1e-10 * np.abs(F) @ np.abs(v))
            if mesh.element.is_linear_simplex and mesh.k == 2 and (plane == "stress" or mesh.d == 3):
                across = np.linalg.svd(now["pk2_stress"])[1]
                assert (across[:, 2] < 1e-12 * across[:, 0]).all() and (np.linalg.eigvalsh(now["green_strain"])[:, 0] != 0).all()


def displacement_gradient_in_space(mesh, v):
    """Return the displacement gradient of linear simplices, zero across them, (nt, d, d)."""
    corners = v.reshape(-1, mesh.d)[mesh.t.T]
    vectors = mesh.p.T[mesh.t[1:].T] - mesh.p.T[mesh.t[:1].T]
    return np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2) @ np.swapaxes(np.linalg.pinv(vectors), 1, 2)


def test_messages_about_st_venant_kirchhoff_are_not_given_for_neo_hookean():
    mesh = MESHES["tetrahedra"]
    body = System(mesh, NeoHookean(young=1.0, poisson=0.3))
    u = -0.5 * mesh.p.T.ravel()
    assert [finding.name for finding in Monitors(body).at(u)] == []
    assert np.ma.getmaskarray(Fields.of(body).at(u)["smallest_acoustic_eigenvalue"]).all()
    u[: mesh.d] += 3.0
    with pytest.raises(StateError, match="inverted or flat"):
        Fields.of(body).at(u)["cauchy_stress"]


def block(law, n=3, amount=0.6):
    """Return a block with a fixed foot.

    The top is prescribed to move down by `amount` of the height until t = 1, without sliding.
    """
    mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)
    mesh = mesh.with_boundaries({"foot": lambda x: x[2] == 0, "top": lambda x: x[2] == 1})
    return System(mesh, law, fixed={"foot": "xyz", "top": "xy"}, prescribed={"top": {"z": -amount}})


def test_a_block_is_compressed_by_sixty_percent_and_stvk_stops_before():
    """The force grows up to 60 % compression. A solve with StVK stops near half of the compression, past its limit point."""
    found = solve_static(block(NeoHookean(young=1.0, poisson=0.3)), steps=6, quiet=True)
    assert found.success and 0 < found.system.smallest_volume_ratio(found.u) < 0.4
    force = -found.reaction("top").resultant[2]
    half = solve_static(block(NeoHookean(young=1.0, poisson=0.3), amount=0.3), steps=3, quiet=True)
    assert force > 2.5 * -half.reaction("top").resultant[2] > 0.9
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        other = solve_static(block(StVK(young=1.0, poisson=0.3)), steps=6, quiet=True, raise_on_failure=False)
    assert other.status is Status.STOPPED and 0.5 < other.t < 0.7
    assert "elements would invert" in other.message and "NeoHookean in place of StVK" in other.message


@pytest.mark.parametrize("integrator", [VelocityVerlet(), BackwardEuler(0.02), Newmark(0.02)])
def test_a_block_compressed_by_its_velocity_has_no_inverted_elements(integrator):
    mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 3)] * 3)
    body = System(mesh, NeoHookean(young=1.0, poisson=0.3, density=1.0))
    run = simulate(body, integrator, until=0.6, v0=(-1.2 * (mesh.p - 0.5)).T.ravel(), quiet=True)
    assert 0.05 < body.smallest_volume_ratio(run.u) < 0.6


@pytest.mark.few
@pytest.mark.parametrize("dtype", [np.float64, slow(np.float32)])
@pytest.mark.parametrize(("name", "rule"), COMPILED)
def test_the_work_of_the_mean_force_is_the_energy_difference(name, rule, dtype):
    mesh = EVERY[name]
    limit = 1e-11 if dtype == np.float64 else 3e-4
    u, v = crushed(mesh, 0.2, 0.03), 0.03 * state(mesh, seed=9).reshape(-1, mesh.d)
    for plane in (None, "stress") if mesh.k == mesh.d == 2 else (None,):
        term, force = bound(mesh, rule, plane, dtype), np.zeros(u.shape, dtype)
        gained = term.energy_and_force(u + v) - term.energy_and_force(u)
        R = term.mean_force(u, u + v, (0.3, 0.7), 0.5, force)
        assert R > 0 and np.vdot(force, v) == pytest.approx(gained + 0.4 * R, abs=limit * np.abs(force).ravel() @ np.abs(v).ravel())


def test_the_mean_force_of_rotations_and_of_tiny_steps():
    """The dissipation of a rigid rotation is zero at any angle, and the mean force of a tiny step is the force.

    The change of the energy is accurate only to its rounding.
    """
    mesh = MESHES["tetrahedra"]
    term, u = bound(mesh), crushed(mesh, 0.2, 0.03)
    rotation = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    now, moved = mesh.p.T + u, (mesh.p.T + u) @ rotation.T
    force, own = np.zeros_like(u), np.zeros_like(u)
    R = term.mean_force(u, moved - mesh.p.T, (0.5, 0.5), 0.5, force)
    term.energy_and_force(u, own)
    assert R < 1e-25 and np.abs(force - own @ (np.eye(3) + rotation).T / 2).max() < 1e-12 * np.abs(own).max() and now.any()
    for size in (1e-6, 1e-9, 1e-12, 1e-15):
        force[:] = 0
        term.mean_force(u, u + size * state(mesh).reshape(-1, 3), (0.5, 0.5), 0.5, force)
        assert np.abs(force - own).max() < (10 * size + 1e-10) * np.abs(own).max()


@pytest.mark.parametrize("name", ["block", "quadratic tetrahedra, curved", "membrane"])
def test_a_free_body_conserves_energy_and_momenta(name):
    """A free body that translates, rotates and vibrates conserves energy and momenta, because the force is a discrete gradient.

    With Newmark's method, which uses the force of single states, the energy drifts.
    """
    flat = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 3)] * 2, np.linspace(0, 2, 3))
    mesh = EVERY[name] if name in EVERY else System(flat, StVK(young=1.0, poisson=0.3)).mesh
    body = System(mesh, NeoHookean(young=50.0, poisson=0.3, density=1.0))
    x = mesh.p.T - mesh.p.mean(axis=1)
    v = (np.cross([0.5, 1.5, 3.0], x) + x * [0.5, -1.0, 1.5] + 0.3 * np.sin(9 * x) + [1.0, 2.0, 3.0]).ravel()
    ledger = simulate(body, EnergyMomentum(0.02), until=0.2, v0=v, quiet=True).ledger
    energy = ledger["total_energy"]
    assert np.ptp(ledger["strain_energy"]) > 0.01 * energy[0] and np.ptp(energy) < 1e-11 * energy[0]
    for axis in "xyz":
        for momentum in ("linear", "angular"):
            values = ledger[f"{momentum}_momentum_{axis}"]
            assert np.ptp(values) < 1e-10 * np.abs(values).max()
    assert np.ptp(simulate(body, Newmark(0.02), until=0.2, v0=v, quiet=True).ledger["total_energy"]) > 1e-5 * energy[0]


def test_removed_elements_may_be_inverted():
    """Removed elements may be inverted: they have no energy and no force, and fields do not evaluate them."""
    mesh = MESHES["tetrahedra"]
    body = System(mesh, NeoHookean(young=1.0, poisson=0.3, density=1.0))
    body = body.without(np.flatnonzero((mesh.t == 0).any(axis=0)))
    u, force = np.zeros((mesh.nv, 3)), np.zeros((mesh.nv, 3))
    u[0] = 5.0
    (term,) = body.bound_terms
    assert np.linalg.norm(mesh.p[:, 0]) < 1 and body.energy(u.ravel()) == 0
    assert term.mean_force(0 * u, u, (0.5, 0.5), 0.5, force) == 0 and not force.any()
    assert np.isfinite(Fields.of(body).at(u.ravel())["cauchy_stress"].filled(0)).all()
