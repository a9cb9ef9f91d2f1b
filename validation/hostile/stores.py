"""Files of runs, responses and scenes that are replaced, cut or damaged: the run restores its data bit for bit, or refuses them."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import skfem

from skfem_stvk import NodalLoad, PrecomputedResponse, Scene, StVK, StvkError, System, VelocityVerlet, simulate, solve_static

from .case import Case, Verdict, Wrong


def strip(young: float) -> System:
    """Return a strip in the plane, clamped at its left end and pulled down at its right end."""
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 9), np.linspace(0, 0.3, 4))
    terms: list[Any] = [StVK(young=young, poisson=0.3, density=1.0), NodalLoad(lambda x: x[0] >= 1, (0.0, -2e-4))]
    return System(mesh, terms, fixed={lambda x: x[0] == 0: "xy"})


@dataclass(frozen=True)
class Store:
    """File of a kind of run.

    Attributes
    ----------
    file
        Name of the file in the folder.
    make, again
        Functions of the folder and of Young's modulus that write the file, and that read it. Both return the same numbers.
    """

    file: str
    make: Callable[[Path, float], Any]
    again: Callable[[Path, float], Any]


def _motion(folder: Path, young: float, until: float = 0.3, resume: bool = False) -> Any:
    run = simulate(strip(young), VelocityVerlet(0.01), until=until, checkpoint=folder, resume=resume, quiet=True)
    return run.u, run.v, run.ledger.rows()


def _path(folder: Path, young: float, resume: bool = False) -> Any:
    result = solve_static(strip(young), steps=2, solver="superlu", checkpoint=folder, resume=resume, quiet=True)
    return (result.u,)


AXES = [[-0.02, 0.0, 0.02], [0.0, 0.02]]


def _response(folder: Path, young: float) -> Any:
    folder.mkdir(exist_ok=True)
    answers = PrecomputedResponse(strip(young), lambda x: x[0] >= 1, AXES, checks=1, quiet=True)
    answers.save(folder / "table.npz")
    return answers((0.01, 0.01))


def _loaded(folder: Path, young: float) -> Any:
    return PrecomputedResponse.load(folder / "table.npz", strip(young))((0.01, 0.01))


STORES = {
    "motion": Store("motion.npz", _motion, partial(_motion, resume=True)),
    "load steps": Store("state_00001.npz", _path, partial(_path, resume=True)),
    "response": Store("table.npz", _response, _loaded),
}


class _Shell:
    """Object whose unpickling runs a shell command."""

    def __reduce__(self) -> Any:
        return os.system, ("touch owned",)


def _cut(part: float, path: Path) -> None:
    path.write_bytes(path.read_bytes()[: int(part * path.stat().st_size)])


def _flipped(seed: int, path: Path) -> None:
    rng, content = np.random.default_rng(seed), bytearray(path.read_bytes())
    for index in rng.integers(0, len(content), 3):
        content[index] ^= int(rng.integers(1, 256))
    path.write_bytes(content)


def _instead(make: Callable[[Path], Any], path: Path) -> None:
    path.unlink()
    make(path)


#: Contents that replace a file.
NOT_OURS: dict[str, Callable[[Path], Any]] = {
    "empty": lambda path: path.write_bytes(b""),
    "text": lambda path: path.write_bytes(b"hello"),
    "a pickle": lambda path: path.write_bytes(pickle.dumps(_Shell())),
    "an archive of pickles": lambda path: np.savez(path, header=np.array([_Shell()], dtype=object)),
    "an archive of others": lambda path: np.savez(path, a=np.ones(3)),
    "an archive of compressed zeros": lambda path: np.savez_compressed(path, header=np.zeros(10**7)),
    "a folder": partial(_instead, os.mkdir),
    "a fifo": partial(_instead, os.mkfifo),
    "/dev/zero": partial(_instead, lambda path: path.symlink_to("/dev/zero")),
    "a link to itself": partial(_instead, lambda path: path.symlink_to(path.name)),
}
DAMAGES: dict[str, Callable[[Path], Any]] = {
    **NOT_OURS,
    **{f"cut at {percent} %": partial(_cut, percent / 100) for percent in range(5, 100, 10)},
    **{f"of three other bytes, seed {seed}": partial(_flipped, seed) for seed in range(20)},
}


def cases() -> Iterator[Case]:
    """Yield all damages of all files, files of another problem, and scenes."""
    for name, store in STORES.items():
        for what, damage in DAMAGES.items():
            attempt = partial(_damaged, store, damage, 1.0)
            yield Case(f"{name}: a file that is {what}", attempt, lambda same: None, refused, quick=what == "a fifo")
        yield Case(f"{name}: the file of another modulus", partial(_damaged, store, lambda path: None, 0.9), refused=refused)
    for what, text in SCENES.items():
        yield Case(f"scene: {what}", partial(_scene, partial(_written, text)))
    for what, damage in NOT_OURS.items():
        yield Case(f"scene: a file that is {what}", partial(_scene, damage))


def refused(error: BaseException) -> bool:
    """Return whether an error is one of this package that explains something, also one of solves and motions."""
    return isinstance(error, StvkError) and len(str(error).split()) > 5


def _damaged(store: Store, damage: Callable[[Path], Any], factor: float, folder: Path) -> None:
    """Write the file, damage it, and read it for a body with another modulus. Raise `Wrong` if the numbers differ."""
    expected = store.make(folder / "saved", 3.0)
    damage(folder / "saved" / store.file)
    found = store.again(folder / "saved", 3.0 * factor)
    if factor != 1.0:
        raise Wrong(Verdict.SILENT, "the files of another problem were accepted")
    if not all(map(np.array_equal, found, expected)):
        raise Wrong(Verdict.SILENT, "the result differs from that of the undamaged file; expected equal bits")


#: Texts of scenes that are too large or too deep.
SCENES = {
    "900 lists in lists": f"x = {900 * '['}{900 * ']'}\n",
    "900 tables in tables": f"x = {900 * '{a = '}1{900 * '}'}\n",
    "a key of 3 000 parts": f"{3_000 * 'a.'}a = 1\n",
    "10 000 terms": 10_000 * "[[terms]]\n",
    "20 000 materials": "".join(f"[materials.m{n}]\n" for n in range(20_000)),
}


def _written(text: str, path: Path) -> None:
    path.write_text(text)


def _scene(write: Callable[[Path], Any], folder: Path) -> Any:
    (folder / "scene.toml").touch()
    write(folder / "scene.toml")
    return Scene.read(folder / "scene.toml")
