"""Registration of a dataset: convert readings from a tracker's frame to the arm's base, and fit its targets.

Sizes on a KR 500 in 10 poses, with deflections of 6 mm and 40 um of noise: an uncertain rotation of the frame
changes a deflection by 1 um because of noise, and by 5 um (at most 12) because of joints off by 1 mm and 1
mrad; this is added to its covariance. Uncertain targets change it as much, through the tool's rotation of 4
mrad; this is not added. Neither covers deflection and errors of the arm that look like a rotation of the
frame: 0.1 deg by the arm's own weight, 0.2 deg by both.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from testbench.data.dataset import Dataset, Series, runs_of_station, select_rows, series_from_runs
from testbench.errors import Array, BenchError, Mask, check_type
from testbench.identify.equations import check_runs, resolve_line_readings
from testbench.identify.registration import (
    Frame,
    Registration,
    largest_deviation,
    median_tool_distance,
    register,
)
from testbench.model.vjm import Vjm, marker_positions, skew, tool_points

FrameChoice = Literal["auto", "base", "tracker"]
"""Frame in which a dataset was read; "auto" decides it from the readings."""

STATION_PREFIX = "station"
"""Prefix of the names of tracker frames; the number of the station follows."""
MAX_BASE_ROTATION, MAX_BASE_SHIFT = math.radians(0.5), 0.01
"""Rotation [rad] and translation [share of the arm's reach] below which a frame counts as the arm's base.

Readings in base axes of a heavy arm with `plant.disturbance.TYPICAL_DISTURBANCES` fit frames rotated by up to
0.35 deg and moved by 15 mm at a reach of 2.5 m; without errors, by 0.13 deg and 4 mm because of own weight
(30 campaigns, KR 500).
"""
MAX_TARGET_SHIFT = 0.005
"""Distance of a target from its nominal position beyond which the fitted position replaces it, for readings
in base axes [m]. Own weight moves a target of an arm without errors by up to 2 mm."""
MAX_BASE_FRAME_DEVIATIONS = 3.0
"""Number of standard deviations that are added to the limits within which a frame counts as the base [1]."""
MAX_FRAME_ROTATION_DEVIATION = math.radians(1.0)
"""Standard deviation of a frame's rotation beyond which the frame counts as undetermined [rad]."""
MAX_NOMINAL_DISTANCE = 0.02
"""Median distance between readings and nominal arm, over the tool's distance from the base, beyond which the
readings are refused: they are of another arm or of other joint angles [1]."""


@dataclass(frozen=True)
class RegisteredDataset:
    """Hold a dataset in base axes, and the arm with the positions of its targets on the tool."""

    vjm: Vjm  #: The arm; fitted positions of targets replace nominal ones.
    data: Dataset  #: The readings in base axes.
    #: Fitted frames and targets; None if they could not be fitted, or readings are along lines.
    registration: Registration | None
    frame: Literal["base", "tracker"]  #: Frame in which the readings were given.
    is_fitted_target: Mask  #: Whether a target's fitted position replaces the nominal one, (m,).
    failure: str = ""  #: Why there is no registration.


def register_dataset(
    vjm: Vjm, data: Dataset, frame: FrameChoice | Mapping[str, Frame] = "auto"
) -> RegisteredDataset:
    """Convert a dataset to base axes: fit the frames of the tracker's stations to the unloaded readings.

    Readings that are in base axes already stay as they are. Targets of the arm stay nominal where these agree
    with the readings.

    Args:
        vjm: The arm's virtual joint model.
        data: The dataset.
        frame: "base" or "tracker": frame of the readings; "auto" to decide this from the readings; or the
            known frames of the stations by name.

    Returns:
        The dataset in base axes, the arm with its targets, and the fit.

    Raises:
        BenchError: When an argument has another type, or a frame or a target cannot be fitted but must be.
    """
    check_type(vjm, Vjm, "vjm")
    check_type(data, Dataset, "data")
    check_runs(vjm, data)
    # Directions and fixed points are in base axes: nothing is registered.
    if data.is_line_reading.any():
        if frame not in ("auto", "base"):
            raise BenchError(
                "frame: expected auto or base, because directions of gauges and distances are in base axes"
            )
        none = np.zeros(len(data.markers), dtype=bool)
        why = "directions of gauges and distances are in base axes"
        return RegisteredDataset(
            vjm, resolve_line_readings(vjm, _at_markers(vjm, data)), None, "base", none, why
        )
    # Fit frames and targets to the unloaded readings; readings in base axes keep their frame.
    series, nominal = unloaded_series(data), dict(zip(vjm.arm.markers, vjm.markers, strict=True))
    base = {readings.frame: Frame(np.eye(3), np.zeros(3)) for readings in series}
    try:
        given = base if frame == "base" else {} if isinstance(frame, str) else frame
        registration = register(vjm, series, nominal, given)
        far = median_tool_distance(vjm, data.q)
        if frame == "auto" and registration.median_distance > MAX_NOMINAL_DISTANCE * far:
            fit = f"({1e3 * registration.rms_distance:.3g} mm RMS)"
            raise BenchError(f"the unloaded readings do not fit the arm in any frame {fit}")
        if frame == "auto" and all(
            _is_base(readings, registration.frames[readings.frame], far) for readings in series
        ):
            frame, registration = "base", register(vjm, series, nominal, base)
    except BenchError as why:
        if frame not in ("auto", "base") or not set(data.markers) <= set(vjm.arm.markers):
            raise
        return RegisteredDataset(vjm, data, None, "base", np.zeros(len(data.markers), dtype=bool), str(why))
    # Fitted targets replace nominal ones; in base axes only those that are far off.
    taken = np.ones(len(registration.target_names), dtype=bool)
    if frame == "base":
        taken = ~(
            np.linalg.norm(registration.targets - registration.nominal_targets, axis=1) <= MAX_TARGET_SHIFT
        )
    else:
        _check_known(registration)
        data = transform_to_base(registration, data)
    places = {name: registration.targets[k] for k, name in enumerate(registration.target_names) if taken[k]}
    model = with_markers(vjm, places) if places else vjm
    return RegisteredDataset(model, data, registration, "base" if frame == "base" else "tracker", taken)


def _at_markers(vjm: Vjm, data: Dataset) -> Dataset:
    """Shift readings along lines to the markers of the rigid arm; their differences are unchanged."""
    start = tool_points(vjm, data.q, marker_positions(vjm, data.markers))
    lines = data.is_line_reading[..., None]
    before = np.where(lines, start, data.before)
    return replace(data, before=before, after=np.where(lines, start + data.deflection, data.after))


def unloaded_series(data: Dataset) -> tuple[Series, ...]:
    """Return the readings without load of a dataset, one series per station of the tracker."""
    every = (
        select_rows(series, np.arange(series.n_rows // 2))
        for series in series_from_runs(data, STATION_PREFIX, "tool")
    )
    return tuple(series for series in every if series.is_measured.any())


def _is_base(series: Series, frame: Frame, reach: float) -> bool:
    """Tell whether a frame is the base up to errors of the arm, or cannot be distinguished from it."""
    y = series.position[series.is_measured]
    x = (y - frame.translation) @ frame.rotation
    at_targets = np.hstack([-frame.rotation @ skew(x.mean(axis=0)), np.eye(3)])
    turn, shift = frame.rotation_deviation, largest_deviation(at_targets @ frame.covariance @ at_targets.T)
    moved = float(np.median(np.linalg.norm(y - x, axis=1)))
    return (
        frame.rotation_angle < MAX_BASE_ROTATION + MAX_BASE_FRAME_DEVIATIONS * turn
        and moved < MAX_BASE_SHIFT * reach + MAX_BASE_FRAME_DEVIATIONS * shift
    )


def _check_known(registration: Registration) -> None:
    for name, frame in registration.frames.items():
        if frame.rotation_deviation > MAX_FRAME_ROTATION_DEVIATION:
            degrees = f"{math.degrees(frame.rotation_deviation):.1f} deg"
            raise BenchError(
                f"registration: the frame of {name} is uncertain by {degrees}; "
                "expected more poses, over more joints, or the frame itself"
            )


def with_markers(vjm: Vjm, positions: Mapping[str, Array]) -> Vjm:
    """Return the arm with markers at given positions in the tool's frame; new names add markers.

    Args:
        vjm: The arm's virtual joint model.
        positions: Position in the tool's frame by name of the marker, (3,) [m] each.
    """
    have = dict(zip(vjm.arm.markers, vjm.markers, strict=True)) | dict(positions)
    return replace(vjm, arm=replace(vjm.arm, markers=tuple(have)), markers=np.array(list(have.values())))


def transform_to_base(registration: Registration, data: Dataset) -> Dataset:
    """Convert readings from the frames of the tracker's stations to base axes.

    The uncertainty of a frame's rotation is added to the covariance of every deflection, as if it were
    independent from run to run.

    Args:
        registration: The fitted frames.
        data: The readings in the frames of their stations.
    """
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    R, t = np.tile(np.eye(3), (data.n_runs, 1, 1)), np.zeros((data.n_runs, 1, 3))
    about = np.zeros((data.n_runs, 1, 3, 3))  # covariance of the rotation of every run's frame, base axes
    for name, frame in registration.frames.items():
        of_station = runs_of_station(data, station_number(name))
        R[of_station] = frame.rotation
        t[of_station] = frame.translation
        about[of_station] = frame.covariance[:3, :3]
    before, after = ((readings - t) @ R for readings in (data.before, data.after))
    turned = [
        r if r is None else (Rotation.from_matrix(R).inv() * Rotation.from_rotvec(r)).as_rotvec()
        for r in (data.rotation_before, data.rotation_after)
    ]
    across = np.cross(np.eye(3), (after - before)[:, :, None]).swapaxes(2, 3)  # e_a x d
    C = R.swapaxes(1, 2)[:, None] @ data.covariance @ R[:, None] + across @ about @ across.swapaxes(2, 3)
    return replace(
        data,
        before=before,
        after=after,
        rotation_before=turned[0],
        rotation_after=turned[1],
        precision=np.where(data.is_measured[..., None, None], np.linalg.inv((C + C.swapaxes(2, 3)) / 2), 0.0),
    )


def station_number(name: str) -> int:
    """Return the number of a tracker's station from the name of its frame, such as 2 for "station 2"."""
    return int(name.removeprefix(STATION_PREFIX))
