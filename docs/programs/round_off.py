"""The error of F of this package, of a textbook form and of scikit-fem, against the strain: cancellation at small strains."""

from pathlib import Path

import skfem

from skfem_stvk import verify
from skfem_stvk.referee.plots import error_against_strain

report = verify(skfem.MeshTet.init_ball(2), young=1e5, poisson=0.3, quiet=True)


def picture():
    """Draw the error of F against the strain."""
    return error_against_strain(report.precision)


if __name__ == "__main__":
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=150)
