"""Absolute readings of a true arm: what is measured, what trackers read, and the truth to judge by.

Arm, geometry, gears and springs are MuJoCo's; nothing here is shared with the model that is fitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from testbench.data.dataset import Dataset, Series, select_rows
from testbench.errors import Array, BenchError, Ids, Mask
from testbench.plant.build import Plant
from testbench.plant.disturbance import TYPICAL_DISTURBANCES, Disturbances, GearErrors
from testbench.plant.equilibrium import solve_equilibrium
from testbench.plant.tracker import (
    DistanceMeter,
    IsotropicTracker,
    LaserTracker,
    PlaneProbe,
    deflection_precision,
    place_faces,
    read_orientations,
    read_positions,
)
from testbench.plant.true_arms import disturb
from testbench.runs.rows import trial_rng
from testbench.workflows.campaign import LoadedPoses, poses_with_weight
from testbench.workflows.cell import Cell, clear_poses
from testbench.workflows.instruments import (
    Mounted,
    blocks_of,
    check_markers,
    distances_of,
    names_of,
    poses_on_planes,
    unit_normal,
)
from testbench.workflows.plan_input import Place

MAX_POSES = 20_000
Mass = Annotated[float, Field(ge=0, le=10_000)]

REAL_ARM = Disturbances(
    own_weight=True,
    geometry=TYPICAL_DISTURBANCES.geometry,
    joint_offset_sigma=TYPICAL_DISTURBANCES.joint_offset_sigma,
    gear_errors=GearErrors(),
)
"""What absolute readings show of an arm: own weight, typical errors of geometry and joint offsets, gears."""
NEAREST, FARTHEST = 1.5, 3.0  #: How far from the base a tracker stands, over the arm's reach [1].
LOWEST, HIGHEST = 0.8, 2.0  #: Its height over the base [m].
MOUNT = 2e-3, 5e-3
"""How far the mount of the targets is from where the arm's folder has it, standard deviations [m, rad]."""
OUTLIER_SIZE = 2e-3  #: How far outliers are off, in any direction [m].
TILT = 0.02  #: How far from upright it stands, about each horizontal axis, standard deviation [rad].


