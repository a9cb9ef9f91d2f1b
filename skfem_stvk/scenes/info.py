"""Inspection of a scene or of a mesh before anything runs: the body that would be built, and its faults."""

from __future__ import annotations

import itertools
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from rich.console import Group, RenderableType
from scipy.linalg import eigh
from scipy.spatial import cKDTree

from ..arguments import Array, choice
from ..errors import MaterialError, Remark, StvkError, StvkWarning, name_ids
from ..kernels.threads import threads
from ..linear.choose import choose, why
from ..mesh import ElementMesh, MeshQuality, mesh_quality
from ..mesh.facets import facet_ids, pairs_in
from ..mesh.quality import Extreme
from ..solvers.dynamics import EdgeDamping, Rayleigh, critical_elements, critical_step, modes
from ..solvers.dynamics.motion import Motion
from ..solvers.dynamics.simulate import first_state
from ..solvers.dynamics.steps import SAFETY
from ..system import System
from ..system.free_tangent import entries_of, kind_of, with_loads
from ..system.rigid import free_rigid_modes, parts_of_body
from ..terminal import grid, printable
from ..terms import StVK
from ..units import UNITS, implausible_moduli
from .build import Built
from .run_scene import on_threads
from .scene import Scene
from .schema.analyses import DynamicAnalysis

#: Bodies with more rigid motions than this, such as bodies in many pieces, get no eigenfrequencies.
MOST_FREE_MOTIONS = 60
#: Frequencies below this part of the largest one found are those of mechanisms.
MECHANISM = 1e-6
#: Unknowns up to which eigenfrequencies are computed; those of larger bodies are bounded from above.
MOST_UNKNOWNS = 6_000
#: Numbers in the stiffnesses of all elements above which the elements that shorten the step are not searched: some 2 GB.
MOST_NUMBERS = 8e7
#: A remark names elements that allow less than this part of the step that usual elements allow.
SHORT_STEP = 0.2
#: Degree of the polynomials whose span bounds eigenfrequencies.
DEGREE = 3


class Fact(NamedTuple):
    """Row of a table: a name, a number or a text, its unit, and a note."""

    name: str
    value: Any
    unit: str = ""
    note: str = ""

    @property
    def shown(self) -> str:
        """The value with its unit."""
        parts = self.value if isinstance(self.value, list | tuple) else [self.value]
        return f"{', '.join(map(_shown, parts))} {self.unit}".strip()


@dataclass
class Inspection:
    """Facts on the body that would be built, and its faults.

    Attributes
    ----------
    units
        The system of units.
    facts
        Tables of facts, by title.
    extremes
        The worst elements, by measure.
    remarks
        Faults and doubts, refusals first.
    k
        Dimension of the elements.
    """

    units: str
    facts: dict[str, list[Fact]] = field(default_factory=dict)
    extremes: list[Extreme] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
    k: int = 3

    @property
    def refused(self) -> bool:
        """Whether nothing can be run."""
        return any(remark.refused for remark in self.remarks)

    def add(self, title: str, *facts: Fact) -> None:
        """Add rows to a table."""
        self.facts.setdefault(title, []).extend(facts)

    def remark(self, name: str, text: str, refused: bool = False) -> None:
        """Add a remark once, refusals before the others."""
        if text not in [remark.text for remark in self.remarks]:
            self.remarks.append(Remark(name, (), text, refused))
            self.remarks.sort(key=lambda remark: not remark.refused)

    @contextmanager
    def part(self, name: str, refused: bool = False) -> Iterator[None]:
        """Turn an error or a warning into a remark, so that the other parts are still inspected."""
        with warnings.catch_warnings(record=True) as noted:
            warnings.simplefilter("always")
            try:
                yield
            except Exception as error:  # a fault in one part must not stop the inspection of the others
                message = str(error) if isinstance(error, StvkError) else f"{type(error).__name__}: {error}"
                self.remark(name, message if refused else f"{name} could not be inspected: {message}", refused)
        for warning in noted:
            if issubclass(warning.category, StvkWarning):
                self.remark(name, str(warning.message))

    def symbol(self, dimension: str) -> str:
        """Return the unit of a dimension."""
        return UNITS[self.units].symbol(dimension)

    def to_dict(self) -> dict[str, Any]:
        """Return all facts and remarks in lists, texts and numbers, in the units of the scene, as JSON has them."""
        facts = {title: {fact.name: _plain(fact.value) for fact in rows} for title, rows in self.facts.items()}
        worst = {
            one.name: {"median": _plain(one.median), "elements": list(one.elements), "values": _plain(one.values)}
            for one in self.extremes
        }
        remarks = [{"name": one.name, "text": one.text, "refused": one.refused} for one in self.remarks]
        return {"units": self.units, **facts, "worst elements": worst, "remarks": remarks}

    def rendered(self, width: int) -> RenderableType:
        """Return tables for a rich console of this width; remarks are at the end, where a reader sees them."""
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
            parts.append("[green]no problem was found[/]")
        return Group(*parts)

    def _unit(self, one: Extreme) -> str:
        length = self.symbol("length")
        return {"length": f" {length}", "size": f" {_power(length, self.k)}", "angle": "°"}.get(one.dimension, "")


