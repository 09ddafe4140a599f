"""What a registration does to runs and model: readings in the base's axes, targets where they were found."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testbench.data.dataset import Dataset, Mask, read_by
from testbench.errors import Array
from testbench.identify.registration import Registration
from testbench.model.vjm import Vjm


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
