"""The command `info`: of the installation, of a mesh, or of a scene."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from rich.console import Console

from ..errors import StvkError
from ..kernels.threads import threads
from ..mesh import read_mesh
from ..referee.header import caches, machine, optional, versions
from ..referee.terminal import WIDTH, printable
from ..scene import Scene
from ..scene.footprint import footprint, table
from ..scene.info import Inspection, inspect_mesh, inspect_scene

#: Options that make the material of a mesh.
MATERIAL = ("young", "poisson", "density")


def info_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `info`."""
    parser.add_argument(
        "file", nargs="?", help="scene file (.toml), or mesh file; without one: versions, machine, optional packages"
    )
    parser.add_argument("--young", type=float, help="Young's modulus of the mesh's material [Pa]")
    parser.add_argument("--poisson", type=float, help="its Poisson's ratio")
    parser.add_argument("--density", type=float, help="its mass density [kg/m^3]")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="another value in a scene")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    parser.add_argument("--footprint", action="store_true", help="what each part of a scene costs: bytes, kernels, times, packages")


def info(options: argparse.Namespace) -> int:
    """Say what would be built of a scene or of a mesh, what it would cost and what is wrong with it.

    The exit code is 2 if no body can be made of it.

    Without a file: versions, the machine, threads, caches and every optional package, or the line that installs it.
    """
    if options.footprint:
        return _footprint(options)
    if options.file is None:
        return _of_installation(options)
    found = inspect_scene(_scene(options)) if options.file.endswith(".toml") else _of_mesh(options)
    console = Console(highlight=False)
    console = console if console.is_terminal else Console(highlight=False, width=WIDTH)
    if options.json:
        print(json.dumps(found.to_dict(), indent=1))
    else:
        console.print(found.rendered(console.width))
    return 2 if found.refused else 0


def _of_installation(options: argparse.Namespace) -> int:
    facts = machine() | {"kernels run on": f"{threads()} threads"} | caches() | versions() | optional()
    if options.json:
        print(json.dumps(facts, indent=1))
        return 0
    console = Console(highlight=False)
    for name, value in facts.items():
        console.print(f"{name:>16}  {printable(str(value))}", soft_wrap=True)
    return 0


def _scene(options: argparse.Namespace) -> Scene:
    given = [f"--{name}" for name in MATERIAL if getattr(options, name) is not None]
    if given:
        raise StvkError(f"{', '.join(given)}: a scene has materials of its own. Change them by --set materials.NAME.young=...")
    return Scene.read(options.file, options.set)


def _footprint(options: argparse.Namespace) -> int:
    """Print what each part of a scene costs."""
    if not (options.file or "").endswith(".toml"):
        raise StvkError(f"--footprint is of a scene: got {options.file or 'no file'}; expected a scene file (.toml).")
    rows = footprint(_scene(options).built)
    if options.json:
        print(json.dumps([row._asdict() for row in rows], indent=1))
    else:
        console = Console(highlight=False)
        console = console if console.is_terminal else Console(highlight=False, width=WIDTH)
        console.print(table(rows))
    return 0


def _of_mesh(options: argparse.Namespace) -> Inspection:
    if options.set:
        raise StvkError(
            "--set changes keys of a scene file (.toml); a mesh file has none. Its material is --young, --poisson, --density."
        )
    given = {name: getattr(options, name) for name in MATERIAL}
    if options.young is None and any(value is not None for value in given.values()):
        raise StvkError("A material needs --young (Pa), e.g. --young 70e9 --poisson 0.33 --density 2700.")
    return inspect_mesh(read_mesh(Path(options.file)), **given)
