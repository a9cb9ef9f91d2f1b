"""Tables of a run, for the terminal and the page."""

from __future__ import annotations

from dataclasses import dataclass

from rich.text import Text

from .results import CONTROL, CSR, MODELS, OURS, QUANTITIES, REFERENCE, Benchmark
from .targets import TargetVerdict, judged, of_memory, of_time, verdicts

Row = tuple[str | Text, ...]

STYLES = {"met": "green", "missed": "yellow", "not": "dim"}


@dataclass(frozen=True)
class FigureTable:
    """Title, columns and rows of a table. The first `words` columns contain text, the others numbers; `note` explains them."""

    title: str
    note: str
    columns: tuple[str, ...]
    rows: list[Row]
    words: int = 1


def tables(results: Benchmark) -> list[FigureTable]:
    """Return the tables that have rows, targets first."""
    every = (targets, ours, precisions, models, others, growth, setup, memory, memory_by_mesh, errors, missing)
    return [table for make in every if (table := make(results)).rows]


def number(value: float | None) -> str:
    """Return the number as text with three digits; None gives an empty text.

    >>> number(0.1234), number(12.34), number(1234.5), number(None)
    ('0.123', '12.3', '1234', '')
    """
    if value is None:
        return ""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def quotient(above: float | None, below: float | None) -> str:
    return "" if above is None or below is None else number(above / below)


def targets(results: Benchmark) -> FigureTable:
    meshes = judged(results)
    rows = [_row_of(verdict, meshes) for verdict in verdicts(results)]
    columns = ("target", "limit", "moonshot", *meshes, "all", "verdict", "moonshot met")
    note = "One thread, double precision. The worst mesh decides. Targets for two threads apply to the largest meshes only."
    return FigureTable("Targets", note, columns, rows if results.meshes else [])


def _row_of(verdict: TargetVerdict, meshes: list[str]) -> Row:
    target, sign = verdict.target, "≥" if verdict.target.at_least else "≤"
    word = verdict.in_words()
    moonshot = {None: "", True: "yes", False: "no"}[verdict.moonshot]
    return (
        target.what,
        f"{sign} {target.limit:g}",
        "" if target.moonshot is None else f"{sign} {target.moonshot:g}",
        *(number(verdict.values.get(mesh)) for mesh in meshes),
        number(verdict.values.get("")),
        Text(word, style=STYLES[word.split()[0]]),
        Text(moonshot, style="green" if moonshot == "yes" else ""),
    )


def ours(results: Benchmark) -> FigureTable:
    rows: list[Row] = []
    for mesh in results.meshes:
        product = results.best(mesh, CSR, "K v")
        for quantity in QUANTITIES:
            timing = results.timing(mesh, OURS, quantity)
            if timing is not None:
                compared = ("W", "F") if quantity == "W+F" else (quantity,)
                loop = results.best(mesh, CONTROL, "F" if quantity == "W+F" else quantity)
                reference = results.best(mesh, REFERENCE, *compared)
                limit = _limit(results, mesh, quantity)
                ratios = quotient(timing.best, product), quotient(timing.best, loop), quotient(reference, timing.best)
                rows.append((mesh, quantity, number(timing.best), number(timing.median), *ratios, quotient(timing.best, limit)))
    columns = ("mesh", "of", "ns per tet", "median", "CSR products", "of the C loop", "x scikit-fem", "x memory limit")
    note = (
        "One thread, double precision. W+F is compared with scikit-fem's W and F, and with the C loop's F. The row K v is the "
        "product with a vector; its preparation for new displacements has its own row. The memory limit is the time to read and "
        "write the necessary data once, as fast as a copy of arrays that exceed any cache. Smaller meshes fit into a large cache "
        "and can be faster."
    )
    return FigureTable("This package", note, columns, rows, words=2)


def _limit(results: Benchmark, mesh: str, quantity: str) -> float | None:
    """Return the time of the necessary reads and writes at the speed of a copy [ns per tetrahedron]; None if not measured."""
    least = results.least_bytes.get(mesh, {}).get(quantity)
    return None if least is None or results.bandwidth is None else 1e9 * least / results.bandwidth


def precisions(results: Benchmark) -> FigureTable:
    rows: list[Row] = []
    for mesh in results.meshes:
        for implementation, quantity in [(OURS, quantity) for quantity in QUANTITIES] + [(CSR, "K v")]:
            one, two, single, both = (
                results.best(mesh, implementation, quantity, threads=threads, dtype=dtype)
                for dtype in ("float64", "float32")
                for threads in (1, 2)
            )
            if one is not None:
                times = number(one), number(two), quotient(one, two), number(single), number(both), quotient(single, both)
                rows.append((mesh, quantity if implementation == OURS else implementation, *times, quotient(one, single)))
    columns = ("mesh", "of", "float64", "2 threads", "gain", "float32", "2 threads", "gain", "float64/float32")
    return FigureTable("Threads and precision", "Best times, ns per tetrahedron.", columns, rows, words=2)


