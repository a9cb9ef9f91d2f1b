"""Comparison of spring networks with the elastic body: shares of energy, errors and speed, for one mesh, material and state."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.linalg import norm

from ..arguments import Array, shown
from ..errors import MaterialError, MeshError, StvkError, StvkWarning
from ..mesh import ElementMesh, MeshLike
from ..system import System
from ..terms import EdgeNetwork, SpringNetwork, StVK
from ..terms.laws.spring_network import RULES
from .complete_files import output_path

#: Minimum number of timed calls, and minimum total time [s].
CALLS, SECONDS = 3, 0.05
#: A model with a smaller error of F equals the elastic body up to rounding.
EXACT = 1e-9


@dataclass(frozen=True)
class Row:
    """Comparison of a model with the elastic body at one state.

    Attributes
    ----------
    name
        Name of the model.
    force
        Error of the force `|F - F_StVK| / |F_StVK|`, Euclidean norms over all degrees of freedom.
    energy
        Error of the energy `W / W_StVK - 1`.
    at_rest
        Error of the stiffness at rest `|K(0) - K_StVK(0)| / |K_StVK(0)|`, Frobenius norms.
    ns
        Time for W and F [ns per element].
    ratio
        Time relative to that of `StVK`.
    """

    name: str
    force: float
    energy: float
    at_rest: float
    ns: float
    ratio: float


@dataclass(frozen=True)
class NetworkComparison:
    """Result of `compare_networks`; it prints itself as a table.

    Attributes
    ----------
    shares
        The fractions of the strain energy in `edges`, `adjacent` and `opposite` pairs of edges, of sum 1; fractions of pairs can be
        negative.
    rows
        A `Row` for each model, `StVK` first.
    strain
        The largest elongation of an edge, `|l/L - 1|`.
    """

    shares: dict[str, float]
    rows: tuple[Row, ...]
    strain: float

    def __getitem__(self, name: str) -> Row:
        for row in self.rows:
            if row.name == name:
                return row
        raise StvkError(
            f"name = {shown(name)}; expected the name of a compared model: {', '.join(repr(row.name) for row in self.rows)}."
        )

    def __str__(self) -> str:
        width = max(len(row.name) for row in self.rows)
        parts = ", ".join(f"{value:.1%} in {name}" for name, value in self.shares.items())
        lines = [
            f"Strain energy of the elastic body: {parts} (edges elongated by up to {self.strain:.1%}).",
            f"{'':{width}}  error of F  error of W  K at rest  ns/element  time",
        ]
        for row in self.rows:
            errors = f"{row.force:>10.2%}  {row.energy:>+10.2%}  {row.at_rest:>9.2%}"
            lines.append(f"{row.name:{width}}  {errors}  {row.ns:>10.1f}  {row.ratio:.2f} x")
        return "\n".join(lines)

    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """Draw the shares of the energy, and the error of F over time; return matplotlib's `Figure`, written to `path` if there is
        one.

        Raises StvkError if the path does not end in .png, .pdf or .svg or cannot be written.
        """
        target = None if path is None else output_path(path, ".png", ".pdf", ".svg")
        return _draw(self, target)


def compare_networks(mesh: MeshLike, law: StVK, u: ArrayLike) -> NetworkComparison:
    """Compare spring networks with the elastic body that they approximate, at a state.

    The compared models are: all edges and pairs of edges (`EdgeNetwork`, exact); without opposite, and without adjacent pairs;
    edges alone, which are quartic springs; and Hookean springs (`SpringNetwork`). Each rule for this material and these elements is
    included, `"lloyd"` also for Poisson's ratios other than its own. Times are those of one run on this machine.

    Parameters
    ----------
    mesh
        Mesh of linear simplices.
    law
        Law of the body, with its material.
    u
        Displacements (ndofs,) [m], with strain.

    Returns
    -------
    NetworkComparison
        One `Row` for each model, the shares of the energy and the largest strain; it prints itself as a table.

    Raises
    ------
    MeshError
        if the elements are not linear simplices.
    StvkError
        if `law` is not `StVK`, or `u` has no strain energy.
    StateError
        if `u` does not have one finite entry for each degree of freedom.

    Examples
    --------
    >>> import skfem
    >>> mesh = skfem.MeshTet().refined(2)
    >>> found = compare_networks(mesh, StVK(young=1.0, poisson=0.25), 0.1 * (mesh.p[[1, 2, 0]] ** 2).ravel("F"))
    >>> {name: round(share, 3) for name, share in found.shares.items()}
    {'edges': 3.964, 'adjacent pairs': -1.686, 'opposite pairs': -1.278}
    >>> found["edges and pairs"].force < 1e-12 < 0.1 < found["van-gelder springs"].force
    True
    """
    body = ElementMesh.of(mesh)
    if body.space.comm.divided:
        raise StvkError("mesh is a part of a divided body; expected a whole mesh: the comparison needs the whole stiffness.")
    if not hasattr(law, "coefficients"):
        raise StvkError(f"law = {shown(law)}; expected StVK(young=..., poisson=...).")
    if not body.element.is_linear_simplex:
        raise MeshError(
            f"The mesh has {body.kind}; expected linear simplices, because networks lie along their edges. Use degree=1."
        )
    network = EdgeNetwork.of(body, law)
    models: dict[str, Any] = {"StVK": law, "edges and pairs": network}
    if body.k == 3:
        models["without opposite pairs"] = network.without("opposite")
        models["without adjacent pairs"] = network.without("adjacent")
    models["quartic springs"] = network.diagonal()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)  # warnings of rules for other Poisson's ratios: the table reports them
        for rule in RULES:
            springs = SpringNetwork(law.material, rule, None, law.region, law.plane, law.thickness, area=law.area)
            try:
                springs.constants(body)
            except MaterialError:
                continue
            models[f"{rule} springs"] = springs
        systems = {name: System(body, term) for name, term in models.items()}
    W0, F0 = systems["StVK"].energy_and_force(u)
    if not W0 > 0:
        raise StvkError("u has no strain energy; expected displacements that strain the body, so that energies can be compared.")
    rest, K0 = np.zeros(body.p.size), systems["StVK"].tangent(np.zeros(body.p.size))
    rows, times = [], _times(systems, np.asarray(u, dtype=float))
    for name, system in systems.items():
        W, F = system.energy_and_force(u)
        error = np.linalg.norm(F - F0) / np.linalg.norm(F0)
        at_rest = norm(system.tangent(rest) - K0) / norm(K0)
        n = len(body.elements(law.region))
        rows.append(Row(name, float(error), W / W0 - 1, float(at_rest), 1e9 * times[name] / n, times[name] / times["StVK"]))
    form = law.bind(body).form
    x = np.asarray(u, dtype=float).reshape(-1, body.d)
    lengths = np.linalg.norm(form.P, axis=1)
    strain = np.linalg.norm(form.P + form.differences(x), axis=1) / lengths - 1
    return NetworkComparison(_shares(network, form.squared_elongations(x)), tuple(rows), float(np.abs(strain).max()))


def _shares(network: EdgeNetwork, zeta: Array) -> dict[str, float]:
    """Return the fractions of `1/4 zeta' L zeta` in the edges, and in their pairs."""
    i, j = network.pairs
    each = np.asarray(network.L[i, j]).ravel() * zeta[i] * zeta[j] * 2
    parts = {
        "edges": network.L.diagonal() @ zeta**2,
        "adjacent pairs": each[network.adjacent].sum(),
        "opposite pairs": each[~network.adjacent].sum(),
    }
    total = sum(parts.values())
    return {name: float(value / total) for name, value in parts.items() if name == "edges" or len(each)}


def _times(systems: dict[str, System], u: Array) -> dict[str, float]:
    """Return the shortest time of W and F of each system [s], all in turn."""
    best, out = dict.fromkeys(systems, np.inf), np.zeros(len(u))
    for system in systems.values():
        system.energy_and_force(u, out=out)  # compiles, and makes the cached data
    begin, calls = perf_counter(), 0
    while calls < CALLS or perf_counter() - begin < SECONDS * len(systems):
        for name, system in systems.items():
            start = perf_counter()
            system.energy_and_force(u, out=out)
            best[name] = min(best[name], perf_counter() - start)
        calls += 1
    return best


def _draw(found: NetworkComparison, path: Path | None) -> Any:
    from matplotlib.figure import Figure

    from ..about import write_machine

    figure = Figure(figsize=(6.8, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.15))
    values = [100 * share for share in found.shares.values()]
    left.bar([name.replace(" ", "\n") for name in found.shares], values, color=["#0072B2", "#D55E00", "#009E73"])
    for i, value in enumerate(values):
        left.annotate(f"{value:.0f} %", (i, max(value, 0)), (0, 3), textcoords="offset points", ha="center")
    left.axhline(0, color="#444444", lw=0.8)
    left.margins(y=0.15)
    left.set(ylabel="share of the strain energy [%]", title="StVK")
    rows = sorted(found.rows[1:], key=lambda row: -row.force)
    right.barh([row.name for row in rows], [100 * row.force for row in rows], color="#0072B2", alpha=0.8)
    for i, row in enumerate(rows):
        label = "exact" if row.force < EXACT else f"{row.force:.1%}"
        right.annotate(
            f"{label}, {row.ratio:.2f} x", (100 * row.force, i), (4, 0), textcoords="offset points", va="center", fontsize=9
        )
    right.margins(x=0.75)
    right.set(xlabel="error of F [%]", title="networks; time for W and F, StVK 1 x")
    for axes in (left, right):
        axes.title.set_fontsize(9)
        axes.tick_params(labelsize=9)
    left.tick_params("x", labelsize=8)
    figure.suptitle(f"A state with edges elongated by up to {found.strain:.1%}", fontsize=9)
    write_machine(figure)
    if path is not None:
        figure.savefig(path, dpi=150)
    return figure
