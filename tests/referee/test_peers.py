"""Peers agree with this package, or report the missing package."""

import sys
from types import ModuleType

import numpy as np
import pytest
from bodies import distorted, turned_round
from skfem import MeshTet

from skfem_stvk import StVK, StvkError, System
from skfem_stvk.referee.peers import PEERS, Package, available, load

YOUNG, POISSON = 2.0, 0.3
LIMIT = 1e-12


def part():
    """Return an unstructured mesh: random order of vertices and elements, unequal edges, half of them with negative orientation."""
    rng = np.random.default_rng(5)
    mesh = MeshTet.init_tensor(*[np.linspace(0, 1, 5)] * 3)
    number = rng.permutation(mesh.p.shape[1])
    p = distorted(mesh.p, rng)[:, np.argsort(number)]
    t = turned_round(number[mesh.t][:, rng.permutation(mesh.t.shape[1])], rng)
    return p, t.astype(np.int32)


def test_an_old_dolfinx_is_an_error_with_its_version_and_the_install_command(monkeypatch):
    """DOLFINx 0.5.2 of Debian 12, which has no `basix.ufl`, is an error with its version and the install command."""
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
    R = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    yield "crumpled", 0.3 * rng.standard_normal(p.size)
    yield (
        "rotated and stretched",
        ((R @ np.diag([1.5, 0.6, 1.1]) - np.eye(3)) @ p).T.ravel() + 0.05 * rng.standard_normal(p.size),
    )
    yield "inverted", (np.diag([-2.2, 0.1, 0.2]) @ p).T.ravel() + 0.05 * rng.standard_normal(p.size)


STATES = dict(states())


@pytest.mark.few(8)
@pytest.mark.parametrize("state", STATES)
def test_a_peer_agrees_in_its_quantities(peer, body, state):
    quantities = [quantity for quantity in ("energy", "internal_force", "tangent") if hasattr(peer, quantity)]
    assert "internal_force" in quantities
    for quantity in quantities:
        ours, theirs = (getattr(model, quantity)(STATES[state]) for model in (body, peer))
        assert abs(theirs - ours).max() <= LIMIT * abs(ours).max() if quantity != "energy" else abs(theirs - ours) <= LIMIT * ours


def test_a_peer_returns_the_promised_types(peer):
    u = STATES["crumpled"]
    assert peer.name.startswith(tuple(PEERS)) and peer.version[0].isdigit()
    if hasattr(peer, "energy"):
        assert isinstance(peer.energy(u), float)
    if hasattr(peer, "tangent"):
        K = peer.tangent(u)
        assert K.format == "csr" and K.shape == (u.size, u.size)
    assert peer.internal_force(u).shape == u.shape


def test_a_later_call_does_not_change_earlier_results(peer):
    first, second = (STATES[state] for state in ("crumpled", "inverted"))
    for quantity in ("internal_force", "tangent"):
        if hasattr(peer, quantity):
            earlier = getattr(peer, quantity)(first)
            copy = earlier.copy()
            getattr(peer, quantity)(second)
            assert abs(earlier - copy).max() == 0


@pytest.mark.parametrize("name", PEERS)
def test_a_missing_package_is_named_with_its_install_command(name, monkeypatch):
    monkeypatch.setitem(sys.modules, PEERS[name].module, None)
    with pytest.raises(StvkError, match=PEERS[name].install):
        load(name)(*part(), YOUNG, POISSON)


def test_the_package_imports_without_its_peers(monkeypatch):
    for module in list(sys.modules):
        if module.startswith("skfem_stvk.referee.peers"):
            monkeypatch.delitem(sys.modules, module)
    for package in PEERS.values():
        monkeypatch.setitem(sys.modules, package.module, None)
    from skfem_stvk.referee import peers

    for name in peers.PEERS:
        assert peers.load(name).name == name


def test_peers_that_are_not_installed_are_listed_with_their_install_command(monkeypatch):
    monkeypatch.setitem(PEERS, "FElupe", Package("felupe", "no-such-distribution", "pip install felupe"))
    assert available()["FElupe"] == "pip install felupe"


def test_an_unknown_peer_is_refused_with_the_known_names():
    with pytest.raises(StvkError, match=r"no peer 'Abaqus'.*MuJoCo, FElupe"):
        load("Abaqus")


def test_mujoco_refuses_an_auxetic_material():
    pytest.importorskip("mujoco")
    with pytest.raises(StvkError, match=r"got -0\.2"):
        load("MuJoCo")(*part(), YOUNG, -0.2)


def test_ngsolve_without_a_compiler_reports_that_it_is_not_compiled(body, monkeypatch):
    pytest.importorskip("ngsolve")
    monkeypatch.setattr("skfem_stvk.referee.peers.ngsolve.shutil.which", lambda program: None)
    peer = load("NGSolve")(*part(), YOUNG, POISSON)
    assert not peer.compiled and peer.name == "NGSolve (no compiler)"
    u = STATES["crumpled"]
    assert abs(peer.tangent(u) - body.tangent(u)).max() <= LIMIT * abs(body.tangent(u)).max()