class AbsoluteCampaign(BaseModel):
    """Describe series of absolute readings of one true arm; each has its own poses."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)

    series: int = Field(default=1, ge=1, le=50)  #: Set-ups.
    poses: int = Field(default=200, ge=1, le=MAX_POSES)  #: Of each series.
    #: What hangs in a pose, one after the other, a row each [kg]; 0 for own weight alone.
    masses: tuple[Mass, ...] = Field(default=(0.0,), min_length=1)
    #: How many poses of a series see all the masses, the first of them only the others; None for all.
    loaded_poses: int | None = Field(default=None, ge=0)
    targets: int = Field(default=1, ge=1)  #: So many of the arm's markers are read.
    orientations: bool = False  #: Whether the orientation of the mount is read too.
    sigma: float = Field(default=50e-6, ge=1e-9, le=0.01)  #: Of one position along one axis [m].
    sigma_rotation: float = Field(default=50e-6, ge=1e-9, le=0.1)  #: Of one orientation about an axis [rad].
    noise: bool = True  #: Whether readings are noisy.
    #: Where the trackers stand, a series each and then from the first again [m]; None for anywhere around.
    trackers: tuple[Place, ...] | None = Field(default=None, min_length=1)
    share_frame: bool = False  #: Whether all series have one tracker that stays where it is.
    share_target: bool = False  #: Whether all series have one mount that stays on the tool.
    #: Scatter of every joint's angle from one approach of a pose to the next, standard deviation [rad, m].
    repeatability: float = Field(default=0.0, ge=0, le=0.01)
    outliers: float = Field(default=0.0, ge=0, le=0.5)  #: Share of positions that are outliers [1].
    disturbances: Disturbances = REAL_ARM  #: What the true arm does.

    @model_validator(mode="after")
    def _loads_differ(self) -> "AbsoluteCampaign":
        if len(set(self.masses)) < len(self.masses):
            raise BenchError(f"masses: expected different ones, got {self.masses}")
        return self


@dataclass(frozen=True)
class PlacedFrame:
    """Place a frame in another: x there = rotation @ x here + position."""

    rotation: Array  #: (3, 3).
    position: Array  #: (3,) [m].


@dataclass(frozen=True)
class Truth:
    """Hold the true arm and how it was measured."""

    arm: Plant  #: The arm that was measured.
    stations: tuple[PlacedFrame, ...]  #: The world in the tracker's frame, of every series.
    mounts: tuple[PlacedFrame, ...]  #: The mount of the targets in the tool's frame, of every series.
    markers: Array  #: Targets on their mount, (m, 3) [m].
    outliers: tuple[Mask, ...]  #: Which positions of every series are outliers, (rows, m).

    @property
    def C_theta(self) -> Array:
        """Return the true aggregated joint compliance, (n_theta, n_theta), Eq. (17)."""
        return self.arm.arm.C_theta

    @property
    def theta_0(self) -> Array:
        """Compute constants of the virtual joints that make up the true geometry, (n_theta,) [m, rad].

        Exact without loads: slides and hinges of a link, one after the other, take the next frame to where it
        truly is; a joint's is its offset. Deflections add to them to first order. Stations, mounts and gears
        are apart.
        """
        from scipy.spatial.transform import Rotation  # here: it takes long to import

        plant = self.arm
        names = [*(link.name for link in plant.arm.links[1:]), plant.arm.tool]
        parts = []
        for link, name, error in zip(plant.arm.links, names, plant.frame_errors, strict=True):
            frame = Rotation.from_quat(plant.model.body(name).quat, scalar_first=True)
            beam = Rotation.from_matrix(link.beam_axes).inv() * frame
            turn = beam * Rotation.from_rotvec(error[3:]) * beam.inv()
            parts += [link.beam_axes.T @ error[:3], turn.as_euler("XYZ")]
        return np.concatenate([*parts, plant.joint_offset])


def _seen(truth: Truth, series: int, tool: Array, rotation: Array) -> tuple[Array, Array]:
    """Targets and mount in the tracker's frame, of poses of the tool in the world."""
    station, mount = truth.stations[series], truth.mounts[series]
    turned = station.rotation @ rotation
    at = tool @ station.rotation.T + station.position
    on_tool = mount.position + truth.markers @ mount.rotation.T
    return at[:, None] + on_tool @ turned.swapaxes(1, 2), turned @ mount.rotation


def simulate_series(
    cell: Cell, absolute_campaign: AbsoluteCampaign | None = None, seed: int = 1, q: Array | None = None
) -> tuple[tuple[Series, ...], Truth]:
    """Draw an arm, set-ups and poses, settle the arm in each pose, and read its targets.

    A series does not depend on how many there are; what is switched off leaves all else as it was.

    Args:
        cell: The arm; its plant has the true compliances.
        absolute_campaign: What to measure; None for 200 poses of one target under own weight alone.
        seed: Root of all randomness.
        q: Poses of every series, (poses, n) [rad, m]; None for random ones that the arm can take.

    Returns:
        The series, and the truth.
    """
    absolute_campaign = AbsoluteCampaign() if absolute_campaign is None else absolute_campaign
    _check(cell, absolute_campaign)
    arm = disturb(cell.plant, absolute_campaign.disturbances, trial_rng(seed))
    chances = [trial_rng(seed, 1 + k).spawn(6) for k in range(absolute_campaign.series)]
    turn = _turns(absolute_campaign, absolute_campaign.poses if q is None else len(q))
    truth = Truth(
        arm=arm,
        stations=_of_all(
            [_station(cell, absolute_campaign, k, own[0]) for k, own in enumerate(chances)],
            absolute_campaign.share_frame,
        ),
        mounts=_of_all([_mount(own[1]) for own in chances], absolute_campaign.share_target),
        markers=cell.plant.model.body_pos[cell.plant.marker_bodies[: absolute_campaign.targets]],
        outliers=tuple(
            own[2].random((len(turn), absolute_campaign.targets)) < absolute_campaign.outliers
            for own in chances
        ),
    )
    found = []
    for k, (*_, strays, poses, scatter, noise) in enumerate(chances):
        here = clear_poses(cell, None, absolute_campaign.poses, poses) if q is None else q
        pose = np.cumsum(turn == 0) - 1
        rows = poses_with_weight(cell, here[pose], pose + 1, np.array(absolute_campaign.masses)[turn])
        off = absolute_campaign.repeatability * scatter.standard_normal(here.shape)
        position, rotation = _seen(truth, k, *_settled(arm, rows, turn, off[pose]))
        position = position + _off(truth.outliers[k], strays)
        clean = _series(cell, absolute_campaign, k, rows, (position, rotation))
        found.append(_noisy(clean, noise) if absolute_campaign.noise else clean)
    return tuple(found), truth