def models(results: Benchmark) -> FigureTable:
    rows: list[Row] = []
    for mesh in results.meshes:
        usual = [results.best(mesh, MODELS[0], quantity) for quantity in ("W+F", "K")]
        for name in MODELS:
            force, tangent = (results.best(mesh, name, quantity) for quantity in ("W+F", "K"))
            if force is not None:
                of_usual = quotient(force, usual[0]), quotient(tangent, usual[1])
                rows.append((mesh, name, number(force), of_usual[0], number(tangent), of_usual[1]))
    columns = ("mesh", "model", "W+F", "of StVK", "K", "of StVK's")
    note = "One thread, double precision, ns per tetrahedron; alternating calls, a fifth of the deformation of the other tables."
    return FigureTable("Models", note, columns, rows, words=2)


def others(results: Benchmark) -> FigureTable:
    rows: list[Row] = []
    for timing in results.timings:
        if timing.implementation not in (OURS, *MODELS) and timing.dtype == "float64":
            ratio = quotient(timing.best, results.best(timing.mesh, OURS, timing.quantity))
            rows.append((timing.mesh, timing.implementation, timing.quantity, number(timing.best), number(timing.median), ratio))
    columns = ("mesh", "implementation", "of", "ns per tet", "median", "x ours")
    return FigureTable("Others, in the same run", "One thread, double precision.", columns, rows, words=3)


def growth(results: Benchmark) -> FigureTable:
    sizes = [facts["nt"] for name, facts in results.meshes.items() if name.startswith("box")]
    rows: list[Row] = []
    if len(sizes) > 1:
        rows += [(f"time of {q}", number(s)) for q in ("W+F", "K", "K v") if (s := of_time(results, q)) is not None]
        rows += [(f"memory for {q}", number(s)) for q in ("F", "F and K") if (s := of_memory(results, q)) is not None]
    span = f"{min(sizes)} to {max(sizes)} tetrahedra" if sizes else ""
    note = f"Exponent of the number of tetrahedra, fitted over the boxes of {span}."
    return FigureTable("Growth", note, ("of", "exponent"), rows)


def setup(results: Benchmark) -> FigureTable:
    rows: list[Row] = []
    for timing in results.timings:
        if timing.quantity.startswith("setup"):
            in_k = quotient(timing.best, results.best(timing.mesh, OURS, "K"))
            rows.append((timing.mesh, timing.quantity, number(timing.best), number(timing.median), in_k))
    columns = ("mesh", "of", "ns per tet", "median", "in assemblies of K")
    note = "From arrays of points and tetrahedra to the first result, minus the time of one such call. Kernels are compiled before."
    return FigureTable("Setup", note, columns, rows, words=2)


def memory(results: Benchmark) -> FigureTable:
    """Return the memory by part, on the largest mesh with targets."""
    mesh = (judged(results) or [""])[-1]
    entries = [m for m in results.memory if m.mesh == mesh]
    names = dict.fromkeys(name for m in entries for name in m.parts)
    rows: list[Row] = [(name, *(number(m.parts.get(name, 0) / m.nt) for m in entries)) for name in names]
    if rows:
        rows.append(("all but the pattern of K", *(number(m.without_pattern / m.nt) for m in entries)))
    columns = (mesh, *(m.quantity + (", float32" if m.dtype == "float32" else "") for m in entries))
    note = "Bytes per tetrahedron of a system on one thread. The matrix that a user gets contains the pattern and the values of K."
    return FigureTable("Memory by part", note, columns, rows)


def memory_by_mesh(results: Benchmark) -> FigureTable:
    kinds = list(dict.fromkeys((m.quantity, m.dtype) for m in results.memory))
    found = {(m.mesh, m.quantity, m.dtype): m.without_pattern / m.nt for m in results.memory}
    rows: list[Row] = [
        (mesh, *(number(found.get((mesh, *kind))) for kind in kinds))
        for mesh in results.meshes
        if any((mesh, *kind) in found for kind in kinds)
    ]
    columns = ("mesh", *(quantity + (", float32" if dtype == "float32" else "") for quantity, dtype in kinds))
    return FigureTable("Memory by mesh", "Bytes per tetrahedron, all but the pattern of K.", columns, rows)


def errors(results: Benchmark) -> FigureTable:
    strains = sorted({e.strain for e in results.errors}, reverse=True)
    found = {(e.implementation, e.dtype, e.quantity, e.strain): e.error for e in results.errors}
    rows: list[Row] = [
        (*key, *("" if (error := found.get((*key, strain))) is None else f"{error:.0e}" for strain in strains))
        for key in dict.fromkeys(key[:3] for key in found)
    ]
    columns = ("implementation", "in", "of", *(f"strain {strain:.0e}" for strain in strains))
    note = "Largest error of an entry of F, and of K times a vector, against 50 digits, relative to the largest; 64 tetrahedra."
    return FigureTable("Errors", note, columns, rows, words=3)


def missing(results: Benchmark) -> FigureTable:
    rows: list[Row] = list(results.not_measured.items())
    rows += [(what, Text(f"failed: {why}", style="bold red")) for what, why in results.failures.items()]
    return FigureTable("Not measured", "", ("what", "why"), rows, words=2)
