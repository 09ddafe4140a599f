"""Registration: the base in every station's frame and the targets on the tool, from unloaded readings alone.

The closed forms of `frames` are refined together by Gauss-Newton on

    sum_rk rho(|W_rk (p_rk - R_s (R_r m_k + p_r) - t_s)|) + sum_k |m_k - nominal_k|^2 / ROUGH^2

with Huber's rho and the weight W_rk^-2 = C_rk + s^2 I. C_rk is the reading's covariance. s is the noise that
the residuals show beyond it: the arm's geometric errors and its own sag. It is estimated with the rest, by
Huber's proposal 2.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset, Mask
from testbench.errors import Array, BenchError
from testbench.identify.frames import Found, Unloaded, points, starts, unloaded
from testbench.identify.weighed import check_runs
from testbench.model.vjm import Vjm

ROUGH = 0.02
"""Standard deviation of a nominal target position along each axis [m]."""
BEND = 3.0
"""Length of a residual, in standard deviations, beyond which a reading pulls no harder: 3 % of sound ones."""
MEAN_SQUARE = 2.936
"""Mean of min(|z|, BEND)^2 of normal 3-vectors z."""
ASSUMED = 1e-3  #: Noise by geometric errors where the readings cannot tell [m].
SPARE = 6  #: Fewer equations beyond the unknowns tell nothing of the noise.
STEP = 1e-9  #: A Gauss-Newton step below this is the last [m, rad].
MOST_STEPS = 200
NEAR, FAR_STEPS = 1e-4, 60
"""After a step below NEAR [m, rad], or so many, wild readings are dropped and the noise is estimated too.

Before, residuals are those of the start: they would let nominal targets and wild readings win.
"""
FAR = 10.0
"""Length of a residual over the median, or over ASSUMED if that is more, beyond which a reading is dropped."""
BISECTIONS = 80
TURNED = 1e-3  #: A joint that moves less stands still [rad, m].
POSES = 6  #: That fix one station and one target without a nominal position.
SINGULAR = 1e-11  #: Least eigenvalue of the scaled information; below it a direction is not seen at all.


@dataclass(frozen=True)
class Frame:
    """The base in the frame of one station: a reading is rotation @ x + translation, x in base axes."""

    station: int  #: Identifier of the station.
    rotation: Array  #: Station from base, (3, 3).
    translation: Array  #: Base in the station's frame, (3,) [m].
    #: Covariance of a small rotation about the base's axes, R exp(phi), and of the translation, (6, 6)
    #: [rad, m]; zero for a frame that was given.
    covariance: Array


@dataclass(frozen=True)
class Registration:
    """What the unloaded readings say of frames and targets."""

    frames: tuple[Frame, ...]  #: One a station, in order of their identifiers.
    markers: tuple[str, ...]  #: Names of the targets.
    targets: Array  #: Their positions in the tool's frame, (m, 3) [m].
    nominal: Array  #: Where the arm's folder has them, (m, 3) [m]; NaN for a target that it lacks.
    covariance: Array  #: Of rotation and translation of every frame not given, then of all targets [rad, m].
    readings: int  #: Targets read, once a pose.
    rms: float  #: RMS distance of readings from where arm, frames and targets have them [m].
    typical: float  #: Median of these distances [m].
    noise: float  #: s: standard deviation along an axis beyond the tracker's [m].
    wild: int  #: Readings that pull less or not at all, as they are more than BEND standard deviations off.

    @property
    def target_deviations(self) -> Array:
        """Standard deviation of every target along the tool's axes, (m, 3) [m]."""
        own = np.diag(self.covariance)[len(self.covariance) - self.targets.size :]
        return np.asarray(np.sqrt(own).reshape(-1, 3))