def inspect_mesh(
    mesh: ElementMesh,
    *,
    young: float | None = None,
    poisson: float | None = None,
    density: float | None = None,
    units: str = "SI",
) -> Inspection:
    """Inspect a mesh, and the free body of one material on it, without supports and loads.

    A mesh that cannot carry a body raises no error: the remarks say why.

    Parameters
    ----------
    young, poisson, density
        Constants of the material [Pa, -, kg/m^3]; without them only the mesh is inspected.
    units
        System of units of all values, such as "mm-N-MPa".
    """
    found = Inspection(choice("units", units, UNITS))
    _mesh(found, mesh)
    with found.part("units"):
        for text in implausible_moduli({"--young": young}, UNITS[units], float(mesh.extent.max())):
            found.remark("implausible", text)
    if young is None:
        found.remark("material", "Without a material only the mesh is inspected; add --young, --poisson and --density.")
    elif not found.refused:
        with found.part("body", refused=True):
            system = System(mesh, StVK(young=young, poisson=poisson, density=density), units=units)
            _body(found, system, [f"stvk, E = {young:g} {found.symbol('stress')}, nu = {poisson}"])
    return found


def inspect_scene(scene: Scene) -> Inspection:
    """Inspect a scene: its mesh and body, its analysis, and whether its values are plausible. A faulty mesh raises no error."""
    sections = scene.sections
    found = Inspection(sections.units)
    built, mesh = None, None
    with found.part("scene", refused=True):
        built = scene.built
    with found.part("mesh", refused=True):
        mesh = sections.mesh.mesh(scene.source.folder) if built is None else built.mesh
        _mesh(found, mesh, () if built is None else [body.mesh for body in built.system.body.beside])
    with found.part("units"):
        for text in sections.implausible(0.0 if mesh is None else float(mesh.extent.max())):
            found.remark("implausible", text)
    if built is not None:
        materials = [getattr(term, "material", None) for term in sections.terms]
        terms = [term.type + (f" of {name}" if name else "") for term, name in zip(sections.terms, materials, strict=True)]
        with on_threads(sections.threads):
            _body(found, built.system, terms, built)
    return found


