"""Stiffness ellipsoids along a path: over which a force of any direction moves the loaded tool."""

from collections.abc import Sequence

import numpy as np

from testbench.errors import Array, Ids
from testbench.runs.rows import Row
from testbench.workflows.rows import MM

COUNT = 8  #: Poses along a path that have an ellipsoid, at most.


def some_poses(count: int) -> Ids:
    """Pick poses evenly, the first and the last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, COUNT)).round().astype(int))


def ellipsoids(
    compliance: Array, lever: Array, position: Array, labels: Sequence[str], force: float
) -> list[Row]:
    """Describe the ellipsoids over which a force of any direction moves a point of the tool.

    The point p is at r from the tool's origin. By a force f it moves by T C T^T f with T = [I, -[r]x].

    Args:
        compliance: Compliance C at the tool's origin, twist = C @ wrench, world axes, (poses, 6, 6)
            [m/N, rad/N, rad/(N m)].
        lever: r, world axes, (poses, 3) [m].
        position: Where the point is, (poses, 3) [m].
        labels: What the poses are called.
        force: Size of the force [N].

    Returns:
        A row for each pose: its `label`, `at_m`, `semi_axes_mm` from the longest to the shortest, and their
        unit vectors `directions`, one per row.
    """
    turned = np.cross(lever[:, None], np.eye(3))
    T = np.concatenate([np.broadcast_to(np.eye(3), turned.shape), turned], axis=2)
    directions, give, _ = np.linalg.svd(T @ compliance @ T.transpose(0, 2, 1))
    return [
        Row(
            label=label,
            at_m=at.tolist(),
            semi_axes_mm=(MM * force * sizes).tolist(),
            directions=axes.T.tolist(),
        )
        for label, at, sizes, axes in zip(labels, position, give, directions, strict=True)
    ]
