"""Meshes and files that the tests of mesh readers share."""

import meshio
import numpy as np
import skfem

LEFT = {"left_half": lambda x: x[0] < 0.5, "right:half": lambda x: x[0] > 0.5}
TETS = skfem.MeshTet().refined(2).with_subdomains(LEFT).with_boundaries({"wall": lambda x: x[0] == 0})
TRIANGLES = skfem.MeshTri().refined(2).with_subdomains(LEFT).with_boundaries({"wall": lambda x: x[0] == 0})
SEGMENTS = skfem.MeshLine().refined(2).with_subdomains(LEFT).with_boundaries({"wall": lambda x: x[0] == 0})

CUBE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
HEXAHEDRON = [list(range(8))]
FIVE_TETS = [[0, 1, 3, 4], [1, 2, 3, 6], [1, 4, 5, 6], [3, 4, 6, 7], [1, 3, 4, 6]]


def write(path, points, cells, **more):
    meshio.Mesh(np.array(points, dtype=float), cells, **more).write(path, "gmsh" if path.suffix == ".msh" else None)
    return path


def same_facets(mesh, boundary, given, name):
    """Return whether the facets of both boundaries join the same vertices; their order does not matter."""
    one, other = np.sort(mesh.boundaries[boundary], axis=0), np.sort(given.facets[:, given.boundaries[name]], axis=0)
    return sorted(one.T.tolist()) == sorted(other.T.tolist())


def curved(cls, seed=0, amount=0.02):
    """Return a mesh of scikit-fem with all nodes moved and one group of facets; edges of second-order meshes are curved."""
    base = {skfem.MeshTet2: skfem.MeshTet, skfem.MeshTri2: skfem.MeshTri}.get(cls, cls)
    mesh = base.init_tensor(*[np.linspace(0, 1, 3)] * base().dim())
    mesh = mesh if cls is base else cls.from_mesh(mesh)
    moved = mesh.doflocs + amount * np.random.default_rng(seed).uniform(-1, 1, mesh.doflocs.shape)
    return cls(moved, mesh.t).with_boundaries({"wall": lambda x: x[0] < 0.1}).with_subdomains(LEFT)
