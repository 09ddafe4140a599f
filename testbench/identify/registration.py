"""Registration: the base in every station's frame and the targets on the tool, from unloaded readings alone.

The closed forms of `frames` are refined together by `refinement`.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset, Mask, read_by
from testbench.errors import Array, BenchError
from testbench.identify.frames import LEAST_POINTS, Found, points, starts, unloaded
from testbench.identify.refinement import Solved, refine
from testbench.identify.weighed import check_runs
from testbench.model.vjm import Vjm, skew

TURNED = 1e-3  #: A joint that moves less stands still [rad, m].
POSES = 6  #: That fix one station and one target without a nominal position.


@dataclass(frozen=True)
class Frame:
    """The arm's world in the frame of one station: a reading is rotation @ x + translation of x in it."""

    station: int  #: Identifier of the station.
    rotation: Array  #: Station from world, (3, 3).
    translation: Array  #: Origin of the world in the station's frame, (3,) [m].
    #: Covariance of a small rotation about the world's axes, R exp(phi), and of the translation, (6, 6)
    #: [rad, m]; zero for a frame that was given.
    covariance: Array

    def of(self, pose: Array) -> "Frame":
        """What has this pose in the world, (4, 4) [m], as the arm's base, in the frame of the station."""
        turn, place = pose[:3, :3], pose[:3, 3]
        J = np.eye(6)
        J[:3, :3], J[3:, :3] = turn.T, -self.rotation @ skew(place)
        return Frame(
            station=self.station,
            rotation=self.rotation @ turn,
            translation=self.rotation @ place + self.translation,
            covariance=J @ self.covariance @ J.T,
        )

    @property
    def angle(self) -> float:
        """Size of the rotation [rad]."""
        return float(np.linalg.norm(self.rotation_vector))

    @property
    def rotation_vector(self) -> Array:
        """The rotation, (3,) [rad]."""
        from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

        return np.asarray(Rotation.from_matrix(self.rotation).as_rotvec())

    @property
    def deviation(self) -> float:
        """Largest standard deviation of the rotation about any axis [rad]."""
        return spread(self.covariance[:3, :3])


@dataclass(frozen=True)
class Registration:
    """What the unloaded readings say of frames and targets."""

    frames: tuple[Frame, ...]  #: One a station, in order of their identifiers.
    markers: tuple[str, ...]  #: Names of the targets.
    targets: Array  #: Their positions in the tool's frame, (m, 3) [m].
    nominal: Array  #: Where the arm's folder has them, (m, 3) [m]; NaN for a target that it lacks.
    covariance: Array  #: Of rotation and translation of every frame not given, then of all targets [rad, m].
    reach: float  #: Median distance of the targets from the arm's base [m].
    readings: int  #: Targets read, once a pose.
    rms: float  #: RMS distance of readings from where arm, frames and targets have them [m].
    typical: float  #: Median of these distances [m].
    noise: float  #: s: standard deviation along an axis beyond the tracker's [m].
    wild: int  #: Readings that pull less or not at all, as they are more than a bend off.

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
    tried = [refine(seen, start, nominal, free) for start in starts(seen, known)]
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
        reach=float(np.median(np.linalg.norm(points(seen, best.found.targets) - vjm.base[:3, 3], axis=1))),
        readings=len(seen.y),
        rms=float(np.sqrt(np.mean(best.distance**2))),
        typical=float(np.median(best.distance)),
        noise=best.noise,
        wild=best.wild,
    )


def spread(covariance: Array) -> float:
    """Largest standard deviation along any direction, of a covariance, (n, n)."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0)))


def station_names(data: Dataset) -> list[int]:
    """Identifiers of the stations that read anything, in order; 1 where the data name none."""
    if data.station is None:
        return [1]
    return [int(name) for name in np.unique(data.station[data.seen.any(axis=1)])]


def _frames(names: list[int], free: Mask, solved: Solved) -> Iterator[Frame]:
    first = 0
    for k, name in enumerate(names):
        C = np.zeros((6, 6))
        if free[k]:
            C, first = solved.covariance[first : first + 6, first : first + 6], first + 6
        yield Frame(name, solved.found.rotation[k], solved.found.translation[k], C)


def _unsolved(vjm: Vjm, data: Dataset, tried: list[Solved]) -> str:
    """Why no registration was found, and what would help."""
    if any(one.status == "no convergence" for one in tried):
        return "registration: no convergence; a wrong unit, order of joints or sign of an angle?"
    for name in station_names(data):
        own = data.seen[read_by(data, name)]
        if own.sum() < LEAST_POINTS:
            return f"registration: station {name} read {own.sum()} targets; expected at least {LEAST_POINTS}"
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
