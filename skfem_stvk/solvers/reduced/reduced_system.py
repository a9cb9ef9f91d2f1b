"""A body with few unknowns: the amounts of some displacement fields."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rich.progress import BarColumn, TimeElapsedColumn

from ...arguments import Array, array, flag, number, shown, whole
from ...arguments import path as path_of
from ...errors import StvkError
from ...mesh.displacements import finite_vector
from ...npz import Numbers, Stored
from ...results.array_files import write_text
from ...system import System
from ...system.coordinates import checked_whole
from ...system.signature import Fingerprint, sums
from ...terminal import Progress, duration
from ...terms.loads.load import Time
from ..dynamics.at_rest import AtRest
from ..runs.archive import STRICT, Store, refusing_damage
from .basis import SIZE, Lifts, candidates_of, checked_snapshots, masses_of, orthonormality_error, principal_basis
from .quartic import (
    PrecomputedCoordinates,
    ReducedQuartic,
    bytes_needed,
    coefficients,
    quartic_of,
    rows_of,
    seconds_needed,
)
from .step_data import FIRST_LINE, step_data

#: Default limit of the bytes that a reduced body needs while it is made.
MOST_MEMORY = 1e9
#: Default number of modes.
MODES = 20
#: Largest number of modes; unknowns are limited by memory.
MOST = 10_000


class ReducedSystem:
    """St. Venant-Kirchhoff body in the span of a few displacement fields; its cost does not depend on the mesh.

    ::

        u = V q + Phi s(t)        W(q, s) one quartic        F = dW/dq (r,)        K = d2W/dq2 (r, r)

    `V` (ndofs, r) is made of natural modes, their modal derivatives and snapshots, and is orthonormal by mass. `Phi` (ndofs, l) are
    lifts: the response of the body at rest to each independent field of prescribed displacements, minus its part in V. `s(t)` are
    their amounts. `solve_static`, `simulate` and `verify` accept it like any system.

    Parameters
    ----------
    body
        A `System` with supports that leave no motion without strain.
    size
        Number r of unknowns; by default 30, or the number of independent fields.
    modes
        Number of the lowest natural modes in the basis; 0 for snapshots alone. By default 20, or the number of free degrees of
        freedom.
    derivatives
        Whether to include all `modes (modes + 1)/2` modal derivatives. Linear modes alone cannot represent large rotations.
    snapshots
        (ndofs, n) displacements of the body, such as states of a path, that the basis must represent as well.
    times
        Times at which prescribed displacements that are functions are sampled; by default 33 between 0 and 1.
    most_memory
        Maximum number of bytes that are needed while it is made.
    quiet
        Print nothing.

    Attributes
    ----------
    body, size
        The arguments.
    columns
        (ndofs, r + l) columns of V, then of Phi.
    basis, lifts
        Its parts V (ndofs, r) and Phi (ndofs, l).
    masses
        (ndofs,) lumped masses M, of density 1 if the body has none.

    Raises
    ------
    SupportError
        if the body can move without strain, or prescribed displacements have too many independent fields.
    StvkError
        if there are fewer than `size` independent fields, a term has no energy, or more than `most_memory` is needed.

    Notes
    -----
    Arguments that methods share:

    - `q`: (r,) unknowns.
    - `v`: (r,) direction of unknowns.
    - `z`: (r + l,) unknowns and amounts of the lifts, `z = (q, s)`.
    - `u`: (ndofs,) displacements [m].
    - `t`: time [s], or the load factor, of the prescribed displacements and the loads.

    Methods raise StateError if a vector does not have one finite entry for each unknown, or is so large that the result overflows.

    Source: Barbic, James, "Real-time subspace integration for St. Venant-Kirchhoff deformable models" (2005).

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import StVK, System
    >>> mesh = skfem.MeshTet.init_tensor(np.linspace(0, 4, 9), np.linspace(0, 1, 3), np.linspace(0, 1, 3))
    >>> body = System(mesh, StVK(young=1e6, poisson=0.3, density=1e3), fixed=[(lambda x: x[0] == 0, "xyz")])
    >>> reduced = ReducedSystem(body, size=8, modes=4, quiet=True)
    >>> q = 3 * np.cos(np.arange(8))
    >>> u = reduced.displacements(q)
    >>> bool(abs(reduced.energy(q) / body.energy(u) - 1) < 1e-12)
    True
    >>> bool(np.allclose(reduced.internal_force(q), reduced.basis.T @ body.internal_force(u)))
    True
    """

    def __init__(
        self,
        body: System,
        size: int | None = None,
        modes: int | None = None,
        derivatives: bool = True,
        *,
        snapshots: ArrayLike | None = None,
        times: ArrayLike | None = None,
        most_memory: float = MOST_MEMORY,
        quiet: bool = False,
    ) -> None:
        checked_whole(body, "ReducedSystem(body)", "body")
        size = None if size is None else whole("size", size, "a number of unknowns", 1)
        if modes is None:
            modes = min(MODES, body.ndofs - len(body.supports.held))
        modes = whole("modes", modes, f"a number of modes, or 0, at most {MOST}", 0, MOST)
        derivatives, quiet = flag("derivatives", derivatives), flag("quiet", quiet)
        most = number("most_memory", most_memory, "a number of bytes", 0)
        moments = None if times is None else array("times", times, (None,), "a list of times").tolist()
        if moments == []:
            raise StvkError("times are empty; expected at least one, or None for 33 between 0 and 1.")
        if not modes and snapshots is None:
            raise StvkError("modes = 0 without snapshots; expected at least one of them, from which a basis is made.")
        if body.without_energy:
            names = ", ".join(body.without_energy)
            raise StvkError(f"{names}: its force is not the gradient of an energy; expected terms that have one, such as StVK.")
        if body.contacts:
            names = ", ".join(repr(contact.name) for contact in body.contacts)
            raise StvkError(f"contacts {names}; expected none: a basis has no fields for touching surfaces. Use the System itself.")
        body.check_held()
        if body.dtype != np.float64:
            raise StvkError("The body is in float32; expected float64: coefficients of a quartic are sums over all elements.")
        count = modes + (modes * (modes + 1) // 2 if derivatives else 0)
        expected = size or (min(SIZE, count) if snapshots is None else SIZE)
        with _Stages(body, expected, count, most, quiet) as stages:
            masses = masses_of(body)
            rest = AtRest(body)
            lifts = Lifts.of(body, rest, moments)
            own = checked_snapshots(body, lifts, snapshots)
            made = candidates_of(body, masses, rest, modes, derivatives, own, tick=stages.stage)
            stages.stage("principal components")
            basis = principal_basis(masses, made, size)
            del rest, made
            columns = np.ascontiguousarray(np.concatenate([basis, lifts.without_basis(masses, basis)], axis=1))
            stages.stage("coefficients")
            terms = [term for term in body.bound_terms if term.quartic]
            self._set(body, columns, basis.shape[1], quartic_of(body, terms, columns, stages.rows))

    def _set(self, body: System, columns: Array, size: int, quartic: ReducedQuartic) -> None:
        columns.flags.writeable = False
        self.in_coordinates = inner = PrecomputedCoordinates(body, columns, size, quartic)
        self.body, self.size, self.columns, self.masses = body, size, columns, inner.masses
        self.basis, self.lifts = columns[:, :size], columns[:, size:]

    def save(self, path: str | Path) -> Path:
        """Write the fields and the coefficients to a file, or all data of a time step as text for other programs.

        `load` restores the reduced body from an .npz file within a second. `docs/reduced.c` reads the text.

        Parameters
        ----------
        path
            Path of the file (.npz or .txt).

        Raises
        ------
        StvkError
            if the path is not writable; for text, if a term or a load needs the mesh in each step, or a name of a location does not
            fit into one line of 127 bytes.
        """
        file = path_of("path", path, "the path of an .npz or .txt file")
        if file.suffix == ".txt":
            write_text(file, step_data(self.in_coordinates), FIRST_LINE)
            return file
        file = npz("path", path)
        saved = SavedReduced(self.basis, self.lifts, self.in_coordinates.coefficients)
        ReducedFile.write_file(file, _fingerprint(self.body, self.masses), saved)
        return file

    @classmethod
    def load(cls, path: str | Path, body: System) -> ReducedSystem:
        """Return the reduced body of a file that `save` wrote, for the same body; loads may differ.

        Parameters
        ----------
        path
            Path of the file (.npz).
        body
            The body, with the mesh, terms, masses and supports with which the file was made.

        Raises
        ------
        StvkError
            if the file is of another kind or damaged, or of a body with another mesh, other terms, masses or supports.

        Examples
        --------
        >>> import skfem, tempfile, os
        >>> from skfem_stvk import StVK, System
        >>> body = System(skfem.MeshTet().refined(1), StVK(young=1.0, poisson=0.3), fixed=[(lambda x: x[0] == 0, "xyz")])
        >>> reduced = ReducedSystem(body, 4, 3, quiet=True)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     again = ReducedSystem.load(reduced.save(os.path.join(folder, "cube.npz")), body)
        >>> bool(again.energy(np.ones(4)) == reduced.energy(np.ones(4)))
        True
        """
        checked_whole(body, "ReducedSystem.load(path, body)", "body")
        file, masses = npz("path", path), masses_of(body)
        problem, saved = ReducedFile.read_file(file)
        _fingerprint(body, masses).refuse_other(problem, file, ReducedFile.remedy)
        with refusing_damage(file, ReducedFile.remedy):
            V, Phi, T = saved.basis, saved.lifts, saved.T
            n = V.shape[1] + Phi.shape[1] + 1
            if (len(V), len(Phi), len(T)) != (body.ndofs, body.ndofs, coefficients(n)):
                raise ValueError(f"its arrays are of {len(V)} degrees of freedom; expected {body.ndofs}")
            quartic = ReducedQuartic(n, T)
        if not orthonormality_error(masses, V) < 1e-11:
            raise StvkError(f"{file} holds a basis that is not orthonormal by the masses of the body. {ReducedFile.remedy}")
        made: ReducedSystem = cls.__new__(cls)
        made._set(body, np.ascontiguousarray(np.concatenate([V, Phi], axis=1)), V.shape[1], quartic)
        return made

    def amounts(self, t: Time = 1.0) -> Array:
        """Return the amounts `s(t)` (l,) [m] of the lifts.

        Raises
        ------
        SupportError
            if prescribed displacements at `t` are off their span.
        """
        return self.in_coordinates.prescribed_values(t)

    def energy(self, q: ArrayLike, t: Time = 1.0) -> float:
        """Return the strain energy `W` [J] at the unknowns."""
        return self.in_coordinates.linearize(self.unknowns(q, t))[0]

    def internal_force(self, q: ArrayLike, t: Time = 1.0) -> Array:
        """Return `F = dW/dq` (r,), which is `V' F(u)` of the body."""
        return self.in_coordinates.linearize(self.unknowns(q, t))[1][: self.size].copy()

    def tangent(self, q: ArrayLike, t: Time = 1.0) -> Array:
        """Return `K = d2W/dq2` (r, r), which is `V' K(u) V` of the body."""
        return self.in_coordinates.linearize(self.unknowns(q, t))[2][: self.size, : self.size].copy()

    def linearize(self, q: ArrayLike, t: Time = 1.0) -> tuple[float, Array, Array]:
        """Return W [J], F (r,) and K (r, r), at the cost of one of them."""
        W, F, K = self.in_coordinates.linearize(self.unknowns(q, t))
        return W, F[: self.size].copy(), K[: self.size, : self.size].copy()

    def lift_force(self, q: ArrayLike, t: Time = 1.0) -> Array:
        """Return `dW/ds` (l,) [N], the forces that hold the lifts."""
        return self.in_coordinates.linearize(self.unknowns(q, t))[1][self.size :].copy()

    @property
    def quartic(self) -> bool:
        """Whether the whole energy is a quartic, so that its cost does not depend on the mesh."""
        return self.in_coordinates.quartic

    def energy_along(self, q: ArrayLike, v: ArrayLike, t: Time = 1.0) -> NDArray[np.float64]:
        """Return the exact coefficients (5,) of the strain energy along `q + s v` [J].

        Raises
        ------
        StvkError
            if the energy of a term is not a quartic.
        """
        if not self.quartic:
            raise StvkError("The strain energy along a line is not a quartic with such terms; use energy(q + s v).")
        direction = np.zeros(self.columns.shape[1])
        direction[: self.size] = finite_vector("v", v, self.size, "unknown")
        return self.in_coordinates.energy_along(self.unknowns(q, t), direction)

    def displacements(self, q: ArrayLike, t: Time = 1.0) -> Array:
        """Return `u = V q + Phi s(t)` (ndofs,) [m], with exact prescribed displacements."""
        u = np.asarray(self.columns @ self.unknowns(q, t))
        u[self.body.supports.held] = self.body.supports.values(t)
        return u

    def coordinates(self, u: ArrayLike, t: Time = 1.0) -> Array:
        """Return `q = V' M (u - Phi s(t))` (r,), the unknowns nearest to displacements by mass."""
        return self.in_coordinates.state(u, t)[: self.size]

    def unknowns(self, q: ArrayLike, t: Time = 1.0) -> Array:
        """Return `z = (q, s(t))` (r + l,)."""
        return np.concatenate([finite_vector("q", q, self.size, "unknown"), self.amounts(t)])

    def external_force(self, q: ArrayLike, t: Time = 1.0) -> Array:
        """Return `V' f_ext` (r,) of the loads.

        Constant dead loads are precomputed, so that their cost does not depend on the mesh.
        """
        return self.in_coordinates.external_force(self.unknowns(q, t), t)[: self.size]

    def load_stiffness(self, q: ArrayLike, t: Time = 1.0) -> Array | None:
        """Return `-V' df_ext/du V` (r, r); None if all loads are dead."""
        K = self.in_coordinates.load_stiffness(self.unknowns(q, t), t)
        return None if K is None else K[: self.size, : self.size]

    def residual(self, q: ArrayLike, t: Time = 1.0) -> Array:
        """Return `F - V' f_ext` (r,)."""
        return self.internal_force(q, t) - self.external_force(q, t)

    def jacobian(self, q: ArrayLike, t: Time = 1.0) -> Array:
        """Return the derivative of the residual (r, r): K, plus the stiffness of follower loads."""
        K, more = self.tangent(q, t), self.load_stiffness(q, t)
        return K if more is None else K + more

    def potential(self, q: ArrayLike, t: Time = 1.0) -> float:
        """Return the strain energy plus the potentials of the loads [J].

        Raises
        ------
        LoadError
            if a load has no potential.
        """
        return self.in_coordinates.potential(self.unknowns(q, t), t)

    def response(self, z: Array) -> tuple[float, Array, Array]:
        """Return W [J], `dW/dz` (r + l,) and `d2W/dz2` (r + l, r + l) at unknowns and amounts.

        The arrays are read only.
        """
        return self.in_coordinates.linearize(finite_vector("z", z, self.columns.shape[1], "amount"))

    def __repr__(self) -> str:
        return repr(self.in_coordinates)


def _fingerprint(body: System, masses: Array) -> Fingerprint:
    """Return the fingerprint of the mesh, the elastic terms, supports and masses; loads are not included."""
    return Fingerprint("path of equilibria", body, {}, [], {"masses": sums(masses)})


def npz(name: str, value: Any) -> Path:
    """Return the path of an .npz file."""
    file = path_of(name, value, "the path of an .npz file")
    if file.suffix != ".npz":
        raise StvkError(f"{name} = {shown(value)} does not end in .npz; expected the path of an .npz file.")
    return file


@dataclass(frozen=True)
class SavedReduced:
    """Record of a reduced system: its fields and coefficients."""

    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT

    basis: Annotated[Array, Stored(2)]
    lifts: Annotated[Array, Stored(2)]
    T: Numbers


class ReducedFile(Store[SavedReduced]):
    """File of a reduced system."""

    known, schema = ("reduced body of skfem-stvk", 1), SavedReduced
    remedy = "Reduce the body again: ReducedSystem(body, ...)."


class _Stages(Progress):
    """Cost of a reduced body while it is made: printed before, refused above a limit, and shown as progress.

    `count` is the number of modes and derivatives.
    """

    def __init__(self, body: System, size: int, count: int, most: float, quiet: bool) -> None:
        needed, self._begin = bytes_needed(size) + 16 * body.ndofs * (count + size), time.perf_counter()
        if needed > most:
            raise StvkError(
                f"size = {size} needs about {needed / 1e6:,.0f} MB, {most / 1e6:,.0f} MB are allowed: there are r^4/24 "
                "coefficients, six times as many while they are made, and the fields. Take fewer unknowns, or allow more: "
                "most_memory=."
            )
        super().__init__("reduced", quiet, (BarColumn(), TimeElapsedColumn()))
        self._rows = sum(rows_of(term, body) for term in body.bound_terms)
        if self._reports:
            seconds = seconds_needed(size, self._rows)
            self.print(
                f"reduced: {size} unknowns on {body.mesh.nt} {body.mesh.kind}; about {needed / 1e6:,.0f} MB, and "
                f"{duration(seconds)} for {coefficients(size + 1):,} coefficients after {count} fields"
            )

    def stage(self, words: str) -> None:
        """Print the next stage."""
        self.show(description=words)

    def rows(self, done: int) -> None:
        """Count rows of strains that are in the coefficients."""
        self.show(total=self._rows, advance=done)

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        if error[0] is None:
            self.print(f"reduced: took {duration(time.perf_counter() - self._begin)}")
