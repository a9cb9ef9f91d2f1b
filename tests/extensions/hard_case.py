"""A toy group of hard cases: a cube that is stretched along one axis, with rollers on the other faces."""

import numpy as np

from validation.hard import meshes, truths
from validation.hard.case import Body, Case


def stretched():
    return Body(
        meshes.cube(2),
        1e5,
        0.3,
        fixed={lambda x, i=i: x[i] == 0: "xyz"[i] for i in range(3)} | {lambda x: x[1] == 1: "y", lambda x: x[2] == 1: "z"},
        prescribed={lambda x: x[0] == 1: {"x": 0.5}},
    )


def hard_case():
    truth = truths.homogeneous(np.diag([1.5, 1.0, 1.0]), "closed form: uniaxial strain")
    return [Case("stretch a cube by 50 %", stretched, 2, truth, truth)]
