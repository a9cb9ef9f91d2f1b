"""The boundaries of a scikit-fem mesh: names of facets that are found when they are asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import frozen
from .facets import facets_of


class NamedFacets(Mapping[str, NDArray[np.int32]]):
    """Facets (k, n) by name, from their numbers in scikit-fem's order. Looking at one finds all facets of the mesh, once.

    Parameters
    ----------
    t : (k + 1, nt) vertices of the simplices.
    nv : number of vertices.
    ids : numbers of facets by name.
    """

    def __init__(self, t: NDArray[np.int32], nv: int, ids: Mapping[str, Any]) -> None:
        self._t, self._nv, self._ids = t, nv, frozen(ids)

    def __getitem__(self, name: str) -> NDArray[np.int32]:
        return self._facets[:, np.asarray(self._ids[name])]

    def __iter__(self) -> Iterator[str]:
        return iter(self._ids)

    def __len__(self) -> int:
        return len(self._ids)

    def __contains__(self, name: object) -> bool:
        return name in self._ids

    @cached_property
    def _facets(self) -> NDArray[np.int32]:
        return facets_of(self._t, self._nv)[0]

    def __repr__(self) -> str:
        return f"NamedFacets: {', '.join(self._ids)}"
