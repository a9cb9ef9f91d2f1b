"""A textbook law, and five common mistakes by a factor of 2: the checks that detect each mistake, and the text of the report.

A neo-Hookean law (Bonet, Wood, 2008, section 6.4): W, the second Piola-Kirchhoff stress S and its tangent C = dS/dE as functions of
the deformation gradient F. No mesh is needed.
"""

import textwrap

import numpy as np

from skfem_stvk import NeoHookean, verify_law

LAM, MU = 10.0, 4.0
CLAIM = NeoHookean(young=MU * (3 * LAM + 2 * MU) / (LAM + MU), poisson=LAM / 2 / (LAM + MU))


def law(lam=LAM, mu=MU, stress=1.0, tangent=1.0, logarithm=1.0):
    """Return W, S and C; the arguments introduce mistakes."""

    def log_of_volume(F):
        return np.log(np.linalg.det(F)) if np.linalg.det(F) > 0 else np.nan

    def W(F):
        return mu / 2 * (np.trace(F.T @ F) - 3) - mu * log_of_volume(F) + lam / 2 * log_of_volume(F) ** 2

    def S(F):
        inverse = np.linalg.inv(F.T @ F)
        return stress * (mu * (np.eye(3) - inverse) + lam * log_of_volume(F) * inverse)

    def C(F):
        inverse = np.linalg.inv(F.T @ F)
        both = np.einsum("ik,jl->ijkl", inverse, inverse) + np.einsum("il,jk->ijkl", inverse, inverse)
        of_lam = lam * np.einsum("ij,kl->ijkl", inverse, inverse)
        return tangent * (of_lam + (mu - logarithm * lam * log_of_volume(F)) * both)

    return {"energy": W, "stress": S, "elasticity": C}


MISTAKES = {
    "right": {},
    "lambda doubled everywhere": {"lam": 2 * LAM},
    "E/(1 + nu) taken for mu": {"mu": 2 * MU},
    "S = dW/dC, not 2 dW/dC": {"stress": 0.5},
    "C = dS/dC, not 2 dS/dC": {"tangent": 0.5},
    "2 lambda ln J in C": {"logarithm": 2.0},
}

reports = {name: verify_law(**law(**mistake), claims=CLAIM) for name, mistake in MISTAKES.items()}
failed = {name: sorted({f"{r.check} ({r.quantity})" for r in report.failures()}) for name, report in reports.items()}


def said(report):
    """Return the lines of the report that name the mistake."""
    return [] if report.named is None else report.named.lines()


def picture():
    import matplotlib.pyplot as plt

    checks = list(dict.fromkeys(check for found in failed.values() for check in found))
    finds = np.array([[check in failed[name] for name in MISTAKES] for check in checks])
    figure, axes = plt.subplots(figsize=(9, 3.6), layout="constrained")
    axes.imshow(finds, cmap="cividis_r", vmin=0, vmax=1.4, aspect="auto")
    axes.set_yticks(range(len(checks)), checks)
    axes.set_xticks(range(len(MISTAKES)), [textwrap.fill(name, 14) for name in MISTAKES])
    axes.set_xticks(np.arange(0.5, len(MISTAKES)), minor=True)
    axes.set_yticks(np.arange(0.5, len(checks)), minor=True)
    axes.grid(which="minor", color="0.8")
    axes.tick_params(which="minor", length=0)
    axes.set_title("Which check of the law finds which mistake")
    return figure


if __name__ == "__main__":
    for name, report in reports.items():
        print(f"{name}: {', '.join(failed[name]) or 'passed'}")
        for line in said(report):
            print(f"    {line}")
