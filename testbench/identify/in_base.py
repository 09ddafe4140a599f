"""What a registration does to runs and model: readings in the base's axes, targets where they were found."""

from dataclasses import replace

import numpy as np

from testbench.data.dataset import Dataset, Mask
from testbench.errors import Array
from testbench.identify.registration import Frame, Registration
from testbench.model.vjm import Vjm


def of_station(frame: Frame, data: Dataset) -> Mask:
    """Which runs, (runs,), its station read."""
    return np.ones(data.runs, dtype=bool) if data.station is None else data.station == frame.station


def with_targets(vjm: Vjm, found: Registration, taken: Mask) -> Vjm:
    """The model with these of the targets, (m,), where they were found."""
    if not taken.any():
        return vjm
    have = dict(zip(vjm.arm.markers, vjm.markers, strict=True))
    have |= {name: found.targets[k] for k, name in enumerate(found.markers) if taken[k]}
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
        own = of_station(frame, data)
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
    if data.precision is None:
        C = np.broadcast_to(2 * data.sigma**2 * np.eye(3), (*data.before.shape, 3))
    else:
        C = np.linalg.inv(np.where(lost, np.eye(3), data.precision))
    across = np.cross(np.eye(3), deflection[:, :, None]).swapaxes(2, 3)  # e_a x d
    C = R.swapaxes(1, 2)[:, None] @ C @ R[:, None]
    C = C + across @ about[:, None] @ across.swapaxes(2, 3)
    return np.where(lost, 0.0, np.linalg.inv((C + C.swapaxes(2, 3)) / 2))