def simulate_distances(
    cell: Cell,
    absolute_campaign: AbsoluteCampaign,
    mounted: Sequence[Mounted],
    seed: int = 1,
    q: Array | None = None,
) -> tuple[tuple[Series, ...], Truth]:
    """Read the distances of markers from fixed points and planes, of the arm of `simulate_series`.

    Args:
        cell: The arm; its plant has the true compliances.
        absolute_campaign: What to measure: one series of all markers.
        mounted: Distance meters and plane probes, each of one marker.
        seed: Root of all randomness.
        q: Poses, (poses, n) [rad, m]; None for random ones that the arm can take, on the planes if there are
            some.

    Returns:
        A series per instrument, with one mount, and the truth.

    Raises:
        BenchError: When an instrument reads no distances, or the arm lacks its marker.
    """
    check_markers(cell, mounted)
    if any(own.fixed is None for own in mounted):
        raise BenchError("--instrument: expected ballbar, bar, wire or plane with --absolute")
    planes = [own for own in mounted if isinstance(own.instrument, PlaneProbe)]
    if q is None and planes:
        q = poses_on_planes(cell, planes, absolute_campaign.poses, trial_rng(seed, 4))
    every = {"noise": False, "targets": len(cell.arm.markers), "series": 1, "orientations": False}
    (exact,), truth = simulate_series(cell, absolute_campaign.model_copy(update=every), seed, q)
    [station], rng = truth.stations, trial_rng(seed, 3)
    world = (exact.position - station.position) @ station.rotation
    used = [name for name in cell.arm.markers if name in {own.marker for own in mounted}]
    bare = replace(exact, markers=tuple(used), position=np.zeros((exact.n_rows, len(used), 3)))
    found = []
    for own, face, name in zip(mounted, _true_faces(mounted, rng), names_of(mounted), strict=True):
        places = world[:, cell.arm.markers.index(own.marker)]
        series = distances_of(own, bare, _read_distances(own, face, places, exact.pose_id, rng))
        if own.direction is not None:  # beside a face nothing is read
            series = select_rows(series, np.asarray(series.is_measured.any(axis=1)))
        if not series.n_rows:
            raise BenchError(f"--instrument: no pose brings {own.marker} near {name}; expected poses on it")
        found.append(replace(series, name=name, frame=own.block or name))
    return tuple(found), truth


Face = tuple[Array, Array]  #: A point of a plane [m] and its unit normal [1], (3,) each.


def _true_faces(mounted: Sequence[Mounted], rng: np.random.Generator) -> list[Face | None]:
    """Place the faces of all planes, those of a block together; None for other instruments."""
    faces: list[Face | None] = [None] * len(mounted)
    for members in blocks_of(mounted):
        stated = [(np.asarray(mounted[k].fixed), unit_normal(mounted[k])) for k in members]
        probes = [own for k in members if isinstance(own := mounted[k].instrument, PlaneProbe)]
        shift, tilt = max(own.fixed_point_sigma for own in probes), max(own.tilt_sigma for own in probes)
        for k, face in zip(members, place_faces(stated, shift, tilt, rng), strict=True):
            faces[k] = face
    return faces


