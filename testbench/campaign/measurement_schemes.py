"""Runs that were not read: the same poses measured in another way, or others under the same loads."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.fold import reduce
from testbench.identify.regression import Regression
from testbench.model.vjm import Vjm, marker_points

OFFSET = 0.3  #: Distance of a second load point or of one more marker [m].
SIGMA_ROTATION = 250e-6
"""Standard deviation of one orientation reading where the data have none, as in section 5.2 [rad]."""
REPEAT = "the same runs once more"  #: The yardstick: what only averages noise is no better.


def imagined(data: Dataset, **changes: object) -> Dataset:
    """The dataset with other runs, markers or loads, and all readings zero: only its rows are wanted."""
    other = {"run": data.run, "q": data.q, "markers": data.markers, **changes}
    runs, markers = len(np.asarray(other["run"])), len(tuple(other["markers"]))  # type: ignore[arg-type]
    blank = np.zeros((runs, markers, 3))
    turned = None if data.rotation_before is None else np.zeros((runs, 3))
    plain = {"precision": None, "station": None}
    fields = {"rotation_before": turned, "rotation_after": turned, **plain, **other}
    return replace(data, before=blank, after=blank, **fields)  # type: ignore[arg-type]


def more_poses(vjm: Vjm, data: Dataset, count: int, *, seed: int) -> Dataset:
    """Runs in random poses within the joint limits, under the loads of the data in turn.

    Where the data have more runs than are asked for, these are evenly spaced among them.
    """
    lower, upper = vjm.arm.limits
    rng = np.random.Generator(np.random.Philox(seed))
    q = rng.uniform(lower, upper, (count, vjm.arm.n_joints))
    turn = np.arange(count) % data.runs
    if data.runs > count:
        turn = np.linspace(0, data.runs - 1, count).astype(int)
    ids = np.arange(count)
    return imagined(data, run=ids, pose=ids, q=q, wrench=data.wrench[turn], point=data.point[turn])


def measured_otherwise(vjm: Vjm, data: Dataset, regression: Regression) -> Iterator[tuple[str, Regression]]:
    """What each proposal adds, reduced."""
    structure = regression.structure
    for words, extra in _loads(data):
        yield words, reduce(vjm, structure, imagined(data, **extra))
    poses = np.unique(data.q, axis=0, return_inverse=True)[1].ravel()
    fresh = more_poses(vjm, data, poses.max() + 1, seed=2).q[poses]
    yield "as many poses again at random", reduce(vjm, structure, imagined(data, q=fresh))
    points = marker_points(vjm, data.markers)
    name = f"one more marker off the {'plane' if len(points) > 2 else 'line'} of the {len(points)}"
    name = "a second marker" if len(points) == 1 else name
    marker = reduce(with_marker(vjm, points, name), structure, imagined(data, markers=(name,)))
    yield name, replace(marker, terms=marker.terms[:1])
    if data.rotation_before is None:
        blank = np.zeros((data.runs, 3))
        turned = replace(
            imagined(data), rotation_before=blank, rotation_after=blank, sigma_rotation=SIGMA_ROTATION
        )
        read = reduce(vjm, structure, turned)
        yield (
            f"orientation of the tool read to {1e6 * SIGMA_ROTATION:g} urad",
            replace(read, terms=read.terms[1:]),
        )


def _loads(data: Dataset) -> Iterator[tuple[str, dict[str, Array]]]:
    yield REPEAT, {}
    yield "half the load", {"wrench": data.wrench / 2}
    force = np.linalg.norm(data.wrench[:, :3], axis=1)
    if force.any():
        for k, axis in enumerate("xy"):
            side = np.zeros((data.runs, 6))
            side[:, k] = force
            yield f"the force as a side load along world {axis}", {"wrench": side}
        for k, axis in enumerate("xyz"):
            point = data.point + OFFSET * np.eye(3)[k]
            yield f"load point moved {OFFSET:g} m along tool {axis}", {"point": point}


def with_marker(vjm: Vjm, points: Array, name: str) -> Vjm:
    """The model with one more marker, fixed to the tool off the line or plane of others, (m, 3) [m]."""
    centre = points.mean(axis=0)
    away = np.linalg.svd(points - centre)[2][-1]
    arm = replace(vjm.arm, markers=(*vjm.arm.markers, name))
    return replace(vjm, arm=arm, markers=np.vstack([vjm.markers, centre + OFFSET * away]))
