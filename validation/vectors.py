"""Published test vectors: `python -m validation.vectors` writes them to `skfem_stvk/referee/data`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skfem_stvk import ElementMesh, StVK
from skfem_stvk.mesh.element import ELEMENTS
from skfem_stvk.referee.vectors import PUBLISHED, Vectors, export_vectors
from skfem_stvk.results.array_files import write_npz

FOLDER = Path(__file__).parent.parent / "skfem_stvk" / "referee" / "data"


def made(name: str) -> Vectors:
    """Return a published set: all edges differ, both orientations occur, and lambda differs from mu."""
    mesh, laws = {"tetrahedron": _tetrahedron, "block": _block, "membrane": _membrane, "curved": _curved, "hexahedra": _hexahedra}[
        name
    ]()
    return export_vectors(mesh, laws, title=name, seed=19, quiet=True)


def _tetrahedron() -> tuple[ElementMesh, list[StVK]]:
    p = np.array([[0.0, 1.0, 0.2, 0.1], [0.0, 0.1, 0.8, 0.3], [0.0, -0.1, 0.1, 0.9]])
    return ElementMesh(p, np.arange(4, dtype=np.int32)[:, None]), [StVK(young=1e5, poisson=0.3)]


def _block() -> tuple[ElementMesh, list[StVK]]:
    """Return two cubes of five tetrahedra each, of two materials; every second element has negative orientation."""
    x = np.array([[i, j, k] for i in range(3) for j in range(2) for k in range(2)], dtype=float).T
    x += 0.1 * np.random.default_rng(1).uniform(-1, 1, x.shape)
    five = np.array([[0, 1, 2, 4], [3, 1, 7, 2], [5, 1, 4, 7], [6, 2, 7, 4], [1, 2, 4, 7]]).T
    mirrored = np.array([4, 5, 6, 7, 0, 1, 2, 3])[five] + 4  # diagonals of the neighbour coincide with those of the first
    t = np.concatenate([five, mirrored], axis=1)
    t[:2, ::2] = t[1::-1, ::2]
    halves = [np.arange(5), np.arange(5, 10)]
    return ElementMesh(x, t), [StVK(young=1e5, poisson=0.3, region=halves[0]), StVK(young=3e4, poisson=0.45, region=halves[1])]


def _membrane() -> tuple[ElementMesh, list[StVK]]:
    x, y = np.array([[i, j] for i in range(3) for j in range(3)], dtype=float).T / 2
    p = np.stack([x, y, 0.2 * np.sin(3 * x) + 0.3 * y**2]) + 0.03 * np.random.default_rng(2).uniform(-1, 1, (3, 9))
    t = np.array([[a, a + 3, a + 1, a + 1, a + 3, a + 4] for a in (0, 1, 3, 4)]).reshape(-1, 3).T
    return ElementMesh(p, t), [StVK(young=2e6, poisson=0.4, thickness=2e-3)]


def _curved() -> tuple[ElementMesh, list[StVK]]:
    p = np.array([[0.0, 1.0, 0.1, 0.2, 0.9], [0.0, 0.1, 0.9, 0.2, 0.8], [0.0, 0.0, -0.1, 1.0, 0.7]])
    mesh = ElementMesh(p, np.array([[0, 1, 2, 3], [1, 2, 4, 3]]).T).with_degree(2)
    bent = mesh.p.copy()
    bent[:, 5:] += 0.04 * np.random.default_rng(3).uniform(-1, 1, bent[:, 5:].shape)
    return ElementMesh(bent, mesh.t, element=mesh.element), [StVK(young=1e5, poisson=0.3)]


def _hexahedra() -> tuple[ElementMesh, list[StVK]]:
    element = ELEMENTS["hexahedra"]
    first, second = (element.nodes.T + shift for shift in (0.0, np.array([[1.0], [0.0], [0.0]])))
    p, number = np.unique(np.concatenate([first, second], axis=1), axis=1, return_inverse=True)
    p = p + 0.08 * np.random.default_rng(4).uniform(-1, 1, p.shape)
    return ElementMesh(p, number.reshape(2, 8).T, element=element), [StVK(young=1e5, poisson=0.35)]


def main() -> None:
    """Write all published sets."""
    FOLDER.mkdir(exist_ok=True)
    for name in PUBLISHED:
        write_npz(FOLDER / f"{name}.npz", made(name).arrays)
        print(f"{name}: {(FOLDER / f'{name}.npz').stat().st_size} B")


if __name__ == "__main__":
    main()
