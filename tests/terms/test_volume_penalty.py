"""The volume penalty: its energies, the rule for its stiffness, its barrier, and the refused arguments."""

import re

import numpy as np
import pytest
from bodies import BODIES, MESHES, bar, box, some_voigt, state

from skfem_stvk import (
    Anisotropic,
    ElasticFoundation,
    ElementMesh,
    MaterialError,
    RegionError,
    StateError,
    StVK,
    StvkError,
    System,
    VolumePenalty,
    verify,
)
from skfem_stvk.edges import TENSILE
from skfem_stvk.kernels.volume_energies import COMPRESSION, QUADRATIC
from skfem_stvk.terms import Body
from skfem_stvk.terms.laws.volume_penalty import ENERGIES

SOLID = ("tetrahedra", "triangles", "segments")
WIDE = np.linspace(-2, 3, 501)
PSI = {
    "quadratic": lambda J: (J - 1) ** 2 / 2,
    "compression": lambda J: (1 - J) ** 3 / 3 if J < 1 else 0.0,
    "barrier": lambda J: -((J - 1) ** 2) * np.log(J) if J < 1 else 0.0,
}
KINDS = tuple(PSI)


def test_each_kind_has_a_closed_form():
    assert PSI.keys() == ENERGIES.keys(), "add a row psi(J) to PSI in tests/terms/test_volume_penalty.py"


@pytest.mark.filterwarnings("ignore:invalid value")
def test_energies_that_are_not_finite_where_elements_are_inverted_say_so():
    for kind, energy in ENERGIES.items():
        finite = np.isfinite(energy.density(np.array([-2.0, -1.5]))).all()
        assert finite == (not energy.infinite_energy), f"{kind}: expected infinite_energy = a message where psi is infinite"


def domain(kind):
    return WIDE[WIDE > 0] if ENERGIES[kind].infinite_energy else WIDE


@pytest.mark.few
@pytest.mark.parametrize(
    ("kind", "J"),
    [(kind, J) for kind in KINDS for J in (1.7, 1.0, 0.8, 0.3, 1e-3, -0.6) if J > 0 or not ENERGIES[kind].infinite_energy],
)
@pytest.mark.parametrize("name", SOLID)
def test_the_energy_is_k_psi_times_the_volume(name, J, kind):
    mesh, k = MESHES[name], np.random.default_rng(0).uniform(1, 5, MESHES[name].nt)
    gradient = np.linalg.qr(np.random.default_rng(1).standard_normal((mesh.d, mesh.d)))[0] * np.geomspace(1, 2, mesh.d)
    gradient[0] *= J / np.linalg.det(gradient)
    u = mesh.p.T @ (gradient.T - np.eye(mesh.d))
    section = {1: {"area": 0.3}, 2: {"thickness": 0.3}}.get(mesh.k, {})
    body = Body(mesh, [StVK(young=1.0, poisson=0.3, **section)])
    found = VolumePenalty(k, kind).bind(body).energy_and_force(u)
    assert found == pytest.approx((k * body.volumes).sum() * PSI[kind](J), rel=1e-11, abs=1e-14)


def volume_energies(kind, J):
    """Return `psi, psi', psi''` of `J` for a stiffness of 1."""
    if kind == QUADRATIC:
        return (J - 1) ** 2 / 2, J - 1, np.ones_like(J)
    J = np.minimum(J, 1)
    if kind == COMPRESSION:
        return (1 - J) ** 3 / 3, -((1 - J) ** 2), 2 * (1 - J)
    J = np.where(J > 0, J, 1)
    log = np.log(J)
    slope = 2 * (1 - J) * log - (J - 1) ** 2 / J
    return -((J - 1) ** 2) * log, slope, -2 * log + 4 * (1 - J) / J + ((J - 1) / J) ** 2


