"""Absolute readings of a true arm: what trackers read of it, and the truth to judge a calibration by.

Arm, geometry, gears and springs are MuJoCo's; nothing here is shared with the model that is fitted.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from testbench.bench.absolute_settings import AbsoluteCampaign
from testbench.bench.campaign import Cell, LoadedPoses, clear_poses, hanging, stream
from testbench.bench.set_ups import Frame, draw_mounts, draw_stations
from testbench.data.dataset import Ids, Mask
from testbench.data.series import Series
from testbench.data.tracker import Tracker, read_orientations, read_positions
from testbench.errors import Array, BenchError
from testbench.plant import DisturbedPlant, Gears, disturb, part_of, settle_disturbed


@dataclass(frozen=True)
class Truth:
    """The true arm and how it was looked at."""

    arm: DisturbedPlant  #: The arm that was measured.
    stations: tuple[Frame, ...]  #: The world in the tracker's frame, of every series.
    mounts: tuple[Frame, ...]  #: The mount of the targets in the tool's frame, of every series.
    markers: Array  #: Targets on their mount, (m, 3) [m].
    outliers: tuple[Mask, ...]  #: Which positions of every series are outliers, (rows, m).

    @property
    def C_theta(self) -> Array:
        """True aggregated joint compliance, (n_theta, n_theta), Eq. (17)."""
        return self.arm.plant.arm.C_theta

    @property
    def gears(self) -> Gears | None:
        """Joint errors that depend on the pose."""
        return self.arm.gears

    @property
    def theta_0(self) -> Array:
        """Constants of the virtual joints that make up the true geometry, (n_theta,) [m, rad].

        Exact without loads: slides and hinges of a link, one after the other, take the next frame to where it
        truly is; a joint's is its offset. Deflections add to them to first order. Stations, mounts and gears
        are apart.
        """
        plant = self.arm.plant
        names = [*(link.name for link in plant.arm.links[1:]), plant.arm.tool]
        parts = []
        for link, name, error in zip(plant.arm.links, names, self.arm.frames, strict=True):
            frame = Rotation.from_quat(plant.model.body(name).quat, scalar_first=True)
            beam = Rotation.from_matrix(link.frame).inv() * frame
            turn = beam * Rotation.from_rotvec(error[3:]) * beam.inv()
            parts += [link.frame.T @ error[:3], turn.as_euler("XYZ")]
        return np.concatenate([*parts, self.arm.offset])


def true_poses(
    truth: Truth, series: int, q: Array, wrench: Array | None = None, point: Array | None = None
) -> tuple[Array, Array]:
    """Where targets truly are in any poses, as the tracker of a series would see them without noise.

    Args:
        truth: The arm.
        series: Index of the series.
        q: Commanded joints, (rows, n) [rad, m].
        wrench: Load beside own weight, world axes, (rows, 6) [N, N m]; None for none.
        point: Where it acts, in the tool's frame, (rows, 3) [m]; None for the tool's origin.

    Returns:
        Positions in the tracker's frame, (rows, m, 3) [m], and orientations of the mount, (rows, 3, 3).
    """
    rest = settle_disturbed(truth.arm, q, wrench, point)
    return _seen(truth, series, rest.tool, rest.rotation)


def _seen(truth: Truth, series: int, tool: Array, rotation: Array) -> tuple[Array, Array]:
    """Targets and mount in the tracker's frame, of poses of the tool in the world."""
    station, mount = truth.stations[series], truth.mounts[series]
    turned = station.rotation @ rotation
    at = tool @ station.rotation.T + station.position
    on_tool = mount.position + truth.markers @ mount.rotation.T
    return at[:, None] + on_tool @ turned.swapaxes(1, 2), turned @ mount.rotation