def _mesh(found: Inspection, mesh: ElementMesh, others: Sequence[ElementMesh] = ()) -> None:
    """Add counts, sizes, groups and qualities of a mesh; the `others` are on the same nodes."""
    length, found.k = found.symbol("length"), mesh.k
    found.add("mesh", Fact("elements", mesh.nt, "", mesh.kind), Fact("nodes", mesh.nv))
    with found.part("edges"):
        edges = pairs_in(mesh.corners, mesh.element.edges, mesh.nv)
        found.add("mesh", Fact("edges", edges[0].shape[1]))
        if mesh.element.is_linear_simplex and mesh.k > 1:
            faces = mesh.nt if mesh.k == 2 else int(facet_ids(mesh).max()) + 1
            opposite = 3 * mesh.nt if mesh.k == 3 else 0
            found.add("mesh", Fact("TSEPs", 3 * faces + opposite, "", "pairs of edges that share an element"))
    with found.part("quality"):
        quality = mesh_quality(mesh, others)
        finite = mesh.p[:, np.isfinite(mesh.p).all(axis=0)]
        if finite.size:
            low, high = finite.min(axis=1), finite.max(axis=1)
            found.add("mesh", Fact("size of the box", (high - low).tolist(), length, f"from {_shown(low)} to {_shown(high)}"))
        _quality(found, quality)
    units = {"boundaries": "facets", "lines": "segments", "node sets": mesh.words, "subdomains": "elements"}
    for title, unit in units.items():
        if groups := getattr(mesh, title.replace(" ", "_")):
            found.add(title, *(Fact(name, int(np.shape(ids)[-1]), unit) for name, ids in groups.items()))


def _quality(found: Inspection, quality: MeshQuality) -> None:
    """Add the total size of a mesh, its parts, its worst elements and its faults."""
    mesh = quality.mesh
    whole, unit = float(np.nansum(quality.size)), _power(found.symbol("length"), mesh.k)
    found.add("mesh", Fact(("length", "area", "volume")[mesh.k - 1], whole, unit))
    found.add("mesh", Fact("parts", len(quality.parts), "", "each needs its own supports" if len(quality.parts) > 1 else ""))
    if mesh.k == mesh.d:
        found.add("mesh", Fact("negative orientation", int(quality.turned.sum()), "elements", "harmless"))
    found.extremes = quality.extremes()
    for fault in quality.faults:
        found.remark(fault.name, fault.text, fault.refused)


def _body(found: Inspection, system: System, terms: list[str], built: Built | None = None) -> None:
    """Add unknowns, mass, frequencies, the critical step, and the costs of an analysis."""
    constrained, has_mass = len(system.supports.held), True
    found.add("body", Fact("unknowns", system.ndofs - constrained, "free", f"and {constrained} constrained"))
    found.add("body", *(Fact(f"terms[{number}]", term) for number, term in enumerate(terms)))
    other_meshes = [body.mesh for body in system.body.beside]
    found.add("body", *(Fact(f"{one.element.name} on nodes of the mesh", one.nt) for one in other_meshes))
    try:
        found.add("body", Fact("mass", system.mass().total, found.symbol("mass")))
    except MaterialError as error:
        has_mass = False
        reason = str(error).partition(". ")[0]
        found.add("body", Fact("mass", "unknown", "", f"and no eigenfrequencies and explicit steps: {reason}"))
    free_motions = 0
    with found.part("supports"):
        free_motions = _free_motions(found, system, built)
    if has_mass:
        with found.part("eigenfrequencies"):
            _frequencies(found, system, free_motions)
        with found.part("critical step"):
            _critical(found, system, built)
    if built is not None and isinstance(built.sections.analysis, DynamicAnalysis):
        with found.part("motion", refused=True):
            _motion(found, built, built.sections.analysis)
    with found.part("time and memory"):
        _costs(found, system, built)


def _free_motions(found: Inspection, system: System, built: Built | None) -> int:
    """Add and return the number of free rigid motions of the parts of the body."""
    constrained = np.union1d(system.supports.held, system.grounded)
    remaining = free_rigid_modes(system.mesh.p, parts_of_body(system), constrained, system.mesh.word)
    count = sum(one.count for one in remaining)
    found.add("body", Fact("rigid motions left", count))
    if remaining and built is not None and built.sections.analysis.type in ("static", "arc-length"):
        found.remark(
            "supports", f"Static analyses need a constrained body: {'; '.join(map(str, remaining[:3]))}. Add supports there.", True
        )
    return count


