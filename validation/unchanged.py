"""Bitwise comparison of F, K and whole runs of two versions of the package, to check that a change of structure changed no number.

    python validation/unchanged.py --record before.json              in a checkout of the version before
    python validation/unchanged.py --against before.json             in the other one, on the same machine

The first command writes a digest of the bytes of each result, with counts of iterations and the status. The second one compares.
Both run the package of the current folder through names that `skfem_stvk` exports and attributes that its pages document, so one
copy of this program runs in both. What only one of the versions has is named, and counts as no change. Solvers that are not
reproducible are left out.
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
    material: dict[str, Any] = {"young": 1e6, "poisson": 0.3, "density": 1e3}
    lying = stvk.RigidContact(stvk.RigidPlane((0, 0, -0.005), (0, 0, 1)), friction=stvk.Friction(0.3, slip_speed=0.1), name="floor")
    towards = stvk.RigidContact(
        stvk.RigidSphere((1.6, 0.5, 1.42), 0.5),
        stiffness=1e7,
        onset=0.01,
        motion=lambda t: (0, 0, -0.2 * t),
        friction=stvk.Friction(0.2, slip_length=0.01),
        name="ball",
    )
    blocks = skfem.MeshTet().refined(1) + skfem.MeshTet().refined(1).scaled(0.6).translated((0.2, 0.15, 1.02))
    blocks = blocks.with_subdomains({"table": lambda x: x[2] < 1, "cube": lambda x: x[2] > 1})
    soil, bottom = stvk.StVK(young=3e4, poisson=0.4, density=1e3), {lambda x: x[2] == 0: "xyz"}
    touch = stvk.MeshContact("table", "cube", distance=0.02, friction=stvk.Friction(0.4, slip_speed=0.1, slip_length=1e-3))
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
        "neo-Hooke": stvk.System(
            box, [stvk.NeoHookean(**material), gravity], fixed=held, prescribed={"right": {"x": lambda x, t: -0.4 * t}}
        ),
        "invertible": stvk.System(box, [stvk.InvertibleStVK(**material), gravity], fixed=held, prescribed={"right": {"x": -0.4}}),
        "corotated": stvk.System(box, [stvk.Corotated(**material), gravity], fixed=held),
        "corotated, at nodes": stvk.System(box, [stvk.Corotated(**material, rotation="vertex"), gravity], fixed=held),
        "linear": stvk.System(box, [stvk.LinearElastic(**material), gravity], fixed=held),
        "springs": stvk.System(box, [stvk.SpringNetwork(**material, rule="van-gelder"), gravity], fixed=held),
        "springs, penalty": stvk.System(box, [stvk.SpringNetwork(**material), stvk.VolumePenalty(), gravity], fixed=held),
        "lying": stvk.System(box, [one, gravity, lying]),
        "pressed by a ball": stvk.System(box, [one, towards], fixed=held),
        "blocks": stvk.System(blocks, [soil, gravity, touch], fixed=bottom),
        "pressed blocks": stvk.System(
            blocks, [soil, touch], fixed=bottom, prescribed={lambda x: x[2] > 1.6: {"x": 0.0, "y": 0.02, "z": -0.05}}
        ),
    }


def arrays(system: stvk.System) -> Iterator[tuple[str, str]]:
    """Yield digests of the quantities of a system in a state with large displacements, at 60 % of its loads."""
    rng = np.random.default_rng(1)
    h = 0.2 * np.abs(np.diff(system.mesh.p[:, system.mesh.t[:2]], axis=1)).mean()
    u = 0.05 * h * rng.normal(size=system.ndofs) + 0.1 * system.mesh.p.ravel("F")
    v = rng.normal(size=system.ndofs)
    d = len(system.mesh.p)
    left = (d * np.flatnonzero(system.mesh.p[0] == system.mesh.p[0].min())[:, None] + np.arange(d)).ravel()

    def entries(K: Any) -> str:
        return digest(K.data, K.indices, K.indptr)

    quantities: dict[str, Callable[[], str]] = {
        "W and F": lambda: digest(*system.energy_and_force(u), system.internal_force(u), system.energy(u)),
        "K": lambda: entries(system.tangent(u)),
        "W, F, K": lambda: digest(*system.linearize(u)[:2], system.linearize(u)[2].data),
        "jacobian": lambda: entries(system.jacobian(u, 0.6)),
        "residual": lambda: digest(system.residual(u, 0.6), system.external_force(u, 0.6)),
        "K v": lambda: digest(system.product(u, v), system.linear_operator(u) @ v),
        "energies": lambda: digest(*system.energies(u, 0.6).values()),
        "masses": lambda: digest(*(system.mass(kind).multiply(v) for kind in ("lumped", "consistent"))),
        "shape": lambda: digest(system.smallest_volume_ratio(u), system.inside_out(u)),
        "K free": lambda: entries(system.free_dofs(left).matrix(system.tangent(u))),
    }
    for name, quantity in quantities.items():
        try:
            yield name, quantity()
        except AttributeError as error:  # one of the versions does not have it
            print(f"{name} is left out: {error}", file=sys.stderr)
        except stvk.StvkError as error:
            yield name, f"{type(error).__name__}: {error}"


def static(name: str, fields: bool = True, **options: Any) -> Callable[[dict[str, stvk.System], Path], list[Any]]:
    """Return a function that runs a static solve and returns digests of its last state and fields, loads, iterations and status."""

    def run(all_bodies: dict[str, stvk.System], folder: Path) -> list[Any]:
        result = stvk.solve_static(all_bodies[name], quiet=True, raise_on_failure=False, **options)
        steps = result.history
        found = [digest(result.u), [step.t.hex() for step in steps], result.history.iterations, result.status.value]
        return [*found, digest(result.stress("cauchy"), result.reaction().resultant)] if fields else found

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


def reduced(all_bodies: dict[str, stvk.System], folder: Path) -> list[Any]:
    """Solve and move a reduced body."""
    whole = all_bodies["bricks"]
    weights = (whole.mesh.p[:, None, :] ** np.arange(1, 5)[:, None]).reshape(-1, whole.mesh.nv) * whole.mesh.p[0]  # 0 on the left
    snapshots = np.array([np.outer(weight, axis).ravel() for weight in weights for axis in 0.1 * np.eye(3)]).T
    body = stvk.ReducedSystem(whole, size=12, modes=0, snapshots=snapshots, quiet=True)  # modes are found by PARDISO where it is
    result = stvk.solve_static(body, steps=3, quiet=True)
    run = stvk.simulate(body, stvk.LinearBackwardEuler(dt=0.01), until=0.2, quiet=True)
    return [digest(result.u), result.history.iterations, digest(run.u, run.v), run.iterations]


def precomputed(all_bodies: dict[str, stvk.System], folder: Path) -> list[Any]:
    """Compute answers to displacements of a handle before they are asked."""
    grid = [0.0, 0.1], [-0.1, 0.1], [0.0]
    answers = stvk.PrecomputedResponse(all_bodies["bricks"], "right", grid, checks=2, solver="superlu", quiet=True)
    return [digest(*answers((0.05, 0.03, 0.0))), digest(answers.error.largest_force)]


def steps_of_a_loop(all_bodies: dict[str, stvk.System], folder: Path) -> list[Any]:
    """Push a body in single steps, go back to a copy of its state, and go on."""
    sim = stvk.Simulation(
        all_bodies["bricks, penalty"], stvk.BackwardEuler(dt=0.01), pushed=["right"], damping=stvk.Rayleigh(beta=1e-3)
    )
    for step in range(3):
        sim.step(right=(0.0, 0.0, -10.0 * step))
    saved = sim.copy_state()
    sim.step(right=(50.0, 0.0, 0.0))
    sim.restore(saved)
    sim.step(right=(0.0, 20.0, 0.0))
    return [digest(sim.u, sim.v, sim.mean("right"), sim.reaction("left")), sim.steps]


def removed(all_bodies: dict[str, stvk.System], folder: Path) -> list[Any]:
    """Compute W, F and K of a body without some of its elements."""
    cut = all_bodies["two materials"].without(np.arange(0, 900, 30))
    energy, force, K = cut.linearize(0.1 * cut.mesh.p.ravel("F"))
    return [digest(energy, force, K.data, K.indices)]


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
        "statics, neo-Hooke": static("neo-Hooke", steps=4, solver="superlu"),
        "statics, invertible": static("invertible", steps=4, solver="superlu"),
        "statics, corotated": static("corotated", steps=2, solver="superlu"),
        "statics, linear": static("linear", steps=2, solver="superlu"),
        "statics, springs": static("springs, penalty", fields=False, steps=2, solver="superlu"),
        "statics, curved": static("curved", steps=2, solver="block-jacobi-cg"),
        "statics, bricks": static("bricks", steps=2, solver="ssor-cg"),
        "statics, rigid contact": static("pressed by a ball", steps=4, solver="superlu"),
        "statics, contact of meshes": static("pressed blocks", steps=2, solver="superlu"),
        "VelocityVerlet, rigid contact": motion("lying", stvk.VelocityVerlet(), 0.02),
        "EnergyMomentum, rigid contact": motion("lying", stvk.EnergyMomentum(dt=0.005), 0.05),
        "BackwardEuler, contact of meshes": motion("blocks", stvk.BackwardEuler(dt=5e-3), 0.1),
        "EnergyMomentum, springs": motion("springs", stvk.EnergyMomentum(dt=0.01), 0.03),
        "Newmark, neo-Hooke": motion("neo-Hooke", stvk.Newmark(dt=0.01, solver="superlu"), 0.05),
        "LinearBackwardEuler, corotated at nodes": motion(
            "corotated, at nodes", stvk.LinearBackwardEuler(dt=0.01, solver="superlu"), 0.05
        ),
        "reduced": reduced,
        "precomputed response": precomputed,
        "steps of a loop": steps_of_a_loop,
        "elements removed": removed,
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
    print(f"the package of {Path(stvk.__file__).parent}", flush=True)
    found = everything()
    if given.record:
        Path(given.record).write_text(json.dumps(found, indent=1))
        return 0
    before = json.loads(Path(given.against).read_text())
    both = before.keys() & found.keys()
    other = [name for name in found if name in both and before[name] != found[name]]

    def only(results: dict[str, Any]) -> str:
        return ", ".join(sorted(results.keys() - both)) or "none"

    for name in other:
        print(f"{name}\n  before {before[name]}\n  now    {found[name]}")
    print(f"{len(both)} results, {len(both) - len(other)} bitwise identical; only before: {only(before)}; only now: {only(found)}")
    return bool(other)


if __name__ == "__main__":
    sys.exit(main())
