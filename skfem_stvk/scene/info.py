"""What would be built of a scene or of a mesh, what it would cost, and what is wrong with it: before anything runs."""

from __future__ import annotations

import itertools
import time
import tracemalloc
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field
from rich.console import Group, RenderableType
from scipy.linalg import eigh
from scipy.spatial import cKDTree

from ..arguments import Array
from ..dynamics import EdgeDamping, Integrator, Rayleigh, critical_elements, critical_step, modes, simulate
from ..errors import MaterialError, StvkError, StvkWarning, name_ids
from ..kernels.threads import threads
from ..kernels.topology import edges_of_simplices
from ..linear import LinearSolver, Unknowns
from ..linear.choose import choose, why
from ..mesh import ElementMesh, MeshQuality, mesh_quality
from ..mesh.facets import facet_ids
from ..mesh.quality import Extreme
from ..referee.terminal import grid, printable
from ..system import FreeOperator, System
from ..system.free_tangent import FreeTangent, entries_of, kind_of, with_loads
from ..system.rigid import rigid_modes, rigid_modes_left
from ..terms import StVK
from .build import Built
from .run import on_threads
from .scene import Scene
from .units import UNITS, implausible

#: Of a body with more rigid motions than so many, as one in pieces, eigenfrequencies are not looked for; those that are a smaller
#: part of the largest than that are of mechanisms.
LOOSE, MECHANISM = 60, 1e-6
#: Unknowns up to which a factorisation is measured on the whole body, and not on a part of it; SuperLU fills in more.
WHOLE, WHOLE_BY_SUPERLU, PART = 60_000, 9_000, 6_000
#: Of a first sample, which compiles kernels and loads packages.
SMALL = 300
#: How times of factorisations grow with the number of unknowns, by the dimension of the elements: least and largest power.
GROWTH = {1: (1.0, 1.1), 2: (1.2, 1.6), 3: (1.7, 2.2)}
#: Powers by which memory of factors grows.
FILL = {1: 1.0, 2: 1.1, 3: 1.35}
#: Up to so many unknowns eigenfrequencies are computed; beyond, they are bounded from above.
FEW = 6_000
#: Newton's iterations of a load step, or of a step in time: usual ones, few and many.
ITERATIONS = 3, 6
#: Residual of linear solves in most of them.
PRECISION = 1e-4
#: Modes are found with about so many solves.
SOLVES = 100
#: Steps of a motion that are run to measure one.
EXPLICIT_STEPS, IMPLICIT_STEPS = 50, 2
#: A sample that takes longer is not run a second time [s].
PATIENCE = 2.0
#: Of explicit steps that are found, as a part of the critical one.
SAFETY = 0.85
#: Numbers in the stiffnesses of all elements beyond which those that make steps short are not looked for: some 2 GB.
MOST_NUMBERS = 8e7
#: Elements that allow a smaller part of the step that usual ones allow are worth a remark.
SHORT = 0.2
#: Degree of the polynomials whose span bounds eigenfrequencies.
DEGREE = 3


class Fact(NamedTuple):
    """A row of a table: its name, a number or a text, its unit, and what is to be said of it."""

    name: str
    value: Any
    unit: str = ""
    note: str = ""

    @property
    def shown(self) -> str:
        """The value with its unit."""
        parts = self.value if isinstance(self.value, list | tuple) else [self.value]
        joined = (" ... " if self.name in RANGES else ", ").join(map(_shown, parts))
        return f"{joined} {self.unit}".strip()


#: Facts that are ranges, from the least to the largest.
RANGES = ("estimated time", "estimated time of a state")


class Remark(NamedTuple):
    """What is wrong or doubtful, in a sentence with what to do; `refused`: nothing is run like that."""

    name: str
    text: str
    refused: bool = False


