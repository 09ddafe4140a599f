"""The refinement of a registration: frames and targets together, by Gauss-Newton.

It minimises

    sum_rk rho(|W_rk (p_rk - R_s (R_r m_k + p_r) - t_s)|) + sum_k rho(|m_k - nominal_k| / ROUGH)

with Huber's rho and the weight W_rk^-2 = C_rk + s^2 I. C_rk is the reading's covariance. s is the noise that
the residuals show beyond it: the arm's geometric errors and its own sag. It is estimated with the rest.
"""

from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Ids, Mask
from testbench.errors import Array
from testbench.identify.frames import Found, Unloaded, points
from testbench.identify.robust_loss import FRAMES

ROUGH = 0.02
"""Standard deviation of a nominal target position along each axis [m]."""
ASSUMED = 1e-3  #: Noise by geometric errors where the readings cannot tell [m].
SPARE = 6  #: Fewer equations beyond the unknowns tell nothing of the noise.
STEP = 1e-9  #: A Gauss-Newton step below this is the last [m, rad].
MOST_STEPS = 200
NEAR, FAR_STEPS = 1e-4, 60
"""After a step below NEAR [m, rad], or so many, wild readings are dropped and the noise is estimated too.

Before, residuals are those of the start: they would let nominal targets and wild readings win.
"""
FAR = 10.0
"""Length of a residual over the median, or over ASSUMED if that is more, beyond which it is dropped."""
SAME = 1e-6  #: Relative change of the noise that ends the search.
SINGULAR = 1e-11  #: Least eigenvalue of the scaled information; below it a direction is not seen at all.


@dataclass(frozen=True)
class Solved:
    """A minimum of the cost, or where the search for it ended."""

    found: Found
    covariance: Array  #: Of the free unknowns [rad, m].
    distance: Array  #: Of every reading from the model, (n,) [m].
    noise: float  #: s [m].
    wild: int  #: Readings that pull less.
    status: str  #: "solved", "open" or "no convergence".


def refine(seen: Unloaded, found: Found, nominal: Array, free: Mask) -> Solved:
    """Gauss-Newton from a start; "open" when readings and nominal targets leave a direction without bound."""
    column = np.concatenate([np.repeat(free, 6), np.ones(nominal.size, dtype=bool)])
    at = np.hstack([6 * seen.station[:, None] + np.arange(6), 3 * seen.target[:, None] + np.arange(3)])
    at[:, 6:] += 6 * len(free)
    values, V = np.linalg.eigh(seen.covariance)
    noise, status, kept = ASSUMED, "no convergence", None
    for k in range(MOST_STEPS):
        e, J = _linearised(seen, found)
        root = V.swapaxes(1, 2) / np.sqrt(values + noise**2)[..., None]
        u, B = (root @ e[..., None])[..., 0], root @ J
        counts = FRAMES.pull(np.linalg.norm(u, axis=1)) * (True if kept is None else kept)
        information, pulled = _summed(at, len(column), counts, u, B)
        information, pulled = information[np.ix_(column, column)], pulled[column]
        held, off = _nominal(nominal - found.targets, 6 * free.sum())
        P = _inverse(information + np.diag(held), 6 * free.sum())
        if P is None:
            return Solved(found, np.diag(held), np.linalg.norm(e, axis=1), noise, 0, "open")
        step = P @ (pulled + held * off)
        found, before = _moved(found, free, step), noise
        if kept is None and (np.abs(step).max() < NEAR or k == FAR_STEPS):
            kept = _plausible(e)
        if kept is not None:
            spare = 3 * kept.sum() - float(np.sum(P * information))
            along = np.einsum("nxk,nx->nk", V, e)[kept]
            noise = FRAMES.spread(along, values[kept], spare / along.size) if spare >= SPARE else ASSUMED
            if np.abs(step).max() < STEP and abs(noise - before) <= SAME * noise:
                status = "solved"
                break
    assert P is not None
    return Solved(found, P, np.linalg.norm(e, axis=1), noise, int((counts < 1).sum()), status)


