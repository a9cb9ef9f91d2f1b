"""`python -m validation STUDY`: the studies whose figures stand in the README and the docs."""

from __future__ import annotations

import argparse
import sys

from . import aspect, kernels, operations, part

STUDIES = {"part": part.main, "aspect": aspect.main, "kernels": kernels.main, "operations": operations.main}


def main() -> int:
    """Run one study; the exit code is 0 if it came out as it must."""
    parser = argparse.ArgumentParser(prog="python -m validation", description=__doc__)
    parser.add_argument("study", choices=STUDIES, help="; ".join(f"{name}: {study.__doc__}" for name, study in STUDIES.items()))
    return STUDIES[parser.parse_args().study]()


if __name__ == "__main__":
    sys.exit(main())