def _read_distances(
    own: Mounted, face: Face | None, places: Array, pose: Ids, rng: np.random.Generator
) -> Array:
    """Read one marker, at these places in the world, (rows, 3) [m], by one instrument of distances, (rows,).

    The face is that of a plane as it truly is.
    """
    assert own.fixed is not None
    if isinstance(own.instrument, PlaneProbe):
        assert face is not None
        return own.instrument.read_absolute(face, places, pose, rng)
    assert isinstance(own.instrument, DistanceMeter)
    return own.instrument.read_absolute(own.fixed, places, rng)


def _of_all(placed_frames: list[PlacedFrame], shared: bool) -> tuple[PlacedFrame, ...]:
    """One of every series; the first of all where it is shared."""
    return tuple(placed_frames[:1] * len(placed_frames) if shared else placed_frames)


def _station(
    cell: Cell, absolute_campaign: AbsoluteCampaign, k: int, rng: np.random.Generator
) -> PlacedFrame:
    """The world in the tracker's frame: facing anywhere, and never quite upright."""
    from scipy.spatial.transform import Rotation  # here: it takes long to import

    azimuth, heading = rng.uniform(-np.pi, np.pi, 2)
    distance, height = cell.vjm.reach * rng.uniform(NEAREST, FARTHEST), rng.uniform(LOWEST, HIGHEST)
    tilt = Rotation.from_rotvec([*(TILT * rng.standard_normal(2)), 0.0])
    around = np.array([distance * np.cos(azimuth), distance * np.sin(azimuth), height])
    place = cell.vjm.base_pose[:3, 3] + around
    if absolute_campaign.trackers is not None:
        place = np.array(absolute_campaign.trackers[k % len(absolute_campaign.trackers)])
    R = (tilt * Rotation.from_rotvec([0.0, 0.0, heading])).as_matrix()
    return PlacedFrame(R, -R @ place)


def _mount(rng: np.random.Generator) -> PlacedFrame:
    """The mount of the targets in the tool's frame."""
    from scipy.spatial.transform import Rotation  # here: it takes long to import

    shift, turn = (deviation * rng.standard_normal(3) for deviation in MOUNT)
    return PlacedFrame(Rotation.from_rotvec(turn).as_matrix(), shift)


def _check(cell: Cell, absolute_campaign: AbsoluteCampaign) -> None:
    have = cell.arm.markers
    if absolute_campaign.targets > len(have):
        raise BenchError(f"targets: expected at most {len(have)}, as {cell.arm.name} has {', '.join(have)}")
    if not cell.arm.joints:
        raise BenchError(f"{cell.arm.name}: expected an arm with joints")


def _turns(absolute_campaign: AbsoluteCampaign, poses: int) -> Ids:
    """Which of the masses hangs in every row, (rows,): pose by pose, those of a pose one after the other."""
    loaded = poses if absolute_campaign.loaded_poses is None else absolute_campaign.loaded_poses
    rows = np.where(np.arange(poses) < loaded, len(absolute_campaign.masses), 1)
    return np.asarray(np.arange(rows.sum()) - np.repeat(np.cumsum(rows) - rows, rows))


def _settled(arm: Plant, rows: LoadedPoses, turn: Ids, off: Array) -> tuple[Array, Array]:
    """The tool of every row at rest in the world; in a pose each load is hung on the arm as the last left it.

    A row has the `turn`-th load of its pose, its joints are `off` what is commanded, (rows, n) [rad, m].
    """
    tool = np.empty((len(turn), 3))
    rotation = np.empty((len(turn), 3, 3))
    rest = None
    for k in range(turn.max() + 1):
        own = np.flatnonzero(turn == k)  # poses of several loads come first
        before = None if rest is None else select_rows(rest, slice(len(own)))
        q = rows.q[own] + off[own]
        rest = solve_equilibrium(arm, q, rows.wrench[own], rows.point[own], equilibrium_before=before)
        tool[own], rotation[own] = rest.tool_positions, rest.tool_rotations
    return tool, rotation


