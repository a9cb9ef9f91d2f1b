"""The peers compute what this package computes, or say what is missing."""

import sys
from types import ModuleType

import numpy as np
import pytest
from bodies import distorted, turned_round
from skfem import MeshTet

from skfem_stvk import Gravity, StVK, StvkError, System, simulate
from skfem_stvk.dynamics import ForwardEuler, LinearBackwardEuler
from skfem_stvk.peers import PEERS, available, load
from skfem_stvk.peers.peer import Package, require

YOUNG, POISSON = 2.0, 0.3
LIMIT = 1e-12


def part():
    """An unstructured mesh: renumbered vertices, no two edges alike, half of the tetrahedra turned round, in any order."""
    rng = np.random.default_rng(5)
    mesh = MeshTet.init_tensor(*[np.linspace(0, 1, 5)] * 3)
    number = rng.permutation(mesh.p.shape[1])
    p = distorted(mesh.p, rng)[:, np.argsort(number)]
    t = turned_round(number[mesh.t][:, rng.permutation(mesh.t.shape[1])], rng)
    return p, t.astype(np.int32)


def test_a_dolfinx_that_is_too_old_says_its_version_and_what_to_get(monkeypatch):
    """Debian 12 has 0.5.2, which lacks `basix.ufl`."""
    old = ModuleType("dolfinx")
    old.__version__ = "0.5.2"
    monkeypatch.setitem(sys.modules, "dolfinx", old)
    with pytest.raises(StvkError, match=r"DOLFINx 0\.5\.2 lacks what 0\.9 and later come with .* Get it: conda install"):
        load("DOLFINx")(*part(), YOUNG, POISSON)


@pytest.fixture(scope="module", params=PEERS)
def peer(request):
    name = request.param
    if PEERS[name].version() is None:
        pytest.skip(f"{name} is not installed: {available()[name]}")
    return load(name)(*part(), YOUNG, POISSON)


@pytest.fixture(scope="module")
def body():
    return System(part(), StVK(young=YOUNG, poisson=POISSON))


def states():
    rng = np.random.default_rng(6)
    p, _ = part()
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    yield "crumpled", 0.3 * rng.standard_normal(p.size)
    yield (
        "rotated and stretched",
        ((turn @ np.diag([1.5, 0.6, 1.1]) - np.eye(3)) @ p).T.ravel() + 0.05 * rng.standard_normal(p.size),
    )
    yield "inverted", (np.diag([-2.2, 0.1, 0.2]) @ p).T.ravel() + 0.05 * rng.standard_normal(p.size)


STATES = dict(states())


@pytest.mark.parametrize("state", STATES)
def test_a_peer_agrees_in_what_it_has(peer, body, state):
    quantities = [quantity for quantity in ("energy", "internal_force", "tangent") if hasattr(peer, quantity)]
    assert "internal_force" in quantities
    for quantity in quantities:
        ours, theirs = (getattr(model, quantity)(STATES[state]) for model in (body, peer))
        assert abs(theirs - ours).max() <= LIMIT * abs(ours).max() if quantity != "energy" else abs(theirs - ours) <= LIMIT * ours


def test_a_peer_gives_what_its_type_promises(peer):
    u = STATES["crumpled"]
    assert peer.name.startswith(tuple(PEERS)) and peer.version[0].isdigit()
    if hasattr(peer, "energy"):
        assert isinstance(peer.energy(u), float)
    if hasattr(peer, "tangent"):
        K = peer.tangent(u)
        assert K.format == "csr" and K.shape == (u.size, u.size)
    assert peer.internal_force(u).shape == u.shape


def test_a_later_call_leaves_earlier_results_alone(peer):
    first, second = (STATES[state] for state in ("crumpled", "inverted"))
    for quantity in ("internal_force", "tangent"):
        if hasattr(peer, quantity):
            kept = getattr(peer, quantity)(first)
            copy = kept.copy()
            getattr(peer, quantity)(second)
            assert abs(kept - copy).max() == 0


@pytest.mark.parametrize("name", PEERS)
def test_a_missing_package_is_named_with_the_line_that_installs_it(name, monkeypatch):
    monkeypatch.setitem(sys.modules, PEERS[name].module, None)
    with pytest.raises(StvkError, match=PEERS[name].install):
        load(name)(*part(), YOUNG, POISSON)