def simulate_series(
    cell: Cell, asked: AbsoluteCampaign | None = None, seed: int = 1, q: Array | None = None
) -> tuple[tuple[Series, ...], Truth]:
    """Draw an arm, set-ups and poses, settle the arm in each pose, and read its targets.

    A series does not depend on how many there are; what is switched off leaves all else as it was.

    Args:
        cell: The arm; its plant has the true compliances.
        asked: What to measure; None for 200 poses of one target under own weight alone.
        seed: Root of all randomness.
        q: Poses of every series, (poses, n) [rad, m]; None for random ones that the arm can take.

    Returns:
        The readings, and the truth behind them.

    Raises:
        BenchError: When the arm has no joints, or fewer markers than targets are asked for.
        PoseError: When too few feasible poses exist.
        NoEquilibrium: When the arm cannot carry a load.
    """
    asked = AbsoluteCampaign() if asked is None else asked
    _check(cell, asked)
    arm = disturb(cell.plant, asked.disturbances, stream(seed))
    chances = [stream(seed, 1 + k).spawn(6) for k in range(asked.series)]
    turn = _turns(asked, asked.poses if q is None else len(q))
    truth = Truth(
        arm=arm,
        stations=draw_stations(cell, asked, [own[0] for own in chances]),
        mounts=draw_mounts(cell.plant, asked, [own[1] for own in chances]),
        markers=cell.plant.model.body_pos[cell.plant.markers[: asked.targets]],
        outliers=tuple(own[2].random((len(turn), asked.targets)) < asked.outliers for own in chances),
    )
    found = []
    for k, (*_, strays, poses, scatter, noise) in enumerate(chances):
        here = clear_poses(cell, None, asked.poses, poses) if q is None else q
        pose = np.cumsum(turn == 0) - 1
        rows = hanging(cell, here[pose], pose + 1, np.array(asked.masses)[turn])
        off = asked.repeatability * scatter.standard_normal(here.shape)
        position, rotation = _seen(truth, k, *_settled(arm, rows, turn, off[pose]))
        position = position + _off(asked, truth.outliers[k], strays)
        clean = _series(cell, asked, k, rows, (position, rotation))
        found.append(_noisy(clean, noise) if asked.noise else clean)
    return tuple(found), truth


def _check(cell: Cell, asked: AbsoluteCampaign) -> None:
    have = cell.arm.markers
    if asked.targets > len(have):
        raise BenchError(f"targets: expected at most {len(have)}, as {cell.arm.name} has {', '.join(have)}")
    if not cell.arm.joints:
        raise BenchError(f"{cell.arm.name}: expected an arm with joints")


def _turns(asked: AbsoluteCampaign, poses: int) -> Ids:
    """Which of the masses hangs in every row, (rows,): pose by pose, those of a pose one after the other."""
    loaded = poses if asked.loaded_poses is None else asked.loaded_poses
    rows = np.where(np.arange(poses) < loaded, len(asked.masses), 1)
    return np.asarray(np.arange(rows.sum()) - np.repeat(np.cumsum(rows) - rows, rows))


def _settled(arm: DisturbedPlant, rows: LoadedPoses, turn: Ids, off: Array) -> tuple[Array, Array]:
    """The tool of every row at rest in the world; in a pose each load is hung on the arm as the last left it.

    Args:
        arm: The true arm.
        rows: What is commanded.
        turn: Which load of its pose a row has, (rows,).
        off: How far the joints are off what is commanded, (rows, n) [rad, m].
    """
    tool, rotation, rest = np.empty((len(turn), 3)), np.empty((len(turn), 3, 3)), None
    for k in range(turn.max() + 1):
        own = np.flatnonzero(turn == k)  # poses of several loads come first
        before = None if rest is None else part_of(rest, slice(len(own)))
        q = rows.q[own] + off[own]
        rest = settle_disturbed(arm, q, rows.wrench[own], rows.point[own], before=before)
        tool[own], rotation[own] = rest.tool, rest.rotation
    return tool, rotation


def _off(asked: AbsoluteCampaign, outliers: Mask, rng: np.random.Generator) -> Array:
    """How far outliers are off, (rows, m, 3) [m]."""
    direction = rng.standard_normal((*outliers.shape, 3))
    direction *= asked.outlier_size / np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.asarray(np.where(outliers[..., None], direction, 0.0))


def _series(
    cell: Cell, asked: AbsoluteCampaign, k: int, rows: LoadedPoses, seen: tuple[Array, Array]
) -> Series:
    """A series without noise, of what the tracker sees."""
    position, rotation = seen
    return Series(
        name=f"series {k + 1}",
        markers=cell.arm.markers[: asked.targets],
        frame=f"tracker {1 if asked.share_frame else k + 1}",
        target=f"mount {1 if asked.share_target else k + 1}",
        row=np.arange(len(rows.q)) + 1,
        pose=rows.pose,
        q=rows.q,
        wrench=rows.wrench + 0.0,  # no load is 0, not -0
        point=rows.point,
        position=position,
        sigma=asked.sigma,
        rotation=rotation if asked.orientations else None,
        sigma_rotation=asked.sigma_rotation if asked.orientations else None,
    )


def _noisy(series: Series, rng: np.random.Generator) -> Series:
    """The series as the tracker reads it."""
    tracker = Tracker(series.sigma, series.sigma_rotation)
    read = replace(series, position=read_positions(tracker, series.position, rng))
    if series.rotation is None:
        return read
    turned = read_orientations(tracker, series.rotation, rng)
    return replace(read, rotation=Rotation.from_rotvec(turned).as_matrix())
