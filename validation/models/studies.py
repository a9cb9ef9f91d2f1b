"""Comparisons of models, with their tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ..study import Study
from . import bars, motions
from .costs import Cost, cost_of
from .models import MODELS, NEO_HOOKEAN, TRUE


def bent(quick: bool) -> Study:
    """Compare the bar with a load at its end."""
    return at_rest(bars.BENT, quick)


def twisted(quick: bool) -> Study:
    """Compare the bar with a rotated end."""
    return at_rest(bars.TWISTED, quick)


def released(quick: bool) -> Study:
    """Compare the bar that falls from its clamp."""
    return in_motion("released", motions.released, quick)


def thrown(quick: bool) -> Study:
    """Compare the bar that spins freely."""
    return in_motion("thrown", motions.thrown, quick)


def at_rest(trial: bars.Trial, quick: bool) -> Study:
    """Compare a bar at rest under every model with StVK on the same mesh and with both references."""
    n, finest = (bars.QUICK_ACROSS, bars.QUICK_FINEST) if quick else (bars.ACROSS, bars.FINEST)
    truths = bars.true_stvk(trial, finest).measured, bars.true_neo_hookean(trial.name, finest)
    found = {model.name: bars.of_model(trial, model, n) for model in MODELS}
    same = found[TRUE.name].measured
    rows = []
    for model in MODELS:
        one = found[model.name]
        errors = [
            f"{bars.error(one.measured, truth):.1%}" if one.measured.shape == truth.shape else "-" for truth in (same, *truths)
        ]
        rows.append((model.name, *errors, str(one.iterations), f"{one.seconds:.2f}", one.said))
    return Study(
        f"A bar that is {trial.name}",
        "neo-Hookean by scikit-fem and StVK on fine meshes are close to each other at these strains; StVK and neo-Hookean converge",
        ("model", "StVK, same mesh", "StVK, fine", "neo-Hookean, fine", "iterations", "seconds", "said"),
        tuple(rows),
        tuple(_wrong(found, same, truths)),
        (
            f"linear tetrahedra with {n} cells across; fine meshes: quadratic tetrahedra with {finest} cells across, "
            f"StVK by this package and neo-Hookean by scikit-fem, which differ by {bars.error(*truths):.1%}",
        ),
    )


def _wrong(found: dict[str, bars.Found], same: np.ndarray, truths: Sequence[np.ndarray]) -> Iterator[str]:
    if not bars.error(*truths) < 0.2:
        yield f"difference of the references = {bars.error(*truths):.0%}; expected less than 20 %"
    for name in (TRUE.name, NEO_HOOKEAN.name):
        if not np.isfinite(found[name].measured).all():
            yield f"{name}: {found[name].said}"


def in_motion(name: str, motion: Callable[..., motions.Path], quick: bool) -> Study:
    """Compare the bar in motion under every model with StVK and neo-Hookean on the same mesh."""
    found = {model.name: motion(model, quick) for model in MODELS}
    truths = found[TRUE.name], found[NEO_HOOKEAN.name]
    rows, wrong = [], []
    for model in MODELS:
        path = found[model.name]
        apart = [f"{motions.off(path, truth):.1%}" for truth in truths]
        drifts = [f"{x:.0e}" if x == x else "-" for x in (path.energy, path.spin)]
        rows.append((model.name, *apart, *drifts, path.said))
        if path.energy > 1e-2:
            wrong.append(f"{model.name}: energy drifts by {path.energy:.0e} of the kinetic energy")
        if path.spin > 1e-9 and model.keeps_spin:
            wrong.append(f"{model.name}: angular momentum drifts by {path.spin:.0e}")
    return Study(
        f"A bar that is {name}",
        "every model conserves energy to 1 % of the kinetic energy, and models with balanced torques conserve angular momentum",
        ("model", "StVK", "neo-Hookean", "energy", "spin", "said"),
        tuple(rows),
        tuple(wrong),
        (f"largest distance of the end's paths over {motions.UNTIL:g} s, relative to the largest displacement; velocity Verlet",),
    )


def costs(quick: bool) -> Study:
    """Tabulate times, memory and stable steps of every model."""
    found: dict[str, Cost] = {model.name: cost_of(model, quick) for model in MODELS}
    usual = found[TRUE.name]
    rows = tuple(
        (
            name,
            *_shown(one.force, one.force / usual.force),
            *_shown(one.tangent, one.tangent / usual.tangent),
            *(_shown(value)[0] for value in (one.explicit, one.implicit, one.memory)),
            _shown(one.step / usual.step)[1],
        )
        for name, one in found.items()
    )
    return Study(
        "Cost of models",
        "",
        ("model", "W + F", "x StVK", "K", "x StVK's", "Verlet", "eq. 9", "bytes", "stable step"),
        rows,
        (),
        (
            "ns and bytes per tetrahedron, one thread: W and F together, K, a step of velocity Verlet and one of eq. 9, with their",
            "rows in the ledger; a stable step of 1 is StVK's",
        ),
    )


def _shown(value: float, ratio: float | None = None) -> tuple[str, str]:
    """Return a value as a whole number, and the ratio (or the value) with two decimals; "-" for NaN."""
    if value != value:
        return "-", "-"
    return f"{value:.0f}", f"{value if ratio is None else ratio:.2f}"
