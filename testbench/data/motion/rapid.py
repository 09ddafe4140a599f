"""ABB RAPID: a module of MoveAbsJ, axes in degrees, slides and the axes beyond six as external axes."""

from collections.abc import Iterator, Sequence

from testbench.arm.folder import Joint
from testbench.data.motion.words import (
    EXTERNAL,
    MAIN,
    check_moves,
    comment,
    identifier,
    numbers,
    plain,
    split_axes,
)
from testbench.errors import Array

LONGEST = 32  #: Characters of a name.
DECIMALS = 8  #: Of a degree or millimetre; the controller keeps some seven digits of them (num).
PREFIX = "run_"  #: Of the procedure: a module and a procedure in it have different names.
NONE = "9E9"  #: An external axis that is not there.
SPEED = "[100,30,100,30]"
"""Of the tool [mm/s, deg/s] and of external axes [mm/s, deg/s]."""
RESERVED = frozenset(
    """
    ALIAS AND BACKWARD CASE CONNECT CONST DEFAULT DIV DO ELSE ELSEIF ENDFOR ENDFUNC ENDIF ENDMODULE ENDPROC
    ENDRECORD ENDTEST ENDTRAP ENDWHILE ERROR EXIT FALSE FOR FROM FUNC GOTO IF INOUT LOCAL MAIN MOD MODULE
    NOSTEPIN NOT NOVIEW OR PERS PROC RAISE READONLY RECORD RETRY RETURN STEP SYSMODULE TASK TEST THEN TO TRAP
    TRUE TRYNEXT UNDO USER VAR VIEWONLY WHILE WITH XOR BASE
    """.split()
)


def lines(name: str, q: Array, joints: Sequence[Joint], labels: Sequence[str] = ()) -> Iterator[str]:
    """A module whose procedure stops in every point.

    Args:
        name: Of the module; the procedure is called run_NAME.
        q: Joints of every point, (points, n) [rad, m], as the model counts them.
        joints: Whose they are.
        labels: A comment a point, or none.

    Yields:
        Its lines.

    Raises:
        BenchError: When RAPID has no place for so many joints.
    """
    q = check_moves(q, joints, labels)
    main, external = split_axes(joints)
    module = identifier(name, LONGEST - len(PREFIX), RESERVED)
    yield f"MODULE {module}"
    places = [f"rax_{k + 1}" for k in range(len(main))] + [f"eax_{'abcdef'[k]}" for k in range(len(external))]
    for place, k in zip(places, [*main, *external], strict=True):
        yield f"  ! {place} is {plain(joints[k].name)} [{joints[k].shown_unit}]"
    yield f"  LOCAL CONST speeddata vMove:={SPEED};"
    yield f"  PROC {PREFIX}{module}()"
    for k, point in enumerate(q):
        if labels:
            yield f"    ! {comment(k + 1, labels[k])}"
        robot, beside = (
            numbers(point[at] * [joints[i].shown for i in at], DECIMALS) for at in (main, external)
        )
        robot += ["0"] * (MAIN - len(robot))
        beside += [NONE] * (EXTERNAL - len(beside))
        yield f"    MoveAbsJ [[{','.join(robot)}],[{','.join(beside)}]]\\NoEOffs,vMove,fine,tool0;"
    yield "  ENDPROC"
    yield "ENDMODULE"