@dataclass
class Inspection:
    """What would be built, and what is wrong with it.

    Attributes
    ----------
    units : the system of units.
    facts : tables of facts, by title.
    extremes : the worst elements, by measure.
    remarks : what is wrong or doubtful, what is refused first.
    k : dimension of the elements.
    """

    units: str
    facts: dict[str, list[Fact]] = field(default_factory=dict)
    extremes: list[Extreme] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
    k: int = 3

    @property
    def refused(self) -> bool:
        """Whether nothing is run like that."""
        return any(remark.refused for remark in self.remarks)

    def to_dict(self) -> dict[str, Any]:
        """All of it in lists, texts and numbers, in the units of the scene, as JSON has them."""
        facts = {title: {fact.name: _plain(fact.value) for fact in rows} for title, rows in self.facts.items()}
        worst = {
            one.name: {"median": _plain(one.median), "elements": list(one.elements), "values": _plain(one.values)}
            for one in self.extremes
        }
        return {"units": self.units, **facts, "worst elements": worst, "remarks": [remark._asdict() for remark in self.remarks]}

    def rendered(self, width: int) -> RenderableType:
        """Tables for a rich console of this width; what is wrong stands at the end, where it is seen."""
        parts: list[RenderableType] = []
        for title, rows in self.facts.items():
            table = grid(title, "name", "value", "remark")
            table.show_header = False
            for fact in rows:
                table.add_row(printable(fact.name), printable(fact.shown), printable(fact.note))
            parts.append(table)
        if self.extremes:
            table = grid("worst elements", "measure", "worst", "median", "elements", right=("worst", "median"))
            for one in self.extremes:
                unit = self._unit(one)
                shown = ", ".join(map(str, one.elements[: 5 if width >= 90 else 3]))
                table.add_row(one.name, f"{one.value:.4g}{unit}", f"{one.median:.4g}{unit}", shown)
            parts.append(table)
        for remark in self.remarks:
            style, word = ("bold red", "refused") if remark.refused else ("yellow", "note")
            parts.append(f"[{style}]{word}[/] {printable(remark.text)}")
        if not self.remarks:
            parts.append("[green]nothing wrong was found[/]")
        return Group(*parts)

    def _unit(self, one: Extreme) -> str:
        length = UNITS[self.units].symbol("length")
        return {"length": f" {length}", "size": f" {_power(length, self.k)}", "angle": "°"}.get(one.dimension, "")


def inspect_mesh(
    mesh: ElementMesh, *, young: float | None = None, poisson: float | None = None, density: float | None = None
) -> Inspection:
    """A mesh, and the free body of one material that it would be: nothing is held, nothing acts on it.

    Parameters
    ----------
    young, poisson, density : of the material [Pa, -, kg/m^3]; without them the mesh alone is looked at.

    Never fails for a mesh that no body can be made of: it says why.
    """
    look = _Look(Inspection("SI"))
    look.mesh(mesh)
    with look.part("units"):
        given = _Given(materials={"given": _Material(young=young, density=density)})
        look.implausible([text.replace("materials.given.", "--") for text in implausible(given, mesh)])
    if young is None:
        look.remark("material", "Without a material the mesh alone is looked at; add --young, --poisson and --density.")
    elif not look.found.refused:
        with look.part("body", refused=True):
            system = System(mesh, StVK(young=young, poisson=poisson, density=density))
            look.body(system, [f"stvk, E = {young:g} Pa, nu = {poisson}"])
    return look.done()


def inspect_scene(scene: Scene) -> Inspection:
    """A scene: its mesh and body, what the analysis would cost, and whether its values are plausible. It never fails for a mesh."""
    sections = scene.sections
    look = _Look(Inspection(sections.units))
    built, mesh = None, None
    with look.part("scene", refused=True):
        built = scene.built
    with look.part("mesh", refused=True):
        mesh = sections.mesh.mesh(scene.source.folder) if built is None else built.mesh
        look.mesh(mesh, () if built is None else [body.mesh for body in built.system.body.beside])
    with look.part("units"):
        look.implausible(implausible(sections, mesh))
    if built is None:
        return look.done()
    materials = [getattr(term, "material", None) for term in sections.terms]
    terms = [term.type + (f" of {name}" if name else "") for term, name in zip(sections.terms, materials, strict=True)]
    with on_threads(sections.threads):
        look.body(built.system, terms, built)
    return look.done()


class _Material(BaseModel):
    """A material that a mesh is given, with the dimensions of its values."""

    young: Annotated[float | None, Field(json_schema_extra={"dimension": "stress"})]
    density: Annotated[float | None, Field(json_schema_extra={"dimension": "density"})]


class _Given(BaseModel):
    """What is given beside a mesh, as a scene has it."""

    materials: dict[str, _Material]


