"""Absolute readings as arrays: targets on the tool in a tracker's frame, one pose and load per row."""

from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset, Shapes, check_rows, in_order, read_by
from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, Mask, check_array


@dataclass(frozen=True, repr=False)
class Series(Displayed):
    """Hold the readings of one station of a tracker on one arm.

    Frame and target are names: series that share a name share the unknown frame or mount. Rows of one `pose`
    are readings without a move in between, such as unloaded and loaded: the model error there is common to
    them.
    """

    name: str  #: Name in reports, such as the file's name.
    markers: tuple[str, ...]  #: Names of the targets, m of them.
    frame: str  #: Name of the tracker's frame.
    target: str  #: Name of the mount that holds the targets to the tool.
    row: Ids  #: Identifier of every row, such as its line in the file, (rows,).
    pose: Ids  #: Identifier of the pose of every row, (rows,).
    q: Array  #: Actuated joints, commanded or read, (rows, n) [rad, m].
    wrench: Array  #: Load in addition to own weight, force and moment, world axes, (rows, 6) [N, N m].
    point: Array  #: Point where the load acts, in the tool's frame, (rows, 3) [m].
    position: Array  #: Targets in the tracker's frame, (rows, m, 3) [m]; zero for lost ones.
    sigma: float  #: Standard deviation of one position reading along one axis [m].
    #: Inverse covariance of every position, the tracker's axes, (rows, m, 3, 3) [1/m^2]; zero where the
    #: target was lost. None where sigma holds for all.
    precision: Array | None = None
    #: Orientation of a target that has one, the tracker from the target, (rows, 3, 3); None if not read, all
    #: NaN in rows where it was lost.
    rotation: Array | None = None
    sigma_rotation: float | None = None  #: Standard deviation of an orientation about an axis [rad].
    torque: Array | None = None  #: Torques of the actuated joints, (rows, n) [N m, N].
    temperature: Array | None = None  #: Temperature, (rows,) [degree Celsius].
    time: Array | None = None  #: Time from any start, (rows,) [s].
    #: Name and unit of every joint's column in the file that it was read from, in the arm's order.
    joints: tuple[tuple[str, str], ...] = ()

    def about(self) -> dict[str, object]:
        """Summarise the series: rows, poses, targets, frame, mount and noise."""
        return {
            "name": self.name,
            "rows": len(self.row),
            "poses": len(np.unique(self.pose)),
            "targets": " ".join(self.markers),
            "frame": self.frame,
            "mount": self.target,
            "orientations": self.rotation is not None,
            "sigma_um": f"{1e6 * self.sigma:g}",
        }

    def __post_init__(self) -> None:
        """Refuse wrong shapes and identifiers, and what is not finite, by BenchError."""
        rows, m = len(self.row), len(self.markers)
        if (self.rotation is None) != (self.sigma_rotation is None):
            raise BenchError("orientations: expected rotation and sigma together, or none")
        own: Shapes = {"position [m]": (rows, m, 3), "temperature": (rows,), "time": (rows,)}
        own["torque [N m, N]"] = np.shape(self.q)
        check_rows(self, rows, ("row", "pose"), own)
        if self.rotation is not None:
            if self.rotation.shape != (rows, 3, 3):
                raise BenchError(f"rotation: expected shape {(rows, 3, 3)}, got {self.rotation.shape}")
            check_array(self.rotation[self.turned], (None, 3, 3), "rotation")

    @property
    def rows(self) -> int:
        """Count the rows."""
        return len(self.row)

    @property
    def seen(self) -> Mask:
        """Tell which targets were read, (rows, m)."""
        if self.precision is None:
            return np.ones((self.rows, len(self.markers)), dtype=bool)
        return np.asarray(self.precision.any(axis=(2, 3)))

    @property
    def turned(self) -> Mask:
        """Tell in which rows an orientation was read, (rows,)."""
        if self.rotation is None:
            return np.zeros(self.rows, dtype=bool)
        return np.asarray(np.isfinite(self.rotation).all(axis=(1, 2)))


select_rows = in_order  #: The rows of a mask, or of their places, (rows,).


def series_of(data: Dataset, name: str, target: str) -> tuple[Series, ...]:
    """Convert deflection pairs to absolute readings: two rows per run, one pose; one series per station.

    Args:
        data: The pairs; their orientations are carried over.
        name: First part of every frame's name; the number of the station follows.
        target: Name of the mount.

    Returns:
        The series.
    """
    stations = [1] if data.station is None else np.unique(data.station).tolist()
    every = [(station, in_order(data, read_by(data, station))) for station in stations]
    return tuple(_both(own, name, f"{name} {station}", target) for station, own in every)


def _both(data: Dataset, name: str, frame: str, target: str) -> Series:
    """Combine the unloaded and then the loaded readings of some runs."""
    rotation, both = None, in_order(data, np.tile(np.arange(data.runs), 2))
    placed = (data.seen & ~data.lines)[..., None]  # a reading along a line is no position
    P = both.precision
    if P is not None and both.direction is not None:
        P = P * ~both.lines[..., None, None]
    if data.rotation_before is not None and data.rotation_after is not None:
        from scipy.spatial.transform import Rotation  # here: it takes long to import

        turns = np.concatenate([data.rotation_before, data.rotation_after])
        rotation = Rotation.from_rotvec(turns).as_matrix()
    return Series(
        name=name,
        markers=data.markers,
        frame=frame,
        target=target,
        row=both.run,
        pose=np.concatenate([np.arange(data.runs)] * 2),
        q=both.q,
        wrench=np.concatenate([np.zeros((data.runs, 6)), data.wrench]),
        point=both.point,
        position=np.concatenate([own * placed for own in (data.before, data.after)]),
        sigma=data.sigma,
        precision=None if P is None else 2 * P,  # that is of a deflection
        rotation=rotation,
        sigma_rotation=data.sigma_rotation,
    )
