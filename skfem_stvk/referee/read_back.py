"""Verification of the results that another program computed from test vectors."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from ..arguments import Array, path
from ..errors import StvkError, name_known
from ..results.array_files import read, type_of
from ..results.complete_files import ForeignFile
from .bodies import elasticity, homogeneous_copy
from .case import CANDIDATE, REFERENCE, Case
from .checks.agreement import agreement
from .checks.rigid_motions import balance
from .discretisation import Shape
from .exact import Truth
from .implementations import Implementation
from .report import Report, header
from .results import Task
from .vectors import LAYOUT, NAME, PUBLISHED, RESULTS, Vectors, published_vectors, read_vectors, sizes_of
from .verification import name_what_failed

FILES = ("results.npz", "results.txt")
EXACT = "50 digits"


def verify_results(folder: str | Path, vectors: Vectors | str | Path | None = None) -> Report:
    """Check the W, F and K that another program, in any language, computed from test vectors.

    The values are compared with 50 digits in every state for which there are results. Forces and torques must balance, K must be
    symmetric, and rigid modes must have no force. Limits are those of `verify`. For linear simplices they are those of the edge
    form.

    Parameters
    ----------
    folder
        A folder with `results.txt` or `results.npz`, which holds any of `W`, `F` and `K_blocks` or `K_values` in the layout of the
        vectors.
    vectors
        The vectors that the results were computed from, or their folder. The default is the vectors in the same folder as the
        results, or else the published vectors with the same digest.

    Returns
    -------
    Report
        Use `report.passed`, `print(report)` and `report.save("folder")`.

    Raises
    ------
    StvkError
        if there are no results or no vectors, or the file is damaged, has arrays of other names or sizes, or belongs to other
        vectors.

    Examples
    --------
    >>> import tempfile
    >>> from skfem_stvk.referee.vectors import published_vectors
    >>> from skfem_stvk.results.array_files import write_text
    >>> one = published_vectors("tetrahedron")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_text(Path(folder) / "results.txt", {name: one.arrays[name] for name in ("digest", "W", "F")})
    ...     verify_results(folder).passed
    True
    """
    started = time.perf_counter()
    if vectors is not None and not isinstance(vectors, Vectors):
        vectors = read_vectors(path("vectors", vectors, "Vectors, or the path of a folder of them"))
    file = _file_of(path("folder", folder, "the path of a folder"))
    returned = read(file, RESULTS)
    vectors = _vectors_of(file, returned) if vectors is None else vectors
    _refuse_wrong(file, returned, vectors)
    case = _case(vectors, returned)
    program = str(returned["program"][0])[:200] if "program" in returned else "a program without a name"
    head = header(case.shape, [vectors.term], f"test vectors {vectors.title!r}", 0)
    report = Report(head | {"reference": f"{EXACT}, rounded once", "candidate": [f"{file}, by {program}"]})
    report.results += [task.run() for task in _tasks(case)]
    name_what_failed(report, _of_all_states(case, vectors), [vectors.term], None)
    report.seconds = time.perf_counter() - started
    return report


def folders_of_results(folder: str | Path) -> list[Path]:
    """Return a list of the folder itself if it has results, or of its subfolders with results.

    Raises
    ------
    StvkError
        if there are no results.
    """
    folder = path("folder", folder, "the path of a folder")
    if not folder.is_dir():
        raise StvkError(f"{folder} is no folder; expected one with {' or '.join(FILES)}, or with folders that have them.")
    found = [one for one in (folder, *sorted(folder.iterdir())) if any((one / name).is_file() for name in FILES)]
    if not found:
        raise StvkError(
            f"{folder} has neither {' nor '.join(FILES)}, and none of its folders has. Write them as README.txt next to the "
            "vectors says."
        )
    return found[:1] if found[0] == folder else found


def _file_of(folder: Path) -> Path:
    found = [folder / name for name in FILES if (folder / name).is_file()]
    if len(found) != 1:
        what = f"both {' and '.join(FILES)}; which are meant? Remove the others" if found else f"neither {' nor '.join(FILES)}"
        raise StvkError(f"{folder} has {what}.")
    return found[0]


def _vectors_of(file: Path, returned: dict[str, Array]) -> Vectors:
    """Return the vectors in the folder of the results, or the published vectors with the digest of the results."""
    if any((file.parent / f"{NAME}{suffix}").is_file() for suffix in (".npz", ".txt")):
        return read_vectors(file.parent)
    named = returned["digest"].tolist() if "digest" in returned else []
    for name in PUBLISHED:
        vectors = published_vectors(name)
        if vectors.arrays["digest"].tolist() == named:
            return vectors
    raise StvkError(
        f"{file.parent} has no {NAME}.npz or {NAME}.txt, and {file.name} has "
        f"{'the digest of no published set' if named else 'no digest'}. Put the vectors from "
        "which it was computed in the same folder, or name their folder: --vectors FOLDER"
    )


def _refuse_wrong(file: Path, returned: dict[str, Array], vectors: Vectors) -> None:
    """Raise ForeignFile for results of other vectors, or of other sizes. Values that are not finite are left to the checks."""
    arrays, sizes = vectors.arrays, sizes_of(vectors.arrays)
    if not {"W", "F", "K_blocks", "K_values"} & set(returned):
        raise ForeignFile(f"{file} has none of W, F, K_blocks and K_values.")
    if {"K_blocks", "K_values"} <= set(returned):
        raise ForeignFile(f"{file} has both K_blocks and K_values; expected one of them.")
    for name, array in returned.items():
        if type_of(array) != RESULTS[name].type and not (type_of(array) == "int" and RESULTS[name].type == "real"):
            raise ForeignFile(f"{file}: {name} is of type {type_of(array)}; expected {RESULTS[name].type}.")
    if "digest" in returned and returned["digest"].tolist() != arrays["digest"].tolist():
        raise ForeignFile(
            f"{file} was computed from other vectors than {vectors.title!r}: the digests differ. Compute it again from these."
        )
    known = arrays["states"].tolist()
    names = returned["states"].tolist() if "states" in returned else known
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ForeignFile(f"{file}: states has {unknown[0][:80]!r}; {name_known(unknown[0][:80], known)}")
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice or not names:
        raise ForeignFile(f"{file}: states {f'has {twice[0]!r} more than once' if twice else 'is empty'}.")
    for name in ("program", "W", "F", "K_blocks", "K_values"):
        if name in returned:
            sized = sizes | {"ns": len(names), "1": 1}
            shape = tuple(sized[size] for size in LAYOUT.get(name, RESULTS[name]).sizes)
            if returned[name].shape != shape:
                raise ForeignFile(
                    f"{file}: {name} has the sizes {returned[name].shape}; expected {shape}, {' x '.join(RESULTS[name].sizes)}. "
                    "If not all states were computed, say which in states."
                )


def _case(vectors: Vectors, returned: dict[str, Array]) -> Case:
    mesh, term, ndofs = vectors.mesh, vectors.term, vectors.mesh.p.size
    shape = Shape(mesh, vectors.discretisation)
    truth = Implementation(EXACT, vectors.model(), ndofs)
    names = returned["states"].tolist() if "states" in returned else list(vectors.states)
    as_real = {name: array.astype(float) if RESULTS[name].type == "real" else array for name, array in returned.items()}
    return Case(
        shape=shape,
        ours=truth,
        reference=truth,
        scikit_fem=truth,
        candidate=Implementation(CANDIDATE, vectors.model(as_real), ndofs),
        states={name: u for name, u in vectors.states.items() if name in names},
        seed=0,
        homogeneous=homogeneous_copy(mesh, [term], shape),
        by_edges=mesh.element.is_linear_simplex,
    )


def _of_all_states(case: Case, vectors: Vectors) -> Case:
    """Return the case with a reference that can be evaluated in any state, which hypotheses need."""
    tensor = elasticity(vectors.mesh, [vectors.term], vectors.discretisation)
    reference = Implementation(REFERENCE, Truth(case.shape, tensor), case.mesh.p.size)
    return replace(case, reference=reference, states=vectors.states)


def _tasks(case: Case) -> Iterator[Task]:
    """Yield the checks of the candidate that need no other states than those with results."""
    seen = set()
    for check in (agreement, balance):
        for task in check(case):
            key = task.check, task.quantity, task.state
            if task.implementation is case.candidate and task.state in case.states and key not in seen:
                seen.add(key)
                yield task
