"""A registration in words."""

import math
from collections.abc import Iterator

import numpy as np

from testbench.data.dataset import Mask
from testbench.errors import Array
from testbench.identify.registration import Registration, spread

SMALL = 1e-9  #: Rotation that has no axis [rad].


def frame_notes(found: Registration, base: Array, sag: float | None) -> Iterator[str]:
    """Where the base is in every station's frame, how well that is known, and how well all readings fit.

    Of a base with this pose in the arm's world, (4, 4) [m].
    """
    for frame in (one.of(base) for one in found.frames):
        axis = (frame.rotation_vector / max(frame.angle, SMALL)).round(3) + 0.0  # no -0.000
        at = ", ".join(f"{1e3 * x:.1f}" for x in frame.translation)
        about = ", ".join(f"{x:.3f}" for x in axis)
        text = f"station {frame.station}: base at ({at}) mm in the tracker's frame, turned by "
        text += f"{math.degrees(frame.angle):.3f} deg about ({about})"
        if frame.covariance.any():
            where = 1e3 * spread(frame.covariance[3:, 3:])
            text += f". By noise it is known to {where:.2f} mm and {math.degrees(frame.deviation):.3f} deg"
        yield text
    yield fit_note(found, sag)


def fit_note(found: Registration, sag: float | None) -> str:
    """How well all readings fit, and how far own weight alone sags the tool, RMS [m], where that is known."""
    text = f"unloaded readings fit the arm's kinematics to {1e3 * found.rms:.2f} mm RMS"
    if found.wild:
        text += f"; {found.wild} of {found.readings} fit worse and count less"
    known = "" if sag is None else f" the tool by {1e3 * sag:.2f} mm RMS, by the arm's folder"
    return f"{text}. Own weight alone sags{known or ' the arm'}, which harms no deflection"


def target_notes(found: Registration, taken: Mask) -> Iterator[str]:
    """Where targets taken as found, (m,), are, and how far from where the arm's folder has them."""
    deviations = found.target_deviations.max(axis=1)
    for k in np.flatnonzero(taken):
        at = ", ".join(f"{1e3 * x:.1f}" for x in found.targets[k])
        away = float(np.linalg.norm(found.targets[k] - found.nominal[k]))
        new = "new" if math.isnan(away) else f"{1e3 * away:.1f} mm from nominal"
        text = f"target {found.markers[k]} at ({at}) mm in the tool's frame, {new}. By noise it is known to"
        yield f"{text} {1e3 * deviations[k]:.2f} mm"
