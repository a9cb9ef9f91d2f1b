"""Bitwise comparison of F, K and whole runs of two versions of the package, to check that a change of structure changed no number.

    python validation/unchanged.py --record before.json              in a checkout of the version before
    python validation/unchanged.py --against before.json             in the other one, on the same machine

The first command writes a digest of the bytes of each result, with counts of iterations and the status. The second one compares.
Both run the package of the current folder through public names. Solvers that are not reproducible are left out.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, os.getcwd())

import numba
import numpy as np
import skfem

import skfem_stvk as stvk
from skfem_stvk.edges import NONE, TENSILE

THREADS = (1, 2)


def digest(*arrays: Any) -> str:
    """Return a digest of the bytes of the arrays in their own precision."""
    found = hashlib.sha256()
    for array in arrays:
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()[:16]


def bodies() -> dict[str, stvk.System]:
    """Return systems of all kinds of elements, materials, terms and loads."""
    box = skfem.MeshTet.init_tensor(*(np.linspace(0, s, n) for s, n in ((2, 17), (1, 9), (0.9, 8))))
    box = box.with_boundaries({"left": lambda x: x[0] == 0, "right": lambda x: x[0] == 2, "top": lambda x: x[2] == 0.9})
    p = box.p + 0.012 * np.random.default_rng(0).normal(size=box.p.shape) * (box.p > 0) * (box.p < [[2], [1], [0.9]])
    box = skfem.MeshTet(p, box.t).with_boundaries(box.boundaries)
    box = box.with_subdomains(
        {"soft": np.flatnonzero(box.p[0, box.t].mean(axis=0) < 1), "hard": np.flatnonzero(box.p[0, box.t].mean(axis=0) >= 1)}
    )
    soft, hard = (
        stvk.StVK(young=1e5, poisson=0.3, density=1e3, region="soft"),
        stvk.StVK(young=3e6, poisson=0.45, density=2e3, region="hard"),
    )
    one = stvk.StVK(young=1e6, poisson=0.3, density=1e3)
    wood = stvk.StVK(stvk.Orthotropic(young=(1e6, 2e5, 3e5), poisson=(0.3, 0.2, 0.1), shear=(1e5, 2e5, 1.5e5), density=600.0))
    plate = skfem.MeshTri.init_tensor(np.linspace(0, 1, 15), np.linspace(0, 0.3, 6)).with_boundaries(
        {"left": lambda x: x[0] == 0, "right": lambda x: x[0] == 1}
    )
    sheet = np.vstack([plate.p, 0.1 * np.sin(3 * plate.p[:1])])
    cable = np.vstack([np.linspace(0, 1, 21), 0.2 * np.linspace(-1, 1, 21) ** 2]), np.stack([np.arange(20), np.arange(1, 21)])
    held = {"left": "xyz"}
    large = skfem.MeshTet.init_tensor(*(np.linspace(0, s, n) for s, n in ((2, 41), (1, 21), (0.9, 18))))  # enough for two threads
    large = large.with_boundaries({"left": lambda x: x[0] == 0, "right": lambda x: x[0] == 2})
    gravity = stvk.Gravity(g=(0, 0, -9.81))
    line = np.linspace(0, 1, 6)
    bricks = skfem.MeshHex.init_tensor(2 * line, line, 0.9 * line)
    inner = (bricks.p > 0) & (bricks.p < [[2], [1], [0.9]])
    bricks = skfem.MeshHex(bricks.p + 0.03 * np.random.default_rng(2).normal(size=bricks.p.shape) * inner, bricks.t)
    bricks = bricks.with_boundaries({"left": lambda x: x[0] == 0, "right": lambda x: x[0] == 2})
    curved = stvk.ElementMesh.of(skfem.MeshTet.init_tensor(2 * line, line, 0.9 * line)).with_degree(2)
    bend = 0.02 * np.sin(3 * curved.p[[1, 2, 0]]) * (curved.p[0] > 1)
    curved = dataclasses.replace(curved, p=curved.p + bend)
    tiles = skfem.MeshQuad.init_tensor(2 * line, line).with_boundaries({"left": lambda x: x[0] == 0, "right": lambda x: x[0] == 2})
    bent = stvk.ElementMesh.of(plate).with_degree(2)
    return {
        "curved": stvk.System(curved, [one, gravity], fixed=[(np.flatnonzero(curved.p[0] == 0), "xyz")]),
        "curved, single": stvk.System(curved, [one, gravity], fixed=[(np.flatnonzero(curved.p[0] == 0), "xyz")], dtype=np.float32),
        "curved, wood": stvk.System(curved, [wood, stvk.VolumePenalty(), gravity], quadrature="exact"),
        "quadratic plate": stvk.System(
            bent, [stvk.StVK(young=1e6, poisson=0.4, density=1e3), stvk.BodyForce((0, -1e3))], fixed={"left": "xy"}
        ),
        "bricks": stvk.System(bricks, [one, gravity, stvk.Traction("right", (0, 0, -300.0))], fixed=held),
        "bricks, penalty": stvk.System(bricks, [one, stvk.VolumePenalty(), gravity], fixed=held),
        "bricks, one point": stvk.System(bricks, [one, gravity], fixed=held, quadrature="one-point", hourglass=0.05),
        "bricks, one point, penalty": stvk.System(
            bricks, [wood, stvk.VolumePenalty(), gravity], fixed=held, quadrature="one-point", hourglass=0.05
        ),
        "tiles, one point": stvk.System(
            tiles, stvk.StVK(young=1e6, poisson=0.4, density=1e3), fixed={"left": "xy"}, quadrature="one-point", hourglass=0.05
        ),
        "box": stvk.System(box, [one, gravity, stvk.Traction("right", (0, 0, -300.0))], fixed=held),
        "large": stvk.System(large, [one, gravity, stvk.Traction("right", (0, 0, -300.0))], fixed=held),
        "two materials": stvk.System(box, [soft, hard, gravity], fixed=held, prescribed={"right": {"x": 0.2}}),
        "wood": stvk.System(box, [wood, gravity], fixed=held),
        "penalty": stvk.System(
            box, [one, stvk.VolumePenalty(), gravity], fixed=held, prescribed={"right": {"x": lambda x, t: -0.4 * t}}
        ),
        "foundation": stvk.System(box, [one, stvk.ElasticFoundation("top", 1e4), gravity], fixed=held),
        "pressure": stvk.System(box, [one, stvk.Pressure("top", 4e3)], fixed=held),
        "single": stvk.System(box, [one, gravity], fixed=held, dtype=np.float32),
        "plate": stvk.System(
            plate, [stvk.StVK(young=1e6, poisson=0.4, density=1e3), stvk.BodyForce((0, -1e3))], fixed={"left": "xy"}
        ),
        "membrane": stvk.System(
            (sheet, plate.t),
            [stvk.StVK(young=1e6, poisson=0.4, thickness=0.01, density=1e3), gravity],
            fixed=[(np.flatnonzero(plate.p[0] < 0.08), "xyz")],
            prescribed=[(np.flatnonzero(plate.p[0] == 1), {"x": 0.1, "y": 0.0, "z": 0.0})],
        ),
        "cable": stvk.System(
            cable, [stvk.StVK(young=1e6, poisson=0.3, area=1e-3, density=1e3), stvk.Gravity(g=(0, -9.81))], fixed=[([0, 20], "xy")]
        ),
    }


def arrays(system: stvk.System) -> Iterator[tuple[str, str]]:
    """Yield digests of the quantities of a system in a state with large displacements, at 60 % of its loads."""
    rng = np.random.default_rng(1)
    h = 0.2 * np.abs(np.diff(system.mesh.p[:, system.mesh.t[:2]], axis=1)).mean()
    u = 0.05 * h * rng.normal(size=system.ndofs) + 0.1 * system.mesh.p.ravel("F")
    v = rng.normal(size=system.ndofs)
    energy, force = system.energy_and_force(u)
    yield "W and F", digest(energy, force, system.internal_force(u), system.energy(u))
    K = system.tangent(u)
    yield "K", digest(K.data, K.indices, K.indptr)
    energy, force, K = system.linearize(u)
    yield "W, F, K", digest(energy, force, K.data)
    yield (
        "jacobian",
        digest(system.jacobian(u, 0.6).data, system.jacobian(u, 0.6, kept=TENSILE).data, system.jacobian(u, 0.6, kept=NONE).data),
    )
    yield "residual", digest(system.residual(u, 0.6), system.external_force(u, 0.6))
    operator = system.linear_operator(u)
    yield "K v", digest(system.product(u, v), operator @ v, operator.diagonal_blocks())
    yield "round-off", digest(system.round_off(u))
    yield (
        "shape",
        digest(system.smallest_volume_ratio(u), system.step_limit(u, v), system.smallest_stretch(u), system.inside_out(u)),
    )
    free = system.free_dofs(system.supports.held)
    yield "K free", digest(free.matrix(K).data, free.structure.indices)


def static(name: str, **options: Any) -> Callable[[dict[str, stvk.System], Path], list[Any]]:
    """Return a function that runs a static solve and returns the digest of its states, iterations and status."""

    def run(all_bodies: dict[str, stvk.System], folder: Path) -> list[Any]:
        result = stvk.solve_static(all_bodies[name], quiet=True, raise_on_failure=False, **options)
        steps = result.history
        return [digest(result.u), [step.t.hex() for step in steps], result.history.iterations, result.status.value]

    return run


def resumed_static(all_bodies: dict[str, stvk.System], folder: Path) -> list[Any]:
    """Run a path that is stopped and resumed."""
    options: dict[str, Any] = {"method": "arc-length", "solver": "superlu", "quiet": True, "checkpoint": folder / "static"}
    stvk.solve_static(all_bodies["plate"], 8, stop=stvk.Stop(load=0.4), **options)
    result = stvk.solve_static(all_bodies["plate"], 8, stop=stvk.Stop(load=1.0), resume=True, **options)
    return [digest(result.u), result.history.iterations, result.status.value, len(result.history)]


def motion(name: str, integrator: Any, until: float, **options: Any) -> Callable[[dict[str, stvk.System], Path], list[Any]]:
    """Return a function that runs a motion and returns digests of its last state and ledger, iterations and status."""

    def run(all_bodies: dict[str, stvk.System], folder: Path) -> list[Any]:
        run = stvk.simulate(all_bodies[name], integrator, until=until, quiet=True, raise_on_failure=False, **options)
        ledger = [run.ledger[column] for column in sorted(run.ledger.names)]
        return [digest(run.u, run.v), digest(*ledger), run.iterations, run.ledger.steps, run.status.value]

    return run


def resumed_motion(name: str, integrator: Any, middle: float, until: float) -> Callable[[dict[str, stvk.System], Path], list[Any]]:
    """Return a function that runs a motion that is stopped and resumed."""

    def run(all_bodies: dict[str, stvk.System], folder: Path) -> list[Any]:
        checkpoint = folder / f"{integrator.name}-{name}"
        stvk.simulate(all_bodies[name], integrator, until=middle, quiet=True, checkpoint=checkpoint)
        run = stvk.simulate(all_bodies[name], until=until, quiet=True, checkpoint=checkpoint, resume=True)
        return [digest(run.u, run.v), run.iterations, run.ledger.steps, run.status.value]

    return run


def runs() -> dict[str, Callable[[dict[str, stvk.System], Path], list[Any]]]:
    """Return whole runs by name."""
    return {
        "statics, superlu": static("plate", steps=5, solver="superlu"),
        "statics, tets, superlu": static("box", steps=3, solver="superlu"),
        "statics, block-jacobi-cg": static("box", steps=3, solver="block-jacobi-cg"),
        "statics, large, block-jacobi-cg": static("large", steps=1, solver="block-jacobi-cg"),
        "statics, ssor-cg": static("two materials", steps=2, solver="ssor-cg"),
        "statics, one step, ssor-cg": static("box", steps=1, solver="ssor-cg", stability=True),
        "statics, penalty": static("penalty", steps=4, solver="block-jacobi-cg"),
        "statics, foundation": static("foundation", steps=2, solver="superlu"),
        "statics, pressure": static("pressure", steps=2, solver="superlu"),
        "statics, membrane": static("membrane", steps=4, solver="superlu"),
        "statics, cable": static("cable", steps=4, solver="superlu"),
        "arc length": static("plate", steps=10, solver="superlu", method="arc-length", stop=stvk.Stop(load=2.0)),
        "arc length, membrane": static("membrane", steps=10, solver="superlu", method="arc-length", stop=stvk.Stop(states=15)),
        "statics, resumed": resumed_static,
        "ForwardEuler": motion("box", stvk.ForwardEuler(dt=1e-5), 1e-3),
        "VelocityVerlet": motion("box", stvk.VelocityVerlet(), 0.1),
        "VelocityVerlet, large": motion("large", stvk.VelocityVerlet(), 0.02),
        "EnergyMomentum, large": motion("large", stvk.EnergyMomentum(dt=0.01), 0.02),
        "VelocityVerlet, damped": motion(
            "plate", stvk.VelocityVerlet(), 0.02, damping=[stvk.Rayleigh(1.0, 1e-5), stvk.EdgeDamping(1e-5)]
        ),
        "LinearBackwardEuler": motion("box", stvk.LinearBackwardEuler(dt=0.01), 0.1),
        "BackwardEuler": motion("box", stvk.BackwardEuler(dt=0.01), 0.05, damping=stvk.EdgeDamping(1e-3)),
        "Newmark, superlu": motion("plate", stvk.Newmark(dt=0.01, solver="superlu"), 0.2),
        "Newmark, diagonal": motion("plate", stvk.Newmark(dt=1e-4, tangent="diagonal"), 0.001),
        "GeneralizedAlpha": motion("box", stvk.GeneralizedAlpha(dt=0.01, solver="block-jacobi-cg"), 0.05),
        "EnergyMomentum, curved": motion("curved", stvk.EnergyMomentum(dt=0.01), 0.05, damping=stvk.EdgeDamping(1e-3)),
        "VelocityVerlet, bricks, one point": motion("bricks, one point", stvk.VelocityVerlet(), 0.02),
        "EnergyMomentum, bricks, one point": motion(
            "bricks, one point", stvk.EnergyMomentum(dt=0.01), 0.03, damping=stvk.EdgeDamping(1e-3)
        ),
        "EnergyMomentum": motion("box", stvk.EnergyMomentum(dt=0.01), 0.1),
        "EnergyMomentum, rest": motion(
            "plate", stvk.EnergyMomentum(dt=0.001, tangent="rest", solver="superlu"), 0.01, damping=stvk.Rayleigh(0.5, 1e-4)
        ),
        "EnergyMomentum, penalty": motion("penalty", stvk.EnergyMomentum(dt=0.01), 0.02),
        "VelocityVerlet, resumed": resumed_motion("box", stvk.VelocityVerlet(dt=2e-4), 0.02, 0.05),
        "Newmark, resumed": resumed_motion("plate", stvk.Newmark(dt=0.01, solver="superlu"), 0.1, 0.2),
    }


def everything() -> dict[str, Any]:
    """Return all digests by number of threads and name."""
    found: dict[str, Any] = {}
    for threads in THREADS:
        numba.set_num_threads(threads)
        all_bodies = bodies()
        for name, system in all_bodies.items():
            for what, value in arrays(system):
                found[f"{threads} | {name}: {what}"] = value
        modes = stvk.modes(all_bodies["plate"], 6)
        found[f"{threads} | modes"] = digest(modes.frequencies)
        found[f"{threads} | critical step"] = stvk.critical_step(all_bodies["box"]).step.hex()
        with tempfile.TemporaryDirectory() as folder:
            for name, run in runs().items():
                try:
                    found[f"{threads} | {name}"] = run(all_bodies, Path(folder))
                except stvk.StvkError as error:
                    found[f"{threads} | {name}"] = f"{type(error).__name__}: {error}"
                print(f"{threads} thread(s): {name}: {found[f'{threads} | {name}']}", flush=True)
    return found


def main() -> int:
    """Record, or compare; the exit code is 0 if nothing changed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--record", metavar="FILE")
    what.add_argument("--against", metavar="FILE")
    given = parser.parse_args()
    found = everything()
    if given.record:
        Path(given.record).write_text(json.dumps(found, indent=1))
        return 0
    before = json.loads(Path(given.against).read_text())
    other = [name for name in before | found if before.get(name) != found.get(name)]
    for name in other:
        print(f"{name}\n  before {before.get(name)}\n  now    {found.get(name)}")
    print(f"{len(found)} results, {len(found) - len(other)} bitwise identical")
    return bool(other)


if __name__ == "__main__":
    sys.exit(main())
