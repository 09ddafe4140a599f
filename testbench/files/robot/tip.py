"""End of the arm in a robot's tree: the place of the tool."""

import re
from typing import NamedTuple

import numpy as np

from testbench.files.robot.robot import ImportedSite, Robot

TIPS = (
    *("tool0", "tcp", "tool", "flange", "attachment_site", "attachment", "ee", "eef"),
    *("ee_gripper", "ee_arm", "end_effector", "grip_site", "pinch_site", "hand"),
)
"""How files call the place of the tool, the best first; `panda_` or the like may stand before, `_link` or
`_frame` behind."""
FLANGES = "tool0", "flange"
"""Names that no finger of a gripper has."""
FINGER_JOINTS = 4
"""Most joints of a branch behind an arm that counts as a finger."""
ARM_JOINTS = 3  #: Fewest joints of an arm.
GRIPS = re.compile("gripper|finger|jaw", re.IGNORECASE)
"""Words in the name of a joint that closes a gripper."""


class Tip(NamedTuple):
    """Describe a place where a tool may be mounted."""

    body: int  #: Index of its body.
    site: ImportedSite  #: In the body's frame.


def path_to(robot: Robot, body: int) -> list[int]:
    """List the bodies from the root of the tree to a body.

    Args:
        robot: The robot.
        body: Index of the last body.

    Returns:
        Indices of the bodies, root first.
    """
    path = [body]
    while (before := robot.bodies[path[0]].parent) >= 0:
        path.insert(0, before)
    return path


def named_tips(robot: Robot) -> list[Tip]:
    """List every body and site that may carry the tool.

    Args:
        robot: The robot.

    Returns:
        The places, in the order of the bodies.
    """
    return [
        Tip(k, site)
        for k, body in enumerate(robot.bodies)
        for site in (ImportedSite(body.name, np.eye(4)), *body.sites)
    ]


def usual_tip(robot: Robot) -> Tip:
    """Find the place of the tool if none is given: the end of the longest chain of moving joints.

    A gripper and rods that follow other joints do not count; a link with the name of a flange has priority
    over a longer chain. On the last moving body, or fixed to it, a usual name decides; else a bare frame
    fixed to it; else the body itself.

    Args:
        robot: The robot.

    Returns:
        The place.
    """
    bodies, tips = robot.bodies, named_tips(robot)
    carriers = [_carrier(robot, k) for k in range(len(bodies))]
    ranked = [(rank, tip) for tip in tips if (rank := _rank(tip.site.name)) is not None]
    flanges = [(rank, carriers[tip.body]) for rank, tip in ranked if _is_flange(robot, rank, tip)]
    last = min(flanges, key=lambda found: found[0])[1] if flanges else _last_moving(robot, carriers)
    if here := [(rank, tip) for rank, tip in ranked if carriers[tip.body] == last]:
        return min(here, key=lambda found: found[0])[1]
    fixed = [tip for tip in tips if bodies[tip.body].parent == last and not bodies[tip.body].moves]
    bare = [tip for tip in fixed if bodies[tip.body].mass == 0 and not bodies[tip.body].shapes]
    return bare[0] if len(bare) == 1 else Tip(last, ImportedSite(bodies[last].name, np.eye(4)))


def _is_flange(robot: Robot, rank: int, tip: Tip) -> bool:
    """Tell whether a place has the name of a flange and is behind the joints of an arm."""
    joints = sum(robot.bodies[k].joint is not None for k in path_to(robot, tip.body))
    return TIPS[rank] in FLANGES and joints >= ARM_JOINTS


def _rank(name: str) -> int | None:
    """Rank a name as that of a tool's place, 0 the best; None if it is none."""
    words = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    words = re.sub("_(link|frame)$", "", words)
    return next((k for k, tip in enumerate(TIPS) if f"_{words}".endswith(f"_{tip}")), None)


def _carrier(robot: Robot, body: int) -> int:
    """Find the moving body, or the first of the tree, to which a body is fixed."""
    while not robot.bodies[body].moves and robot.bodies[body].parent >= 0:
        body = robot.bodies[body].parent
    return body


def _is_rod(robot: Robot, k: int) -> bool:
    """Tell whether a body follows a joint before it: a rod of the arm, not a finger of a gripper."""
    name = robot.bodies[k].follows
    before = [robot.bodies[b].joint for b in path_to(robot, k)[:-1]]
    return bool(name) and name in [joint.name for joint in before if joint]


def _last_moving(robot: Robot, carriers: list[int]) -> int:
    """Find the last moving body of the arm: the deepest one before a gripper.

    A gripper shows by branches, or by the name of a joint.
    """
    bodies = robot.bodies
    branches: dict[int, list[int]] = {k: [] for k in range(len(bodies))}
    height = [0] * len(bodies)  # moving joints behind a body, the longest way
    for k in reversed(range(len(bodies))):
        branches[k] = [b for b in branches[k] if not _is_rod(robot, b)] or branches[k]
        height[k] = max((height[b] + 1 for b in branches[k]), default=0)
        if bodies[k].moves and bodies[k].parent >= 0:
            branches[carriers[bodies[k].parent]].append(k)
    here = max((k for k, body in enumerate(bodies) if body.parent < 0), key=lambda k: (height[k], -k))
    joints = 0
    while height[here]:
        ahead = max(branches[here], key=lambda k: (not bodies[k].follows, height[k], -k))
        joint = bodies[ahead].joint
        gripper = len(branches[here]) > 1 or bool(joint and GRIPS.search(joint.name))
        if gripper and height[here] <= FINGER_JOINTS and joints >= ARM_JOINTS:
            break
        here, joints = ahead, joints + 1
    return here
