"""Draw the pictures of the gallery's programs that other pages show: `python docs/draw.py ex01_loaded_bracket ...`."""

import os
import runpy
import sys
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt

os.chdir(Path(__file__).parent / "examples")
shown = [path.stem for path in sorted(Path().glob("ex[0-2]*.png"))]
for name in sys.argv[1:] or shown:
    plt.close("all")
    with plt.rc_context():
        runpy.run_path(f"{name}.py", run_name="__main__")
        plt.figure(1).savefig(f"{name}.png")  # the others are of films
