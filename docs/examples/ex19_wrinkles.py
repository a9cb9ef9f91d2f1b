"""A sheet in shear between two clamps, with and without wrinkling: a tension field.

The lower edge is fixed, and the upper edge moves sideways. Without wrinkling, the flat sheet has compression normal to the tension.
This equilibrium is unstable, and the result reports it. With wrinkling, the stress has one direction. In the middle it is close to
the closed form of an infinite strip.
"""

from pathlib import Path

import numpy as np
import skfem

from skfem_stvk import ElementMesh, StVK, System, solve_static

YOUNG, SHEAR = 1e6, 0.2
flat = skfem.MeshTri.init_tensor(np.linspace(0, 4, 33), np.linspace(0, 1, 9))
sheet = ElementMesh(np.concatenate([flat.p, np.zeros((1, flat.p.shape[1]))]), flat.t)
lower, upper = np.flatnonzero(flat.p[1] == 0), np.flatnonzero(flat.p[1] == 1)


def sheared(wrinkling):
    """Return the equilibrium of the sheet between its clamps."""
    law = StVK(young=YOUNG, poisson=0.3, thickness=1e-3, wrinkling=wrinkling)
    moved = {tuple(upper): {"x": SHEAR, "y": 0.0, "z": 0.0}}
    return solve_static(
        System(sheet, law, fixed={tuple(lower): "xyz"}, prescribed=moved),
        steps=4,
        quiet=True,
        raise_on_failure=False,
    )


results = {"with wrinkling": sheared(True), "without": sheared(False)}
E1 = SHEAR**2 / 4 + np.sqrt(
    SHEAR**4 / 16 + SHEAR**2 / 4
)  # principal strain of an infinite strip
middle = np.flatnonzero(np.abs(sheet.p[0][sheet.t].mean(axis=0) - 2) < 0.5)
principal = {
    name: np.linalg.eigvalsh(result.state["pk2_stress"])[middle].mean(axis=0)[[0, -1]]
    for name, result in results.items()
}
forces = {
    name: float(result.reaction(tuple(upper)).resultant[0])
    for name, result in results.items()
}


def picture():
    """Draw the von Mises stress in the wrinkling sheet."""
    return results["with wrinkling"].plot("von_mises_stress")


if __name__ == "__main__":
    for name, (least, most) in principal.items():
        print(
            f"{name}: from {least:.0f} to {most:.0f} Pa in the middle, {forces[name]:.1f} N at the clamp"
        )
    print(f"An endless strip that wrinkles: 0 and {YOUNG * E1:.0f} Pa")
    picture().savefig(Path(__file__).with_suffix(".png"), dpi=80)
