"""Bodies that are divided into parts: refusal of analyses that need the whole body on one machine, and the parts as text."""

from __future__ import annotations

from ..errors import StvkError
from ..kernels.threads import threads
from ..mesh.mesh import ElementMesh
from ..space import Communicator


def refuse_divided(comm: Communicator, what: str, expected: str, reason: str) -> None:
    """Refuse an analysis or an option `what` of a body that is divided into parts, with the expected value and the reason.

    >>> refuse_divided(Communicator(), "stability = True", "False", "K is not factorised.")
    """
    if comm.divided:
        raise StvkError(f"{what}; expected {expected} for a body that is divided into parts: {reason}")


def parts_line(mesh: ElementMesh) -> str:
    """Return a line on the parts of a divided body, for the header of a run; empty on one machine.

    The line has the number of ranks, and the numbers of elements and shared nodes of the smallest and the largest part.
    """
    comm = mesh.space.comm
    if not comm.divided:
        return ""
    elements, nodes = (f"{comm.least(n):.0f} to {comm.most(n):.0f}" for n in (mesh.nt, len(mesh.space.shared)))
    each = f"{threads()} thread{'s' * (threads() > 1)}"
    return f"\n{comm.size} ranks with {elements} elements, {nodes} shared nodes and {each} each"
