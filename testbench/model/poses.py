"""Poses to measure: random ones that the arm can take, inside a work area or anywhere."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, Mask, PoseError
from testbench.model.vjm import Vjm, tool_pose

BATCH = 4096  #: Poses drawn at a time.
PIECE = 512  #: Poses looked at before it is asked whether there are enough.
MAX_BATCHES = 400


@dataclass(frozen=True)
class WorkArea:
    """Where the tool has to be, and where it has to point."""

    lower: tuple[float, float, float]  #: Lower corner of the tool's position, world, (3,) [m].
    upper: tuple[float, float, float]  #: Upper corner, (3,) [m].
    #: Unit vector that the tool's x axis follows, world, (3,).
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    cone: float = np.pi  #: Largest angle between the two [rad].


def in_area(vjm: Vjm, area: WorkArea, q: Array) -> Mask:
    """Which poses have their tool in the area, (poses,)."""
    position, rotation = tool_pose(vjm, q)
    inside = ((position >= area.lower) & (position <= area.upper)).all(axis=1)
    cosine = rotation[:, :, 0] @ np.array(area.direction)
    return np.asarray(inside & (cosine >= np.cos(area.cone)))


def random_poses(
    vjm: Vjm,
    area: WorkArea | None,
    count: int,
    clear: Callable[[Array], Mask],
    rng: np.random.Generator,
) -> Array:
    """Poses drawn evenly over the joint limits, kept if in the area and clear, (count, n) [rad, m].

    Args:
        vjm: The model, for its nominal kinematics.
        area: Where the tool has to be; None for anywhere.
        count: How many.
        clear: Tells which of the poses, (poses, n) [rad, m], are free of collision.
        rng: Source of the poses.

    Raises:
        PoseError: When too few can be found; says which condition emptied the set.
    """
    kept: list[Array] = []
    drawn = reached = 0
    for _ in range(MAX_BATCHES):
        q = vjm.arm.drawn(rng, BATCH)
        drawn += len(q)
        for piece in np.split(q, range(PIECE, BATCH, PIECE)):
            inside = piece if area is None else piece[in_area(vjm, area, piece)]
            reached += len(inside)
            kept.extend(inside[clear(inside)])
            if len(kept) >= count:
                return np.array(kept[:count])
    raise PoseError(
        f"found {len(kept)} of {count} poses: of {drawn} drawn {reached} put the tool in the work area "
        f"and {len(kept)} are clear of collision; widen the area"
    )
