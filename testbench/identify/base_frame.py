"""Runs converted to the base's frame from any tracker frame, and the model with its targets as measured.

Sizes on a KR 500 in 10 poses, with deflections of 6 mm and 40 um of noise: the uncertainty of the frame's
rotation changes a deflection by 1 um through noise, and by 5 um (at most 12) through joints off by 1 mm and 1
mrad; this is added to its covariance. The uncertainty of the targets changes it as much, through the tool's
rotation of 4 mrad; this is not added. Neither contains the part of the arm's sag and errors that resembles a
rotation of the frame: 0.1 deg by the arm's own weight, 0.2 deg by both.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from testbench.data.dataset import Dataset, Series, runs_of_station, select_rows, series_of
from testbench.errors import Array, BenchError, Mask, check_type
from testbench.identify.equations import check_runs, resolve_line_readings
from testbench.identify.registration import Frame, Registration, arm_reach, largest_deviation, register
from testbench.model.vjm import Vjm, marker_positions, skew, tool_points

FrameChoice = Literal["auto", "base", "tracker"]

STATION_PREFIX = "station"
"""Prefix of the names of frames; the number of the station follows."""
MAX_BASE_ROTATION, MAX_BASE_SHIFT = math.radians(0.5), 0.01
"""A frame nearer to the base than this is the base [rad, share of the arm's reach].

Readings in the base's frame seem turned by up to 0.35 deg and moved by 15 mm at 2.5 m, those of a heavy arm
with `plant.disturbance.TYPICAL` errors; without errors, by 0.13 deg and 4 mm by its own weight (30 campaigns,
KR 500).
"""
MAX_TARGET_SHIFT = 0.005
"""Distance from its nominal position beyond which a target of readings in the base's frame is fitted [m]. Own
weight moves a target of a sound arm by up to 2 mm; fitting targets costs nothing."""
BASE_FRAME_DEVIATIONS = 3.0
"""Standard deviations within which a frame may be the base."""
MAX_FRAME_ROTATION_DEVIATION = math.radians(1.0)
"""Standard deviation of a frame's rotation beyond which it is undetermined [rad]."""
MAX_NOMINAL_DISTANCE = 0.02
"""Median distance of readings from the nominal arm, over the tool's distance from its base, beyond which they
are of another arm or of other joint angles [1]."""


@dataclass(frozen=True)
class RegisteredDataset:
    """Hold runs in the base's frame, with the model whose targets fit them."""

    vjm: Vjm  #: The model, with targets where the readings have them.
    data: Dataset  #: The runs in the base's frame.
    registration: Registration | None  #: Result of the registration; None if it failed.
    frame: Literal["base", "tracker"]  #: Frame of the readings.
    is_fitted_target: Mask  #: Targets that were fitted, (m,).
    failure: str = ""  #: Why the registration failed.


def register_dataset(
    vjm: Vjm, data: Dataset, frame: FrameChoice | Mapping[str, Frame] = "auto"
) -> RegisteredDataset:
    """Identify the frame in which runs were read, and convert them to the base's frame.

    Args:
        vjm: The arm.
        data: The runs.
        frame: "base" or "tracker"; the frames of stations where they are known; "auto" to find out.

    Returns:
        Runs as they are, and the arm's own targets, where both agree with the arm's kinematics.

    Raises:
        BenchError: When an argument has another type, or a frame or a target that must be found cannot be.
    """
    check_type(vjm, Vjm, "vjm")
    check_type(data, Dataset, "data")
    check_runs(vjm, data)
    # Directions and fixed points are in base axes: nothing is registered.
    if data.lines.any():
        if frame not in ("auto", "base"):
            raise BenchError(
                "frame: expected auto or base, because directions of gauges and distances are in base axes"
            )
        none = np.zeros(len(data.markers), dtype=bool)
        why = "directions of gauges and distances are in base axes"
        return RegisteredDataset(
            vjm, resolve_line_readings(vjm, _at_markers(vjm, data)), None, "base", none, why
        )
    # Register the unloaded readings; those that are in base axes already keep their frame.
    series, nominal = unloaded_series(data), dict(zip(vjm.arm.markers, vjm.markers, strict=True))
    base = {readings.frame: Frame(np.eye(3), np.zeros(3)) for readings in series}
    try:
        given = base if frame == "base" else {} if isinstance(frame, str) else frame
        registration = register(vjm, series, nominal, given)
        far = arm_reach(vjm, data.q)
        if frame == "auto" and registration.median_distance > MAX_NOMINAL_DISTANCE * far:
            fit = f"({1e3 * registration.rms:.3g} mm RMS)"
            raise BenchError(f"the unloaded readings do not fit the arm in any frame {fit}")
        if frame == "auto" and all(
            _is_base(readings, registration.frames[readings.frame], far) for readings in series
        ):
            frame, registration = "base", register(vjm, series, nominal, base)
    except BenchError as why:
        if frame not in ("auto", "base") or not set(data.markers) <= set(vjm.arm.markers):
            raise
        return RegisteredDataset(vjm, data, None, "base", np.zeros(len(data.markers), dtype=bool), str(why))
    # Which targets replace those of the folder: in base axes only those that are far off.
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
    lines = data.lines[..., None]
    before = np.where(lines, start, data.before)
    return replace(data, before=before, after=np.where(lines, start + data.deflection, data.after))


def unloaded_series(data: Dataset) -> tuple[Series, ...]:
    """Return the unloaded readings of runs, one series per station that read anything."""
    every = (
        select_rows(series, np.arange(series.rows // 2)) for series in series_of(data, STATION_PREFIX, "tool")
    )
    return tuple(series for series in every if series.seen.any())


def _is_base(series: Series, frame: Frame, reach: float) -> bool:
    """Tell whether a frame is the base's up to the arm's errors, or cannot be distinguished from it."""
    y = series.position[series.seen]
    x = (y - frame.translation) @ frame.rotation
    at_targets = np.hstack([-frame.rotation @ skew(x.mean(axis=0)), np.eye(3)])
    turn, shift = frame.rotation_deviation, largest_deviation(at_targets @ frame.covariance @ at_targets.T)
    moved = float(np.median(np.linalg.norm(y - x, axis=1)))
    return (
        frame.rotation_angle < MAX_BASE_ROTATION + BASE_FRAME_DEVIATIONS * turn
        and moved < MAX_BASE_SHIFT * reach + BASE_FRAME_DEVIATIONS * shift
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
    """Return the model with markers at given places in the tool's frame, some of them new.

    Args:
        vjm: The arm's virtual joint model.
        positions: Positions by marker, (3,) [m] each.
    """
    have = dict(zip(vjm.arm.markers, vjm.markers, strict=True)) | dict(positions)
    return replace(vjm, arm=replace(vjm.arm, markers=tuple(have)), markers=np.array(list(have.values())))


def transform_to_base(registration: Registration, data: Dataset) -> Dataset:
    """Turn readings from their stations' frames into the base's.

    The uncertainty of a frame's rotation is added to the covariance of every deflection, as if it were
    independent from run to run.

    Args:
        registration: The registered frames.
        data: The runs in the stations' frames.
    """
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    R, t = np.tile(np.eye(3), (data.runs, 1, 1)), np.zeros((data.runs, 1, 3))
    about = np.zeros((data.runs, 1, 3, 3))  # covariance of the rotation of every run's frame, base axes
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
        precision=np.where(data.seen[..., None, None], np.linalg.inv((C + C.swapaxes(2, 3)) / 2), 0.0),
    )


def station_number(name: str) -> int:
    """Return the number of the station from the name of its frame."""
    return int(name.removeprefix(STATION_PREFIX))
