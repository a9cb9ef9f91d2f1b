"""The benchmark: time, memory and errors of this package and of others in one run, and the targets that they are held against."""

from .plan import FULL, QUICK, Plan
from .results import Benchmark
from .run import bench

__all__ = ["FULL", "QUICK", "Benchmark", "Plan", "bench"]
