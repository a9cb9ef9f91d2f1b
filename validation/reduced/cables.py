"""Studies of cables, a net of cables and an inflated sphere against closed forms and independent equations of equilibrium."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq, root

from skfem_stvk import BackwardEuler, ElementMesh, Gravity, NodalLoad, Pressure, StVK, System, simulate, solve_static
from skfem_stvk.arguments import Array

from ..study import Study

#: The cable: length [m], weight per length [N/m], span [m] and height difference of its ends [m].
REST, WEIGHT, SPAN, DROP = 1.3, 2.0, 1.0, 0.2
G = 9.81
#: Stiffness `E A` of the cable over its weight.
RATIOS, QUICK_RATIOS = (1e1, 1e2, 1e3, 1e4, 1e5, 1e7), (1e2, 1e4)
SEGMENTS = 60
#: Ratio above which a damped motion provides the initial state of the static solve.
STIFF = 1e6
#: Largest number of cells along a net for which its own equations are also solved.
OWN = 8
YOUNG, POISSON, THICKNESS, STRETCH = 2e5, 0.3, 2e-3, 1.5


def stretch_of(tension: Array, stiffness: float) -> Array:
    """Return the stretch `s` of a St. Venant-Kirchhoff cable with the tension `T = E A (s^3 - s)/2 >= 0`."""
    s = np.maximum(1.0, np.cbrt(2 * tension / stiffness))
    for _ in range(60):
        s = s - ((s**3 - s) / 2 - tension / stiffness) / ((3 * s**2 - 1) / 2)
    return s


def hanging_cable(quick: bool) -> Iterable[Study]:
    """Yield the study of a cable under its own weight: the chain's own equations, the elastic and the inextensible catenary."""
    rows, wrong, off = [], [], []
    for ratio in QUICK_RATIOS if quick else RATIOS:
        stiffness = ratio * WEIGHT * REST
        body = chain(stiffness)
        start = {}
        if ratio > STIFF:
            start = {"u0": simulate(body, BackwardEuler(dt=0.02), until=4.0, quiet=True).u, "t0": 0.999}
        result = solve_static(body, quiet=True, **start)  # type: ignore[arg-type]
        x = body.mesh.p + result.u.reshape(-1, 2).T
        own = own_chain(body.mesh.p, stiffness)
        error = float(np.abs(x - own).max())
        elastic, rigid = lowest_point(stiffness), lowest_point(np.inf)
        sag = -float(x[1].min())
        off.append(abs(elastic - rigid) * ratio)
        rows.append(
            (f"{ratio:g}", f"{sag:.6f}", f"{elastic:.6f}", f"{rigid:.6f}", f"{(elastic - rigid) * ratio:.4f}", f"{error:.1e}")
        )
        if error > 1e-8 or abs(sag - elastic) > 1e-3:
            wrong.append(
                f"E A/(w L) = {ratio:g}: error against its own equations = {error:.1e}, against the elastic catenary = "
                f"{sag - elastic:.1e}"
            )
    if not quick and abs(off[-2] / off[-1] - 1) > 1e-3:
        wrong.append(f"the distance from the catenary is not proportional to 1/(E A): factors {off[-2]:.4g} and {off[-1]:.4g}")
    yield Study(
        "A hanging cable: lowest point [m]",
        "positions agree with the chain's own equations to 1e-8 m, and converge to the catenary as 1/(E A)",
        ("E A/(w L)", "computed", "elastic catenary", "catenary", "difference x E A/(w L)", "off own equations"),
        tuple(rows),
        tuple(wrong),
        (
            f"{SEGMENTS} unequal segments, {REST} m of cable between points {SPAN} m apart, one {DROP} m lower; the elastic "
            "catenary has the law of StVK, T = E A (s^3 - s)/2",
            f"above {STIFF:g}, a motion provides the initial state: simulate(body, BackwardEuler(dt=0.02), until=4.0)",
        ),
    )


def chain(stiffness: float) -> System:
    """Return a cable of unequal segments whose initial shape is a parabola of the same length."""
    s = np.linspace(0, 1, SEGMENTS + 1) ** 1.2

    def shape(sag: float) -> NDArray[np.float64]:
        return np.stack([SPAN * s, -DROP * s - 4 * sag * s * (1 - s)])

    sag = brentq(lambda a: np.hypot(*np.diff(shape(a))).sum() - REST, 1e-6, REST, xtol=1e-15)
    t = np.array([np.arange(SEGMENTS), np.arange(1, SEGMENTS + 1)])
    cable = StVK(young=stiffness / 1e-4, area=1e-4, density=WEIGHT / G / 1e-4, simplices=t)
    return System(shape(sag), [cable, Gravity(g=(0, -G))], fixed={(0, SEGMENTS): "xy"})