def _off(outliers: Mask, rng: np.random.Generator) -> Array:
    """How far outliers are off, (rows, m, 3) [m]."""
    direction = rng.standard_normal((*outliers.shape, 3))
    direction *= OUTLIER_SIZE / np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.asarray(np.where(outliers[..., None], direction, 0.0))


def _series(
    cell: Cell, absolute_campaign: AbsoluteCampaign, k: int, rows: LoadedPoses, seen: tuple[Array, Array]
) -> Series:
    """A series without noise, of what the tracker sees."""
    position, rotation = seen
    return Series(
        name=f"series {k + 1}",
        markers=cell.arm.markers[: absolute_campaign.targets],
        frame=f"tracker {1 if absolute_campaign.share_frame else k + 1}",
        mount=f"mount {1 if absolute_campaign.share_target else k + 1}",
        row_id=np.arange(len(rows.q)) + 1,
        pose_id=rows.pose_id,
        q=rows.q,
        wrench=rows.wrench + 0.0,  # no load is 0, not -0
        point=rows.point,
        position=position,
        sigma=absolute_campaign.sigma,
        rotation=rotation if absolute_campaign.orientations else None,
        sigma_rotation=absolute_campaign.sigma_rotation if absolute_campaign.orientations else None,
    )


def _noisy(series: Series, rng: np.random.Generator) -> Series:
    """The series as the tracker reads it."""
    from scipy.spatial.transform import Rotation  # here: it takes long to import

    tracker = IsotropicTracker(series.sigma, series.sigma_rotation)
    read = replace(series, position=read_positions(tracker, series.position, rng))
    if series.rotation is None:
        return read
    turned = read_orientations(tracker, series.rotation, rng)
    return replace(read, rotation=Rotation.from_rotvec(turned).as_matrix())


def by_trackers(clean: Dataset, trackers: Sequence[Place], seed: int, sigma: float | None = None) -> Dataset:
    """Read an arm by trackers at several places in turn, one pose each.

    Positions are in the frame of the tracker that read them, which has its origin there, an upright z axis
    and any direction, with the covariance of every deflection; stations from 1 where there are several.

    Args:
        clean: Readings without noise, in world axes.
        trackers: Places of the trackers, (3,) each [m].
        seed: Root of all randomness.
        sigma: Standard deviation of a reading along an axis [m]; None for that of `clean`.

    Returns:
        Readings in the frames of the trackers.
    """
    from scipy.spatial.transform import Rotation  # here: it takes long to import

    pose = np.unique(clean.pose_id, return_inverse=True)[1].ravel()
    station = pose % len(trackers)
    rng, noise = trial_rng(seed, 2), trial_rng(seed, 1)
    before, after = np.empty_like(clean.before), np.empty_like(clean.after)
    for k, (place, angle) in enumerate(zip(trackers, rng.uniform(-np.pi, np.pi, len(trackers)), strict=True)):
        R = Rotation.from_rotvec([0.0, 0.0, -angle]).as_matrix()
        for own, true in ((before, clean.before), (after, clean.after)):
            own[station == k] = (true[station == k] - np.array(place)) @ R.T
    tracker = LaserTracker((0.0, 0.0, 0.0))
    instrument = tracker if sigma is None else IsotropicTracker(sigma)
    before, after = (read_positions(instrument, x, noise) for x in (before, after))
    P = None
    if sigma is None:
        P = deflection_precision(tracker, before, after)
        sigma = float(np.sqrt(np.trace(np.linalg.inv(P), axis1=2, axis2=3).mean() / 6))
    return replace(
        clean,
        before=before,
        after=after,
        sigma=sigma,
        precision=P,
        station=station + 1 if len(trackers) > 1 else None,
    )