def register(vjm: Vjm, data: Dataset, given: tuple[Frame, ...] = ()) -> Registration:
    """Frames of all stations and positions of all targets.

    Args:
        vjm: The arm; a target that it lacks has no nominal position.
        data: The runs; only the unloaded readings are used.
        given: Frames that are known; those of other stations are found.

    Raises:
        BenchError: When the readings leave a frame or target open, or no solution was found.
    """
    check_runs(vjm, data)
    names, nominal = station_names(data), nominal_targets(vjm, data.markers)
    known = Found(np.full((len(names), 3, 3), np.nan), np.full((len(names), 3), np.nan), nominal)
    for frame in given:
        if frame.station not in names:
            raise BenchError(f"frame of station {frame.station}: the readings are of stations {names}")
        known.rotation[names.index(frame.station)] = frame.rotation
        known.translation[names.index(frame.station)] = frame.translation
    free, seen = np.isnan(known.translation[:, 0]), unloaded(vjm, data)
    tried = [_refine(seen, start, nominal, free) for start in starts(seen, known)]
    solved = [one for one in tried if one.status == "solved"]
    if not solved:
        raise BenchError(_unsolved(vjm, data, tried))
    best = min(solved, key=lambda one: float(np.median(one.distance)))
    return Registration(
        frames=tuple(_frames(names, free, best)),
        markers=data.markers,
        targets=best.found.targets,
        nominal=nominal,
        covariance=best.covariance,
        readings=len(seen.y),
        rms=float(np.sqrt(np.mean(best.distance**2))),
        typical=float(np.median(best.distance)),
        noise=best.noise,
        wild=best.wild,
    )


def station_names(data: Dataset) -> list[int]:
    """Identifiers of the stations in order; 1 where the data name none."""
    return [1] if data.station is None else [int(name) for name in np.unique(data.station)]


def _frames(names: list[int], free: Mask, solved: "_Solved") -> Iterator[Frame]:
    first = 0
    for k, name in enumerate(names):
        C = np.zeros((6, 6))
        if free[k]:
            C, first = solved.covariance[first : first + 6, first : first + 6], first + 6
        yield Frame(name, solved.found.rotation[k], solved.found.translation[k], C)


def _unsolved(vjm: Vjm, data: Dataset, tried: list["_Solved"]) -> str:
    """Why no registration was found, and what would help."""
    if any(one.status == "no convergence" for one in tried):
        return "registration: no convergence; a wrong unit, order of joints or sign of an angle?"
    turning = [
        j.name for j, size in zip(vjm.arm.joints, np.ptp(data.q, axis=0), strict=True) if size > TURNED
    ]
    return (
        f"registration: {len(np.unique(data.q, axis=0))} poses, in which {', '.join(turning) or 'no joint'} "
        f"turns, leave a frame or a target open; expected at least {POSES} poses that turn three joints, or "
        "nominal positions of all targets"
    )


def nominal_targets(vjm: Vjm, markers: tuple[str, ...]) -> Array:
    """Where the arm's folder has the targets, tool's frame, (m, 3) [m]; NaN for those that it lacks."""
    have = dict(zip(vjm.arm.markers, vjm.markers, strict=True))
    return np.array([have.get(name, np.full(3, np.nan)) for name in markers])


@dataclass(frozen=True)
class _Solved:
    """A minimum of the cost, or where the search for it ended."""

    found: Found
    covariance: Array  #: Of the free unknowns [rad, m].
    distance: Array  #: Of every reading from the model, (n,) [m].
    noise: float  #: s [m].
    wild: int  #: Readings that pull less.
    status: str  #: "solved", "open" or "no convergence".


def _refine(seen: Unloaded, found: Found, nominal: Array, free: Mask) -> _Solved:
    """Gauss-Newton from a start; "open" when readings and nominal targets leave a direction without bound."""
    column = np.concatenate([np.repeat(free, 6), np.ones(nominal.size, dtype=bool)])
    values, V = np.linalg.eigh(seen.covariance)
    noise, status, kept = ASSUMED, "no convergence", None
    for k in range(MOST_STEPS):
        e, J = _linearised(seen, found)
        root = V.swapaxes(1, 2) / np.sqrt(values + noise**2)[..., None]
        u, B = (root @ e[..., None])[..., 0], root @ J[:, :, column]
        pull = np.minimum(1, BEND / np.maximum(np.linalg.norm(u, axis=1), BEND))
        pull = pull if kept is None else pull * kept
        information = np.einsum("nxi,n,nxj->ij", B, pull, B, optimize=True)
        held, off = _nominal(nominal - found.targets, 6 * free.sum())
        P = _inverse(information + np.diag(held))
        if P is None:
            return _Solved(found, np.diag(held), e, noise, 0, "open")
        step = P @ (np.einsum("nxi,n,nx->i", B, pull, u, optimize=True) + held * off)
        found, before = _moved(found, free, step), noise
        if kept is None and (np.abs(step).max() < NEAR or k == FAR_STEPS):
            kept = _plausible(e)
        if kept is not None:
            spare = 3 * kept.sum() - float(np.sum(P * information))
            noise = _noise(np.einsum("nxk,nx->nk", V, e)[kept], values[kept], spare)
            if np.abs(step).max() < STEP and abs(noise - before) <= STEP:
                status = "solved"
                break
    return _Solved(found, P, np.linalg.norm(e, axis=1), noise, int((pull < 1).sum()), status)


