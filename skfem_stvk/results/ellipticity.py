"""Strong ellipticity: a plane wave `a cos(N . X - w t)` has `rho w^2 = a . Q(N) a > 0`, with the acoustic tensor

    Q(N) = (N . S N) I + F [N . C . N] F' + psi'' n n'        [N . C . N]_MN = C_MJNL N_J N_L        n = cof F N

The last term is that of `VolumePenalty`. Where strong ellipticity is lost, results depend on the mesh, however fine it is.
"""

import numpy as np

from ..arguments import Array
from ..terms.laws.response_at_points import embedded
from ..terms.laws.volume_penalty import ENERGIES
from .law_on_elements import adjugate, dilation, elasticity
from .response import Masked, Response

#: Number of nets of directions, and of directions in each; number of steps from the best of each net, and the longest step [rad].
NETS, DIRECTIONS, STEPS, LONGEST = 3, 60, 30, 0.3


def smallest_acoustic_eigenvalue(state: Response) -> Masked:
    """Return the smallest eigenvalue (nt,) [Pa] of `Q(N)` over all unit `N`. Strong ellipticity is lost where it is not positive.

    The best of sampled directions are improved by gradient steps (Barzilai, Borwein, 1988). An isotropic solid at rest has `mu`.
    Elements in no term or in another law than StVK are masked, and membranes and cables in space, which wrinkle when compressed.
    """
    fields, lowest, tiny = state.fields, np.full(state.fields.mesh.nt, np.inf), np.finfo(float).tiny
    masked = fields.without_term | (fields.mesh.k < fields.mesh.d)
    for part in fields.parts:
        masked[part.elements] |= part.law.has_response or part.law.small_strain
    form = acoustic_form(state) if not masked.all() else np.zeros((len(lowest), 1, 1, 1, 1))
    for directions in np.random.default_rng(0).standard_normal((NETS, DIRECTIONS, form.shape[1])):
        N = directions[np.argmin([np.linalg.eigvalsh(form @ N @ N)[:, 0] / (N @ N) for N in directions], axis=0)]
        before = slope_before = np.zeros_like(N)
        for _ in range(STEPS):
            N = N / np.linalg.norm(N, axis=1, keepdims=True)
            along = form @ N[:, None, None, :, None]
            q, a = np.linalg.eigh((along.swapaxes(3, 4) @ N[:, None, None, :, None])[..., 0, 0])
            slope = np.einsum("nikJ,ni,nk->nJ", along[..., 0], a[:, :, 0], a[:, :, 0]) - q[:, :1] * N
            turn = np.abs(((N - before) * (slope - slope_before)).sum(axis=1))
            step = ((N - before) ** 2).sum(axis=1) / np.maximum(turn, tiny)
            step = np.minimum(step, LONGEST / np.maximum(np.linalg.norm(slope, axis=1), tiny))
            lowest, before, slope_before, N = np.minimum(lowest, q[:, 0]), N, slope, N - step[:, None] * slope
    return lowest, masked


def acoustic_form(state: Response) -> Array:
    """Return the form (nt, k, k, k, k) of elements that fill their space, with `Q_ik = form_ikJL N_J N_L`."""
    fields, k = state.fields, state.fields.mesh.k
    C, F = np.zeros((fields.mesh.nt, k, k, k, k)), np.eye(3) + embedded(state.gradient)
    for part in fields.parts:
        share = (part.section / fields.section[part.elements])[:, None, None, None, None]
        C[part.elements] += share * elasticity(part.law.material, part.hypothesis, state.point.frames[part.elements], k)
    cofactors, F = np.swapaxes(adjugate(F), 1, 2)[:, :k, :k], F[:, :k, :k]
    form = np.einsum("niM,nMJNL,nkN->nikJL", F, C, F, optimize=True)
    form += np.einsum("ik,nJLMN,nMN->nikJL", np.eye(k), C, state.strain[:, :k, :k], optimize=True)
    for penalty in fields.volume_parts:
        n, e = cofactors[penalty.elements], dilation(state.gradient[penalty.elements])
        psi = penalty.stiffness * ENERGIES[penalty.term.kind].curvature(e)
        form[penalty.elements] += np.einsum("n,niJ,nkL->nikJL", psi, n, n)
    return np.asarray((form + np.swapaxes(form, 3, 4)) / 2)
