"""The places whose motion, and whose forces, stand in a ledger."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arguments import shown
from ..errors import StvkError
from ..mesh.places import Where, vertices_at
from ..results.reactions import held_vertices
from ..system import System
from .ledger import column_names

Vertices = Mapping[str, NDArray[np.int64]]
NOWHERE: Vertices = MappingProxyType({})


class Places(NamedTuple):
    """Vertices by name.

    Attributes
    ----------
    probes : whose mean displacements are entered.
    reactions : where the forces of supports and foundations are entered.
    """

    probes: Vertices = NOWHERE
    reactions: Vertices = NOWHERE

    @classmethod
    def checked(cls, system: System, probes: Mapping[str, Where] | None, reactions: Mapping[str, Where] | None) -> Places:
        """Those that were asked for.

        Raises
        ------
        RegionError, SupportError
            if there is no vertex at a place, or neither a support nor a foundation at one for reactions.
        StvkError
            if they do not come by name, or two columns would have the same name.
        """
        places, supports = _named("probes", probes, "'tip': [17]"), _named("reactions", reactions, "'clamp': 'left'")
        moving = {name: vertices_at(system.mesh, where, f"probe {name!r}") for name, where in places.items()}
        held_up = {name: held_vertices(system, where, f"reaction {name!r}") for name, where in supports.items()}
        columns = column_names(system, moving, held_up)
        twice = sorted({name for name in columns if columns.count(name) > 1})
        if twice:
            raise StvkError(f"The ledger would have two columns {twice[0]!r}: rename a probe or a reaction.")
        return cls(moving, held_up)


def _named(name: str, given: Any, example: str) -> Mapping[str, Where]:
    if given is None:
        return {}
    if not isinstance(given, Mapping) or not all(isinstance(one, str) and one for one in given):
        raise StvkError(f"{name} = {shown(given)}; expected places by name, such as {{{example}}}.")
    hidden = [one for one in given if not one.isprintable()]
    if hidden:
        raise StvkError(
            f"{name}: the name {ascii(hidden[0])[:80]} has characters that cannot be printed. It stands in tables and pictures: rename it."
        )
    return given
