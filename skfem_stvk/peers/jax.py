"""JAX, which differentiates an energy density written in its own arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from .differentiated import Density, Differentiated, Library
from .peer import require


class JAX(Differentiated):
    """`jax.grad` and `jax.hessian` of each element's energy, compiled by XLA; see `Peer`.

    `density(F)` in the place of St. Venant-Kirchhoff's is what a user has written: of F (3, 3), with all its constants, in
    `jax.numpy`. Double precision is set for the whole process.
    """

    name = "JAX"

    def __init__(self, p: Array, t: NDArray[np.int32], young: float, poisson: float, *, density: Density | None = None) -> None:
        jax = require("JAX")
        jax.config.update("jax_enable_x64", True)
        self.version: str = jax.__version__

        def over_elements(function: Callable[..., Any], order: int) -> Callable[..., Any]:
            derivative = (lambda one: one, jax.grad, jax.hessian)[order](function)
            compiled: Callable[..., Any] = jax.jit(jax.vmap(derivative))
            return compiled

        super().__init__(Library(jax.numpy.asarray, over_elements), p, t, (young, poisson), density)
