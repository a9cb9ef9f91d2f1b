"""What scikit-fem's `basis.get_dofs(...)` returned: the vertices and the degrees of freedom that it stands for on a mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem.assembly.dofs import DofsView

from ..errors import RegionError
from .simplices import SimplexMesh

#: Vertices count as the same within this part of the size of the mesh: files keep fewer digits than arrays.
SAME_PLACE = 1e-6


def vertices_of(view: DofsView) -> NDArray[Any]:
    """Vertices of the view, in its own order; whether they are of a certain mesh is not looked at."""
    return np.arange(view.obj.topo.nvertices)[view.nodal_ix]


def dofs_of(mesh: SimplexMesh, view: DofsView, what: str) -> NDArray[np.int64]:
    """Degrees of freedom of the view on this mesh, ascending; components that were dropped from it are not among them.

    Raises
    ------
    RegionError
        as `refuse_foreign`.

    >>> import skfem
    >>> square = skfem.MeshTri()
    >>> view = skfem.Basis(square, skfem.ElementVector(skfem.ElementTriP1())).get_dofs(lambda x: x[0] == 0)
    >>> vertices_of(view), dofs_of(SimplexMesh.of(square), view.keep("u^2"), "fixed")
    (array([0, 2]), array([1, 5]))
    """
    refuse_foreign(mesh, view, what)
    return np.unique(view.obj.nodal_dofs[view.nodal_rows][:, view.nodal_ix]).astype(np.int64)


def refuse_foreign(mesh: SimplexMesh, view: DofsView, what: str) -> None:
    """Refuse degrees of freedom that are not those of the displacements of this mesh.

    Raises
    ------
    RegionError
        if the view is of a basis on another mesh, or of another element than vectors that are linear on each simplex.
    """
    dofs, numbers = view.obj, np.arange(mesh.p.size).reshape(mesh.nv, mesh.d).T
    p = dofs.topo.doflocs[:, : dofs.topo.nvertices]
    if p.shape != mesh.p.shape or np.abs(p - mesh.p).max() > SAME_PLACE * np.ptp(mesh.p, axis=1).max():
        difference = f"{p.shape[1]} vertices in {p.shape[0]}D" if p.shape != mesh.p.shape else "as many vertices elsewhere"
        raise RegionError(
            f"{what}: scikit-fem's degrees of freedom are of another mesh, with {difference}; this one has {mesh.nv} vertices in "
            f"{mesh.d}D. Take them from a basis on the mesh of the system."
        )
    others = dofs.facet_dofs.size + dofs.edge_dofs.size + dofs.interior_dofs.size
    if others or not np.array_equal(dofs.nodal_dofs, numbers):
        raise RegionError(
            f"{what}: scikit-fem's degrees of freedom are of {_named(dofs.element)}; expected those of linear vectors with {mesh.d} "
            "components, such as ElementVector(ElementTetP1()). Vertices alone can be given by their ids: view.nodal_ix."
        )


def _named(element: Any) -> str:
    """An element in words, with the one that a vector element repeats."""
    inner = getattr(element, "elem", None)
    return type(element).__name__ + (f"({type(inner).__name__}())" if inner is not None else "")
