"""KUKA KRL: a .src of PTP moves by axes, A1 to A6 and E1 on, in degrees and millimetres."""

from collections.abc import Iterator, Sequence

import numpy as np

from testbench.arm.folder import Joint
from testbench.data.motion.words import check_moves, comment, identifier, numbers, plain, split_axes, taken
from testbench.errors import Array

LONGEST = 24  #: Characters of a name.
DECIMALS = 8
"""Of a degree or millimetre; the controller keeps some seven digits of them (REAL)."""
SPEED, ACCELERATION = 10, 20  #: Share of what every axis can do [%].
RESERVED = taken(
    """
    ABS ACOS AND ANIN ANOUT ATAN2 AXIS B_AND B_EXOR B_NOT B_OR BAS BASE BOOL BRAKE C_DIS C_ORI C_PTP C_VEL
    CASE CAST_FROM CAST_TO CCLOSE CHANNEL CHAR CIRC CIRC_REL CONFIRM CONST CONTINUE COPEN COS CREAD CWRITE
    DECL DEF DEFAULT DEFDAT DEFFCT DELAY DIGIN DISTANCE DO E3AXIS E3POS E6AXIS E6POS ELSE END ENDDAT ENDFCT
    ENDFOR ENDIF ENDLOOP ENDSPLINE ENDSWITCH ENDWHILE ENUM EXIT EXOR EXT EXTFCT FALSE FOR FORWARD FRAME
    FRAMES GLOBAL GOTO HALT IF IMPORT INI INITMOV INT INTERRUPT INVERSE IS LIN LIN_REL LOAD LOOP MAXIMUM
    MINIMUM MODUS_T NOT OFF ON OR PATH POS PRIO PTP PTP_REL PUBLIC PULSE REAL REPEAT RESUME RETURN SCIRC SEC
    SIGNAL SIN SLIN SPL SPLINE SPTP SQRT STATE_T STRUC SWITCH SYNC TAN THEN TO TOOL TRIGGER TRUE UNTIL VAR
    WAIT WHEN WHILE
    """,
    "STR[A-Z]+",
)
"""Words of the language, and names of its types and functions."""


def lines(name: str, q: Array, joints: Sequence[Joint], labels: Sequence[str] = ()) -> Iterator[str]:
    """A program that stops in every point.

    Args:
        name: Of the program; the file must be called the same, see `identifier`.
        q: Joints of every point, (points, n) [rad, m], as the model counts them.
        joints: Whose they are.
        labels: A comment a point, or none.

    Yields:
        Its lines.

    Raises:
        BenchError: When KRL has no place for so many joints.
    """
    q = check_moves(q, joints, labels)
    main, external = split_axes(joints)
    axes = [f"A{k + 1}" for k in range(len(main))] + [f"E{k + 1}" for k in range(len(external))]
    order = [*main, *external]
    yield f"DEF {identifier(name, LONGEST, RESERVED)}()"
    for axis, joint in zip(axes, (joints[k] for k in order), strict=True):
        yield f"; {axis} is {plain(joint.name)} [{joint.shown_unit}]"
    yield from ("BAS(#INITMOV,0)", f"BAS(#VEL_PTP,{SPEED})", f"BAS(#ACC_PTP,{ACCELERATION})")
    shown = np.array([joints[k].shown for k in order])
    for k, point in enumerate(q[:, order] * shown):
        if labels:
            yield f"; {comment(k + 1, labels[k])}"
        moved = ",".join(f"{a} {x}" for a, x in zip(axes, numbers(point, DECIMALS), strict=True))
        yield f"PTP {{{moved}}}"
    yield "END"
