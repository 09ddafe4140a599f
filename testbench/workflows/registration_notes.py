"""Notes on the frames and targets of measured runs, in sentences."""

import math
from collections.abc import Iterator

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import InputError
from testbench.identify.fold import BLOCK_RUNS
from testbench.identify.registered import RegisteredDataset
from testbench.identify.registration import Frame, Registration, largest_deviation
from testbench.model.vjm import Vjm, chain
from testbench.model.weights import own_weight, read_weights
from testbench.workflows.rows import MM

SMALL = 1e-9  #: Rotation that has no axis [rad].


def registration_notes(registered: RegisteredDataset) -> tuple[str, ...]:
    """Sentences on the frames, on how well the readings fit, and on targets that were taken as found."""
    if registered.registration is None:
        return (f"readings are taken to be in the base's frame: {registered.why}",)
    frames = ["readings are in the base's frame"]
    if registered.frame == "tracker":
        every = registered.registration.frames.items()
        frames = [_frame_note(name, frame.of(registered.vjm.base)) for name, frame in every]
    fit = _fit_note(registered.registration, _sag(registered.vjm, registered.data))
    return (*frames, fit, *_target_notes(registered, registered.registration))


def _frame_note(name: str, frame: Frame) -> str:
    """Where the base is in the frame of a station, and how well that is known."""
    angle = frame.angle
    axis = (frame.rotation_vector / max(angle, SMALL)).round(3) + 0.0  # no -0.000
    at = ", ".join(f"{MM * x:.1f}" for x in frame.translation)
    about = ", ".join(f"{x:.3f}" for x in axis)
    text = f"{name}: base at ({at}) mm in the tracker's frame, "
    text += f"turned by {math.degrees(angle):.3f} deg about ({about})"
    if not frame.covariance.any():
        return text
    where = MM * largest_deviation(frame.covariance[3:, 3:])
    return f"{text}. Uncertainty by noise: {where:.2f} mm and {math.degrees(frame.deviation):.3f} deg"


def _fit_note(registration: Registration, sag: float | None) -> str:
    """How well all readings fit, and how far own weight alone sags the tool, RMS [m], where that is known."""
    text = f"unloaded readings fit the arm's kinematics to {MM * registration.rms:.2f} mm RMS"
    if registration.downweighted:
        text += (
            f"; {registration.downweighted} of {len(registration.distance)} fit worse and have less weight"
        )
    size = "" if sag is None else f" by {MM * sag:.2f} mm RMS, by the arm's folder"
    return f"{text}. Own weight deflects the tool{size}; differences of readings do not contain this"


def _target_notes(registered: RegisteredDataset, registration: Registration) -> Iterator[str]:
    """Where targets taken as found are, and how far from where the arm's folder has them."""
    deviations = registration.target_deviations.max(axis=1)
    for k in np.flatnonzero(registered.targets_taken):
        at = ", ".join(f"{MM * x:.1f}" for x in registration.targets[k])
        away = float(np.linalg.norm(registration.targets[k] - registration.nominal[k]))
        new = "new" if math.isnan(away) else f"{MM * away:.1f} mm from nominal"
        text = (
            f"target {registration.markers[k]} at ({at}) mm in the tool's frame, {new}. Uncertainty by noise:"
        )
        yield f"{text} {MM * deviations[k]:.2f} mm"


def _sag(vjm: Vjm, data: Dataset) -> float | None:
    """How far own weight bends the folder's arm at its tool, linear, RMS [m]; None where nobody knows it."""
    try:
        weights = read_weights(vjm.arm)
    except InputError:
        return None
    total = 0.0
    for first in range(0, data.runs, BLOCK_RUNS):
        where = chain(vjm, data.q[first : first + BLOCK_RUNS])
        moved = np.einsum("xtp,tp->px", where.J_theta[:3], vjm.arm.C_theta @ own_weight(where, weights))
        total += float((moved**2).sum())
    return math.sqrt(total / data.runs)
