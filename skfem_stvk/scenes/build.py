"""Conversion of the sections of a scene into a mesh, a system and a first state, and the errors that only these reveal."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any

import numba
import numpy as np

from ..arguments import Array, shown
from ..arguments import path as checked_path
from ..edges.materials import Hypothesis, Material
from ..errors import RegionError, StvkError, name_known
from ..mesh import ElementMesh
from ..mesh.locations import Box, Where, vertices_at
from ..mesh.read import is_partition
from ..results.table import find
from ..solvers.dynamics import Integrator
from ..solvers.dynamics.ledger_rows import refuse_name_of_column
from ..solvers.dynamics.motion import Motion
from ..solvers.state_files import read_state
from ..system import System
from ..system.free_tangent import solver_for
from ..system.supports import Supports, fixed_dofs
from ..terms import TERMS, Body, MeshContact, RigidContact, is_load
from ..terms.term import specified
from ..units import UNITS
from .complaints import Complaints
from .schema import SceneTables
from .schema.analyses import ArcLengthAnalysis, DynamicAnalysis, ModesAnalysis, options
from .schema.derived import SURFACES, Derived
from .schema.places import BoxPlace, where_of
from .schema.quantities import input_files
from .schema.sections import Expectation
from .schema.terms import given_by, in_elements, in_time
from .source import SceneSource

_LAST = ("energy.strain", "displacement.largest", "stress.largest", "volume_ratio.smallest", "steps")
#: Results of a motion, by their columns in its energy ledger.
ENERGIES = {
    "kinetic": "kinetic_energy",
    "strain": "strain_energy",
    "potential": "potential_energy",
    "total": "total_energy",
    "dissipated": "dissipated_work",
    "external": "external_work",
    "removed": "removed_energy",
    "closure": "closure_error",
}
#: Names of results by the type of analysis, in addition to those of probes and reactions.
RESULTS = {
    "static": ("load", "jumps", *_LAST),
    "arc-length": ("load", "jumps", *_LAST),
    "dynamic": ("time", *(f"energy.{name}" for name in ENERGIES), "energy_gained", "blow_ups", *_LAST),
    "modes": ("modes.rigid", "modes.unstable"),
}
#: Terms with forces where surfaces touch.
CONTACTS = RigidContact, MeshContact
#: Results that need an energy of each term.
OF_ENERGY = "energy.strain", "energy.total"
#: Results with several values.
NUMBERED = re.compile(r"(frequency|critical)\.\d+")


class Names:
    """Materials, places and regions of a scene by name, on its mesh, and the folder of its files."""

    def __init__(self, sections: SceneTables, mesh: ElementMesh, folder: Path = Path()) -> None:
        self.mesh, self.sections, self.folder = mesh, sections, folder
        self._materials: dict[str, Material] = {}

    def material(self, name: str) -> Material:
        """Return a material by its name."""
        if name not in self._materials:
            self._materials[name] = self.sections.materials[name].made()
        return self._materials[name]

    def place(self, where: Any) -> Where:
        """Return a place as `System` takes it; a name refers to `[places]` first. Raise RegionError for an unknown name."""
        if isinstance(where, str):
            places, marked = self.sections.places, {*self.mesh.boundaries, *self.mesh.node_sets}
            if where in places:
                return where_of(places[where])
            if where not in marked:
                hint = " It is a region of elements." if where in self.mesh.subdomains else ""
                raise RegionError(f"there is no place {shown(where)}; {name_known(where, {*places, *marked})}{hint}")
        return where_of(where)

    def surface(self, where: Any) -> Where:
        """Return a place, or the name of a region of the mesh, which means its part of the surface."""
        region = isinstance(where, str) and where in self.mesh.subdomains and where not in self.sections.places
        return where if region and where not in self.mesh.boundaries else self.place(where)

    def region(self, region: Any) -> Any:
        """Return a region as terms take it: the name of a subdomain, or listed elements, or those with their centres in a box."""
        if isinstance(region, str):
            if region in self.mesh.subdomains:
                return region
            boxes = {name: place for name, place in self.sections.places.items() if isinstance(place, BoxPlace)}
            if region not in boxes:
                known = name_known(region, {*self.mesh.subdomains, *boxes})
                raise RegionError(f"there is no region {shown(region)}: neither a subdomain of the mesh nor a box; {known}")
            region = boxes[region]
        found = where_of(region)
        if isinstance(found, Box):
            return self.mesh.element_numbers[self.mesh.elements(found)]
        return np.array(found)


@dataclass(frozen=True, eq=False)
class Built:
    """System and first state that a scene builds.

    Attributes
    ----------
    sections, source
        The scene, and its text with the lines of its keys.
    system
        The body, loads and supports.
    probes, reactions
        Locations by name, as `simulate` takes them.
    u0, v0
        (ndofs,) first displacements and velocities; None without any.
    """

    sections: SceneTables
    source: SceneSource
    system: System
    names: Names
    probes: dict[str, Where] = field(default_factory=dict)
    reactions: dict[str, Where] = field(default_factory=dict)
    u0: Array | None = None
    v0: Array | None = None

    @property
    def mesh(self) -> ElementMesh:
        """The mesh of the system."""
        return self.system.mesh

    @cached_property
    def integrator(self) -> Integrator | None:
        """The integrator of a motion; None for other analyses."""
        analysis = self.sections.analysis
        return analysis.method(self.sections.solver) if isinstance(analysis, DynamicAnalysis) else None

    @cached_property
    def solver(self) -> str:
        """Name of the linear solver, with "auto" resolved; empty for explicit integrators. With few unknowns it stays "auto"."""
        analysis, system, requested = self.sections.analysis, self.system, self.sections.solver.name
        if self.sections.reduced is not None:
            return requested
        if self.integrator is not None:
            if self.integrator.explicit:
                return ""
            motion = Motion(system, analysis.mass, None)
            return str(self.integrator.linear_solver(motion).name)  # type: ignore[attr-defined]
        return str(solver_for(system, requested, isinstance(analysis, ArcLengthAnalysis | ModesAnalysis)).name)


def check(sections: SceneTables, source: SceneSource) -> None:
    """Refuse the faults that are visible without a mesh: unknown names, missing files, keys that exclude each other.

    Raises
    ------
    SceneError
        with all faults found.
    """
    complaints = Complaints(source)
    most = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    if sections.threads is not None and sections.threads > most:
        complaints.add(
            ("threads",),
            f"{sections.threads}; expected at most {most}, the number of threads of this process, which NUMBA_NUM_THREADS sets",
        )
    _check_files(sections, source, complaints)
    for complain in (_check_materials, _check_analysis, _check_friction, _check_reduced, _check_outputs):
        complain(sections, complaints)
    complaints.refuse()


def _check_files(sections: SceneTables, source: SceneSource, complaints: Complaints) -> None:
    for loc, name in input_files(sections):
        with complaints.at(*loc):
            path = checked_path("path", source.folder / name, "the path of a file")
            if not path.is_file():
                fault = "is a folder" if path.is_dir() else "is not a regular file" if path.exists() else "does not exist"
                hint = "" if path.parent.is_dir() else f" There is no folder {path.parent} either."
                others = [one.name for one in path.parent.iterdir() if one != path] if path.parent.is_dir() else []
                if similar := get_close_matches(path.name, others, n=1):
                    hint = f" Did you mean {similar[0]!r}?"
                complaints.add(loc, f"the file {path} {fault}; paths are relative to the scene file.{hint}")


def _check_materials(sections: SceneTables, complaints: Complaints) -> None:
    used = set()
    dense = isinstance(sections.analysis, DynamicAnalysis | ModesAnalysis)
    dense |= any(getattr(term.library, "needs_density", False) for term in sections.terms)
    for number, term in enumerate(sections.terms):
        name = getattr(term, "material", None)
        if name is None:
            continue
        used.add(name)
        if name not in sections.materials:
            known = name_known(name, sections.materials)
            complaints.add(("terms", number, "material"), f"there is no [materials.{name}]; {known}")
    for name in sorted(set(sections.materials) - used) if used <= set(sections.materials) else ():
        complaints.add(("materials", name), "no term has this material. Remove it, or name it in a term: material = ...")
    if not used:
        complaints.add(("terms",), 'no term has a material, so there is no elastic body. Add one, such as type = "stvk".')
    for name in sorted(used & set(sections.materials)):
        if dense and sections.materials[name].density is None:
            what = "motion, modes and gravity need"
            complaints.add(("materials", name), f"the density is missing, which {what}. Add density = ...")


def _check_analysis(sections: SceneTables, complaints: Complaints) -> None:
    analysis, solver = sections.analysis, sections.solver
    if isinstance(analysis, DynamicAnalysis):
        if not analysis.until > sections.initial.t0:
            complaints.add(("analysis", "until"), f"{analysis.until:g} is not after initial.t0 = {sections.initial.t0:g}")
        if analysis.dt is None and not analysis.explicit:
            complaints.add(("analysis", "dt"), f"is missing; {analysis.integrator} needs a time step")
        if analysis.explicit:
            for name in sorted(solver.model_fields_set):
                complaints.add(("solver", name), f"{analysis.integrator} solves no linear systems; remove this key")
        for name, integrators_with in sorted(options().items()):
            if name in analysis.model_fields_set and analysis.integrator not in integrators_with:
                complaints.add(
                    ("analysis", name), f"is an option of {', '.join(integrators_with)}, not of {analysis.integrator}; remove it"
                )
        return
    if solver.tangent is not None:
        complaints.add(("solver", "tangent"), f"is for implicit integrators, not for type = {analysis.type!r}; remove it")
    if isinstance(analysis, ModesAnalysis) and solver.rtol is not None:
        complaints.add(("solver", "rtol"), "is for statics and motion, not for modes; remove it")
    for name in sorted({"velocity"} & sections.initial.model_fields_set):
        complaints.add(("initial", name), f"is for motion, not for type = {analysis.type!r}; remove it")


def _check_friction(sections: SceneTables, complaints: Complaints) -> None:
    """Complain about friction without the width that the analysis needs."""
    widths = {"dynamic": "slip_speed", "static": "slip_length", "arc-length": "slip_length"}
    name = widths.get(sections.analysis.type)
    for number, term in enumerate(sections.terms):
        friction = getattr(term, "friction", None)
        if friction is not None and name is not None and getattr(friction, name) is None:
            complaints.add(("terms", number, "friction"), f"type = {sections.analysis.type!r} needs {name}; add {name} = ...")


def _check_reduced(sections: SceneTables, complaints: Complaints) -> None:
    """Complain about keys that need all displacements, which a reduced analysis does not have."""
    analysis, solver = sections.analysis, sections.solver
    if sections.reduced is None:
        return
    if isinstance(analysis, ModesAnalysis):
        complaints.add(("reduced",), "is for statics, arc length and motion; modes need the whole body. Remove it")
    if solver.name != "auto":
        complaints.add(
            ("solver", "name"), "a reduced body has few unknowns and dense matrices with their own solver; remove this key"
        )
    if solver.tangent not in (None, "exact"):
        complaints.add(("solver", "tangent"), "the tangent of a reduced body is always exact; remove this key")
    if not isinstance(analysis, DynamicAnalysis):
        return
    if analysis.explicit:
        complaints.add(
            ("analysis", "integrator"), f"{analysis.integrator} does not support reduced bodies; use an implicit integrator"
        )
    if analysis.mass != "lumped":
        complaints.add(("analysis", "mass"), "the basis of a reduced body is orthonormal with lumped masses; remove this key")
    if analysis.damping.tau:
        complaints.add(("analysis", "damping", "tau"), "acts on edges, which a reduced body does not have; use alpha or beta")
    if analysis.remove is not None:
        complaints.add(("analysis", "remove"), "a reduced body cannot lose elements; remove this key")


def _check_outputs(sections: SceneTables, complaints: Complaints) -> None:
    output, dynamic = sections.output, isinstance(sections.analysis, DynamicAnalysis)
    followed = [*output.probes, *output.reactions]
    for name in sorted(output.probes.keys() & output.reactions.keys()):
        complaints.add(("output", "reactions", name), "is also the name of a probe; rename one of them")
    known = [*followed, "ledger" if dynamic else "path"]
    taken = {known[-1], "critical", *(name.partition(".")[0] for name in RESULTS[sections.analysis.type])}
    for table in ("probes", "reactions"):
        for name in sorted(taken.intersection(getattr(output, table))):
            complaints.add(("output", table, name), "is also the name of a result or plot; choose another name")
    contacts, others = contacts_of(sections), {*followed, *taken}
    first = {name: number for number, name in reversed(contacts.items())}
    for number, name in contacts.items():
        also = "a probe, a reaction, a result or a plot" if name in others else ""
        also = "another contact" if first[name] < number else also
        if also:
            complaints.add(("terms", number, "name"), f"{name!r} is also the name of {also}; choose another name")
    if isinstance(sections.analysis, ModesAnalysis):
        known, contacts = [], {}
        for name in ("probes", "reactions"):
            if getattr(output, name):
                complaints.add(("output", name), "modes have no history in time; remove this key")
    for number, name in enumerate(output.plots):
        if name not in known:
            complaints.add(("output", "plots", number), f"unknown plot {name!r}; {name_known(name, known)}")
    for number, name in enumerate(output.fields or ()):
        with complaints.at("output", "fields", number):
            find(name)
    for name in ("file", "animation"):
        given = getattr(output, name)
        with complaints.at("output", name):
            checked_path("name", f".{given}_0000.part", "the name of a file")  # name of the files of its states
        if given is not None and (Path(given).name != given or "\\" in given):
            complaints.add(("output", name), f"{given!r} is not a file name; expected a name without folders, such as 'body.pvd'")
    if output.animation is not None and not (output.file or "").endswith(".pvd"):
        complaints.add(("output", "animation"), 'needs saved states; add file = "NAME.pvd"')
    results = {*(f"{name}.{axis}" for name in (*followed, *contacts.values()) for axis in "xyz"), *RESULTS[sections.analysis.type]}
    for loc, one in expectations(sections.expect).items():
        name = ".".join(loc)
        if name not in results and not NUMBERED.fullmatch(name):
            complaints.add(("expect", *loc), f"there is no result {name!r}; {name_known(name, results)}")
        if (one.rtol is None) == (one.atol is None):
            complaints.add(("expect", *loc), "give either rtol or atol, the largest difference")


def contacts_of(sections: SceneTables) -> dict[int, str]:
    """Return the names of the contacts, by their number among the terms."""
    return {number: term.name for number, term in enumerate(sections.terms) if TERMS.get(term.type) in CONTACTS}


def expectations(expect: Mapping[str, Any], above: tuple[str, ...] = ()) -> dict[tuple[str, ...], Expectation]:
    """Return the expectations by the name of their result, in its parts."""
    found: dict[tuple[str, ...], Expectation] = {}
    for name, one in expect.items():
        found |= {(*above, name): one} if isinstance(one, Expectation) else expectations(one, (*above, name))
    return found


def build(sections: SceneTables, source: SceneSource, comm: Any = None) -> Built:
    """Build the system and the first state of a checked scene. All ranks of the communicator `comm` build their parts together.

    Raises
    ------
    SceneError
        with all faults found: a mesh that cannot carry a body, empty places and regions, materials that do not fit the
        elements, supports that contradict each other, a result file of another mesh.
    """
    complaints = Complaints(source)
    with complaints.at("mesh"):
        mesh = _whole_mesh(sections, source) if comm is None else _part(sections, source, comm)
    complaints.refuse()
    names = Names(sections, mesh, source.folder)
    for name in sections.places:
        with complaints.at("places", name):
            if name in {*mesh.boundaries, *mesh.node_sets}:
                raise StvkError("the mesh has a boundary or a node set of the same name; rename the place.")
            if not isinstance(names.place(name), Box):  # a box may be a region of elements
                vertices_at(mesh, names.place(name), f"place {name!r}")
    terms: list[Any] = []
    for number, term in enumerate(sections.terms):
        if _fits(complaints, names, number, term):
            with complaints.at("terms", number):
                terms.append(term.term(names))
                _check_poisson(complaints, names, term, terms[-1])
    fixed: list[Any] = []
    prescribed: list[Any] = []
    for name, components in sections.fixed.items():
        with complaints.at("fixed", name):
            constraint = names.place(name), components
            fixed_dofs(mesh, [constraint])
            fixed.append(constraint)
    for name, motion in sections.prescribed.items():
        with complaints.at("prescribed", name):
            given = {axis: getattr(motion, axis) for axis in "xyz"}
            prescription = names.place(name), {axis: in_time(x, motion.time) for axis, x in given.items() if x is not None}
            Supports(mesh, fixed, [*prescribed, prescription])
            prescribed.append(prescription)
    complaints.refuse()
    system = None
    with complaints.at(), _naming_terms(complaints, mesh, terms, sections.units):
        options = {name: getattr(sections.mesh, name) for name in ("quadrature", "hourglass")}
        system = System(mesh, terms, fixed or None, prescribed or None, **options, units=sections.units)
    complaints.refuse()
    assert system is not None
    _check_energies(complaints, sections, system)
    probes, reactions = ({}, {})  # type: dict[str, Where], dict[str, Where]
    for table, found in (("probes", probes), ("reactions", reactions)):
        for name, place in getattr(sections.output, table).items():
            with complaints.at("output", table, name):
                found[name] = names.place(place)
                vertices_at(mesh, found[name], name)
                if table == "probes" and isinstance(sections.analysis, DynamicAnalysis):
                    refuse_name_of_column(system, name)
    u0 = v0 = None
    if sections.initial.file is not None:
        with complaints.at("initial", "file"):
            if mesh.space.comm.divided:
                raise StvkError("is not available on several ranks; remove it, or solve the scene on one machine.")
            u0, v0 = read_state(source.folder / sections.initial.file, mesh, sections.initial.at)
    if sections.initial.velocity is not None:
        with complaints.at("initial", "velocity"):
            v0 = np.tile(_components(sections.initial.velocity, mesh.d), mesh.nv)
            v0[system.supports.held] = 0.0
    complaints.refuse()
    return Built(sections, source, system, names, probes, reactions, u0, v0)


def partition_of(sections: SceneTables, source: SceneSource) -> Path | None:
    """Return the partition file that a scene has as its mesh; None for another mesh."""
    file = source.folder / getattr(sections.mesh, "file", "")
    return file if file.is_file() and is_partition(file) else None


def _whole_mesh(sections: SceneTables, source: SceneSource) -> ElementMesh:
    if (file := partition_of(sections, source)) is not None:
        raise StvkError(f"{file.name} is a partition file, for several ranks: mpiexec -n 4 skfem-stvk solve {source.name}.")
    given = [getattr(term, "simplices", None) for term in sections.terms]
    mesh = sections.mesh.mesh(source.folder, [name for name in given if isinstance(name, str)])
    return mesh if sections.mesh.degree is None else mesh.with_degree(sections.mesh.degree)


def _part(sections: SceneTables, source: SceneSource, comm: Any) -> ElementMesh:
    """Return this rank's part of a partition file, or of the mesh that the first rank reads or makes."""
    from ..ranks import distribute  # imports MPI
    from ..ranks.job import on_first

    if (file := partition_of(sections, source)) is not None:
        for name in {"scale", "dimension"} & sections.mesh.model_fields_set:
            raise StvkError(f"{name} with the partition file {file.name}; remove it: skfem-stvk partition has --{name}.")
        part = distribute(file, comm)
        return part if sections.mesh.degree is None else part.with_degree(sections.mesh.degree)
    return distribute(on_first(comm, lambda: _whole_mesh(sections, source)), comm)


