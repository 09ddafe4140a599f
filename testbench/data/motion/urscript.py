"""URScript of Universal Robots: a function of movej, six joints in radians."""

from collections.abc import Iterator, Sequence

from testbench.arm.folder import Joint
from testbench.data.motion.words import MAIN, check_moves, comment, identifier, numbers, plain
from testbench.errors import Array, BenchError

LONGEST = 64  #: Characters of a name.
DECIMALS = 11  #: Of a radian.
ACCELERATION, SPEED = 0.5, 0.25  #: Of the joint that leads [rad/s^2, rad/s].
RESERVED = frozenset(
    """
    AND BREAK CONTINUE DEF ELIF ELSE END ENTER_CRITICAL EXIT_CRITICAL FALSE FORCE FREEDRIVE_MODE FUNCTION
    GET_ACTUAL_JOINT_POSITIONS GLOBAL HALT IF JOIN KILL LOCAL MOVEC MOVEJ MOVEL MOVEP NOT OR PASS POPUP
    POWERDOWN RETURN RUN SEC SERVOC SERVOJ SLEEP SPEEDJ SPEEDL STOPJ STOPL STRUCT SYNC TEXTMSG THREAD TRUE
    WHILE XOR
    """.split()
)


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