@pytest.mark.parametrize("kind", KINDS)
def test_the_energies_have_two_continuous_derivatives_and_the_second_is_never_negative(kind):
    J = domain(kind)
    psi, slope, curvature = volume_energies(ENERGIES[kind].number, J)
    assert psi == pytest.approx([PSI[kind](j) for j in J], rel=1e-13, abs=1e-15)
    assert ENERGIES[kind].density(J - 1) == pytest.approx(psi, rel=1e-9, abs=1e-15)
    assert ENERGIES[kind].slope(J - 1) == pytest.approx(slope, rel=1e-9, abs=1e-15)
    assert (psi >= 0).all() and (curvature >= 0).all() and curvature.max() > 0.5
    h, inner = 1e-5, J[(np.abs(J - 1) > 1e-3) & (J > 0.02)] if kind == "barrier" else J[np.abs(J - 1) > 1e-3]
    for n in (0, 1):
        low, high = (volume_energies(ENERGIES[kind].number, inner + s) for s in (-h, h))
        exact = volume_energies(ENERGIES[kind].number, inner)[n + 1]
        assert (high[n] - low[n]) / (2 * h) == pytest.approx(exact, rel=2e-6, abs=1e-8)
    around = volume_energies(ENERGIES[kind].number, 1 + np.array([-1e-9, 0, 1e-9]))
    assert around[0] == pytest.approx([0, 0, 0], abs=1e-15) and around[1] == pytest.approx([0, 0, 0], abs=2e-9)
    assert np.ptp(around[2]) < 1e-8


def confined_stiffness(kind, c, s):
    """Return the derivative of the nominal stress by the stretch s, divided by lam + 2 mu."""
    return (3 * s**2 - 1) / 2 + c * volume_energies(ENERGIES[kind].number, s)[2]


@pytest.mark.parametrize("kind", KINDS)
def test_the_rule_is_the_least_stiffness_without_a_limit_point_in_confined_compression(kind):
    s, c = np.linspace(1e-6, 1, 200_001), ENERGIES[kind].least
    assert confined_stiffness(kind, c, s).min() >= -2e-10
    assert confined_stiffness(kind, 0.9999 * c, s).min() < -1e-6


@pytest.mark.few
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("name", "term"),
    [
        ("tetrahedra", StVK(young=3.0, poisson=0.35)),
        ("triangles", StVK(young=3.0, poisson=0.35, thickness=0.2)),
        ("triangles", StVK(young=3.0, poisson=0.35, plane="stress")),
        ("segments", StVK(young=3.0, area=0.4)),
    ],
)
def test_the_least_stiffness_just_prevents_a_limit_point_in_confined_compression(name, term, kind):
    mesh = MESHES[name]
    axis = np.eye(mesh.d)[0]
    v = (mesh.p.T * axis).ravel()  # confined in all other directions
    least = VolumePenalty(kind=kind).moduli(Body(mesh, [term])) * ENERGIES[kind].least / ENERGIES[kind].usual
    s = np.linspace(0.02, 0.999, 50)
    lowest = []
    for factor in (1.0, 0.99):
        body = System(mesh, [term, VolumePenalty(factor * least, kind)])
        stiffness = [v @ (body.tangent((stretch - 1) * v) @ v) for stretch in s]
        lowest.append(min(stiffness) / max(stiffness))
    assert lowest[0] > -1e-12
    if kind != "quadratic":  # the limit point of the quadratic penalty is at s = 0
        assert lowest[1] < 0
    else:
        assert confined_stiffness(kind, 0.99 * ENERGIES[kind].least, np.array([0.02]))[0] < 0