def _check_energies(complaints: Complaints, sections: SceneTables, system: System) -> None:
    """Complain about expected energies that do not exist."""
    for loc in expectations(sections.expect) if system.without_energy else ():
        if ".".join(loc) in OF_ENERGY:
            names = ", ".join(system.without_energy)
            complaints.add(("expect", *loc), f"does not exist: {names} has no energy; expect displacements or forces instead")


def _check_poisson(complaints: Complaints, names: Names, term: Any, law: Any) -> None:
    """Complain about Poisson's ratios of 1/2 and more where strain or its trace is constrained: only plane stress allows them."""
    name = getattr(term, "material", None)
    poisson = None if name is None else getattr(names.sections.materials[name], "poisson", None)
    if name is None or not isinstance(poisson, float | int) or poisson < 0.5 or not specified(law).is_law:
        return
    if law.simplices is not None:  # these are in plane stress, or uniaxial
        return
    hypothesis = law.hypothesis(names.mesh)
    if hypothesis in (Hypothesis.SOLID, Hypothesis.PLANE_STRAIN):
        complaints.add(("materials", name, "poisson"), f"{poisson:g} is outside (-1, 1/2)")


def _components(given: list[float], d: int) -> Array:
    if len(given) != d:
        raise StvkError(f"has {len(given)} components; expected {d}.")
    return np.array(given)


