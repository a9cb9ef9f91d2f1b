"""Damping: forces that are linear in the velocities and oppose them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, TypeAlias

from ...arguments import number, shown
from ...errors import StvkError
from ...npz import Within


@dataclass(frozen=True)
class Rayleigh:
    """Damping by mass and by the stiffness at rest: the force `-D v` with `D = alpha M + beta K0`, constant.

    A mode of circular frequency `omega` at rest gets the damping ratio `(alpha/omega + beta omega)/2`. `alpha` damps all motion,
    including rigid motion of the whole body. `beta` also damps large rotations, because K0 does not rotate with the body.

    Parameters
    ----------
    alpha
        Factor of the mass [1/s], not negative.
    beta
        Factor of the stiffness at rest [s], not negative.

    Raises
    ------
    StvkError
        if one is negative or not finite.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import StVK, System, critical_step
    >>> bar = System(skfem.MeshLine(), StVK(young=4.0, poisson=0.3, density=2.0), fixed={lambda x: x[0] == 0: "x"})
    >>> critical_step(bar).step, critical_step(bar, damping=Rayleigh(alpha=3.0)).step     # ratio 3/4 at omega = 2/s
    (1.0, 0.5)
    """

    alpha: float = 0.0
    beta: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "alpha", _not_negative("Rayleigh: alpha", self.alpha, "1/s"))
        object.__setattr__(self, "beta", _not_negative("Rayleigh: beta", self.beta, "s"))


@dataclass(frozen=True)
class EdgeDamping:
    """Damping by the rate of the squared elongations `zeta` of the edges, which act like dashpots.

    ::

        dzeta_i/dt = 2 p_i . (v_a - v_b)        force = -tau sum_i (L dzeta/dt)_i p_i = -tau K_GN(u) v
        power lost = tau/2 (dzeta/dt)' L (dzeta/dt)

    The sums are over edges `i = ab` with edge vectors `p_i` at `u`. `K_GN`, the Gauss-Newton part of K, is K without tensions.
    Rigid motions are never damped, at any rotation of the body. Hourglass modes of boxes with one point are not damped either,
    because their tensions do not change. `Rayleigh` damps them. A mode of circular frequency `omega` at rest gets the damping ratio
    `tau omega/2`.

    `BackwardEuler` and `EnergyMomentum` use the change of `zeta` over a step of length T instead of its rate. The force is then
    `-tau/T sum_i (L (zeta1 - zeta))_i p_i`, with `p_i` at the end of the step or in its middle. Only terms with edges are damped.
    Contacts, foundations, volume penalties and laws without edges, such as `NeoHookean`, are not.

    The springs of a `SpringNetwork` get dashpots in parallel, `c = tau k`. For `LinearElastic` the force is `tau K v`, which
    resists rotation.

    Parameters
    ----------
    tau
        Time of retardation [s], not negative.

    Raises
    ------
    StvkError
        if it is negative or not finite.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import StVK, System, critical_step
    >>> bar = System(skfem.MeshLine(), StVK(young=4.0, poisson=0.3, density=2.0), fixed={lambda x: x[0] == 0: "x"})
    >>> critical_step(bar).step, critical_step(bar, damping=EdgeDamping(tau=0.75)).step     # ratio 3/4 at omega = 2/s
    (1.0, 0.5)
    """

    tau: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "tau", _not_negative("EdgeDamping: tau", self.tau, "s"))


#: One kind of damping, or several that add up.
Damping: TypeAlias = "Rayleigh | EdgeDamping | Sequence[Rayleigh | EdgeDamping]"


class DampingFactors(NamedTuple):
    """Factors of `D = alpha M + beta K0 + tau K_GN(u)`."""

    alpha: Annotated[float, Within(0.0)] = 0.0
    beta: Annotated[float, Within(0.0)] = 0.0
    tau: Annotated[float, Within(0.0)] = 0.0


def damping_factors(damping: Damping | None) -> DampingFactors:
    """Return the sums of the factors of all kinds of damping; zeros for None.

    Raises
    ------
    StvkError
        if `damping` is anything else.

    Examples
    --------
    >>> damping_factors([Rayleigh(alpha=0.5), EdgeDamping(1e-3), EdgeDamping(2e-3)])
    DampingFactors(alpha=0.5, beta=0.0, tau=0.003)
    """
    several = isinstance(damping, Sequence) and not isinstance(damping, str)
    kinds: Any = () if damping is None else damping if several else (damping,)
    for one in kinds:
        if not isinstance(one, Rayleigh | EdgeDamping):
            raise StvkError(f"damping = {shown(one)}; expected Rayleigh(alpha=..., beta=...), EdgeDamping(tau), or a list of them.")
    rayleigh = [one for one in kinds if isinstance(one, Rayleigh)]
    edges = [one for one in kinds if isinstance(one, EdgeDamping)]
    sums = sum(r.alpha for r in rayleigh), sum(r.beta for r in rayleigh), sum(e.tau for e in edges)
    return DampingFactors(*map(float, sums))


def _not_negative(name: str, value: object, unit: str) -> float:
    return number(name, value, f"a number [{unit}], not negative", low=0.0, closed=True)
