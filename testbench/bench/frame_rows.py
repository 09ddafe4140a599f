"""The registration of a user's runs as rows of models.json."""

import math
from dataclasses import dataclass

import numpy as np

from testbench.bench.rows import MM
from testbench.errors import Array
from testbench.identify.registered import Registered
from testbench.identify.registration import Registration, spread

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class FrameRow:
    """The base in the frame of one station."""

    station: int  #: Its identifier.
    position_mm: Numbers  #: Of the base.
    rotation_deg: Numbers  #: Of the base's axes, as a rotation vector.
    position_sd_mm: float  #: Largest standard deviation along any direction; 0 for a frame that was given.
    rotation_sd_deg: float  #: The same about any axis.


@dataclass(frozen=True)
class TargetRow:
    """A target in the tool's frame."""

    marker: str  #: Its name.
    position_mm: Numbers  #: As found.
    from_nominal_mm: float | None  #: Distance from where the arm's folder has it; None if it has not.
    position_sd_mm: float  #: Largest standard deviation along an axis.


@dataclass(frozen=True)
class RegistrationRow:
    """Frames and targets, and how well the unloaded readings fit them."""

    frame: str  #: What the readings were in: "base" or "tracker".
    frames: tuple[FrameRow, ...]  #: One a station.
    targets: tuple[TargetRow, ...]  #: One a target.
    rms_mm: float  #: RMS distance of unloaded readings from arm, frames and targets.
    noise_mm: float  #: Standard deviation along an axis that the tracker's does not explain.
    readings: int  #: Targets read, once a pose.
    wild: int  #: Those that are far off and count less.


def registration_row(registered: Registered) -> RegistrationRow | None:
    """The row; None where no frame fitted."""
    found = registered.registration
    if found is None:
        return None
    return RegistrationRow(
        frame=registered.frame,
        frames=_frames(found, registered.vjm.base),
        targets=_targets(found),
        rms_mm=MM * found.rms,
        noise_mm=MM * found.noise,
        readings=found.readings,
        wild=found.wild,
    )


def _frames(found: Registration, base: Array) -> tuple[FrameRow, ...]:
    return tuple(
        FrameRow(
            station=frame.station,
            position_mm=tuple((MM * frame.translation).tolist()),
            rotation_deg=tuple(np.degrees(frame.rotation_vector).tolist()),
            position_sd_mm=MM * spread(frame.covariance[3:, 3:]),
            rotation_sd_deg=math.degrees(frame.deviation),
        )
        for frame in (one.of(base) for one in found.frames)
    )


def _targets(found: Registration) -> tuple[TargetRow, ...]:
    away = MM * np.linalg.norm(found.targets - found.nominal, axis=1)
    return tuple(
        TargetRow(
            marker=name,
            position_mm=tuple((MM * found.targets[k]).tolist()),
            from_nominal_mm=float(away[k]) if np.isfinite(away[k]) else None,
            position_sd_mm=MM * float(found.target_deviations[k].max()),
        )
        for k, name in enumerate(found.markers)
    )
