"""PyTorch, which differentiates an energy density written in its own tensors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from .differentiated import Density, Differentiated, Library
from .peer import require


class PyTorch(Differentiated):
    """`torch.func.grad` and `torch.func.hessian` of each element's energy, in double precision on the processor; see `Peer`.

    `density(F)` in the place of St. Venant-Kirchhoff's is what a user has written: of F (3, 3), with all its constants, in `torch`.
    """

    name = "PyTorch"

    def __init__(self, p: Array, t: NDArray[np.int32], young: float, poisson: float, *, density: Density | None = None) -> None:
        torch = require("PyTorch")
        self.version: str = torch.__version__

        def over_elements(function: Callable[..., Any], order: int) -> Callable[..., Any]:
            derivative = (lambda one: one, torch.func.grad, torch.func.hessian)[order](function)
            mapped: Callable[..., Any] = torch.func.vmap(derivative)
            return mapped

        super().__init__(Library(torch.from_numpy, over_elements), p, t, (young, poisson), density)
