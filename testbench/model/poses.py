"""Random poses inside the joint limits: the candidates that a measurement plan or a simulation draws from.

Poses may be limited to a work area of the tool; a caller's check keeps them free of collision.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, Mask, PoseError
from testbench.model.vjm import Vjm, tool_pose

POSES_PER_BATCH = 4096  #: Poses drawn at a time.
POSES_PER_CHECK = 512  #: Poses checked at a time; drawing stops after a piece that completes the count.
MAX_BATCHES = 400  #: Batches drawn before the search is given up.


@dataclass(frozen=True)
class WorkArea:
    """Describe where the tool must be and where its x axis must point."""

    lower: tuple[float, float, float]  #: Lower corner of the tool's position, world, (3,) [m].
    upper: tuple[float, float, float]  #: Upper corner, (3,) [m].
    #: Unit vector that the tool's x axis follows, world, (3,).
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    cone: float = np.pi  #: Largest angle between the two [rad].


def in_area(vjm: Vjm, area: WorkArea, q: Array) -> Mask:
    """Tell which poses have their tool in a work area, the arm rigid.

    Args:
        vjm: Kinematics of the arm.
        area: The work area.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        True where position and direction both fit, (poses,).

    Raises:
        BenchError: When q has another shape or is not finite.
    """
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
    """Draw poses evenly over the joint limits; keep those in the work area that are clear of collision.

    Args:
        vjm: Nominal kinematics of the arm.
        area: Where the tool must be; None for anywhere.
        count: Number of poses to return.
        clear: Function that tells which of the poses, (poses, n) [rad, m], are free of collision, (poses,).
        rng: Source of the poses.

    Returns:
        Actuated joints, (count, n) [rad, m], in the order in which they were drawn.

    Raises:
        PoseError: When `MAX_BATCHES` times `POSES_PER_BATCH` draws yield too few; the message counts what
            each condition left.
    """
    kept: list[Array] = []
    drawn = reached = 0
    for _ in range(MAX_BATCHES):
        q = vjm.arm.drawn(rng, POSES_PER_BATCH)
        drawn += len(q)
        for piece in np.split(q, range(POSES_PER_CHECK, POSES_PER_BATCH, POSES_PER_CHECK)):
            inside = piece if area is None else piece[in_area(vjm, area, piece)]
            reached += len(inside)
            kept.extend(inside[clear(inside)])
            if len(kept) >= count:
                return np.array(kept[:count])
    raise PoseError(
        f"found {len(kept)} of {count} poses: of {drawn} drawn {reached} put the tool in the work area "
        f"and {len(kept)} are clear of collision; widen the area"
    )