def test_the_default_stiffness_follows_the_materials_of_the_elements():
    mesh = MESHES["tetrahedra"]
    rng, half = np.random.default_rng(0), np.arange(mesh.nt // 2)
    young, C = rng.uniform(1, 9, mesh.nt), some_voigt(rng)
    terms = [StVK(young=young, poisson=0.3), StVK(Anisotropic(C), region=half)]
    lam, mu = young * 0.3 / (1.3 * 0.4), young / 2.6
    wanted = lam + 2 * mu
    wanted[half] += C.diagonal()[:3].max()
    for kind in KINDS:
        found = VolumePenalty(kind=kind).moduli(Body(mesh, terms))
        assert found == pytest.approx(ENERGIES[kind].usual * wanted, rel=1e-13)
    region = rng.permutation(mesh.nt)[:20]
    assert VolumePenalty(region=region).moduli(Body(mesh, terms)) == pytest.approx(0.15 * wanted[region], rel=1e-13)


@pytest.mark.parametrize(
    ("kind", "percent"), [("compression", (9.4, 22, 40)), ("barrier", (5.7, 14.5, 29)), ("quadratic", (117, 139, 168))]
)
def test_the_contribution_of_the_default_to_the_stress_in_confined_compression(kind, percent):
    mesh = MESHES["tetrahedra"]
    stvk = StVK(young=3.0, poisson=0.3)
    for strain, wanted in zip((0.1, 0.2, 0.3), percent, strict=True):
        v = -(mesh.p.T * [1, 0, 0]).ravel()
        without, both = (System(mesh, terms).internal_force(strain * v) @ v for terms in (stvk, [stvk, VolumePenalty(kind=kind)]))
        assert 100 * (both / without - 1) == pytest.approx(wanted, rel=0.05)


@pytest.mark.parametrize("kind", ["quadratic", "compression"])
def test_at_the_documented_stiffness_a_mirrored_element_has_no_equilibrium(kind):
    """In uniaxial strain, a mirrored element has no equilibrium at or above the documented stiffness.

    Below that stiffness, the stress vanishes at some negative stretch.
    """
    k = {"quadratic": 1 / 8, "compression": 0.0858}[kind]
    s = np.linspace(-1.5, -1e-3, 20_001)
    slope = volume_energies(ENERGIES[kind].number, s)[1]
    assert ((s**3 - s) / 2 + 1.001 * k * slope).max() < 0 < ((s**3 - s) / 2 + 0.99 * k * slope).max()


@pytest.mark.parametrize("name", SOLID)
def test_at_rest_only_the_quadratic_penalty_changes_the_stiffness(name):
    mesh, rest = MESHES[name], np.zeros(MESHES[name].p.size)
    changed = [System(mesh, VolumePenalty(5.0, kind)).tangent(rest).data.any() for kind in ("compression", "barrier", "quadratic")]
    assert changed == [False, False, True]


@pytest.mark.parametrize("name", [name for name in SOLID if MESHES[name].k > 1])
def test_at_rest_the_quadratic_penalty_changes_the_stiffness_as_lambda_does(name):
    mesh, rest = MESHES[name], np.zeros(MESHES[name].p.size)
    lam, mu = 2.0, 0.7

    def with_lame(lam):
        return StVK(young=mu * (3 * lam + 2 * mu) / (lam + mu), poisson=lam / (2 * (lam + mu)))

    one = System(mesh, [with_lame(lam), VolumePenalty(1.5, "quadratic")]).tangent(rest)
    other = System(mesh, with_lame(lam + 1.5)).tangent(rest)
    assert abs(one - other).max() < 1e-13 * abs(other).max()


@pytest.mark.parametrize("name", SOLID)
def test_the_barrier_grows_without_bound_and_refuses_inverted_elements(name):
    mesh = MESHES[name]
    body = System(mesh, [StVK(young=1.0, poisson=0.3), VolumePenalty(kind="barrier")])
    v = -(mesh.p.T * np.eye(mesh.d)[0]).ravel()
    heights = [1e-1, 1e-2, 1e-4, 1e-8]
    assert (np.diff([body.energy((1 - h) * v) for h in heights]) > 0).all()
    assert np.abs(body.internal_force((1 - 1e-8) * v)).max() > 1e5
    calls = [
        body.energy,
        body.internal_force,
        body.energy_and_force,
        body.tangent,
        body.linearize,
        body.linear_operator,
        body.round_off,
        body.energies,
        body.residual,
        lambda u: body.product(u, u),
        lambda u: body.jacobian(u, kept=TENSILE),
    ]
    for u in (1.3 * v, 1.0 * v):
        for call in calls:
            with pytest.raises(StateError, match=rf"{mesh.nt} elements \(0, 1, 2, 3, 4, \.\.\.\) inverted or flat .* barrier"):
                call(u)
    assert np.isfinite(body.energy(0.5 * v))  # the earlier errors have no effect


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_the_barrier_names_the_elements_of_the_mesh(dtype):
    mesh = box(3)
    region = np.random.default_rng(2).permutation(mesh.nt)[:100]
    body = System(mesh, [StVK(young=1.0, poisson=0.3), VolumePenalty(kind="barrier", region=region)], dtype=dtype)
    term = body.bound_terms[1]
    for e in (region[0], region[57]):
        u = np.zeros((mesh.nv, 3))
        top, base = mesh.t[0, e], mesh.t[1:, e]
        u[top] = 1.05 * (mesh.p[:, base].mean(axis=1) - mesh.p[:, top])
        ids = np.sort(np.intersect1d(body.inside_out(u.ravel()), region))
        assert e in ids and len(ids) < 20
        with pytest.raises(StateError) as caught:
            body.energy(u.ravel())
        count, shown = re.match(r"(\d+) elements? \(([\d, ]+)", str(caught.value)).groups()
        assert int(count) == len(ids) and set(map(int, shown.strip(", ").split(", "))) <= set(ids.tolist())
        assert "Start without inverted elements" in str(caught.value) and 'kind="compression"' in str(caught.value)
        force = np.zeros((mesh.nv, 3), dtype)
        with pytest.raises(StateError):
            term.energy_and_force(u, force)
        assert not force.any()  # nothing is added before the error


def test_elements_outside_of_the_region_may_be_inverted():
    mesh = bar(6)
    body = System(mesh, [StVK(young=1.0), VolumePenalty(1.0, "barrier", np.arange(3))])
    u = np.zeros(mesh.nv)
    u[5] = 2 * (mesh.p[0, 4] - mesh.p[0, 5])
    assert 4 in body.inside_out(u) and body.energy(u) > 0


@pytest.mark.few
@pytest.mark.parametrize("size", [1e60, 1e110, 1e160, 1e300])
@pytest.mark.parametrize("kind", KINDS)
def test_overflow_is_an_error_and_not_nan(kind, size):
    """Overflow raises an error and returns no NaN, if part of the mesh is expanded and half of it inverted."""
    mesh = MESHES["tetrahedra"]
    body, u = System(mesh, VolumePenalty(1e-30, kind)), size * state(mesh)
    for call in (body.energy, body.internal_force, body.tangent, body.linearize, body.linear_operator):
        try:
            found = call(u)
        except StateError:
            continue
        if call == body.linearize:
            found = found[1]
        assert np.isfinite(getattr(found, "data", found)).all() if call != body.linear_operator else np.isfinite(found @ u).all()
    if size > 1e150:
        with pytest.raises(StateError):
            body.energy(u)


def test_a_tangent_with_only_a_finite_diagonal_is_refused():
    """A tangent with a finite diagonal and overflow elsewhere is refused.

    `psi'` overflows and `psi''` does not. The contribution of the pressure to K has no diagonal entries.
    """
    near = MESHES["tetrahedra"]
    body, u = System(ElementMesh(1e49 * near.p, near.t), VolumePenalty(1e-240, "quadratic")), 1e148 * state(near)
    (term,) = body.bound_terms
    data = np.zeros(body.pattern.nnz)
    term.fill(u.reshape(-1, 3), term.rows(body.pattern), data, False)
    K = body.pattern.matrix(data)
    assert np.isfinite(K.diagonal()).all() and not np.isfinite(data).all()
    with pytest.raises(StateError, match="K overflows"):
        body.tangent(u)


def test_the_quartic_is_refused_where_there_is_none():
    mesh = MESHES["tetrahedra"]
    plain, with_penalty = (
        System(mesh, terms) for terms in (StVK(young=1.0, poisson=0.3), [StVK(young=1.0, poisson=0.3), VolumePenalty()])
    )
    u = state(mesh)
    assert plain.quartic and not with_penalty.quartic
    assert plain.energy_along(u, u).shape == (5,)
    with pytest.raises(StvkError, match=r"not a quartic with a VolumePenalty .* Use energy_and_force"):
        with_penalty.energy_along(u, u)


def test_volumes_are_computed_once(monkeypatch):
    mesh = MESHES["tetrahedra"]
    half = np.arange(mesh.nt // 2)
    others = np.arange(mesh.nt // 3, mesh.nt)
    u = 4 * state(mesh)
    alone = System(mesh, StVK(young=1.0, poisson=0.3))
    cases = {
        1: [StVK(young=1.0, poisson=0.3), VolumePenalty(1.0), VolumePenalty(1.0, "quadratic", half)],
        2: [
            StVK(young=1.0, poisson=0.3, region=half),
            VolumePenalty(1.0, region=others),
            ElasticFoundation(lambda x: x[0] > -9, 1.0),
        ],
    }
    for count, terms in cases.items():
        body = System(mesh, terms)
        assert len(body._with_volume) == count
        assert np.array_equal(body.inside_out(u), alone.inside_out(u)) and len(body.inside_out(u)) > 3
        assert body.smallest_volume_ratio(u) == pytest.approx(alone.smallest_volume_ratio(u), rel=1e-14)
        assert body.step_limit(0 * u, u) == alone.step_limit(0 * u, u) < 1


def test_energies_by_term_add_up():
    mesh, terms = BODIES["tetrahedra, two regions"]
    body, u = System(mesh, [*terms, VolumePenalty(kind="compression")]), state(mesh)
    energies = body.energies(u)
    assert list(energies) == ["StVK 0", "StVK 1", "VolumePenalty 2"] and min(energies.values()) > 1e-4
    assert sum(energies.values()) == pytest.approx(body.energy(u), rel=1e-13)


@pytest.mark.parametrize("name", ["membrane", "cable", "cable in the plane"])
def test_elements_that_do_not_fill_their_space_are_refused(name):
    with pytest.raises(MaterialError, match=r"have no inside and no outside\. It is for tetrahedra"):
        System(MESHES[name], [StVK(young=1.0, poisson=0.3), VolumePenalty(1.0)])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stiffness": -1.0}, r"stiffness = -1.; expected values in \(0, inf\)"),
        ({"stiffness": 0.0}, "expected values in"),
        ({"stiffness": np.nan}, "finite values"),
        ({"stiffness": "stiff"}, "VolumePenalty: stiffness = 'stiff'; expected a number"),
        ({"stiffness": [[1.0, 2.0]]}, "has shape"),
        ({"kind": "cubic"}, "kind = 'cubic'; known: 'barrier', 'compression', 'quadratic'"),
        ({"kind": ["barrier"]}, "kind = "),
    ],
)
def test_invalid_options_are_refused(options, message):
    with pytest.raises(MaterialError, match=message):
        VolumePenalty(**options)


def test_options_that_do_not_fit_the_mesh_are_refused():
    mesh = MESHES["tetrahedra"]
    solid, part = StVK(young=1.0, poisson=0.3), StVK(young=1.0, poisson=0.3, region=np.arange(mesh.nt - 3))
    with pytest.raises(MaterialError, match=rf"stiffness has 3 values; expected .* {mesh.nt} elements"):
        System(mesh, [solid, VolumePenalty([1.0, 2.0, 3.0])])
    with pytest.raises(
        MaterialError, match=rf"3 elements \({mesh.nt - 3}, {mesh.nt - 2}, {mesh.nt - 1}\) without a material.* Give stiffness="
    ):
        System(mesh, [part, VolumePenalty()])
    assert System(mesh, [part, VolumePenalty(2.0, "compression")]).energy(state(mesh)) > 0
    with pytest.raises(RegionError, match="no subdomain 'core'"):
        System(mesh, [solid, VolumePenalty(1.0, region="core")])
    with pytest.raises(MaterialError, match="without a material"):
        VolumePenalty().bind(mesh)
    assert VolumePenalty(1.0).bind(mesh).energy_and_force(np.zeros((mesh.nv, 3))) == 0


def test_the_referee_refuses_a_volume_penalty():
    with pytest.raises(MaterialError, match="an object of type VolumePenalty; expected a material, StVK"):
        verify(MESHES["tetrahedra"], material=[StVK(young=1.0, poisson=0.3), VolumePenalty()])


def test_its_memory_is_counted():
    mesh = MESHES["tetrahedra"]
    one, two = (System(mesh, [StVK(young=1.0, poisson=0.3), *more]) for more in ((), (VolumePenalty(kind="compression"),)))
    for body in (one, two):
        body.tangent(state(mesh))
    assert two.memory()["elements"] > 1.5 * one.memory()["elements"]
    assert two.memory()["blocks of edges"] == 2 * one.memory()["blocks of edges"]
