"""The benchmark: time, memory and errors of this package and of others in one run, and the targets that they are held against."""

from .results import FULL, QUICK, Benchmark, Plan
from .run import bench

__all__ = ["FULL", "QUICK", "Benchmark", "Plan", "bench"]
