"""Runs in the base's frame, whatever frame they were read in, and the model with its targets as they are.

Sizes, on a KR 500 in 10 poses with deflections of 6 mm and 40 um of noise: by noise the frame's rotation
leaves 1 um of a deflection open, 5 um (at most 12) with joints 1 mm and 1 mrad off; that is added to its
covariance. The targets leave as much, by the tool's rotation of 4 mrad; that is not added. What the arm's sag
and its errors have in common with a rotation is in neither: 0.1 deg by its own weight, 0.2 deg with both.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from testbench.data.dataset import Dataset, Mask, read_by
from testbench.errors import Array, BenchError, InputError
from testbench.identify.fold import BLOCK_RUNS
from testbench.identify.registration import Frame, Registration, register, spread, station_names
from testbench.model.vjm import Vjm, chain, skew
from testbench.model.weights import own_weight, read_weights

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


Choice = Literal["auto", "base", "tracker"]

TURN, SHIFT = math.radians(0.5), 0.01
"""A frame nearer to the base than this is the base [rad, share of the targets' distance].

Readings in the base's frame seem turned by up to 0.35 deg and moved by 15 mm at 2.5 m, those of a heavy arm
with `plant.TYPICAL` errors; without errors, by 0.13 deg and 4 mm by its own weight (30 campaigns, KR 500).
"""
MOVED = 0.005
"""Distance from its nominal position beyond which a target of readings in the base's frame is taken as found
[m]. By its own weight a sound arm moves one by up to 2 mm; to take targets as found costs nothing."""
SURE = 3.0  #: Standard deviations within which a frame may be the base.
LOOSE = math.radians(1.0)  #: Standard deviation of a frame's rotation beyond which it is not known [rad].
FAR = 0.02
"""Median distance of readings from where the arm has them, over the targets' distance from its base, from
which it is another arm, or has other joint angles."""


@dataclass(frozen=True)
class Registered:
    """Runs and model that fit together."""

    vjm: Vjm  #: The model, with targets where the readings have them.
    data: Dataset  #: The runs in the base's frame.
    registration: Registration | None  #: How they fit; None where nothing was found.
    frame: Literal["base", "tracker"]  #: What the readings were in.
    notes: tuple[str, ...]  #: What was understood.


def registered(vjm: Vjm, data: Dataset, frame: Choice | tuple[Frame, ...] = "auto") -> Registered:
    """Find out what frame runs were read in, and bring them into the base's.

    Args:
        vjm: The arm.
        data: The runs.
        frame: "base" or "tracker"; the frames themselves where they are known; "auto" to find out.

    Returns:
        Runs as they are, and the arm's own targets, where both agree with the arm's kinematics.

    Raises:
        BenchError: When a frame or a target that must be found cannot be.
    """
    if frame == "base":
        return _in_base(vjm, data)
    if frame != "auto":
        return _in_tracker(vjm, data, register(vjm, data, () if frame == "tracker" else frame))
    try:
        found = register(vjm, data)
    except BenchError as why:
        return _unknown(vjm, data, str(why))
    if found.typical > FAR * found.reach:
        fit = f"({1e3 * found.rms:.3g} mm RMS)"
        return _unknown(vjm, data, f"in no frame do the unloaded readings fit the arm {fit}")
    if all(_is_base(one, data, found.reach) for one in found.frames):
        return _in_base(vjm, data)
    return _in_tracker(vjm, data, found)


def _unknown(vjm: Vjm, data: Dataset, why: str) -> Registered:
    """Runs as they are; BenchError where the arm lacks one of their targets, which had to be found."""
    if not set(data.markers) <= set(vjm.arm.markers):
        raise BenchError(why)
    return Registered(vjm, data, None, "base", (f"readings are taken to be in the base's frame: {why}",))


def _is_base(frame: Frame, data: Dataset, reach: float) -> bool:
    """Whether a frame is the base's but for the arm's errors, or cannot be told from it."""
    own = data.seen & read_by(data, frame.station)[:, None]
    y = data.before[own]
    x = (y - frame.translation) @ frame.rotation
    at_targets = np.hstack([-frame.rotation @ skew(x.mean(axis=0)), np.eye(3)])
    turn, shift = frame.deviation, spread(at_targets @ frame.covariance @ at_targets.T)
    moved = float(np.median(np.linalg.norm(y - x, axis=1)))
    return frame.angle < TURN + SURE * turn and moved < SHIFT * reach + SURE * shift


def _in_base(vjm: Vjm, data: Dataset) -> Registered:
    """Runs as they are; targets that are new, or far from where the arm's folder has them, as found."""
    names, zero = station_names(data), np.zeros((6, 6))
    try:
        found = register(vjm, data, tuple(Frame(name, np.eye(3), np.zeros(3), zero) for name in names))
    except BenchError as why:
        return _unknown(vjm, data, str(why))
    far = ~(np.linalg.norm(found.targets - found.nominal, axis=1) <= MOVED)
    notes = ("readings are in the base's frame", fit_note(found, _sag(vjm, data)), *target_notes(found, far))
    return Registered(with_targets(vjm, found, far), data, found, "base", notes)


def _in_tracker(vjm: Vjm, data: Dataset, found: Registration) -> Registered:
    """Runs turned into the base's frame, all targets as found; BenchError where a frame is not known."""
    for frame in found.frames:
        if frame.deviation > LOOSE:
            raise BenchError(
                f"registration: the frame of station {frame.station} is known to "
                f"{math.degrees(frame.deviation):.1f} deg only; expected more poses, over more joints, "
                "or the frame itself"
            )
    every = np.ones(len(found.markers), dtype=bool)
    notes = (*frame_notes(found, vjm.base, _sag(vjm, data)), *target_notes(found, every))
    return Registered(with_targets(vjm, found, every), in_base(found, data), found, "tracker", notes)


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


def with_targets(vjm: Vjm, found: Registration, taken: Mask) -> Vjm:
    """The model with these of the targets, (m,), where they were found."""
    places = {name: found.targets[k] for k, name in enumerate(found.markers) if taken[k]}
    return with_markers(vjm, places) if places else vjm


def with_markers(vjm: Vjm, places: Mapping[str, Array]) -> Vjm:
    """The model with markers at these places in the tool's frame, (3,) [m] each, some of them new."""
    have = dict(zip(vjm.arm.markers, vjm.markers, strict=True)) | dict(places)
    return replace(vjm, arm=replace(vjm.arm, markers=tuple(have)), markers=np.array(list(have.values())))


def in_base(found: Registration, data: Dataset) -> Dataset:
    """Readings turned from their stations' frames into the base's.

    The uncertainty of a frame's rotation is added to the covariance of every deflection, as if it were
    independent from run to run.
    """
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    before, after = data.before.copy(), data.after.copy()
    turned = [r if r is None else r.copy() for r in (data.rotation_before, data.rotation_after)]
    R, about = np.tile(np.eye(3), (data.runs, 1, 1)), np.zeros((data.runs, 3, 3))
    for frame in found.frames:
        own = read_by(data, frame.station)
        R[own], about[own] = frame.rotation, frame.covariance[:3, :3]
        for readings in (before, after):
            readings[own] = (readings[own] - frame.translation) @ frame.rotation
        for vectors in turned:
            if vectors is not None:
                back = Rotation.from_matrix(frame.rotation.T)
                vectors[own] = (back * Rotation.from_rotvec(vectors[own])).as_rotvec()
    return replace(
        data,
        before=before,
        after=after,
        rotation_before=turned[0],
        rotation_after=turned[1],
        precision=_precision(data, R, about, after - before),
    )


def _precision(data: Dataset, R: Array, about: Array, deflection: Array) -> Array:
    """Inverse covariance of deflections in base axes, (runs, m, 3, 3) [1/m^2], zero for a lost target.

    Of the rotation of every run's frame, (runs, 3, 3), and its covariance about base axes, (runs, 3, 3).
    """
    lost = ~data.seen[..., None, None]
    across = np.cross(np.eye(3), deflection[:, :, None]).swapaxes(2, 3)  # e_a x d
    C = R.swapaxes(1, 2)[:, None] @ data.covariance @ R[:, None]
    C = C + across @ about[:, None] @ across.swapaxes(2, 3)
    return np.where(lost, 0.0, np.linalg.inv((C + C.swapaxes(2, 3)) / 2))
