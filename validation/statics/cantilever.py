"""Cantilever of the speed studies: 5 x 1 x 1 m, clamped at x = 0. The load bends its end by half of its length."""

from __future__ import annotations

LENGTH, YOUNG, POISSON = 5.0, 1.5e6, 0.3
TRACTION = (0.0, 0.0, -1.0e4)  # force per rest area at the end [Pa]: P L^2/EI = 2
RTOL = 1e-8
