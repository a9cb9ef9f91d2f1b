"""Runner of the comparisons of models, with their tables and pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from time import perf_counter

import numpy as np
from rich.console import Console

from skfem_stvk.terminal import WIDTH

from ..statics.study import Study
from . import bars, motions, pictures, recoveries
from .costs import Cost, cost_of
from .models import MODELS, NEO_HOOKEAN, TRUE

#: Known results that the study must reproduce: the largest error of a model against StVK on the same mesh.
SAME = {"StVK": 1e-12}


def run(names: Sequence[str], quick: bool, out: str | None) -> int:
    """Run the named studies, print them and write pictures to the folder `out`. The exit code is 0 if all claims hold."""
    folder = None if out is None else Path(out)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    studies: dict[str, Callable[[], Study]] = {
        "bent": lambda: at_rest(bars.BENT, quick, folder),
        "twisted": lambda: at_rest(bars.TWISTED, quick, folder),
        "released": lambda: in_motion("released", motions.released, quick, folder),
        "thrown": lambda: in_motion("thrown", motions.thrown, quick, folder),
        "recoveries": lambda: recovered(quick),
        "random-starts": lambda: from_random_starts(quick),
        "costs": lambda: costs(quick, folder),
    }
    console, failed = Console(width=WIDTH, highlight=False), []
    for name in names:
        start = perf_counter()
        study = studies[name]()
        console.print(study.rendered())
        failed += [] if study.passed else [study.name]
        console.print(f"{name}: {perf_counter() - start:.1f} s\n")
    console.print(f"DOES NOT HOLD: {', '.join(failed)}" if failed else "all claims hold")
    return 1 if failed else 0


def at_rest(trial: bars.Trial, quick: bool, folder: Path | None = None) -> Study:
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
    drawn = (
        () if folder is None else (pictures.side_by_side(bars.bar(n), {m: found[m.name].u for m in MODELS}, folder, trial.name),)
    )
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
        drawn,
    )


def _wrong(found: dict[str, bars.Found], same: np.ndarray, truths: Sequence[np.ndarray]) -> Iterator[str]:
    if not bars.error(*truths) < 0.2:
        yield f"difference of the references = {bars.error(*truths):.0%}; expected less than 20 %"
    for name in (TRUE.name, NEO_HOOKEAN.name):
        if not np.isfinite(found[name].measured).all():
            yield f"{name}: {found[name].said}"


def in_motion(name: str, motion: Callable[..., motions.Path], quick: bool, folder: Path | None = None) -> Study:
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
    drawn = () if folder is None else (pictures.paths(found, folder, name),)
    return Study(
        f"A bar that is {name}",
        "every model conserves energy to 1 % of the kinetic energy, and models with balanced torques conserve angular momentum",
        ("model", "StVK", "neo-Hookean", "energy", "spin", "said"),
        tuple(rows),
        tuple(wrong),
        (f"largest distance of the end's paths over {motions.UNTIL:g} s, relative to the largest displacement; velocity Verlet",),
        drawn,
    )


def recovered(quick: bool) -> Study:
    """Test whether a body comes back to rest from starts with inverted, flat or mirrored elements."""
    mesh = recoveries.box(recoveries.QUICK_CELLS if quick else recoveries.CELLS)
    starts = recoveries.starts(mesh) | recoveries.exact_starts(mesh)
    found = {
        model.name: {name: recoveries.at_rest(model, mesh, u0) for name, u0 in starts.items()} for model in recoveries.models()
    }
    wrong = [
        f"{model} from {name}: {one}"
        for model, several in found.items()
        for name, one in several.items()
        if not (one.back or one.folded) and model in recoveries.COME_BACK
    ]
    return Study(
        "Starts that are inverted, flat or mirrored",
        f"{' and '.join(recoveries.COME_BACK)} come back from all starts, to rest or to another stable state without inverted "
        "elements",
        ("start", *found),
        tuple((name, *(str(several[name]) for several in found.values())) for name in starts),
        tuple(wrong),
        (f"{mesh.nt} tetrahedra clamped at one face, without loads: one static solve from each start, and its iterations",),
    )


def from_random_starts(quick: bool) -> Study:
    """Count the outcomes of static solves from random starts, by law and element."""
    seeds = recoveries.QUICK_SEEDS if quick else recoveries.SEEDS
    rows, wrong = [], []
    laws = [model for model in MODELS if model.name in recoveries.COME_BACK]
    for model in laws:
        for name, degree, linear_first in (("linear", 1, False), ("quadratic", 2, False), ("quadratic, linear first", 2, True)):
            counts = recoveries.random_starts(model, degree, seeds, linear_first)
            rows.append((f"{model.name}, {name}", *(str(counts[end]) for end in recoveries.ENDS)))
            if counts[recoveries.SADDLE] or (counts[recoveries.INVERTED] and name != "quadratic"):
                wrong.append(f"{rows[-1][0]}: {dict(counts)}")
    return Study(
        "Random starts",
        "no solve ends at a saddle point, and no solve of linear elements ends with inverted elements",
        ("law and elements", *recoveries.ENDS),
        tuple(rows),
        tuple(wrong),
        (
            f"{seeds} starts each of {6 * recoveries.FEW_CELLS**3} tetrahedra clamped at one face, without loads: "
            "all nodes at random positions",
            "stable: all eigenvalues of K are positive; linear first: start from the state of linear elements on the corners",
        ),
    )


def costs(quick: bool, folder: Path | None = None) -> Study:
    """Tabulate times, memory and stable steps of every model, and plot error of the bent bar against time if there is a folder."""
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
    drawn = () if folder is None else (pictures.speed_against_error(found, folder, quick),)
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
        drawn,
    )


def _shown(value: float, ratio: float | None = None) -> tuple[str, str]:
    """Return a value as a whole number, and the ratio (or the value) with two decimals; "-" for NaN."""
    if value != value:
        return "-", "-"
    return f"{value:.0f}", f"{value if ratio is None else ratio:.2f}"
