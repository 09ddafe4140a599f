"""A robot's file as a tree of bodies, whatever its format, and where its arm ends."""

import re
from dataclasses import dataclass, field

import numpy as np

from testbench.errors import Array
from testbench.plant.import_robot.chain import JointOf, Shape, Site, pose_of

TIPS = (
    *("tool0", "tcp", "tool", "flange", "attachment_site", "attachment", "ee", "eef"),
    *("ee_gripper", "ee_arm", "end_effector", "grip_site", "pinch_site", "hand"),
)
"""How files call the place of the tool, the best first; `panda_` or the like may stand before, `_link` or
`_frame` behind."""
FLANGES = "tool0", "flange"  #: Those that no finger of a gripper is called.
FINGER_JOINTS = 4  #: A branch of so few joints behind an arm is a finger.
ARM_JOINTS = 3  #: Fewest joints of an arm.
GRIPS = re.compile("gripper|finger|jaw", re.IGNORECASE)  #: In the name of a joint that closes a gripper.


@dataclass(frozen=True, eq=False)
class Body:
    """A link or body; parents come before their children."""

    name: str  #: As the file says it.
    parent: int  #: Index of the body before; -1 for the first of a tree.
    pose: Array  #: In the parent at q = 0, (4, 4) [m]; in the world for the first.
    joint: JointOf | None = None  #: What moves it.
    odd: str = ""  #: Why its joint cannot be one of the arm: "is a free joint".
    follows: str = ""  #: Name of the joint that its joint mimics.
    mass: float = 0.0  #: [kg]
    com: Array = field(default_factory=lambda: np.zeros(3))  #: Centre of mass in the body's frame, (3,) [m].
    #: About the centre of mass in the body's axes, (3, 3) [kg m^2].
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    weighed: bool = True  #: The file states its mass.
    shapes: tuple[Shape, ...] = ()
    sites: tuple[Site, ...] = ()

    @property
    def moves(self) -> bool:
        """Whether anything moves it against its parent."""
        return self.joint is not None or bool(self.odd)


@dataclass(frozen=True, eq=False)
class Tree:
    """All bodies of a file."""

    name: str  #: The robot's.
    bodies: tuple[Body, ...]
    notes: tuple[str, ...]  #: What the reader left out or stood in for.


@dataclass(frozen=True, eq=False)
class Tip:
    """Where the tool is."""

    name: str  #: Of the body or site.
    body: int  #: Index of its body.
    pose: Array  #: In the body's frame, (4, 4) [m].


def path_to(tree: Tree, body: int) -> list[int]:
    """Bodies from the first of the tree to this one."""
    path = [body]
    while (before := tree.bodies[path[0]].parent) >= 0:
        path.insert(0, before)
    return path


def named_tips(tree: Tree) -> list[Tip]:
    """Every body and site that a tool may stand on."""
    tips = []
    for k, body in enumerate(tree.bodies):
        tips.append(Tip(body.name, k, np.eye(4)))
        tips += [Tip(s.name, k, pose_of(s.rotation, s.position)) for s in body.sites]
    return tips


def usual_tip(tree: Tree) -> Tip:
    """Where a tool is mounted if nobody says it: at the end of the longest chain of moving joints.

    A gripper and rods that follow other joints do not count; a flange by its name wins over a longer chain.
    At the last moving body, or on what is fixed to it, a usual name decides; else a bare frame that is fixed
    to it; else the body itself.
    """
    flange = _flange(tree)
    last = _last_moving(tree) if flange is None else flange
    ends = [tip for tip in named_tips(tree) if _carrier(tree, tip.body) == last]
    ranked = [(rank, tip) for tip in ends if (rank := _rank(tip.name)) is not None]
    if ranked:
        return min(ranked, key=lambda found: found[0])[1]
    bare = [tip for tip in ends if tree.bodies[tip.body].parent == last and _is_bare(tree.bodies[tip.body])]
    return bare[0] if len(bare) == 1 else Tip(tree.bodies[last].name, last, np.eye(4))


def _flange(tree: Tree) -> int | None:
    """The moving body of an arm that carries what its file calls a flange, the best name first."""
    joints: list[int] = []  # that lead to a body
    for body in tree.bodies:
        joints.append((joints[body.parent] if body.parent >= 0 else 0) + (body.joint is not None))
    found = [
        (rank, _carrier(tree, tip.body))
        for tip in named_tips(tree)
        if (rank := _rank(tip.name)) is not None and TIPS[rank] in FLANGES and joints[tip.body] >= ARM_JOINTS
    ]
    return min(found, default=(0, None), key=lambda own: own[0])[1]


def _rank(name: str) -> int | None:
    """How good a name is for a tool's place, 0 the best; None if it is none."""
    words = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    words = re.sub("_(link|frame)$", "", words)
    found = [k for k, tip in enumerate(TIPS) if words == tip or words.endswith(f"_{tip}")]
    return found[0] if found else None


def _is_bare(body: Body) -> bool:
    """A frame without mass or surface."""
    return not body.moves and body.mass == 0 and not body.shapes


def _carrier(tree: Tree, body: int) -> int:
    """The moving body, or the first of the tree, that a body is fixed to."""
    while not tree.bodies[body].moves and tree.bodies[body].parent >= 0:
        body = tree.bodies[body].parent
    return body


def _is_rod(tree: Tree, k: int) -> bool:
    """Whether a body follows a joint that leads to it: a rod beside the arm, no finger of a gripper."""
    name, before = tree.bodies[k].follows, tree.bodies[k].parent
    while name and before >= 0:
        joint, before = tree.bodies[before].joint, tree.bodies[before].parent
        if joint is not None and joint.name == name:
            return True
    return False


def _grips(body: Body) -> bool:
    """Whether the name of a body's joint says that it closes a gripper."""
    return body.joint is not None and GRIPS.search(body.joint.name) is not None


def _last_moving(tree: Tree) -> int:
    """The last moving body of the arm: the deepest, before a gripper: branches, or a joint of such a name."""
    carriers = [_carrier(tree, k) for k in range(len(tree.bodies))]
    branches: dict[int, list[int]] = {k: [] for k in range(len(tree.bodies))}
    height = [0] * len(tree.bodies)  # moving joints behind a body, the longest way
    for k in reversed(range(len(tree.bodies))):
        body = tree.bodies[k]
        branches[k] = [b for b in branches[k] if not _is_rod(tree, b)] or branches[k]
        height[k] = max((height[b] + 1 for b in branches[k]), default=0)
        if body.moves and body.parent >= 0:
            branches[carriers[body.parent]].append(k)
    first = [k for k, body in enumerate(tree.bodies) if body.parent < 0]
    here = max(first, key=lambda k: (height[k], -k))
    joints = 0
    while height[here]:
        ahead = max(branches[here], key=lambda k: (not tree.bodies[k].follows, height[k], -k))
        gripper = len(branches[here]) > 1 or _grips(tree.bodies[ahead])
        if gripper and height[here] <= FINGER_JOINTS and joints >= ARM_JOINTS:
            break
        here = ahead
        joints += 1
    return here