def test_the_package_imports_without_its_peers(monkeypatch):
    for module in list(sys.modules):
        if module.startswith("skfem_stvk.peers"):
            monkeypatch.delitem(sys.modules, module)
    for package in PEERS.values():
        monkeypatch.setitem(sys.modules, package.module, None)
    from skfem_stvk import peers

    for name in peers.PEERS:
        assert peers.load(name).name == name


def test_what_is_not_installed_is_listed_with_the_line_that_installs_it(monkeypatch):
    monkeypatch.setitem(PEERS, "FElupe", Package("felupe", "no-such-distribution", "pip install felupe"))
    assert available()["FElupe"] == "pip install felupe"


def test_a_mujoco_that_takes_lambda_twice_is_refused(monkeypatch):
    old = type(sys)("mujoco")
    old.__version__ = "3.17.0"
    monkeypatch.setitem(sys.modules, "mujoco", old)
    with pytest.raises(StvkError, match=r"Expected mujoco 4\.0 or later, got 3\.17\.0\. .* twice"):
        require("MuJoCo")


def test_an_unknown_peer_is_refused_with_the_names_there_are():
    with pytest.raises(StvkError, match=r"no peer 'Abaqus'.*MuJoCo, FElupe"):
        load("Abaqus")


def test_mujoco_refuses_an_auxetic_material():
    pytest.importorskip("mujoco")
    with pytest.raises(StvkError, match=r"got -0\.2"):
        load("MuJoCo")(*part(), YOUNG, -0.2)


def test_ngsolve_without_a_compiler_interprets_and_says_so(body, monkeypatch):
    pytest.importorskip("ngsolve")
    monkeypatch.setattr("skfem_stvk.peers.ngsolve.shutil.which", lambda program: None)
    peer = load("NGSolve")(*part(), YOUNG, POISSON)
    assert not peer.compiled and peer.name == "NGSolve (no compiler)"
    u = STATES["crumpled"]
    assert abs(peer.tangent(u) - body.tangent(u)).max() <= LIMIT * abs(body.tangent(u)).max()


@pytest.mark.parametrize(
    ("integrator", "dt", "ours", "limit"), [("discrete", 5e-3, LinearBackwardEuler, 1e-3), ("Euler", 2e-4, ForwardEuler, 1e-9)]
)
def test_mujoco_moves_as_we_do(integrator, dt, ours, limit):
    """Its implicit integrator is the linearised backward Euler with a clamped tangent, clamped element by element; its explicit one
    the symplectic Euler.
    """
    pytest.importorskip("mujoco")
    from validation.dynamics.against_mujoco import Moving, MuJoCoMotion

    p, t = part()
    wall, gravity = np.flatnonzero(p[0] < 1e-9), (0.5, 0.0, -2.0)
    system = System((p, t), [StVK(young=YOUNG, poisson=POISSON, density=0.1), Gravity(gravity)], fixed=[(wall, "xyz")])
    v = 0.5 * np.cross((0, 1, 2), p.T).ravel()
    v.reshape(-1, 3)[wall] = 0
    peer = MuJoCoMotion(p, t, YOUNG, POISSON, Moving(system.mass().vertex, wall, gravity, dt, integrator, 1e-14))
    peer.begin(0 * v, v)
    for _ in range(20):
        peer.step()
    options = {} if ours is ForwardEuler else {"tangent": "clamped", "rtol": 1e-13}
    u = simulate(system, ours(dt=dt, **options), until=20 * dt, v0=v, quiet=True).u
    assert peer.solved() and abs(u).max() > 0.3 * 20 * dt and abs(peer.displacements() - u).max() <= limit * abs(u).max()


def test_mujoco_tells_of_a_solve_that_ran_out_of_iterations(tmp_path, monkeypatch):
    pytest.importorskip("mujoco")
    from validation.dynamics.against_mujoco import Moving, MuJoCoMotion

    monkeypatch.chdir(tmp_path)  # where MuJoCo writes its log
    p, t = part()
    peer = MuJoCoMotion(p, t, YOUNG, POISSON, Moving(np.full(p.shape[1], 1e-3), np.arange(3), (0.0, 0.0, -2.0), 1.0, iterations=1))
    peer.step()
    assert not peer.solved()
