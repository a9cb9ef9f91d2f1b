"""Verification of another program by test vectors: correct, in single precision, and with one missing pair of edges.

The function represents a program in any language. It reads the arrays of `vectors.npz` and writes `results.npz`.
"""

import tempfile
from pathlib import Path

import numpy as np

from skfem_stvk import published_vectors, verify_results


def their_program(folder, dtype=np.float64, forget=False):
    """Compute W and F in every state from edges and pairs of edges, and write them."""
    given = dict(np.load(folder / "vectors.npz"))
    X, own, between = (given[name].astype(dtype) for name in ("nodes", "edge_coefficients", "pair_coefficients"))
    (a, b), (i, j) = given["edges"].T, given["pairs"].T
    if forget:
        between[np.abs(between).argmax()] = 0
    W, F = [], []
    for u in given["u"].astype(dtype).reshape(-1, *X.shape):
        P, U = X[a] - X[b], u[a] - u[b]
        p, zeta = P + U, ((P + P + U) * U).sum(axis=1)
        tension = own * zeta
        np.add.at(tension, i, between * zeta[j])
        np.add.at(tension, j, between * zeta[i])
        force = np.zeros_like(X)
        np.add.at(force, a, tension[:, None] * p)
        np.subtract.at(force, b, tension[:, None] * p)
        W.append(tension @ zeta / 4)
        F.append(force.ravel())
    np.savez(folder / "results.npz", W=np.array(W, dtype=float), F=np.array(F, dtype=float))


def judged(**how):
    """Return the report on the results of the program, as `skfem-stvk verify --results` prints it."""
    with tempfile.TemporaryDirectory() as place:
        folder = published_vectors("block").save(place)
        their_program(folder, **how)
        return verify_results(folder)


reports = {
    "double precision": judged(),
    "single precision": judged(dtype=np.float32),
    "one pair of edges forgotten": judged(forget=True),
}
errors = {
    name: {result.state: result.measured for result in report.results if (result.check, result.quantity) == ("agreement", "F")}
    for name, report in reports.items()
}


def picture():
    """Draw the error of F in each state, and the limit; zero errors are drawn at 1e-17."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots()
    states = list(errors["double precision"])
    for marker, (name, of) in zip("os^", errors.items(), strict=True):
        axes.semilogy(states, [max(of[state], 1e-17) for state in states], marker, label=name, markersize=8)
    axes.axhline(1e-12, color="black", linewidth=1, label="limit")
    axes.set(
        ylabel="error of F against 50 digits", ylim=(5e-18, 10), title="what a program computed from the vectors of ten tetrahedra"
    )
    axes.set_xticks(range(len(states)), states, rotation=25, ha="right")
    axes.grid(alpha=0.3)
    axes.legend(loc="upper left", bbox_to_anchor=(1, 1))
    return figure


if __name__ == "__main__":
    for name, report in reports.items():
        print(f"{name}: {'passed' if report.passed else 'not passed'}, F off by up to {max(errors[name].values()):.1e}")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=90)