def own_chain(p: Array, stiffness: float) -> Array:
    """Return the nodes (2, n) of a chain with the same segments: tensions from its two equations of equilibrium, by shooting."""
    rest = np.hypot(*np.diff(p))
    weights = np.zeros(len(rest) + 1)
    weights[:-1] += WEIGHT * rest / 2
    weights[1:] += WEIGHT * rest / 2

    def nodes(first: Array) -> Array:
        pull = np.stack([np.full(len(rest), first[0]), first[1] + np.cumsum(weights[:-1])])
        size = np.hypot(*pull)
        steps = rest * stretch_of(size, stiffness) * pull / size
        return p[:, :1] + np.concatenate([np.zeros((2, 1)), np.cumsum(steps, axis=1)], axis=1)

    found = root(lambda first: nodes(first)[:, -1] - p[:, -1], [WEIGHT * REST / 3, -WEIGHT * REST / 1.8], method="hybr", tol=1e-14)
    return nodes(found.x)


def lowest_point(stiffness: float) -> float:
    """Return the depth of a continuous cable below its higher end [m].

    The cable is the elastic catenary of StVK; for infinite stiffness it is the catenary.
    """

    def stretch(tension: float) -> float:
        return 1.0 if np.isinf(stiffness) else float(stretch_of(np.array(tension), stiffness))

    def ends(first: Array) -> list[float]:
        across, down = first
        return [
            quad(lambda s: stretch(t := np.hypot(across, down + WEIGHT * s)) * across / t, 0, REST, epsabs=1e-13)[0] - SPAN,
            quad(lambda s: stretch(t := np.hypot(across, down + WEIGHT * s)) * (down + WEIGHT * s) / t, 0, REST, epsabs=1e-13)[0]
            + DROP,
        ]

    across, down = root(ends, [WEIGHT * REST / 3, -WEIGHT * REST / 1.8], tol=1e-13).x
    lowest = -down / WEIGHT
    fall = quad(lambda s: stretch(t := np.hypot(across, down + WEIGHT * s)) * (down + WEIGHT * s) / t, 0, lowest, epsabs=1e-13)[0]
    return -float(fall)


def cable_net(quick: bool) -> Iterable[Study]:
    """Yield the study of a flat net of cables without initial tension under loads at its nodes, by its own equations."""
    rows, wrong = [], []
    for cells in ((4, 3),) if quick else ((4, 3), (8, 6), (16, 12)):
        points, cables, rim, loads = net(cells)
        area = np.linspace(1e-6, 3e-6, cables.shape[1])
        inside = np.setdiff1d(np.arange(points.shape[1]), rim)
        body = System(
            points,
            [StVK(young=1e9, area=area, simplices=cables), NodalLoad(inside, loads[:, inside])],
            fixed={tuple(rim): "xyz"},
        )
        result = solve_static(body, rtol=1e-12, quiet=True)
        x = points + result.u.reshape(-1, 3).T
        own = unbalanced(x, points, cables, 1e9 * area, loads)
        balance = float(np.abs(own[:, inside]).max() / np.abs(loads).max())
        apart = np.nan
        if cells[0] <= OWN:
            apart = float(np.abs(own_net(points, cables, 1e9 * area, loads, inside) - x).max())
        sag = -float(result.u.reshape(-1, 3)[:, 2].min())
        rows.append((f"{cells[0]} x {cells[1]}", f"{cables.shape[1]}", f"{sag:.6f}", f"{balance:.1e}", f"{apart:.1e}"))
        if balance > 1e-7 or apart > 1e-7:
            wrong.append(f"{cells}: residual of the forces = {balance:.1e}, error of the nodes = {apart:.1e} m")
    yield Study(
        "A flat net of cables under loads at its nodes",
        "forces satisfy the net's own equations to 1e-7, and nodes agree to 1e-7 m with an independent solution of these equations",
        ("cells", "cables", "lowest point [m]", "out of balance", "nodes off [m]"),
        tuple(rows),
        tuple(wrong),
        (
            "no initial tension, so that K is singular at rest; cables with areas from 1 to 3 mm2, loads in all directions",
            f"the independent solution, by Powell's method, is computed up to {OWN} cells (nan: not computed)",
        ),
    )


