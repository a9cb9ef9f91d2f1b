"""Steps of the integrators agree with their equations in dense NumPy."""

from types import SimpleNamespace

import numpy as np
import pytest
from dense import Dense, root
from motions import MESHES, Scene, material, moved, pushed, spinning, velocities
from slow import slow

from skfem_stvk import NodalLoad, System
from skfem_stvk.edges import TENSILE
from skfem_stvk.solvers.dynamics import (
    BackwardEuler,
    EdgeDamping,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    LinearBackwardEuler,
    Newmark,
    Rayleigh,
    VelocityVerlet,
)
from skfem_stvk.terms.loads.load import Moment

FACTORS = {"undamped": (0.0, 0.0, 0.0), "damped": (0.8, 0.02, 0.03), "alpha": (0.8, 0.0, 0.0)}
DT, STEPS, PUSHED = 0.02, 4, (5, 7)


class Textbook(Dense):
    """The motion of `scene` in dense matrices, with constants of its own."""

    def __init__(self, d, damping, consistent=False):
        rng, mesh = np.random.default_rng(5), MESHES[d]
        young, density = 3.0 * rng.uniform(0.7, 1.3, mesh.nt), rng.uniform(0.7, 1.3, mesh.nt)
        super().__init__(mesh, young, density, FACTORS[damping], consistent)
        left = np.unique(mesh.boundaries["left"])
        self.constrained = (d * left[:, None] + np.arange(d)).ravel()
        self.free = np.setdiff1d(np.arange(self.n), self.constrained)
        self.x, self.u0 = mesh.p[:, left], np.zeros(self.n)

    def h(self, t):
        forces = np.zeros((self.mesh.nv, self.mesh.d))
        forces[list(PUSHED)] = [0.04 * f for f in pushed(t)[: self.mesh.d]]
        return forces.ravel()

    def support(self, t):
        return np.stack(moved(self.x, t)[: self.mesh.d], axis=1).ravel()

    def speed(self, t, h):
        """Return the velocities of the supports at `t`, from the side of `h`."""
        return (4 * self.support(t + h) - self.support(t + 2 * h) - 3 * self.support(t)) / (2 * h)

    def start(self):
        u, v = self.u0.copy(), velocities(self.mesh)
        v[self.constrained] = self.speed(0.0, DT / 100)
        a = np.zeros(self.n)
        force = self.h(0.0) - self.resistance(u, v) - self.F(u)
        a[self.free] = np.linalg.solve(self.M[np.ix_(self.free, self.free)], force[self.free])
        return SimpleNamespace(t=0.0, u=u, v=v, a=a)

    def run(self, step):
        state = self.start()
        for number in range(STEPS):
            t = (number + 1) * DT
            w = DT * state.v
            w[self.constrained] = self.support(t) - state.u[self.constrained]
            step(self, state, w, t)
            state.t = t
        return state


def scene(d, damping):
    alpha, beta, tau = FACTORS[damping]
    pull = NodalLoad(PUSHED, lambda t: [0.04 * f for f in pushed(t)[:d]])
    mesh = MESHES[d]
    system = System(mesh, [material(mesh), pull], prescribed={"left": lambda x, t: moved(x, t)[:d]})
    return Scene(system, velocities(mesh), [Rayleigh(alpha, beta), EdgeDamping(tau)])


def forward_euler(it, state, w, t):
    """Make a step of eq. 4."""
    acceleration = (it.h(t) - it.D(state.u) @ state.v - it.F(state.u))[it.free] / np.diag(it.M)[it.free]
    v = w / DT
    v[it.free] = state.v[it.free] + DT * acceleration
    state.u, state.v = state.u + DT * v, v


def velocity_verlet(it, state, w, t):
    half, m = state.v + DT / 2 * state.a, np.diag(it.M)
    v = np.zeros(it.n)
    v[it.constrained] = it.speed(t, -DT / 100)
    state.u = state.u + w
    state.u[it.free] += (DT * half - w)[it.free]
    v[it.free] = (half + DT / 2 * state.a)[it.free]
    a = np.zeros(it.n)
    a[it.free] = ((it.h(t) - it.resistance(state.u, v) - it.F(state.u)) / m)[it.free]
    v[it.free] = (half + DT / 2 * a)[it.free]
    state.v, state.a = v, a


