"""Ten wrong models, and the names that the referee gives to their faults.

If a user's W, F and K fail, the report also names the fault. The referee tests hypotheses and prints those that make the error
vanish, with fitted factors.
"""

import textwrap
from pathlib import Path

from skfem_stvk.referee.faults import FAULTS, bodies
from skfem_stvk.testing import Inconsistent, assert_consistent

PLANTED = (
    "twice lambda", "half mu", "plane-stress lambda", "no half in E", "deformed volume", "one tet skipped", "components first",
    "no geometric term", "frames transposed", "midside nodes exchanged",
)  # fmt: skip


def what_it_is(name):
    """Return the names that the referee gives to a planted fault, and the errors with and without it."""
    fault = FAULTS[name]
    body = bodies()[fault.body]
    try:
        assert_consistent(fault.make(body.mesh, body.terms), body.mesh, body.terms, **body.options)
    except Inconsistent as error:
        return error.report.named
    return None


named = {name: what_it_is(name) for name in PLANTED}


def picture():
    import matplotlib.pyplot as plt
    import numpy as np

    figure, axes = plt.subplots(figsize=(6.6, 4), layout="constrained")
    y = np.arange(len(PLANTED))[::-1]
    before = [named[name].before for name in PLANTED]
    after = [max(1e-16, *(one.residual for one in named[name].explanations)) for name in PLANTED]
    axes.hlines(y, after, before, color="0.8", lw=6)
    axes.plot(before, y, "o", color="#0072B2", label="error of the candidate")
    axes.plot(after, y, "s", color="#E69F00", label="what its explanation leaves")
    for row, name in zip(y, PLANTED, strict=True):
        axes.text(3e-14, row, named[name].names[0], va="center", fontsize=9)
    axes.set(xscale="log", xlim=(3e-17, 100), yticks=y, yticklabels=PLANTED, xlabel="relative error", title="Planted, and named")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def told():
    """Return the lines of the report on each planted fault, after its description."""
    lines = []
    for name in PLANTED:
        lines.append(f"{name}: {FAULTS[name].description}")
        for line in named[name].lines()[1:]:
            lines += textwrap.wrap(line, 118, initial_indent="    ", subsequent_indent="    ")
    return lines


if __name__ == "__main__":
    print("\n".join(told()))
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=150)