class _Look:
    """Looks at one thing after the other; what fails is a remark, and the rest goes on."""

    def __init__(self, found: Inspection) -> None:
        self.found, self._symbol = found, UNITS[found.units].symbol
        self._modes: tuple[int, float] | None = None  # how many were found, and how long that took [s]

    def add(self, title: str, *facts: Fact) -> None:
        """Add rows to a table."""
        self.found.facts.setdefault(title, []).extend(facts)

    def remark(self, name: str, text: str, refused: bool = False) -> None:
        """Add a remark, once."""
        if text not in [remark.text for remark in self.found.remarks]:
            self.found.remarks.append(Remark(name, text, refused))

    def implausible(self, texts: list[str]) -> None:
        """Remarks on values that are not plausible."""
        for text in texts:
            self.remark("implausible", text)

    def done(self) -> Inspection:
        """What was found, what is refused first."""
        self.found.remarks.sort(key=lambda remark: not remark.refused)
        return self.found

    @contextmanager
    def part(self, name: str, refused: bool = False) -> Iterator[None]:
        """Go on where something fails or warns, and say so."""
        with warnings.catch_warnings(record=True) as noted:
            warnings.simplefilter("always")
            try:
                yield
            except Exception as error:  # whatever is wrong with a body, the rest of what is known of it is told
                said = str(error) if isinstance(error, StvkError) else f"{type(error).__name__}: {error}"
                self.remark(name, said if refused else f"{name} could not be looked at: {said}", refused)
        for warning in noted:
            if issubclass(warning.category, StvkWarning):
                self.remark(name, str(warning.message))

    # the mesh

    def mesh(self, mesh: ElementMesh, others: Sequence[ElementMesh] = ()) -> None:
        """Counts, sizes, groups and qualities of a mesh; the `others` are on the same nodes."""
        length, self.found.k = self._symbol("length"), mesh.k
        self.add("mesh", Fact("elements", mesh.nt, "", mesh.kind), Fact("nodes", mesh.nv))
        with self.part("edges"):
            edges = edges_of_simplices(np.ascontiguousarray(mesh.corners, dtype=np.int32), np.array(mesh.element.edges), mesh.nv)
            self.add("mesh", Fact("edges", edges[0].shape[1]))
            if mesh.element.is_linear_simplex and mesh.k > 1:
                faces = mesh.nt if mesh.k == 2 else int(facet_ids(mesh).max()) + 1
                opposite = 3 * mesh.nt if mesh.k == 3 else 0
                self.add("mesh", Fact("TSEPs", 3 * faces + opposite, "", "pairs of edges that share an element"))
        with self.part("quality"):
            quality = mesh_quality(mesh, others)
            finite = mesh.p[:, np.isfinite(mesh.p).all(axis=0)]
            if finite.size:
                low, high = finite.min(axis=1), finite.max(axis=1)
                self.add("mesh", Fact("size of the box", (high - low).tolist(), length, f"from {_shown(low)} to {_shown(high)}"))
            self._quality(quality, length)
        units = {"boundaries": "facets", "lines": "segments", "node sets": mesh.words, "subdomains": "elements"}
        for title, unit in units.items():
            if groups := getattr(mesh, title.replace(" ", "_")):
                self.add(title, *(Fact(name, int(np.shape(ids)[-1]), unit) for name, ids in groups.items()))

    def _quality(self, quality: MeshQuality, length: str) -> None:
        mesh = quality.mesh
        whole = float(np.nansum(quality.size))
        self.add("mesh", Fact(("length", "area", "volume")[mesh.k - 1], whole, _power(length, mesh.k)))
        self.add("mesh", Fact("parts", len(quality.parts), "", "each needs its own supports" if len(quality.parts) > 1 else ""))
        if mesh.k == mesh.d:
            self.add("mesh", Fact("turned round", int(quality.turned.sum()), "elements", "harmless"))
        self.found.extremes = quality.extremes()
        for fault in quality.faults:
            self.remark(fault.name, fault.text, fault.refused)

    # the body

    def body(self, system: System, terms: list[str], built: Built | None = None) -> None:
        """What is solved for, what it weighs, how fast it vibrates, and what an analysis costs."""
        held = len(system.supports.held)
        self.add("body", Fact("unknowns", system.ndofs - held, "free", f"and {held} held"))
        self.add("body", *(Fact(f"terms[{number}]", term) for number, term in enumerate(terms)))
        beside = [body.mesh for body in system.body.beside]
        self.add("body", *(Fact(f"{one.element.name} beside the mesh", one.nt) for one in beside))
        loose, has_mass = 0, True
        try:
            self.add("body", Fact("mass", system.mass().total, self._symbol("mass")))
        except MaterialError as error:
            has_mass = False
            why_not = str(error).partition(". ")[0]
            self.add("body", Fact("mass", "unknown", "", f"and eigenfrequencies and explicit steps: {why_not}"))
        with self.part("supports"):
            loose = self._loose(system, built)
        if has_mass:
            with self.part("eigenfrequencies"):
                self._frequencies(system, loose)
            with self.part("critical step"):
                self._critical(system, built)
        with self.part("time and memory"):
            self._costs(system, loose, built)

    def _loose(self, system: System, built: Built | None) -> int:
        """How many rigid motions are left to the parts of the body."""
        held = np.union1d(system.supports.held, system.grounded)
        left = rigid_modes_left(system.mesh.p, system.parts(), held, system.mesh.word)
        count = sum(one.count for one in left)
        self.add("body", Fact("rigid motions left", count))
        if left and built is not None and built.sections.analysis.type in ("static", "arc-length"):
            self.remark("supports", f"Statics need a body that is held: {'; '.join(map(str, left[:3]))}. Hold it there.", True)
        return count

    def _frequencies(self, system: System, loose: int) -> None:
        unit, free = self._symbol("frequency"), system.ndofs - len(system.supports.held)
        if loose > LOOSE:
            return
        if free <= FEW:
            begin = time.perf_counter()
            found = modes(system, min(loose + 4, free))
            self._modes = len(found), time.perf_counter() - begin
            if found.unstable.any():
                self.remark("eigenfrequencies", "At rest K has negative eigenvalues: a material or a load is not stable there.")
            elastic = found.frequencies[~found.rigid & ~found.unstable]
            elastic = elastic[elastic > MECHANISM * elastic.max(initial=0.0)]
            note = "the lowest ones"
        else:
            elastic, note = _ritz_frequencies(system), "upper bounds on the lowest ones, by polynomials"
        if len(elastic):
            self.add("body", Fact("eigenfrequencies", [float(one) for one in elastic[:3]], unit, f"{note}; are they plausible?"))

    def _critical(self, system: System, built: Built | None) -> None:
        integrator = None if built is None else built.integrator
        explicit, unit = integrator is not None and integrator.explicit, self._symbol("time")
        motion: Any = built.sections.analysis if built is not None and explicit else None
        damped: list[Rayleigh | EdgeDamping] = []
        if motion is not None:  # as it counts for stability
            weight, damping = getattr(integrator, "damping_weight", 1.0), motion.damping
            damped = [Rayleigh(weight * damping.alpha, weight * damping.beta), EdgeDamping(weight * damping.tau)]
        found = critical_step(system, None if built is None else built.u0, damping=damped or None)
        self.add("explicit steps", Fact("critical step", found.step, unit, "the largest stable one, at the first state"))
        dt = None if motion is None else motion.dt
        if dt is not None and dt > found.step:
            text = f"analysis.dt = {dt:g} {unit} is above the critical step, {found.step:.4g} {unit}: the motion will blow up. "
            self.remark(
                "critical step", f"{text}Take {SAFETY * found.step:.2g}, leave dt out to have it found, or an implicit integrator."
            )
        mesh = system.mesh
        if mesh.nt * (mesh.element.n * mesh.d) ** 2 > MOST_NUMBERS:
            self.add("explicit steps", Fact("elements that set it", "not looked for", "", "there are too many elements"))
            return
        try:
            worst = critical_elements(system, 5)
        except StvkError as error:
            self.add("explicit steps", Fact("elements that set it", "none", "", str(error)))
            return
        usual, steps = float(np.median(worst.every[np.isfinite(worst.every)])), worst.steps.tolist()
        self.add(
            "explicit steps",
            Fact("elements that set it", worst.elements.tolist(), "", f"the first allows {_shown(steps[0])} {unit} at most"),
            Fact("usual elements allow", usual, unit, "at most, the median"),
        )
        bad = np.flatnonzero(worst.every < SHORT * usual)
        if len(bad):
            named = name_ids(bad[np.argsort(worst.every[bad], kind="stable")], "element")
            self.remark(
                "critical step",
                f"{named}: explicit steps have to be {usual / steps[0]:.3g} times as short as usual elements allow. Remesh there, "
                "remove the detail, or take an implicit integrator.",
            )

    # what it costs

    def _costs(self, system: System, loose: int, built: Built | None) -> None:
        u = 1e-3 * system.mesh.p.T.ravel()
        force = _best(lambda: system.internal_force(u))
        self.add("costs", Fact("threads", threads()), Fact("a force F", force, "s", "measured"))
        integrator = None if built is None else built.integrator
        if integrator is None or not integrator.explicit:
            K = system.tangent(u)
            stiffness = _best(lambda: system.tangent(u, out=K))
            self.add("costs", Fact("a tangent K", stiffness, "s", "measured"))
            self.add("memory", Fact("K", _megabytes(K.data.nbytes + K.indices.nbytes + K.indptr.nbytes), "MB"))
        if built is not None and integrator is not None:
            with self.part("motion", refused=True):
                self._motion(system, built, integrator)
        else:
            kind = "static" if built is None else built.sections.analysis.type
            self._solves(system, loose, built, kind, force + stiffness)
        parts = system.memory()
        held = sum(fact.value for fact in self.found.facts.get("memory", []))
        self.add("memory", Fact("in all", held + _megabytes(sum(parts.values())), "MB"))
        self.add("memory", *(Fact(name, _megabytes(size), "MB") for name, size in parts.items() if size > 0))

    def _solves(self, system: System, loose: int, built: Built | None, kind: str, assembly: float) -> None:
        """Measure one factorisation and one solve, and multiply."""
        asked = "auto" if built is None else built.sections.solver.name
        free, indefinite, entries = system.ndofs - len(system.supports.held), kind in ("arc-length", "modes"), entries_of(system)
        chosen = with_loads(choose(asked, free, kind_of(system), indefinite, entries), system)
        self.add("costs", Fact("linear solver", chosen.name, "", why(asked, free, kind_of(system), indefinite, entries)))
        sample = _measured(system, chosen, loose)
        least, largest = sample.scaled(sample.factor)
        how = "measured" if sample.whole else f"scaled from {sample.n} unknowns of it, which took {_shown(sample.factor)} s"
        self.add("costs", Fact("a factorisation", _range(least, largest), "s", how), Fact("a solve", sample.scaled_solve, "s"))
        self.add("memory", Fact("factors", _megabytes(sample.memory), "MB", "" if sample.whole else "estimated"))
        if built is None:
            return
        analysis: Any = built.sections.analysis
        one, most = assembly + least + sample.scaled_solve, assembly + largest + 2 * sample.scaled_solve
        few, many = (1, 2) if system.constant_tangent else ITERATIONS
        if kind == "static":
            facts = [Fact("estimated time", [few * min(analysis.steps, 2) * one, many * (analysis.steps + 2) * most], "s")]
            note = f"{few} to {many} iterations per load step"
        elif kind == "modes":
            low, high = least + SOLVES / 2 * sample.scaled_solve, most + 2 * SOLVES * sample.scaled_solve
            note = f"{SOLVES // 2} to {2 * SOLVES} solves"
            if self._modes is not None:
                number, seconds = self._modes
                low, high, note = 0.3 * seconds, 3 * seconds * max(1.0, analysis.n / number), f"{number} of them were found"
            facts = [Fact("estimated time", [low, high], "s")]
        else:
            facts, note = (
                [Fact("estimated time of a state", [few * one, 3 * many * most], "s")],
                "how many states depends on the path",
            )
            if analysis.stop.states is not None:
                states = analysis.stop.states
                facts, note = [Fact("estimated time", [few * one * states, 3 * many * most * states], "s")], f"{states} states"
        self.add("costs", *(fact._replace(note=note) for fact in facts))

    def _motion(self, system: System, built: Built, integrator: Integrator) -> None:
        """Run a few steps, and multiply."""
        analysis: Any = built.sections.analysis
        initial = built.sections.initial
        dt = analysis.dt
        if dt is None:
            step = critical_step(system, built.u0).step
            dt = SAFETY * step
        if built.solver:
            self.add(
                "costs",
                Fact("linear solver", built.solver, "", "of the integrator" if built.sections.solver.name == "auto" else ""),
            )

        def run(steps: int) -> tuple[float, int, Any]:
            begin = time.perf_counter()
            result = simulate(
                system,
                integrator,
                until=initial.t0 + min(steps * dt, analysis.until - initial.t0),
                u0=built.u0,
                v0=built.v0,
                t0=initial.t0,
                mass=analysis.mass,
                damping=analysis.damping.of_library(),
                quiet=True,
                raise_on_failure=False,
            )
            return time.perf_counter() - begin, result.ledger.steps - 1, result

        many = EXPLICIT_STEPS if integrator.explicit else IMPLICIT_STEPS
        seconds, steps, result = run(1)
        if seconds > PATIENCE:  # which may have compiled kernels
            seconds, steps, result = run(1)
        how = f"measured on {steps} step{'s' * (steps > 1)}, with what they begin with"
        if seconds < PATIENCE:
            first, begun, _ = run(1)
            whole, steps, result = run(1 + many)
            seconds, steps = (max(whole - first, 1e-3 * whole), steps - begun) if steps > begun else (whole, steps)
            how = f"measured on {steps} steps"
        if not result.success:
            self.remark("motion", f"The first steps do not go well: {result.message}")
        if steps < 1:
            return  # there is nothing to multiply
        each, total = seconds / max(steps, 1), max((analysis.until - initial.t0) / dt, 1.0)
        spread = (0.8, 1.5) if integrator.explicit else (0.5, 2.5)
        self.add(
            "costs",
            Fact("a step in time", each, "s", how),
            Fact("steps", round(total), "", f"of {dt:.4g} {self._symbol('time')}"),
            Fact("estimated time", [factor * each * total for factor in spread], "s"),
        )


