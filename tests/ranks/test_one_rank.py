"""On one rank of MPI all results have the nodes, elements and values of the same body without MPI."""

import numpy as np
import pytest
from bodies import EVERY_MESH, distorted, turned_round

from skfem_stvk import (
    ElementMesh,
    Gravity,
    Newmark,
    Plane,
    Pressure,
    RigidContact,
    RigidPlane,
    Simulation,
    StVK,
    StvkError,
    System,
    Traction,
    modes,
    simulate,
    solve_static,
)
from skfem_stvk.mesh import box

distributed = pytest.importorskip("skfem_stvk.ranks")
pytestmark = pytest.mark.filterwarnings("ignore::skfem_stvk.errors.StvkWarning")


@pytest.fixture(scope="module", params=["mesh", "file"])
def meshes(request, tmp_path_factory):
    """A mesh whose nodes are in random order, and the part of it on one rank."""
    bare, rng = box((2.0, 1.0, 1.0), (6, 3, 3)), np.random.default_rng(1)
    number = rng.permutation(bare.nv)
    p = np.empty_like(bare.p)
    p[:, number] = distorted(bare.p, np.random.default_rng(2), 0.1)
    ends = {name: number[facets] for name, facets in bare.boundaries.items()}
    mesh = ElementMesh(p, turned_round(number[bare.t], rng), {"low": np.arange(0, bare.nt, 3)}, ends)
    if request.param == "mesh":
        return mesh, distributed.distribute(mesh)
    path = tmp_path_factory.mktemp("one") / "body.h5"
    distributed.write_partition(mesh, path, 5)
    return mesh, distributed.distribute(path)


def same(one, other):
    one, other = (np.ma.filled(values, 0.0) for values in (one, other))
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * np.abs(other).max(initial=0.0))


def test_nodes_and_elements_have_the_order_of_the_mesh(meshes):
    mesh, part = meshes
    assert np.array_equal(part.p, mesh.p) and np.array_equal(part.t, mesh.t)
    assert np.array_equal(part.node_numbers, np.arange(mesh.nv)) and np.array_equal(part.element_numbers, np.arange(mesh.nt))


@pytest.mark.few
@pytest.mark.parametrize("name", EVERY_MESH)
def test_nodes_of_every_kind_of_element_have_the_order_of_the_mesh(name):
    mesh = EVERY_MESH[name]
    part = distributed.distribute(mesh)
    assert np.array_equal(part.p, mesh.p) and np.array_equal(part.t, mesh.t)


def test_static_results_are_those_of_the_mesh(meshes):
    def solved(mesh):
        floor = RigidContact(RigidPlane(point=(0, 0, -0.02), normal=(0, 0, 1)), name="floor")
        terms = [StVK(young=1e5, poisson=0.3), Traction("right", (50.0, 0, -200.0)), floor]
        return solve_static(System(mesh, terms, fixed={"left": "xyz"}), quiet=True, rtol=1e-11)

    whole, own = (solved(mesh) for mesh in meshes)
    same(own.u, whole.u)
    for where in ("left", Plane((0, 0, 0), (1, 0, 0), within=0.2), None):
        one, other = own.reaction(where), whole.reaction(where)
        assert np.array_equal(one.vertices, other.vertices) and np.array_equal(one.rest, other.rest)
        same(one.by_node, other.by_node)
    one, other = own.contact("floor"), whole.contact("floor")
    assert other.area > 0 and np.abs(other.force).max() > 0
    for field in ("force", "pressure", "positions"):
        same(getattr(one, field), getattr(other, field))
    for name in ("von_mises", "cauchy"):
        same(own.state[name], whole.state[name])
        same(own.state.at_nodes(name, "low"), whole.state.at_nodes(name, "low"))
    assert (own.state["von_mises"].argmax(), own.message) == (whole.state["von_mises"].argmax(), whole.message)


def test_motions_and_modes_are_those_of_the_mesh(meshes, tmp_path):
    def moved(mesh, file):
        terms = [StVK(young=1e5, poisson=0.3, density=100.0), Gravity((0, 0, -9.81)), Pressure("top", 100.0)]
        body = System(mesh, terms, fixed={"left": "xyz"})
        own = {"probes": {"tip": [5, 17]}, "reactions": {"wall": "left"}, "save": file}
        run = simulate(body, Newmark(dt=1e-3, rtol=1e-11), until=5e-3, quiet=True, **own)
        simulation = Simulation(body, Newmark(dt=1e-3, rtol=1e-11))
        simulation.step()
        return run, modes(System(mesh, terms[0], fixed={"left": "xyz"}), 3), simulation

    (whole, shapes, of_steps), (own, own_shapes, own_steps) = (moved(mesh, tmp_path / f"{i}.pvd") for i, mesh in enumerate(meshes))
    same(own.u, whole.u)
    same(own.v, whole.v)
    for name in ("tip z", "reaction wall z", "kinetic_energy"):
        same(own.ledger[name], whole.ledger[name])
    assert np.array_equal(own.reaction("left").vertices, whole.reaction("left").vertices)
    same(own.reaction("left").by_node, whole.reaction("left").by_node)
    np.testing.assert_allclose(own_shapes.frequencies, shapes.frequencies, rtol=1e-8)
    same(own_steps.u, of_steps.u)
    one, other = ((tmp_path / f"{i}_0000.vtu").read_text() for i in range(2))
    assert ("GlobalNodeIds" in one, "GlobalNodeIds" in other) == (False, False)


def test_a_launcher_that_mpi4py_does_not_know_is_an_error(monkeypatch):
    world = pytest.importorskip("skfem_stvk.ranks.job").world
    assert world().size == 1
    monkeypatch.setenv("OMPI_COMM_WORLD_RANK", "1")
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "3")
    with pytest.raises(StvkError, match="ranks = 1; expected 3, the number of processes that were started"):
        world()
