"""Meshes and materials that the tests share: unequal edges, both orientations, lambda != mu, nu != 0."""

import numpy as np
import skfem

from skfem_stvk import Anisotropic, ElementMesh, Isotropic, Orthotropic, StVK, TransverselyIsotropic
from skfem_stvk.referee.bodies import elasticity
from skfem_stvk.reference import ReferenceStVK


def distorted(p, rng, amount=0.15):
    """Coordinates moved by a part of the spacing, so that no two edges are alike."""
    return p + amount * (np.ptp(p, axis=1).max() / p.shape[1] ** (1 / p.shape[0])) * rng.uniform(-1, 1, p.shape)


def turned_round(t, rng):
    """Half of the elements with two vertices exchanged: both orientations."""
    t = t.copy()
    half = rng.random(t.shape[1]) < 0.5
    t[:2, half] = t[1::-1, half]
    return t


def box(n=3):
    rng = np.random.default_rng(1)
    mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)
    return ElementMesh(distorted(mesh.p, rng), turned_round(mesh.t, rng))


def sheet(n=4):
    rng = np.random.default_rng(2)
    mesh = skfem.MeshTri.init_tensor(*[np.linspace(0, 1, n + 1)] * 2)
    return ElementMesh(distorted(mesh.p, rng), turned_round(mesh.t, rng))


def membrane(n=4):
    flat = sheet(n)
    x, y = flat.p
    return ElementMesh(np.stack([x, y, 0.3 * np.sin(3 * x) + 0.2 * y**2]), flat.t)


def bar(n=6, d=1):
    s = np.linspace(0, 1, n + 1) ** 1.3
    p = np.stack([s, 0.3 * s**2, np.cos(s)])[:d]
    return ElementMesh(p, np.stack([np.arange(n), np.arange(1, n + 1)])[[1, 0]])


def random_frames(n, rng):
    return np.linalg.qr(rng.standard_normal((n, 3, 3)))[0]


def some_voigt(rng):
    a = rng.standard_normal((6, 6))
    return a @ a.T + 3 * np.eye(6)


MESHES = {
    "tetrahedra": box(),
    "triangles": sheet(),
    "membrane": membrane(),
    "segments": bar(),
    "cable in the plane": bar(d=2),
    "cable": bar(d=3),
}


def bodies():
    """(mesh, terms) by name: every kind of simplex with every kind of material that fits it."""
    rng = np.random.default_rng(3)
    frame = random_frames(1, rng)[0]
    ply = {"young_axial": 14.0, "young_transverse": 1.0, "poisson_axial": 0.3, "poisson_transverse": 0.4, "shear_axial": 0.6}
    cases = {}
    for name, mesh in MESHES.items():
        cases[f"{name}, isotropic"] = mesh, [StVK(young=2.0, poisson=0.3)]
        cases[f"{name}, auxetic"] = mesh, [StVK(young=2.0, poisson=-0.4)]
        # a frame tilted out of the plane has no meaning in plane strain alone, but is a fine material there too
        cases[f"{name}, anisotropic"] = mesh, [StVK(Anisotropic(some_voigt(rng), frame=frame))]
        cases[f"{name}, fibres"] = mesh, [StVK(TransverselyIsotropic(**ply, frame=random_frames(mesh.nt, rng)))]
        cases[f"{name}, two regions"] = (
            mesh,
            [
                StVK(young=2.0, poisson=0.45, region=np.arange(mesh.nt // 2)),
                StVK(Isotropic.from_lame(1.0, 0.3), region=np.arange(mesh.nt // 2, mesh.nt)),
            ],
        )
    for name in ("triangles", "membrane"):
        thickness = rng.uniform(0.5, 2, MESHES[name].nt)
        cases[f"{name}, plane stress"] = MESHES[name], [StVK(young=2.0, poisson=0.3, plane="stress", thickness=thickness)]
    cases["cable, area"] = MESHES["cable"], [StVK(young=rng.uniform(1, 2, MESHES["cable"].nt), area=0.3)]
    n = MESHES["tetrahedra"].nt
    orthotropic = Orthotropic(
        young=(rng.uniform(8, 12, n), rng.uniform(1, 2, n), 0.5),
        poisson=(0.3, 0.25, rng.uniform(0.1, 0.3, n)),
        shear=(0.2, 0.5, rng.uniform(0.6, 0.9, n)),
        frame=random_frames(n, rng),
    )
    cases["tetrahedra, heterogeneous orthotropic with element frames"] = MESHES["tetrahedra"], [StVK(orthotropic)]
    cases["tetrahedra, an array of constants"] = (
        MESHES["tetrahedra"],
        [StVK(young=rng.uniform(1, 100, n), poisson=rng.uniform(-0.4, 0.45, n))],
    )
    return cases


BODIES = bodies()


def reference_of(mesh, terms):
    """scikit-fem's assembly of these terms."""
    return ReferenceStVK(mesh.p, mesh.t, elasticity(mesh, terms))


def state(mesh, amount=0.3, seed=4):
    """A displacement that is not small, of every vertex its own."""
    return amount * np.random.default_rng(seed).standard_normal(mesh.p.size) / mesh.nv ** (1 / mesh.k)
