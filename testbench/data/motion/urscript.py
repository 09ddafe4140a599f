"""URScript of Universal Robots: a function of movej, six joints in radians."""

from collections.abc import Iterator, Sequence

from testbench.arm.folder import Joint
from testbench.data.motion.words import MAIN, check_moves, comment, identifier, numbers, plain, taken
from testbench.errors import Array, BenchError

LONGEST = 64  #: Characters of a name.
DECIMALS = 11  #: Of a radian.
ACCELERATION, SPEED = 0.5, 0.25  #: Of the joint that leads [rad/s^2, rad/s].
RESERVED = taken(
    """
    abs acos and as asin assert atan atan2 break case ceil const continue conveyor_pulse_decode cos d2r def
    default elif else end enter_critical eval exec exit_critical false floor force function global gripper
    halt if in inf interpolate_pose inv inverse join kill length list local lock log make_list mod movec
    movej movel movep nan none norm normalize not optimovej optimovel or pass pi point_dist popup pose
    position_deviation_warning pow powerdown r2d random rename reset_revolution_counter return rotvec2rpy
    rpc_factory rpy2rotvec run screw_driving sec servo servoc servoj sin size sleep speedj speedl sqrt stopj
    stopl struct switch sync tan teach_mode textmsg thread transpose true type unlock while wrench_trans xor
    zero_ftsensor
    """,
    "(get|set|end|is|read|write|socket|modbus|rtde|encoder|path_offset|track_conveyor|stop|pose|str|to)_[a-z0-9_]*",
    "(force|freedrive|high_holding_torque|integer|binary|collision|pause|request|ft|tool|enable|disable)_[a-z0-9_]*",
)
"""Words of the language, and its functions: most of their names begin alike."""


def lines(name: str, q: Array, joints: Sequence[Joint], labels: Sequence[str] = ()) -> Iterator[str]:
    """A program that stops in every point.

    Args:
        name: Of the program.
        q: Joints of every point, (points, 6) [rad], as the model counts them.
        joints: Whose they are.
        labels: A comment a point, or none.

    Yields:
        Its lines.

    Raises:
        BenchError: When the arm has not six joints that turn.
    """
    q = check_moves(q, joints, labels)
    slides = sum(joint.prismatic for joint in joints)
    if len(joints) != MAIN or slides:
        got = f"{len(joints)}, {slides} of them slides"
        raise BenchError(f"URScript: expected an arm of {MAIN} joints that turn, got {got}")
    yield f"def {identifier(name, LONGEST, RESERVED)}():"
    yield f"  # joints [rad]: {', '.join(plain(joint.name) for joint in joints)}"
    for k, point in enumerate(q):
        if labels:
            yield f"  # {comment(k + 1, labels[k])}"
        yield f"  movej([{', '.join(numbers(point, DECIMALS))}], a={ACCELERATION}, v={SPEED})"
    yield "end"