def _plausible(residual: Array) -> Mask:
    """Readings that are not far off all others, by their residuals, (n, 3) [m]."""
    length = np.linalg.norm(residual, axis=1)
    return np.asarray(length <= FAR * max(float(np.median(length)), ASSUMED))


def _nominal(off: Array, frames: int) -> tuple[Array, Array]:
    """Weights of the nominal targets and their distances, of all unknowns: none of frames and new targets.

    Beyond BEND ROUGH a nominal position pulls no harder either: it is wrong, not rough.
    """
    length = np.linalg.norm(off, axis=1, keepdims=True) / ROUGH
    weight = np.where(np.isfinite(off), np.minimum(1, BEND / np.maximum(length, BEND)), 0) / ROUGH**2
    return tuple(np.concatenate([np.zeros(frames), part.ravel()]) for part in (weight, np.nan_to_num(off)))


def _linearised(seen: Unloaded, found: Found) -> tuple[Array, Array]:
    """Residuals, (n, 3) [m], and derivatives of the modelled readings by all unknowns, (n, 3, 6 s + 3 m)."""
    n, stations = len(seen.y), len(found.rotation)
    R, x = found.rotation[seen.station], points(seen, found.targets)
    J = np.zeros((n, 3, 6 * stations + found.targets.size))
    every = np.arange(n)
    turned = R @ np.cross(np.eye(3), x[:, None]).swapaxes(1, 2)
    moved = R @ seen.rotation
    for axis in range(3):
        J[every, :, 6 * seen.station + axis] = turned[:, :, axis]
        J[every, axis, 6 * seen.station + 3 + axis] = 1
        J[every, :, 6 * stations + 3 * seen.target + axis] = moved[:, :, axis]
    return seen.y - np.einsum("nxy,ny->nx", R, x) - found.translation[seen.station], J


def _moved(found: Found, free: Mask, step: Array) -> Found:
    """Frames turned about their own axes and shifted, targets shifted, by a step of the free unknowns."""
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    frames, targets = np.split(step, [6 * free.sum()])
    rotation, translation = found.rotation.copy(), found.translation.copy()
    rotation[free] = rotation[free] @ Rotation.from_rotvec(frames.reshape(-1, 6)[:, :3]).as_matrix()
    translation[free] += frames.reshape(-1, 6)[:, 3:]
    return Found(rotation, translation, found.targets + targets.reshape(-1, 3))


def _inverse(information: Array) -> Array | None:
    """Covariance of the unknowns; None where one of their directions is not seen."""
    size = np.sqrt(np.diag(information))
    if not size.all():
        return None
    values, V = np.linalg.eigh(information / np.outer(size, size))
    if values[0] < SINGULAR:
        return None
    return np.asarray(V / values @ V.T / np.outer(size, size))


def _noise(residual: Array, values: Array, spare: float) -> float:
    """Noise s by Huber's proposal 2 [m]: the mean of min(|u|, BEND)^2, u weighted, is what noise gives.

    Of residuals and variances along the readings' principal axes, (n, 3), and the equations to spare.
    """
    if spare < SPARE:
        return ASSUMED

    def excess(s: float) -> float:
        length = np.square(residual / np.sqrt(values + s**2)).sum(axis=1)
        return float(np.minimum(length, BEND**2).mean() - MEAN_SQUARE * spare / residual.size)

    low, high = 0.0, 10 * float(np.abs(residual).max())
    if excess(low) <= 0:
        return low
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return high