def linear_backward_euler(tangent):
    """Return a step of eq. 9 with this tangent."""

    def step(it, state, w, t):
        K = tangent(it, state.u)
        A, b = it.M / DT**2 + it.D(state.u) / DT + K, it.h(t) - it.F(state.u) + it.M @ state.v / DT
        f, s = it.free, it.constrained
        w[f] = np.linalg.solve(A[np.ix_(f, f)], b[f] - A[np.ix_(f, s)] @ w[s])
        state.v = w / DT
        state.u = state.u + DT * state.v

    return step


def solved(residual, ends, speeds=None):
    """Return a step that solves an equation for `w`; `ends` returns the new velocities and accelerations from `w`.

    With the `speeds` of supports, they are led by other displacements than those that are prescribed.
    """

    def step(it, state, w, t):
        def led(w):
            """Return `w` with the displacements that lead to the velocities of the supports."""
            w = w.copy()
            if speeds is not None:
                w[it.constrained] = speeds(state, it.speed(t, -DT / 100), it.constrained)
            return w

        w = root(lambda w: residual(it, state, w, led(w), t), w, it.free)
        u = state.u + w
        state.v, state.a = (np.asarray(x) for x in ends(state, led(w)))
        state.u = u

    return step


def backward_euler(it, state, w, _, t):
    u = state.u + w
    edges = it.tau / DT * it.pull(u, it.strain(u) - it.strain(state.u))
    return it.M @ (w - DT * state.v) / DT**2 + it.linear_resistance(w / DT) + edges + it.F(u) - it.h(t)


def energy_momentum(it, state, w, led, t):
    middle, before, after = state.u + w / 2, it.strain(state.u), it.strain(state.u + w)
    internal = it.pull(middle, (before + after) / 2) + it.tau / DT * it.pull(middle, after - before)
    return 2 * it.M @ (led / DT - state.v) / DT + it.linear_resistance(w / DT) + internal - (it.h(state.t) + it.h(t)) / 2


def newmark_ends(beta, gamma):
    def ends(state, w):
        a = (w - DT * state.v - DT**2 * (0.5 - beta) * state.a) / (beta * DT**2)
        return state.v + DT * ((1 - gamma) * state.a + gamma * a), a

    return ends


def newmark_speeds(beta, gamma):
    """Return the displacements that lead to the velocities `v1` of supports: `a1 = ((v1 - v)/T - (1 - gamma) a)/gamma`."""

    def speeds(state, v1, s):
        v, a = state.v[s], state.a[s]
        a1 = ((v1 - v) / DT - (1 - gamma) * a) / gamma
        return DT * v + DT**2 * ((0.5 - beta) * a + beta * a1)

    return speeds


def newmark(beta, gamma):
    def residual(it, state, w, led, t):
        v, a = newmark_ends(beta, gamma)(state, led)
        return it.M @ a + it.resistance(state.u + w, v) + it.F(state.u + w) - it.h(t)

    return solved(residual, newmark_ends(beta, gamma), newmark_speeds(beta, gamma))


def generalized_alpha(rho):
    alpha_m, alpha_f = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    factors = (1 - alpha_m + alpha_f) ** 2 / 4, 0.5 - alpha_m + alpha_f
    ends = newmark_ends(*factors)

    def residual(it, state, w, led, t):
        v, a = ends(state, led)
        after = it.resistance(state.u + w, v) + it.F(state.u + w) - it.h(t)
        before = it.resistance(state.u, state.v) + it.F(state.u) - it.h(state.t)
        return it.M @ ((1 - alpha_m) * a + alpha_m * state.a) + (1 - alpha_f) * after + alpha_f * before

    return solved(residual, ends, newmark_speeds(*factors))


TIGHT = {"rtol": 1e-12}
EQUATIONS = {
    "ForwardEuler": (ForwardEuler(DT), forward_euler),
    "VelocityVerlet": (VelocityVerlet(DT), velocity_verlet),
    "eq. 9": (LinearBackwardEuler(DT, **TIGHT), linear_backward_euler(lambda it, u: it.K(u))),
    "eq. 9, factorised": (LinearBackwardEuler(DT, solver="superlu"), linear_backward_euler(lambda it, u: it.K(u))),
    "eq. 9, Gauss-Newton": (
        LinearBackwardEuler(DT, tangent="gauss-newton", **TIGHT),
        linear_backward_euler(lambda it, u: it.gauss_newton(u)),
    ),
    "BackwardEuler": (BackwardEuler(DT, **TIGHT), solved(backward_euler, lambda state, w: (w / DT, state.a))),
    "Newmark": (Newmark(DT, **TIGHT), newmark(0.25, 0.5)),
    "Newmark, damped": (Newmark(DT, beta=0.3025, gamma=0.6, **TIGHT), newmark(0.3025, 0.6)),
    **{f"GeneralizedAlpha, {rho}": (GeneralizedAlpha(DT, rho=rho, **TIGHT), generalized_alpha(rho)) for rho in (0, 0.3, 0.8, 1)},
    "EnergyMomentum": (
        EnergyMomentum(DT, **TIGHT),
        solved(
            energy_momentum,
            lambda state, w: (2 * w / DT - state.v, state.a),
            lambda state, v1, s: DT * (v1 + state.v[s]) / 2,
        ),
    ),
}