def _frequencies(found: Inspection, system: System, free_motions: int) -> None:
    """Add the lowest eigenfrequencies, or bounds on those of a large body."""
    free = system.ndofs - len(system.supports.held)
    if free_motions > MOST_FREE_MOTIONS:
        return
    if free <= MOST_UNKNOWNS:
        result = modes(system, min(free_motions + 4, free))
        if result.unstable.any():
            found.remark("eigenfrequencies", "At rest K has negative eigenvalues: a material or a load makes it unstable.")
        elastic = result.frequencies[~result.rigid & ~result.unstable]
        elastic = elastic[elastic > MECHANISM * elastic.max(initial=0.0)]
        note = "the lowest ones"
    else:
        elastic, note = _ritz_frequencies(system), "upper bounds on the lowest ones, by polynomials"
    if len(elastic):
        values, unit = [float(one) for one in elastic[:3]], found.symbol("frequency")
        found.add("body", Fact("eigenfrequencies", values, unit, f"{note}; check that they are plausible"))


def _critical(found: Inspection, system: System, built: Built | None) -> None:
    """Add the critical step of explicit integrators, and the number of steps of a motion whose step it sets."""
    integrator, unit = None if built is None else built.integrator, found.symbol("time")
    motion: Any = built.sections.analysis if built is not None and integrator is not None and integrator.explicit else None
    damped: list[Rayleigh | EdgeDamping] = []
    if motion is not None:  # masses as the stability limit uses them
        weight, damping = getattr(integrator, "damping_weight", 1.0), motion.damping
        damped = [Rayleigh(weight * damping.alpha, weight * damping.beta), EdgeDamping(weight * damping.tau)]
    step = critical_step(system, None if built is None else built.u0, damping=damped or None).step
    found.add("explicit steps", Fact("critical step", step, unit, "the largest stable one, at the first state"))
    if motion is not None and motion.dt is None:
        _steps(found, built, SAFETY * step)
    elif motion is not None and motion.dt > step:
        text = f"analysis.dt = {motion.dt:g} {unit} is above the critical step, {step:.4g} {unit}: the motion will be unstable. "
        found.remark(
            "critical step", f"{text}Use {SAFETY * step:.2g}, leave dt out for an automatic step, or an implicit integrator."
        )
    _short_elements(found, system)


def _short_elements(found: Inspection, system: System) -> None:
    """Add the elements that make explicit steps short."""
    mesh, unit = system.mesh, found.symbol("time")
    if mesh.nt * (mesh.element.n * mesh.d) ** 2 > MOST_NUMBERS:
        found.add("explicit steps", Fact("elements that set it", "not looked for", "", "there are too many elements"))
        return
    try:
        worst = critical_elements(system, 5)
    except StvkError as error:
        found.add("explicit steps", Fact("elements that set it", "none", "", str(error)))
        return
    usual, steps = float(np.median(worst.every[np.isfinite(worst.every)])), worst.steps.tolist()
    found.add(
        "explicit steps",
        Fact("elements that set it", worst.elements.tolist(), "", f"the first allows {_shown(steps[0])} {unit} at most"),
        Fact("usual elements allow", usual, unit, "at most, the median"),
    )
    bad = np.flatnonzero(worst.every < SHORT_STEP * usual)
    if len(bad):
        named = name_ids(bad[np.argsort(worst.every[bad], kind="stable")], "element")
        found.remark(
            "critical step",
            f"{named}: explicit steps have to be {usual / steps[0]:.3g} times as short as usual elements allow. Remesh there, "
            "remove the detail, or take an implicit integrator.",
        )