def net(cells: tuple[int, int]) -> tuple[Array, NDArray[np.int64], NDArray[np.int64], Array]:
    """Return points (3, n), cables (2, m), nodes of the rim, and loads (3, n) [N] of a net."""
    rng = np.random.default_rng(3)
    nx, ny = cells
    x, y = np.meshgrid(np.linspace(0, 2, nx + 1), np.linspace(0, 1.5, ny + 1), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    ids = np.arange(x.size).reshape(x.shape)
    cables = np.concatenate([[ids[:-1].ravel(), ids[1:].ravel()], [ids[:, :-1].ravel(), ids[:, 1:].ravel()]], axis=1)
    inside = np.zeros(x.shape, dtype=bool)
    inside[1:-1, 1:-1] = True
    points[:2, inside.ravel()] += 0.1 / nx * rng.uniform(-1, 1, (2, int(inside.sum())))
    loads = np.zeros(points.shape)
    loads[:, inside.ravel()] = rng.uniform(-0.2, 0.2, (3, int(inside.sum()))) - np.array([[0.0], [0.0], [1.0]])
    return points, cables, np.flatnonzero(~inside.ravel()), 12.0 / (nx * ny) * loads


def unbalanced(x: Array, rest: Array, cables: Array, stiffness: Array, loads: Array) -> Array:
    """Return the residual force at each node (3, n) [N]: the load and the tensions `E A (s^3 - s)/2` of the cables."""
    along, length = x[:, cables[1]] - x[:, cables[0]], np.linalg.norm(rest[:, cables[1]] - rest[:, cables[0]], axis=0)
    now = np.linalg.norm(along, axis=0)
    s = now / length
    pull = stiffness * (s**3 - s) / 2 * along / now
    left = loads.copy()
    for axis in range(3):
        left[axis] += np.bincount(cables[0], pull[axis], x.shape[1]) - np.bincount(cables[1], pull[axis], x.shape[1])
    return left


def own_net(rest: Array, cables: Array, stiffness: Array, loads: Array, inside: NDArray[np.int64]) -> Array:
    """Return the nodes (3, n) of a net that satisfy its own equations of equilibrium, starting from a sagging net."""

    def left(free: Array) -> Array:
        return unbalanced(_with(rest, inside, free), rest, cables, stiffness, loads)[:, inside].ravel()

    begin = rest[:, inside] + 0.1 * np.array([[0], [0], [-1]])
    return _with(rest, inside, root(left, begin.ravel(), tol=1e-13).x)


def _with(points: Array, inside: NDArray[np.int64], free: Array) -> Array:
    x = points.copy()
    x[:, inside] = free.reshape(3, -1)
    return x


def inflated_sphere(quick: bool) -> Iterable[Study]:
    """Yield the study of an eighth of a sphere under pressure, compared with the closed form."""
    rows, wrong = [], []
    for degree in (1, 2):
        errors, sizes = [], (4, 8) if quick else (4, 8, 16, 32)
        for n in sizes:
            mesh = eighth(n, degree)
            body = System(
                mesh,
                [StVK(young=YOUNG, poisson=POISSON, thickness=THICKNESS), Pressure(None, -pressure_at(STRETCH))],
                fixed=[(np.flatnonzero(mesh.p[axis] < 1e-9), "xyz"[axis]) for axis in range(3)],
            )
            result = solve_static(body, steps=5, quiet=True)
            stretch = np.linalg.norm(mesh.p + result.u.reshape(-1, 3).T, axis=0)
            errors.append(float(np.sqrt(np.mean((stretch - STRETCH) ** 2)) / (STRETCH - 1)))
        order = np.log2(errors[-2] / errors[-1])
        rows.append((f"{degree}", *(f"{error:.2e}" for error in errors), f"{order:.2f}"))
        if order < (1.5 if quick else 1.9) + 0.9 * (degree - 1):
            wrong.append(f"degree {degree}: order {order:.2f}")
    yield Study(
        f"An inflated sphere: error of the stretch s = {STRETCH}, divided by s - 1",
        "the error has about order 2 for linear triangles and order 3 for quadratic triangles",
        ("degree", *(f"{n} edges" for n in sizes), "order"),
        tuple(rows),
        tuple(wrong),
        ("triangles on an eighth of a sphere, follower pressure; root of the mean square over the nodes",),
    )


def pressure_at(stretch: float) -> float:
    """Return `p = 2 N/(s r) = h E (s^2 - 1)/((1 - nu) s r)` [Pa] in the unit sphere at the stretch s, from `N = h S`."""
    return THICKNESS * YOUNG * (stretch**2 - 1) / ((1 - POISSON) * stretch)


def eighth(n: int, degree: int) -> ElementMesh:
    """Return an eighth of the unit sphere with `n` edges along each side and all nodes on the sphere."""
    grid = [(i, j) for i in range(n + 1) for j in range(n + 1 - i)]
    number = {ij: k for k, ij in enumerate(grid)}
    p = np.array([(i, j, n - i - j) for i, j in grid], dtype=float).T
    low = [(number[i, j], number[i + 1, j], number[i, j + 1]) for i, j in grid if i + j < n]
    high = [(number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]) for i, j in grid if i + j < n - 1]
    mesh = ElementMesh(p, np.array(low + high).T).with_degree(degree)
    return ElementMesh(mesh.p / np.linalg.norm(mesh.p, axis=0), mesh.t, element=mesh.element)