BY_MASS = [(name, False) for name in EQUATIONS] + [(name, True) for name, (one, _) in EQUATIONS.items() if not one.explicit]


@pytest.mark.few(12)
@pytest.mark.parametrize("damping", ["undamped", "damped"])
@pytest.mark.parametrize("d", [slow(2), 3])
@pytest.mark.parametrize(("name", "consistent"), BY_MASS)
def test_steps_are_those_of_the_equation(name, d, damping, consistent):
    integrator, step = EQUATIONS[name]
    expected = Textbook(d, damping, consistent).run(step)
    run = scene(d, damping).run(integrator, STEPS * DT, mass="consistent" if consistent else None)
    for name in "uv":
        found, wanted = getattr(run, name), getattr(expected, name)
        assert np.abs(found - wanted).max() < 1e-8 * np.abs(wanted).max(), name


def blocks(K, d):
    """Return the diagonal blocks of a matrix."""
    return K * np.kron(np.eye(len(K) // d), np.ones((d, d)))


def clamped(it, u):
    """Return K without negative tensions of edges."""
    return System(it.mesh, material(it.mesh)).jacobian(u, kept=TENSILE).toarray()


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(
    ("tangent", "damping", "matrix"),
    [
        ("clamped", "damped", clamped),
        ("diagonal", "alpha", lambda it, u: blocks(it.K(u), it.mesh.d)),
        ("rest", "alpha", lambda it, u: it.K0),
    ],
)
def test_other_tangents_solve_their_version_of_equation_9(tangent, damping, matrix, d):
    run = spinning_textbook(d, damping)
    integrator = LinearBackwardEuler(DT, tangent=tangent, rtol=1e-12)
    alpha, beta, tau = FACTORS[damping]
    found = spinning(d, damping=[Rayleigh(alpha, beta), EdgeDamping(tau)]).run(integrator, STEPS * DT, u0=run.u0)
    expected = run.run(linear_backward_euler(matrix))
    assert np.abs(found.v - expected.v).max() < 1e-9 * np.abs(expected.v).max()


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("d", [2, 3])
def test_backward_euler_minimises_the_incremental_potential(d, mass):
    alpha, beta, _ = FACTORS["damped"]
    body = scene(d, "undamped")._replace(damping=Rayleigh(alpha, beta))
    system, rng = body.system, np.random.default_rng(d)
    before, after = (body.run(BackwardEuler(DT, **TIGHT), steps * DT, mass=mass) for steps in (3, 4))
    M, K0 = system.mass(mass).matrix, system.tangent(np.zeros(system.ndofs))
    load = system.external_force(after.u, Moment(after.t, 1.0))

    def cost(w):
        ahead = w - DT * before.v
        losses = w @ (alpha * (M @ w) + beta * (K0 @ w)) / (2 * DT)
        return system.energy(before.u + w) - load @ w + ahead @ (M @ ahead) / (2 * DT**2) + losses

    w, free = after.u - before.u, system.free_dofs(system.supports.held).free
    lowest = cost(w)
    slopes = {}
    for size in (1e-4, 1e-2, 0.2):
        steps = np.zeros((20, system.ndofs))
        steps[:, free] = size * rng.standard_normal((20, len(free)))
        ahead, back = (np.array([cost(w + sign * p) for p in steps]) for sign in (1, -1))
        assert min(ahead.min(), back.min()) > lowest
        slopes[size] = (np.abs(ahead - back) / (ahead + back - 2 * lowest)).max()
    assert slopes[1e-4] < 1e-4  # the remainder is of third order


def spinning_textbook(d, damping):
    """Return a free body without loads."""
    it = Textbook(d, damping)
    it.constrained, it.free, it.x = it.constrained[:0], np.arange(it.n), it.x[:, :0]
    it.h, it.u0 = lambda t: np.zeros(it.n), 0.05 * np.cos(np.arange(it.n))
    return it