class Sample(NamedTuple):
    """A factorisation and a solve that were measured: of all unknowns, or of some of them."""

    n: int  # unknowns that were measured
    of: int  # that there are
    k: int  # dimension of the elements
    iterative: bool
    factor: float  # [s]
    solve: float  # [s]
    bytes: int

    @property
    def whole(self) -> bool:
        """Whether all unknowns were measured, but for some that hold the body."""
        return self.n > 0.9 * self.of or self.of <= SMALL

    def scaled(self, seconds: float) -> tuple[float, float]:
        """Least and largest time for all unknowns."""
        low, high = (1.0, 1.2) if self.iterative else GROWTH[self.k]
        more = 1.0 if self.whole else self.of / self.n
        return seconds * more**low, seconds * more**high

    @property
    def scaled_solve(self) -> float:
        """Time of a solve for all unknowns [s]."""
        return self.solve * (1.0 if self.whole else (self.of / self.n) ** (1.1 if self.iterative else FILL[self.k]))

    @property
    def memory(self) -> float:
        """Bytes of the factors of all unknowns."""
        return self.bytes * (1.0 if self.whole else (self.of / self.n) ** (1.0 if self.iterative else FILL[self.k]))


def _measured(system: System, solver: LinearSolver, loose: int) -> Sample:
    """Factorise K at rest, of the whole body or of a part of it, held where it is cut off."""
    if solver.matrix_free:
        return _without_matrix(system, solver)
    u, mesh = np.zeros(system.ndofs), system.mesh
    free = system.free_dofs(system.supports.held).free
    K = system.tangent(u)[free][:, free]
    n, most = len(free), (WHOLE_BY_SUPERLU if solver.name == "superlu" and mesh.k == 3 else WHOLE)
    size = n if solver.iterative or n <= most else PART
    if loose:  # some nodes are held in a far corner
        size = min(size, n - 4 * mesh.d)
    low, extent = mesh.p.min(axis=1, keepdims=True), np.ptp(mesh.p, axis=1, keepdims=True)
    distance = ((mesh.p - low) / np.where(extent > 0, extent, 1.0)).max(axis=0)
    order = np.argsort(distance[free // mesh.d], kind="stable")
    sample = None
    for count in (min(SMALL, size), size):  # the first one compiles kernels and loads packages
        ids = np.sort(order[: max(count, 1)])
        sample = _sample(system, solver, K[ids][:, ids].tocsr(), free[ids])
    assert sample is not None
    return sample._replace(of=n)


def _without_matrix(system: System, solver: LinearSolver) -> Sample:
    """Solve with K at rest as an operator, a little stiffer, so that rigid motions do no harm."""
    u = np.zeros(system.ndofs)
    tangent = FreeTangent(system, solver, kind_of(system), lambda: u)
    operator, n = tangent.operator(u), len(tangent.free.free)
    stiffer = FreeOperator(operator, tangent.free, tangent.shift(tangent.diagonal_of(operator)))
    for _ in range(2):  # the first one compiles
        begin = time.perf_counter()
        factors = tangent.factorise(stiffer)
        middle = time.perf_counter()
        factors.solve(np.ones(n), PRECISION)
        end = time.perf_counter()
    return Sample(n, n, system.mesh.k, True, middle - begin, end - middle, operator.memory())


def _sample(system: System, solver: LinearSolver, K: Any, dofs: NDArray[np.int64]) -> Sample:
    """Measure a factorisation and a solve of K over these degrees of freedom."""
    mesh, n = system.mesh, len(dofs)
    K.sort_indices()
    unknowns = Unknowns(*np.divmod(dofs, mesh.d), K.indptr, K.indices, lambda: rigid_modes(mesh.p.T)[dofs], mesh.ends())
    tracemalloc.start()
    try:
        begin = time.perf_counter()
        analysis = solver.analyse(unknowns)
        factors = analysis.factorise(K, kind_of(system))
        middle = time.perf_counter()
        size = int(getattr(factors, "nbytes", 0)) or tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    again = time.perf_counter()
    if solver.iterative:  # which keeps its hierarchy from one matrix to the next
        factors = analysis.factorise(K, kind_of(system))
        begin, middle = again, time.perf_counter()
    before = time.perf_counter()
    factors.solve(np.ones(n), PRECISION)
    return Sample(n, n, mesh.k, solver.iterative, middle - begin, time.perf_counter() - before, size)


def _ritz_frequencies(system: System) -> Array:
    """Upper bounds on the lowest eigenfrequencies: Ritz values of polynomials that vanish where the body is held."""
    mesh, d = system.mesh, system.mesh.d
    x = mesh.p.T - mesh.p.mean(axis=1)
    size = float(np.abs(x).max())
    x = x / size
    powers = [one for one in itertools.product(range(DEGREE + 1), repeat=d) if sum(one) <= DEGREE]
    held = np.zeros((mesh.nv, d), dtype=bool)
    held.ravel()[system.supports.held] = True
    vectors = []
    for component in range(d):
        there = held[:, component]
        weight = cKDTree(x[there]).query(x)[0] if there.any() else np.ones(mesh.nv)
        for power in powers:
            v = np.zeros((mesh.nv, d))
            v[:, component] = weight * np.prod(x ** np.array(power), axis=1)
            vectors.append(v.ravel())
    K, mass = system.linear_operator(np.zeros(system.ndofs)), system.mass()
    V = np.array(vectors)
    sizes, c = eigh(V @ np.array([mass.multiply(v) for v in V]).T)
    V = (c[:, sizes > 1e-10 * sizes.max()] / np.sqrt(sizes[sizes > 1e-10 * sizes.max()])).T @ V
    values = np.linalg.eigvalsh(V @ np.array([K.matvec(v) for v in V]).T)
    return np.sqrt(values[values > 1e-9 * values.max()]) / (2 * np.pi)


def _best(call: Callable[[], Any]) -> float:
    """The time of a call [s]: the best of three, or of fewer where that takes long; the first one may compile."""
    call()
    best, begun = np.inf, time.perf_counter()
    for _ in range(3):
        begin = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - begin)
        if time.perf_counter() - begun > PATIENCE:
            break
    return best


def _power(unit: str, k: int) -> str:
    return unit + ("", "^2", "^3")[k - 1]


def _range(low: float, high: float) -> Any:
    return low if high <= 1.001 * low else [low, high]


def _megabytes(size: float) -> float:
    return size / 1e6


def _shown(value: Any) -> str:
    if isinstance(value, str | bool):
        return str(value)
    if isinstance(value, list | tuple | np.ndarray):
        return "(" + ", ".join(map(_shown, value)) + ")"
    return str(value) if isinstance(value, int | np.integer) else f"{value:.4g}"


def _plain(value: Any) -> Any:
    """As JSON has it: None for what is no finite number."""
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    plain = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(plain, float) and not np.isfinite(plain) else plain