def _fits(complaints: Complaints, names: Names, number: int, term: Any) -> bool:
    """Return whether the region and the location of a term are on the mesh; complain at the key of one that is not."""
    mesh, fits = names.mesh, {}
    if getattr(term, "region", None) is not None:
        fits["region"] = False
        with complaints.at("terms", number, "region"):
            mesh.elements(names.region(term.region))
            fits["region"] = True
    if getattr(term, "on", None) is not None and not in_elements(term.library, mesh):
        fits["on"] = False
        with complaints.at("terms", number, "on"):
            vertices_at(mesh, names.place(term.on), "on")
            fits["on"] = True
    for name in SURFACES:
        where = getattr(term, name, None)
        if where is not None and not isinstance(where, Derived):
            fits[name] = False
            with complaints.at("terms", number, name):
                names.region(where) if in_elements(term.library, mesh) else names.surface(where)
                fits[name] = True
    name = given_by(term.library)
    given = getattr(term, name, None)
    if given is None and getattr(term, "time", None) is not None:
        complaints.add(("terms", number, "time"), f"is the factor of {name}, which is missing; add {name} = [...], or remove it")
        fits[name] = False
    if isinstance(given, list) and len(given) != mesh.d:
        complaints.add(("terms", number, name), f"has {len(given)} components; expected {mesh.d}: {', '.join('xyz'[: mesh.d])}")
        fits[name] = False
    return all(fits.values())


@contextmanager
def _naming_terms(complaints: Complaints, mesh: ElementMesh, terms: list[Any], units: str) -> Iterator[None]:
    """If a system is refused, complain at each term that a body of this mesh refuses by itself."""
    try:
        yield
    except StvkError:
        if mesh.space.comm.divided:  # other ranks may not have the error, and would not take part
            raise
        found = False
        body = Body(mesh, [specified(term) for term in terms if not is_load(term)])
        for number, term in enumerate(terms):
            try:
                with UNITS[units].of_errors():
                    term.bind(body) if is_load(term) or type(term) in CONTACTS else System(mesh, term)
            except StvkError as error:
                complaints.add(("terms", number), str(error))
                found = True
        if not found:
            raise
