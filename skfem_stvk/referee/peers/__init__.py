"""W, F and K of other codes for the same model, in this package's conventions, to compare results and speed.

The package of a peer is imported only when an object of its class is made. None of them is needed to use skfem_stvk.
"""

from __future__ import annotations

from importlib import import_module

from ...arguments import shown
from ...errors import StvkError
from .peer import PEERS, Peer

__all__ = ["PEERS", "Peer", "available", "load"]


def available() -> dict[str, str]:
    """Return for each peer the version of its package, or the line that installs it.

    >>> list(available())
    ['MuJoCo', 'FElupe', 'NGSolve', 'DOLFINx', 'JAX', 'PyTorch']
    """
    return {name: package.version() or package.install for name, package in PEERS.items()}


def load(name: str) -> type[Peer]:
    """Return the class of a peer. Its package is imported only when the class is called.

    Raises
    ------
    StvkError
        if there is no peer of that name.
    """
    if not isinstance(name, str) or name not in PEERS:
        raise StvkError(f"There is no peer {shown(name)}; there are {', '.join(PEERS)}.")
    peer: type[Peer] = getattr(import_module(f".{PEERS[name].file or PEERS[name].module}", __name__), name)
    return peer