def _plausible(residual: Array) -> Mask:
    """Readings that are not far off all others, by their residuals, (n, 3) [m]."""
    length = np.linalg.norm(residual, axis=1)
    return np.asarray(length <= FAR * max(float(np.median(length)), ASSUMED))


def _nominal(off: Array, frames: int) -> tuple[Array, Array]:
    """Weights of the nominal targets and their distances, of all unknowns: none of frames and new targets.

    Beyond the bend a nominal position pulls no harder either: it is wrong, not rough.
    """
    length = np.linalg.norm(off, axis=1, keepdims=True) / ROUGH
    weight = np.where(np.isfinite(off), FRAMES.pull(length), 0) / ROUGH**2
    none = np.zeros(frames)
    return np.concatenate([none, weight.ravel()]), np.concatenate([none, np.nan_to_num(off).ravel()])


def _linearised(seen: Unloaded, found: Found) -> tuple[Array, Array]:
    """Residuals, (n, 3) [m], and derivatives of modelled readings by their frame and target, (n, 3, 9)."""
    R, x = found.rotation[seen.station], points(seen, found.targets)
    turned = R @ np.cross(np.eye(3), x[:, None]).swapaxes(1, 2)
    shifted = np.broadcast_to(np.eye(3), R.shape)
    J = np.concatenate([turned, shifted, R @ seen.rotation], axis=2)
    return seen.y - np.einsum("nxy,ny->nx", R, x) - found.translation[seen.station], J


def _summed(at: Ids, size: int, pull: Array, u: Array, B: Array) -> tuple[Array, Array]:
    """Information, (size, size), and pull, (size,), of readings.

    Args:
        at: Where the unknowns of each are, those of its frame and of its target, (n, 9).
        size: How many unknowns there are.
        pull: Weights, (n,).
        u: Residuals, (n, 3) [standard deviations].
        B: Their derivatives, (n, 3, 9).
    """
    weighted = pull[:, None, None] * B.swapaxes(1, 2)
    information, pulled = np.zeros((size, size)), np.zeros(size)
    np.add.at(information, (at[:, :, None], at[:, None]), weighted @ B)
    np.add.at(pulled, at, (weighted @ u[..., None])[..., 0])
    return information, pulled


def _moved(found: Found, free: Mask, step: Array) -> Found:
    """Frames turned about their own axes and shifted, targets shifted, by a step of the free unknowns."""
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    frames, targets = np.split(step, [6 * free.sum()])
    rotation, translation = found.rotation.copy(), found.translation.copy()
    rotation[free] = rotation[free] @ Rotation.from_rotvec(frames.reshape(-1, 6)[:, :3]).as_matrix()
    translation[free] += frames.reshape(-1, 6)[:, 3:]
    return Found(rotation, translation, found.targets + targets.reshape(-1, 3))


def _inverse(information: Array, frames: int) -> Array | None:
    """Covariance of the unknowns, frames first; None where one of their directions is not seen.

    A target shares its readings with frames alone, so that its three numbers are left out by themselves.
    """
    size = np.sqrt(np.diag(information))
    if not size.all():
        return None
    scaled = information / np.outer(size, size)
    m = (len(size) - frames) // 3
    D = scaled[frames:, frames:].reshape(m, 3, m, 3)[np.arange(m), :, np.arange(m)]
    E = np.linalg.solve(D, scaled[frames:, :frames].reshape(m, 3, frames)).reshape(3 * m, frames)
    values, V = np.linalg.eigh(scaled[:frames, :frames] - scaled[:frames, frames:] @ E)
    if min(np.linalg.eigvalsh(D).min(), values.min(initial=1)) < SINGULAR:
        return None
    V = np.vstack([V, -E @ V])
    covariance = V / values @ V.T
    own = covariance[frames:, frames:].reshape(m, 3, m, 3)
    own[np.arange(m), :, np.arange(m)] += np.linalg.inv(D)
    return np.asarray(covariance / np.outer(size, size))