def _motion(found: Inspection, built: Built, analysis: DynamicAnalysis) -> None:
    """Add the number of steps of a motion; refuse a first state from which no motion can start."""
    if analysis.dt is not None:
        _steps(found, built, analysis.dt)
    motion = Motion(built.system, analysis.mass, analysis.damping.of_library())
    first_state(motion, built.u0, built.v0, built.sections.initial.t0, analysis.dt or 1e-6)


def _steps(found: Inspection, built: Any, dt: float) -> None:
    length = built.sections.analysis.until - built.sections.initial.t0
    found.add("costs", Fact("steps", round(max(length / dt, 1.0)), "", f"of {dt:.4g} {found.symbol('time')}"))


def _costs(found: Inspection, system: System, built: Built | None) -> None:
    """Add one measured time each of W, F and K, the linear solver, and bytes by part."""
    u, explicit = 1e-3 * system.mesh.p.T.ravel(), built is not None and built.integrator is not None and built.integrator.explicit
    found.add("costs", Fact("threads", threads()))
    if not system.without_energy:
        found.add("costs", Fact("an energy W", _seconds(lambda: system.energy(u)), "s", "measured once"))
    found.add("costs", Fact("a force F", _seconds(lambda: system.internal_force(u)), "s", "measured once"))
    if not explicit:
        K = system.tangent(u)
        found.add("costs", Fact("a tangent K", _seconds(lambda: system.tangent(u, out=K)), "s", "measured once"))
        found.add("costs", _linear_solver(system, built))
        found.add("memory", Fact("K", (K.data.nbytes + K.indices.nbytes + K.indptr.nbytes) / 1e6, "MB"))
    parts = {name: size / 1e6 for name, size in system.memory().items() if size > 0}
    whole = sum(parts.values()) + sum(fact.value for fact in found.facts.get("memory", []))
    found.add("memory", Fact("in all", whole, "MB"), *(Fact(name, size, "MB") for name, size in parts.items()))


def _linear_solver(system: System, built: Built | None) -> Fact:
    """Return the linear solver of an analysis, or of statics, and why."""
    if built is not None and (built.integrator is not None or built.sections.reduced is not None):
        return Fact("linear solver", built.solver, "", "of the integrator" if built.sections.solver.name == "auto" else "")
    requested, kind = ("auto", "static") if built is None else (built.sections.solver.name, built.sections.analysis.type)
    choice = (
        requested,
        system.ndofs - len(system.supports.held),
        kind_of(system),
        kind in ("arc-length", "modes"),
        entries_of(system),
    )
    return Fact("linear solver", with_loads(choose(*choice), system).name, "", why(*choice))


def _ritz_frequencies(system: System) -> Array:
    """Return upper bounds on the lowest eigenfrequencies: Ritz values of polynomials that vanish at supports."""
    mesh, d = system.mesh, system.mesh.d
    x = mesh.p.T - mesh.p.mean(axis=1)
    size = float(np.abs(x).max())
    x = x / size
    powers = [one for one in itertools.product(range(DEGREE + 1), repeat=d) if sum(one) <= DEGREE]
    constrained = np.zeros((mesh.nv, d), dtype=bool)
    constrained.ravel()[system.supports.held] = True
    vectors = []
    for component in range(d):
        present = constrained[:, component]
        weight = cKDTree(x[present]).query(x)[0] if present.any() else np.ones(mesh.nv)
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


def _seconds(call: Callable[[], Any]) -> float:
    """Return the time of a call [s] after a first call, which may compile."""
    call()
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def _power(unit: str, k: int) -> str:
    return unit + ("", "^2", "^3")[k - 1]


def _shown(value: Any) -> str:
    if isinstance(value, str | bool):
        return str(value)
    if isinstance(value, list | tuple | np.ndarray):
        return "(" + ", ".join(map(_shown, value)) + ")"
    return str(value) if isinstance(value, int | np.integer) else f"{value:.4g}"


def _plain(value: Any) -> Any:
    """Return a value as JSON has it; None for a number that is not finite."""
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    plain = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(plain, float) and not np.isfinite(plain) else plain
