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
    taken,
)
from testbench.errors import Array

LONGEST = 32  #: Characters of a name.
DECIMALS = 8  #: Of a degree or millimetre; the controller keeps some seven digits of them (num).
PREFIX = "run_"  #: Of the procedure: a module and a procedure in it have different names.
NONE = "9E9"  #: An external axis that is not there.
SPEED = "[100,30,100,30]"
"""Of the tool [mm/s, deg/s] and of external axes [mm/s, deg/s]."""
RESERVED = taken(
    """
    Abs AbsDnum AccSet ACos ActUnit Add aiotrigg ALIAS AliasIO AND ArcMove ArgName ASin ATan ATan2 BACKWARD
    BASE BitAnd BitClear BitOr BitSet BookErrNo bool Break btnres busstate buttondata byte CalcJointT
    CalcRobT CallByVar CASE CDate CJointT Clear ClkRead ClkReset ClkStart ClkStop clock Close cnvcmd
    confdata ConfJ ConfL CONNECT CONST corrdescr Cos CPos CRobT CSpeedOverride CTime CTool CWObj datapos
    DeactUnit Decr DEFAULT DefFrame Dim dionum dir diskhome diskram disktemp Distance DIV dnum DO edge
    egmident ELSE ELSEIF ENDFOR ENDFUNC ENDIF ENDMODULE ENDPROC ENDRECORD ENDTEST ENDTRAP ENDWHILE EOffsOff
    EOffsOn EOffsSet EulerZYX event_type EXIT ExitCycle extjoint FALSE fine fllwtime FOR FROM FUNC GetTime
    GOTO GripLoad handler_type high icondata IDelete identno IDisable IEnable IF Incr INOUT inpos intnum
    iodev iounit_state IsFile IWatch jointtarget listitem Load load0 loaddata loadidnum loadsession LOCAL
    low MAIN mecunit MirPos MOD MODULE MotionSup motsetdata NOrient NOSTEPIN NOT NOVIEW num NumToStr Offs
    opcalc Open OpMode opnum OR orient OrientZYX paridnum paridvalidnum PathAccLim pathrecid PDispOff
    PDispOn PDispSet PERS pi pos pose PoseInv PoseMult PoseVect Pow Present PROC ProcCall progdisp PulseDO
    Quad RAISE Random rawbytes ReadBin ReadNum READONLY ReadStr ReadStrBin RECORD RelTool Reset restartdata
    RestoPath RETRY RETURN Rewind robjoint robtarget Round RunMode Save Set SetAO SetDO SetGO shapedata
    signalai signalao signaldi signaldo signalgi signalgo Sin SingArea SoftAct speeddata SpeedRefresh Sqrt
    StartLoad StartMove STEP Stop StopMove stoppointdata stoptime StorePath supervtype switch symnum
    syncident SYSMODULE Tan TASK taskid tasks TEST TestDI testsignal TextGet THEN TO tool0 tooldata TPErase
    tpnum TPReadFK TPReadNum TPShow TPWrite TRAP trapdata TRUE Trunc TRYNEXT uishownum UNDO UnLoad USER
    ValToStr VAR VelSet VIEWONLY visiondata vmax vMove WaitDI WaitDO WaitSync WaitTime WaitUntil WHILE WITH
    wobj0 wobjdata Write WriteBin WriteStrBin XOR zonedata
    """,
    "[zv][0-9]+",
    "v(lin|rot)[0-9]+",
    "move(abs|ext|c|j|l)[a-z]*",
    "(err|str|evt|tune|socket|trigg|search|wz|cap|uimsg|gi|rmq)_?[a-z0-9_]*",
)
"""Words of the language, its predefined types, data, routines, and the constant of ours."""


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
