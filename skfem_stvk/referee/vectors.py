"""Test vectors: a body, states, and its W, F and K in these states, for programs in any language.

All numbers are computed in 50 decimal digits (`exact`) and rounded to double once. Coordinates, displacements and constants are
taken as exact. For linear simplices the vectors have the coefficients L of
`W = 1/4 sum L_ii zeta_i^2 + 1/2 sum_{pairs} L_ij zeta_i zeta_j` over edges and pairs of edges. For other elements they have the
points, and the data from which deformation gradients are computed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from decimal import Decimal, localcontext
from functools import cached_property, partial
from importlib.resources import as_file, files
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_matrix

from ..arguments import Array, choice, flag, path, shown, text, whole
from ..edges.materials import Isotropic, Material
from ..errors import MaterialError, StvkError, name_ids
from ..mesh import ElementMesh, MeshLike
from ..mesh.diagnostics import check_mesh
from ..mesh.element import ELEMENTS
from ..results.array_files import TYPES, read, type_of, write_npz, write_text
from ..results.complete_files import ForeignFile
from ..terminal import CountedProgress
from ..terms import StVK
from .bodies import is_condensed, section_of
from .case import named_states
from .discretisation import Discretisation, Exact, Shape, derivatives
from .exact import CONTEXT, ExactStVK, of_blocks
from .implementations import METHODS
from .report import folder_for, write
from .verification import claimed_terms


class ArrayOfVectors(NamedTuple):
    """Array of the layout: its type, its sizes by name, its unit, its meaning, and the elements for which it exists."""

    type: str
    sizes: tuple[str, ...]
    unit: str
    what: str
    of: str = "all elements"


SIMPLICES, OTHERS = "linear simplices", "other elements"
LAYOUT = {
    "digest": ArrayOfVectors("text", ("1",), "", "SHA-256 of all that follows; results may give it back, to say what they are of"),
    "title": ArrayOfVectors("text", ("1",), "", "the name of the set"),
    "kind": ArrayOfVectors("text", ("1",), "", "the kind of elements: their nodes are in scikit-fem's local order"),
    "rule": ArrayOfVectors("text", ("1",), "", "usual or exact: which points integrals are taken over"),
    "hypothesis": ArrayOfVectors("text", ("1",), "", "none (solids), plane strain, plane stress or uniaxial stress"),
    "nodes": ArrayOfVectors("real", ("nv", "d"), "m", "coordinates at rest"),
    "elements": ArrayOfVectors("int", ("nt", "n"), "", "nodes of each element, from 0; of either orientation"),
    "young": ArrayOfVectors("real", ("nt",), "Pa", "Young's modulus of each element"),
    "poisson": ArrayOfVectors("real", ("nt",), "", "Poisson's ratio; nan for segments without one"),
    "section": ArrayOfVectors(
        "real", ("nt",), "m^(3-k)", "thickness of surfaces, area of segments; 1 for solids, and if none was given"
    ),
    "lame": ArrayOfVectors(
        "real", ("nt", "2"), "N/m^(k-1)", "lambda and mu within the element's dimensions under its hypothesis, times section"
    ),
    "edges": ArrayOfVectors("int", ("ne", "2"), "", "nodes a < b of each edge", SIMPLICES),
    "edge_coefficients": ArrayOfVectors("real", ("ne",), "J/m^4", "L_ii of each edge", SIMPLICES),
    "pairs": ArrayOfVectors("int", ("np", "2"), "", "edges i < j that share an element (TSEPs), as rows of `edges`", SIMPLICES),
    "pair_coefficients": ArrayOfVectors("real", ("np",), "J/m^4", "L_ij of each pair", SIMPLICES),
    "points": ArrayOfVectors("real", ("nq", "k"), "", "reference coordinates of the points", OTHERS),
    "weights": ArrayOfVectors("real", ("nq",), "", "their weights", OTHERS),
    "dN": ArrayOfVectors("real", ("nq", "n", "k"), "", "derivatives dN_a/dxi_i of the shape functions at each point", OTHERS),
    "R_inverse": ArrayOfVectors(
        "real", ("nt", "nq", "k", "k"), "1/m", "inverse of the upper triangle R (diagonal > 0) with dX/dxi = Q R, Q' Q = 1", OTHERS
    ),
    "volumes": ArrayOfVectors("real", ("nt", "nq"), "m^k", "weight times det R: what each point stands for", OTHERS),
    "states": ArrayOfVectors("text", ("ns",), "", "the name of each state"),
    "u": ArrayOfVectors("real", ("ns", "ndofs"), "m", "displacements; degree of freedom d * node + component"),
    "W": ArrayOfVectors("real", ("ns",), "J", "strain energy"),
    "F": ArrayOfVectors("real", ("ns", "ndofs"), "N", "internal force dW/du"),
    "K_node_pairs": ArrayOfVectors("int", ("m", "2"), "", "nodes a, b that share an element, a = b too, in lexicographic order"),
    "K_blocks": ArrayOfVectors(
        "real", ("ns", "m", "d", "d"), "N/m", "tangent stiffness dF/du: the block of each pair, row of a, column of b"
    ),
    "K_row_starts": ArrayOfVectors("int", ("ndofs+1",), "", "the same as compressed sparse rows: where each row begins"),
    "K_columns": ArrayOfVectors("int", ("nnz",), "", "column of each value"),
    "K_values": ArrayOfVectors("real", ("ns", "nnz"), "N/m", "values"),
}
#: Arrays that another program may return: any of W, F and one form of K. `states` is needed if some are missing or reordered.
RESULTS = {
    "digest": LAYOUT["digest"],
    "program": ArrayOfVectors("text", ("1",), "", "the name of the program, for the report"),
    **{name: LAYOUT[name] for name in ("states", "W", "F", "K_blocks", "K_values")},
}
#: Names of the published sets, which are files of the package.
PUBLISHED = ("tetrahedron", "block", "membrane", "curved", "hexahedra")
HYPOTHESES = {"none": None, "plane strain": "strain", "plane stress": "stress", "uniaxial stress": None}
NAME = "vectors"
#: Bytes of a value in the compressed NPZ file and in the text, measured on meshes of 48 to 2862 elements: 5 to 7, and 21 to 23.
BYTES = (7, 22)


class Vectors:
    """Test vectors as arrays of the layout. The arrays are never modified.

    >>> one = published_vectors("tetrahedron")
    >>> one
    Vectors('tetrahedron': 1 tetrahedra in 3D, 8 states)
    >>> one.arrays["edge_coefficients"].shape, one.arrays["pairs"].shape
    ((6,), (15, 2))
    """

    def __init__(self, arrays: dict[str, Array]) -> None:
        self.arrays = arrays

    def __repr__(self) -> str:
        return f"Vectors({self.title!r}: {self.mesh.nt} {self.mesh.kind}, {len(self.states)} states)"

    @property
    def title(self) -> str:
        """Name of the set."""
        return str(self.arrays["title"][0])

    @cached_property
    def mesh(self) -> ElementMesh:
        """Mesh of the body at rest."""
        return ElementMesh(self.arrays["nodes"].T, self.arrays["elements"].T, element=ELEMENTS[str(self.arrays["kind"][0])])

    @property
    def discretisation(self) -> Discretisation:
        """Kind of element and integration rule."""
        rule = str(self.arrays["rule"][0])
        return Discretisation(str(self.arrays["kind"][0]), None if rule == "usual" else rule)

    @property
    def term(self) -> StVK:
        """St. Venant-Kirchhoff term with its constants. A constant is one number if it is the same in all elements."""
        young, poisson, section = (_one_if_same(self.arrays[name]) for name in ("young", "poisson", "section"))
        if np.isnan(poisson).all():
            poisson = None
        sections = {1: {"area": section}, 2: {"thickness": section}}.get(self.mesh.k, {})
        return StVK(young=young, poisson=poisson, plane=HYPOTHESES[str(self.arrays["hypothesis"][0])], **sections)

    @property
    def states(self) -> dict[str, Array]:
        """Displacements (ndofs,) [m] by name."""
        return dict(zip(self.arrays["states"].tolist(), self.arrays["u"], strict=True))

    def model(self, returned: dict[str, Array] | None = None) -> Any:
        """Return an object with those of `energy`, `internal_force` and `tangent` for which there are values.

        The methods raise StvkError except in the states of the vectors. `returned` holds the values of another program. The default
        is the values of these vectors. `returned["states"]` names the states, if not all states are there.
        """
        values = self.arrays if returned is None else returned
        of = {self.states[name].tobytes(): i for i, name in enumerate(values.get("states", self.arrays["states"]).tolist())}
        n, own = self.arrays["u"].shape[1], self.arrays
        make: dict[str, Callable[[Array], Any]] = {
            "W": float,
            "F": np.copy,
            "K_blocks": lambda blocks: of_blocks(own["K_node_pairs"].T, blocks, n),
            "K_values": lambda values: csr_matrix((values, own["K_columns"], own["K_row_starts"]), shape=(n, n), copy=True),
        }
        model = SimpleNamespace()
        for name, take in make.items():
            if name in values:
                setattr(model, METHODS[name[0]], partial(_value_of_state, of, values[name], take))
        return model

    def save(self, folder: str | Path, text: bool = False) -> Path:
        """Write `vectors.npz` and a `README.txt` that describes it into a folder, and return its path.

        The folder is created if it is missing.

        Parameters
        ----------
        folder
            Path of the folder.
        text
            Whether to write the arrays to `vectors.txt` as well. Otherwise an older `vectors.txt` is removed from the folder.

        Raises
        ------
        StvkError
            if the folder cannot be written to.
        """
        text, folder = flag("text", text), folder_for(folder)
        write_npz(folder / f"{NAME}.npz", self.arrays)
        if text:
            write_text(folder / f"{NAME}.txt", self.arrays)
        else:
            (folder / f"{NAME}.txt").unlink(missing_ok=True)
        write(folder / "README.txt", readme(self))
        return folder


def _value_of_state(of: dict[bytes, int], values: Array, take: Callable[[Array], Any], u: Array) -> Any:
    """Return the value in the state `u`. Raise StvkError if there is no value for this state."""
    i = of.get(u.tobytes())
    if i is None:
        raise StvkError("there is no value for this state: values are known in the states of the vectors alone")
    return take(values[i])


def export_vectors(
    mesh: MeshLike,
    material: Material | StVK | Sequence[StVK] | None = None,
    *,
    young: ArrayLike | None = None,
    poisson: ArrayLike | None = None,
    quadrature: str | None = None,
    title: str = "vectors",
    seed: int = 0,
    quiet: bool = False,
) -> Vectors:
    """Return test vectors of a body of isotropic St. Venant-Kirchhoff material, in eight states.

    All values are computed in 50 decimal digits. A linear tetrahedron takes about 4 ms, and 4 kB as NPZ or 12 kB as text. Use
    a small mesh. The first line that is printed gives the expected sizes of the files.

    Parameters
    ----------
    mesh
        Mesh of scikit-fem, arrays `(p, t)` of linear simplices, or `ElementMesh`, as in `verify`.
    material
        An isotropic material, or `StVK` terms of isotropic materials, with each element in exactly one of them. Alternatively, pass
        `young` and `poisson`.
    young, poisson
        Young's modulus [Pa] and Poisson's ratio of one material for all elements.
    quadrature
        Integration rule, "exact", or None for the usual rule.
    title
        Name of the set.
    seed
        Seed of the random states.
    quiet
        Whether to hide the expected sizes and the progress.

    Returns
    -------
    Vectors
        Use `vectors.save("folder")` to write them.

    Raises
    ------
    MaterialError
        if a material is not isotropic, or an element has none or several.
    MeshError, RegionError, StvkError
        under the conditions of `verify`.

    Examples
    --------
    >>> import skfem
    >>> two = export_vectors(skfem.MeshTri().scaled((2, 1)), young=1e5, poisson=0.3, quiet=True)
    >>> two, list(two.states)[:3]
    (Vectors('vectors': 2 triangles in 2D, 8 states), ['rest', 'small random strain', 'rigid rotation'])
    >>> float(two.arrays["W"][0]), two.arrays["K_blocks"].shape
    (0.0, (8, 14, 2, 2))
    """
    seed, title = whole("seed", seed, "a whole number from 0"), text("title", title)
    rule = "usual" if quadrature is None else choice("quadrature", quadrature, ["exact"])
    laws, quiet = claimed_terms(material, young, poisson), flag("quiet", quiet)
    body = ElementMesh.of(mesh)
    check_mesh(body)
    discretisation = Discretisation(body.element.name, None if rule == "usual" else rule)
    shape = Shape(body, discretisation)
    facts, exact_lame = _material(body, laws)
    exact = ExactStVK(body.p, body.t, exact_lame, discretisation)
    centred = (body.p - body.p.mean(axis=1, keepdims=True)).T
    states = named_states(centred, shape.node_size, np.random.default_rng([seed, *b"states"]))
    with CountedProgress("export", 1 + len(states), quiet, lines=True) as progress:
        progress.print(_expected_size(body, len(states), exact))
        progress.step("coefficients")
        coefficients = _edge_form(body, exact) if body.element.is_linear_simplex else _points(discretisation, exact)
        W, F, blocks = [], [], []
        for name, u in states.items():
            progress.step(name)
            energy, force = exact.energy_and_force(u)
            W.append(energy)
            F.append(force)
            blocks.append(exact.blocks(u))
    arrays: dict[str, Any] = {
        "title": [title],
        "kind": [body.element.name],
        "rule": [rule],
        "hypothesis": [_hypothesis(body, laws[0])],
        "nodes": body.p.T,
        "elements": body.t.T,
        **facts,
        **coefficients,
        "states": list(states),
        "u": np.stack(list(states.values())),
    }
    arrays |= {"W": W, "F": F, "K_node_pairs": exact.pairs.T, "K_blocks": blocks}
    rows = [of_blocks(exact.pairs, values, body.p.size) for values in blocks]
    arrays |= {"K_row_starts": rows[0].indptr, "K_columns": rows[0].indices, "K_values": [row.data for row in rows]}
    plain = {name: np.array(arrays[name], dtype=TYPES[of.type]) for name, of in LAYOUT.items() if name in arrays}
    return Vectors({"digest": np.array([digest(plain)])} | plain)


def _expected_size(mesh: ElementMesh, states: int, exact: ExactStVK) -> str:
    """Return a line on the size of the files, which are mostly values of u, F and K, the latter in two forms."""
    values = 2 * states * (mesh.p.size + exact.pairs.shape[1] * mesh.d**2)
    npz, txt = (f"{each * values / 1e6:.2g} MB" for each in BYTES)
    return f"{mesh.nt} {mesh.kind}, {states} states: {NAME}.npz takes about {npz}, and {NAME}.txt, where it is written, {txt}"


def published_vectors(name: str) -> Vectors:
    """Return one of the five published sets of the package.

    - tetrahedron: one scalene tetrahedron.
    - block: tetrahedra of both orientations and two materials.
    - membrane: triangles in space.
    - curved: two curved quadratic tetrahedra.
    - hexahedra: two distorted hexahedra.

    `python -m validation.vectors` generates the sets.

    Parameters
    ----------
    name
        Name of the set, one of `PUBLISHED`.

    Returns
    -------
    Vectors
        The set, with its mesh, its states and the values in them.

    Raises
    ------
    StvkError
        if there is no such set.

    Examples
    --------
    >>> block = published_vectors("block")
    >>> block, block.arrays["W"].shape
    (Vectors('block': 10 tetrahedra in 3D, 8 states), (8,))
    """
    choice("name", name, PUBLISHED)
    with as_file(files("skfem_stvk.referee") / "data" / f"{name}.npz") as file:
        return read_vectors(file)


def read_vectors(source: str | Path) -> Vectors:
    """Return the vectors of a folder, or of a file `.npz` or `.txt`. The digest is checked, so that any change is detected.

    Raises
    ------
    StvkError
        if there are no vectors, or the file is damaged or was changed.
    """
    file = path("vectors", source, "the path of a folder or a file of vectors")
    if file.is_dir():
        found = [file / f"{NAME}{suffix}" for suffix in (".npz", ".txt") if (file / f"{NAME}{suffix}").is_file()]
        if not found:
            raise StvkError(f"{file} has neither {NAME}.npz nor {NAME}.txt. Export vectors there: skfem-stvk export --out {file}")
        file = found[0]
    arrays = read(file, LAYOUT)
    missing = [name for name, of in LAYOUT.items() if of.of == "all elements" and name not in arrays]
    if missing:
        raise ForeignFile(f"{file} lacks {', '.join(missing[:5])}; expected the vectors of `skfem-stvk export`.")
    if arrays["digest"].tolist() != [digest(arrays)]:
        raise ForeignFile(f"{file} has been changed since it was written: its digest differs. Export the vectors again.")
    return Vectors(arrays)


def digest(arrays: dict[str, Array]) -> str:
    """Return the SHA-256 of all arrays of the layout except the digest: names, types, shapes and values."""
    total = hashlib.sha256()
    for name in LAYOUT:
        if name in arrays and name != "digest":
            array = arrays[name]
            kind = type_of(array)
            values = "\n".join(array.tolist()).encode() if kind == "text" else array.astype(TYPES[kind].newbyteorder("<")).tobytes()
            total.update(f"{name} {kind} {array.shape}".encode() + values)
    return total.hexdigest()


def sizes_of(arrays: dict[str, Array]) -> dict[str, int]:
    """Return the values of the sizes by name, such as `nv` and `ndofs`."""
    sizes = {"k": ELEMENTS[str(arrays["kind"][0])].k}
    for name, array in arrays.items():
        sizes |= dict(zip(LAYOUT[name].sizes, array.shape, strict=True))
    return sizes


def readme(vectors: Vectors) -> str:
    """Return the text of README.txt, which describes the files of a folder of vectors."""
    sizes = sizes_of(vectors.arrays)
    lines = [
        f"Test vectors '{vectors.title}' of skfem-stvk: {vectors.mesh.nt} {vectors.mesh.kind}, St. Venant-Kirchhoff.",
        "",
        "vectors.npz (NumPy) and vectors.txt (skfem-stvk export --text) hold the same arrays. In the text, each begins with a line",
        "NAME TYPE RANK N1 ... NRANK (TYPE real, int or text), and its values follow in C order, the last index fastest;",
        "a text has one line for each entry. All numbers were computed in 50 decimal digits and rounded to double once.",
        "",
        *(_line(name, sizes) for name in vectors.arrays),
        "",
        "Give back results.txt or results.npz, in the same layout, with any of W, F and K_blocks or K_values (and digest, program,",
        "and states if not all of them are there), next to these files, and have it judged: skfem-stvk verify --results FOLDER",
        "",
    ]
    return "\n".join(lines)


def _line(name: str, sizes: dict[str, int]) -> str:
    of = LAYOUT[name]
    shape = " x ".join(f"{size}={sizes[size]}" if size.isalpha() else size for size in of.sizes)
    return f"{name:<18} {of.type:<5} {shape:<24} {'[' + of.unit + ']' if of.unit else '':<12} {of.what}".rstrip()


def _hypothesis(mesh: ElementMesh, law: StVK) -> str:
    return {1: "uniaxial stress", 2: "plane stress" if is_condensed(mesh, law) else "plane strain"}.get(mesh.k, "none")


def _material(mesh: ElementMesh, laws: Sequence[StVK]) -> tuple[dict[str, Any], tuple[Exact, Exact]]:
    """Return the constants of each element, and the Lame pair in decimal numbers. Raise MaterialError if they are not suitable."""
    young, poisson, section = np.full(mesh.nt, np.nan), np.full(mesh.nt, np.nan), np.ones(mesh.nt)
    laid = np.zeros(mesh.nt, dtype=np.int64)
    for law in laws:
        if not isinstance(law.material, Isotropic) or law.simplices is not None:
            raise MaterialError(
                f"material = {shown(law)}; expected isotropic materials on the elements of the mesh, as StVK(young=..., "
                "poisson=...) without simplices: vectors have constants of nothing else."
            )
        law.stiffness(mesh)  # raises if the constants do not fit the mesh
        ids = mesh.elements(law.region)
        laid[ids] += 1
        thick = section_of(mesh, law)
        young[ids] = law.material.young
        poisson[ids] = np.nan if law.material.poisson is None else law.material.poisson
        section[ids] = 1.0 if thick is None else thick
    if (laid != 1).any():
        raise MaterialError(f"{name_ids(np.flatnonzero(laid != 1), 'element')}: of no law, or of several; expected one each.")
    if len({_hypothesis(mesh, law) for law in laws}) > 1:
        raise MaterialError("Some elements are in plane strain and others in plane stress; expected one of them.")
    pairs = [_lame(E, nu, t, mesh.k, is_condensed(mesh, laws[0])) for E, nu, t in zip(young, poisson, section, strict=True)]
    exact = np.array(pairs, dtype=object).reshape(-1, 2)
    facts = {"young": young, "poisson": poisson, "section": section, "lame": exact.astype(float)}
    return facts, (exact[:, 0], exact[:, 1])


def _lame(young: float, poisson: float, section: float, k: int, condensed: bool) -> tuple[Decimal, Decimal]:
    with localcontext(CONTEXT):
        E = Decimal(float(young)) * Decimal(float(section))
        if k == 1:
            return E, Decimal(0)
        nu = Decimal(float(poisson))
        mu = E / (2 * (1 + nu))
        return 2 * mu * nu / (1 - (1 if condensed else 2) * nu), mu


def _edge_form(mesh: ElementMesh, exact: ExactStVK) -> dict[str, Any]:
    """Return edges, pairs of edges that share an element, and their coefficients, summed in decimal numbers."""
    local = mesh.element.edges
    L = exact.edge_form(local)
    ends = np.sort(mesh.t.T[:, np.array(local)].astype(np.int64), axis=2)  # (nt, m, 2)
    edges, of = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    of = of.reshape(ends.shape[:2])
    own = np.full(len(edges), Decimal(0), dtype=object)
    with localcontext(CONTEXT):
        np.add.at(own, of, np.einsum("aan->na", L))
        found: dict[str, Any] = {"edges": edges, "edge_coefficients": own.astype(float)}
        first, second = np.array(list(combinations(range(len(local)), 2)), dtype=np.int64).reshape(-1, 2).T
        both = np.sort(np.stack([of[:, first], of[:, second]], axis=2).reshape(-1, 2), axis=1)
        pairs, index = np.unique(both, axis=0, return_inverse=True)
        between = np.full(len(pairs), Decimal(0), dtype=object)
        np.add.at(between, index.ravel(), L[first, second].T.ravel())
        return found | {"pairs": pairs, "pair_coefficients": between.astype(float)}


def _points(discretisation: Discretisation, exact: ExactStVK) -> dict[str, Any]:
    xi, weights = discretisation.points
    inverse, volumes = exact.inverse_triangles()
    dN = derivatives(discretisation.kind, xi).astype(float)
    return {"points": xi.T, "weights": weights, "dN": dN, "R_inverse": inverse, "volumes": volumes}


def _one_if_same(values: Array) -> Any:
    return float(values[0]) if (values == values[0]).all() else values
