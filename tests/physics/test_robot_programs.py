"""Programs in robot languages: read, and corrected in their own text, numbers alone."""

import re
from dataclasses import replace

import numpy as np
import pytest
from run_here import ROOT
from scipy.spatial.transform import Rotation
from unsure import unsure

from testbench.arm.folder import build_joint_map, find_arm, load_arm
from testbench.correct.newton import Aim
from testbench.errors import BenchError, InputError
from testbench.files.languages import (
    FLAGS,
    MARK,
    changed_texts,
    known_languages,
    language_of,
    read_language,
    read_motions,
    with_mark,
)
from testbench.files.mapping import Controller
from testbench.files.motion import Motion, write_moves
from testbench.files.program import changed_numbers, read_program, read_robot_program
from testbench.model.vjm import tool_poses
from testbench.workflows.program import (
    conversion_notes,
    correct_program,
    output_files,
    refuse_corrected,
    turn_notes,
    with_payload,
    write_corrected,
)

ARM = load_arm(find_arm("kr500_l480"))
#: A pendant that counts joint 3 from the horizontal, as FANUC's do.
COUPLED = replace(
    ARM, joint_map=build_joint_map(ARM.joints, {"joint_3": {"joint_3": 1.0, "joint_2": -1.0}}, {})
)
ROUND_TRIP = 1e-6  #: What reading back may lose [rad, m].
NAMES = sorted(known_languages())

DAT = """\
&ACCESS RVP
DEFDAT CELL
EXT BAS (BAS_COMMAND :IN,REAL :IN )
DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}
DECL E6AXIS XP1={A1 10.0,A2 -80.5,A3 95.25,A4 5.0,A5 30.0,A6 -10.0,E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}
DECL E6POS XP2={X 2150.0,Y -300.0,Z 1300.0,A 10.0,B 75.0,C -12.5,S 2,T 35,E1 0.0,E2 0.0}
ENDDAT
"""
SRC = """\
&ACCESS RVP
DEF CELL( )
;FOLD PTP HOME Vel=100 % DEFAULT;%{PE}%R 8.3.22,%MKUKATPBASIS,%CMOVE,%VPTP
PTP  XHOME
;ENDFOLD
;FOLD PTP P1 Vel=100 % PDAT1 Tool[1] Base[0]
FDAT_ACT=FP1
PTP XP1 C_PTP ; die erste Bohrung: {A1 0}
;ENDFOLD
LIN XP2
LIN {X 2150.5, Y -280, Z 1300, A 1.0E1, B 75, C -12.5} C_DIS
$OUT[3]=TRUE
WAIT SEC 0.5
PTP {A1 12,A2 -80,A3 95,A4 5,A5 30,A6 -10}
PTP $AXIS_ACT
END
"""
MOD = """\
MODULE Cell
  CONST robtarget p20:=[[2150,-300,1300],[0.7799,-0.1388,0.5953,0.1348],[0,0,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PERS jointtarget jHome:=[[10,-80.5,95.25,5,30,-10],[9E9,9E9,9E9,9E9,9E9,9E9]]; ! MoveC nie
  PROC main()
    TPWrite "MoveC p1 ! no";
    MoveAbsJ jHome\\NoEOffs,v100,fine,tDrill;
    MoveL p20,v50,z10,tDrill\\WObj:=wobj0;
    MoveJ [[2150.5,-280,1300],[0.7799,-0.1388,0.5953,0.1348],[0,0,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v50,z10,
      tDrill\\WObj:=wobj0;
    SetDO doDrill,1;
  ENDPROC
ENDMODULE
"""
SCRIPT = """\
def cell():
  set_tcp(p[0,0,0,0,0,0])
  global P1_q=[0.17, -1.40, 1.66, 0.09, 0.52, -0.17]
  global P2_p=p[2.15, -0.30, 1.30, 0.1, 1.3, -0.2]
  movej(P1_q, a=1.4, v=1.05) # movec(p[0,0,0,0,0,0])
  movej(get_inverse_kin(P2_p, qnear=P1_q), a=1.4, v=1.05)
  textmsg("movel(P3")
  movel(p[2.15, -0.28, 1.30, 1E-1, 1.3, -0.2], a=1.2, v=0.25, r=0.01)
end
"""
LS = """\
/PROG  CELL
/ATTR
COMMENT\t\t= "Bohren; C P[9]";
LINE_COUNT\t= 5;
/MN
   1:  UTOOL_NUM=1 ;
   2:  !C P[1] is a comment ;
   3:J PR[1:HOME] 50% FINE    ;
   4:J @P[1] 100% CNT100    ;
   5:L P[2:drill] 100mm/sec FINE    ;
   6:  DO[1]=ON ;
   7:L P[3] 100mm/sec FINE    ;
/POS
P[1:"home"]{
   GP1:
\tUF : 0, UT : 1,\t
\tJ1=    10.000 deg,\tJ2=   -80.500 deg,\tJ3=    95.250 deg,
\tJ4=     5.000 deg,\tJ5=    30.000 deg,\tJ6=   -10.000 deg
};
P[2]{
   GP1:
\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX =  2150.000  mm,\tY =  -300.000  mm,\tZ =  1300.000  mm,
\tW =   -12.500 deg,\tP =    75.000 deg,\tR =    10.000 deg
};
P[3]{
   GP1:
\tUF : 0, UT : 1,\t
\tJ1=    12.000 deg,\tJ2=   -80.000 deg,\tJ3=    95.000 deg,
\tJ4=     5.000 deg,\tJ5=    30.000 deg,\tJ6=   -10.000 deg
};
/END
"""
JBI = """\
/JOB
//NAME CELL
//POS
///NPOS 3,0,0,0,0,0
///TOOL 1
///POSTYPE ANGLE
///ANGLE
C00000=10.0000,-80.5000,95.2500,5.0000,30.0000,-10.0000
///POSTYPE PULSE
///PULSE
C00001=13653,-91022,108089,3413,20480,-6827
///POSTYPE ROBOT
///RECTAN
///RCONF 1,0,0,0,0,0,0,0
C00002=2150.000,-300.000,1300.000,-12.5000,75.0000,10.0000
//INST
///DATE 2026/09/14 09:01
///ATTR SC,RW
///GROUP1 RB1
NOP
'MOVC C00000 is a comment
MOVJ C00000 VJ=10.00
MOVJ C00001 VJ=10.00
DOUT OT#(1) ON
MOVL C00002 V=100.0 PL=0
END
"""
#: Files, lines of the moves, kinds of the moves, and which points are poses; for each language.
PROGRAMS = {
    "krl": ({"cell.src": SRC, "cell.dat": DAT}, [8, 10, 11, 14], "jllj", "jppj"),
    "rapid": ({"cell.mod": MOD}, [6, 7, 8], "jlj", "jpp"),
    "urscript": ({"cell.script": SCRIPT}, [5, 6, 8], "jjl", "jpp"),
    "fanuc": ({"cell.ls": LS}, [9, 10, 12], "jll", "jpj"),
    "inform": ({"cell.jbi": JBI}, [22, 23, 25], "jjl", "jjp"),
}
MOTORS = Controller(pulses_per_deg=[4096 / 3] * 3 + [2048 / 3] * 3)
FIRST = np.radians([10, -80.5, 95.25, 5, 30, -10])
AT, TURNED = [2.15, -0.3, 1.3], Rotation.from_euler("ZYX", [10, 75, -12.5], degrees=True).as_matrix()


def written(folder, files, newline="\n"):
    """Write files in a controller's line ends; return the first."""
    for name, text in files.items():
        (folder / name).write_bytes(text.replace("\n", newline).encode("cp1252"))
    return folder / next(iter(files))


def read(path, arm=ARM, controller=MOTORS):
    return read_robot_program(path, language_of(path), arm, controller)


@pytest.mark.parametrize("arm", [ARM, COUPLED], ids=["plain", "coupled"])
@pytest.mark.parametrize("name", NAMES)
def test_joints_and_poses_of_both_kinds_of_moves_are_read_back(name, arm, tmp_path):
    """Written by the template, read, moved in the text, and read again."""
    language, n = known_languages()[name], 12
    rng = np.random.default_rng(5)
    q = arm.draw_poses(rng, n)
    p, R = rng.uniform(-3, 3, (n, 3)), Rotation.random(n, rng=rng).as_matrix()
    R[3] = Rotation.from_euler("ZYX", [30, 90, 0], degrees=True).as_matrix()  # two axes coincide
    linear, posed = np.arange(n) % 2 == 1, np.arange(n) % 4 > 0
    file = tmp_path / f"way{language.suffix}"
    write_moves(
        file, language, Motion(arm.to_file_joints(q), arm.file_joints, ["x"] * n, linear, posed, p, R)
    )
    for moved in (0.0, 2e-3):
        found = read(file, arm)
        np.testing.assert_array_equal(found.content.linear, linear)
        np.testing.assert_array_equal(found.content.posed, posed)
        np.testing.assert_allclose(found.q[~posed], q[~posed], rtol=0, atol=ROUND_TRIP)
        np.testing.assert_allclose(found.position[posed], p[posed], rtol=0, atol=ROUND_TRIP)
        np.testing.assert_allclose(found.rotation[posed], R[posed], rtol=0, atol=ROUND_TRIP)
        q = arm.clip_to_limits(q + moved)
        p = p + moved
        R = Rotation.from_rotvec([0, moved, moved]).as_matrix() @ R
        [(_, content)] = changed_texts(found.content.text, changed_numbers(found.content, arm, q, p, R))
        file.write_bytes(content)
    assert np.abs(np.degrees(arm.to_file_joints(q)[0]) - re_read(file, name, arm)).max() < 1e-6


def re_read(file, name, arm):
    """Joints of the first point as the pendant shows them [deg], read without the library."""
    text = file.read_text()
    if name in ("krl", "fanuc"):
        axes = "A" if name == "krl" else "J"
        return np.array([float(re.search(rf"\b{axes}{k}\s?=?\s?([-\d.]+)", text)[1]) for k in range(1, 7)])
    found = re.search(
        {"rapid": r"J \[\[(.*?)\]", "urscript": r"j\(\[(.*?)\]", "inform": "C00000=(.*)"}[name], text
    )
    numbers = np.array(found[1].split(","), dtype=float)
    return np.degrees(numbers) if name == "urscript" else numbers


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("name", NAMES)
def test_a_program_is_read_move_by_move_and_its_text_stays_but_for_numbers(name, newline, tmp_path):
    files, lines, moves, points = PROGRAMS[name]
    path = written(tmp_path, files, newline)
    found = read(path)
    assert found.content.text.lines.tolist() == lines
    assert ["jl"[int(own)] for own in found.content.linear] == list(moves)
    assert ["jp"[int(own)] for own in found.content.posed] == list(points)
    first = [0.17, -1.40, 1.66, 0.09, 0.52, -0.17] if name == "urscript" else FIRST
    np.testing.assert_allclose(found.q[0], first, rtol=0, atol=1e-12)
    pose = points.index("p")
    np.testing.assert_allclose(found.position[pose], AT, rtol=0, atol=1e-12)
    turned = Rotation.from_rotvec([0.1, 1.3, -0.2]).as_matrix() if name == "urscript" else TURNED
    np.testing.assert_allclose(found.rotation[pose], turned, rtol=0, atol=2e-4)  # four digits
    for source, content in rewritten(found, found.q + 1e-3, found.position + 1e-3, found.rotation):
        before = source.path.read_bytes()
        number = rb"[-+]?\d+\.?\d*(E\d)?"
        assert content != before or source.path.suffix == ".src"
        assert re.sub(number, b"#", content) == re.sub(number, b"#", before)
        for end in (b"Vel=100", b"MoveC", b"a=1.4", b"T 35", b"///NPOS 3"):
            assert content.count(end) == before.count(end)


REFUSED = {
    "krl": {
        "CIRC XP1,XP2": "circular motion is not read, got CIRC",
        "SPLINE": "spline is not read",
        "PTP_REL {A1 5}": "relative motion is not read, got PTP_REL",
        "XP1.A1=XP1.A1+1": "point that changes while the program runs",
        "PTP XP9": "expected a point whose coordinates are in the program or in cell.dat",
        "LIN XP1:XP2": "got 'XP1:XP2'",
        "PTP {A1 12,5,A2 -80,A3 95,A4 5,A5 30,A6 -10}": "got '{A1 12,5,A2 -80",
        "PTP {A1 5}": "expected a number for each of A1, A2, A3, A4, A5, A6, got none for A2",
        "$BASE=BASE_DATA[1]\n$BASE=BASE_DATA[2]": r"the base changes: .* got 1 and then 2",
        "$BASE=BASE_DATA[1]:{X 0}\n$BASE=BASE_DATA[1]:{X 9}": r"the base changes: .*\{X 0\} and then",
        "BAS(#BASE,1)\n$BASE=BASE_DATA[2]": "the base changes: .* got 1 and then 2",
        "$BASE=EK(MACHINE_DEF[2].ROOT,2,{X 0})": "base that moves with an external axis is not read",
        "$BASE.Z=$BASE.Z+9": r"tool or base that changes while the program runs is not read, got \$BASE",
        "BASE_DATA[1].Z=9": "tool or base that changes while the program runs",
        "XP1=XP2": "point that changes while the program runs is not read, got XP1=XP2",
        "PTP {A1 12,A2 80,A3 95,A4 5,A5 30,A6 -10}": "joint_2: expected -130.* to 20.0000 deg, got 80",
    },
    "rapid": {
        "MoveC p20,p20,v1,fine,tDrill;": "circular motion is not read, got MoveC",
        "MoveExtJ jHome,v1,fine;": "motion is not read, got MoveExtJ",
        "TriggL p20,v1,t1,fine,tDrill;": "process motion is not read, got TriggL",
        "MoveL Offs(p20,0,0,5),v1,fine,tDrill;": r"relative motion is not read, got Offs\(",
        "PDispSet pose1;": "shift of the program is not read",
        "wFix.oframe:=pShift;": "that changes while the program runs",
        "jHome:=CJointT();": "point that changes while the program runs is not read, got jHome:=CJ",
        "PERS tooldata tFix:=[FALSE,[[0,0,9],[1,0,0,0]],load0];": "tool that does not move",
        "MoveL p{1},v1,fine,tDrill;": "expected a point whose coordinates are in the program, got 'p{1}",
        "MoveL p20,v1,fine,tMill\\WObj:=wobj0;": "the tool changes: .* tDrill and then tMill",
        "MoveL p20,v1,fine,tDrill\\WObj:=wPart;": "the base changes: .* wobj0 and then wPart",
    },
    "urscript": {
        "  movec(P2_p, P2_p)": "circular motion is not read, got movec",
        "  movep(P2_p)": "motion is not read, got movep",
        "  movel(pose_trans(P2_p, p[0,0,0,0,0,0]))": "relative motion is not read, got pose_trans",
        "  movej([0.17+0.1, -1.4, 1.6, 0, 0.5, 0])": r"got '\[0.17\+0.1",
        "  set_tcp(p[0,0,0.1,0,0,0])": "the tool changes",
        "  P1_q[0]=P1_q[0]+0.1": "point that changes while the program runs is not read, got P1_q",
        "  path_offset_enable()": "motion is not read, got path_offset_enable",
        "  movel(other)": "expected a point whose coordinates are in the program, got 'other",
        "  P1_q=[0,0,0,0,0,0]": "the program defines the point P1_q twice",
    },
    "fanuc": {
        "   8:C P[1]    ;": "circular motion is not read",
        "   8:S P[1] 100mm/sec FINE ;": "spline is not read",
        "   8:L P[1] 100mm/sec FINE INC ;": "relative motion is not read",
        "   8:L P[1] 100mm/sec FINE Offset,PR[2] ;": "shift of a point is not read",
        "   8:L P[1] 100mm/sec FINE\n    :  Tool_Offset,PR[2] ;": "shift of a point is not read",
        "   8:L P[1] 100mm/sec FINE RTCP ;": "motion about an external tool",
        "   8:  UFRAME[1]=PR[3] ;": "tool or base that changes while the program runs",
        "   8:  P[1]=PR[4] ;": r"point that changes while the program runs is not read, got P\[1\]=PR",
        "   8:  UTOOL_NUM=2 ;": "the tool changes: .* 1 and then 2",
        "   8:L P[7] 100mm/sec FINE ;": r"got 'P\[7\]",
    },
    "inform": {
        "MOVC C00000 V=1.0": "circular motion is not read, got MOVC",
        "MOVS C00000 V=1.0": "spline is not read, got MOVS",
        "IMOV P001 V=1.0": "relative motion is not read, got IMOV",
        "SFTON P000": "shift of the program is not read",
        "MOVJ C00009 VJ=1.0": "expected a point whose coordinates are in the program, got 'C00009",
        "MOVL C00000 V=1.0  +MOVL C00001 V=1.0": "motion of several robots",
        "MFRAME UF#(1) C00000 C00001 C00002": "tool or base that changes while the program runs",
        "///TOOL 2": "the tool changes: .* 1 and then 2",
    },
}


@pytest.mark.parametrize(("name", "statement"), [(name, own) for name in REFUSED for own in REFUSED[name]])
def test_what_is_no_plain_move_is_refused_with_its_line_and_its_name(name, statement, tmp_path):
    files, lines, *_ = PROGRAMS[name]
    first, *rest = files
    rows = files[first].split("\n")
    rows[lines[-1] - 1 : lines[-1] - 1] = statement.split("\n")
    path = written(tmp_path, {first: "\n".join(rows), **{own: files[own] for own in rest}})
    line, said = lines[-1] + statement.count("\n"), REFUSED[name][statement]
    with pytest.raises(InputError, match=rf"cell\.\w+: line ({line}|{lines[-1]}|5|6): .*{said}"):
        read(path)


def test_pulses_need_those_per_degree_and_are_whole(tmp_path):
    path = written(tmp_path, PROGRAMS["inform"][0])
    found = read(path)
    np.testing.assert_allclose(np.degrees(found.q[1]), [10, -66.67, 79.17, 5, 30, -10], atol=0.01)
    [(_, content)] = rewritten(found, found.q + 1e-3, found.position, found.rotation)
    assert re.search(rb"C00001=13731,", content.replace(b".00000000", b""))
    with pytest.raises(InputError, match=r"line 11: joints are pulses: expected pulses_per_deg of 6 motors"):
        read(path, controller=Controller())


def test_poses_count_in_the_base_and_of_the_tool_that_a_map_states(tmp_path):
    path = written(tmp_path, PROGRAMS["krl"][0])
    base, tool = [1000, 200, 30, 90, 0, 0], [0, 0, 150, 0, 90, 0]
    plain = read(path)
    found = read(path, controller=Controller(base=base, tool=tool))
    R_base, R_tool = (Rotation.from_euler("ZYX", own[3:], degrees=True).as_matrix() for own in (base, tool))
    R = R_base @ plain.rotation[1] @ R_tool.T
    np.testing.assert_allclose(found.rotation[1], R, atol=1e-12)
    at = np.array([1.0, 0.2, 0.03]) + R_base @ plain.position[1] - R @ [0, 0, 0.15]
    np.testing.assert_allclose(found.position[1], at, atol=1e-12)
    [_, (_, content)] = rewritten(found, found.q, found.position, found.rotation)
    assert content == (tmp_path / "cell.dat").read_bytes()
    with pytest.raises(InputError, match=r"controller.base: expected 6 numbers as a pose in KUKA KRL, got 7"):
        read(path, controller=Controller(base=[0.0] * 7))


def test_a_point_of_two_moves_needs_one_correction(tmp_path):
    path = written(tmp_path, {"cell.src": SRC.replace("WAIT SEC 0.5", "PTP XP1"), "cell.dat": DAT})
    found = read(path)
    changed_numbers(found.content, ARM, found.q, found.position, found.rotation)
    q = found.q.copy()
    q[0] += 1e-3
    with pytest.raises(InputError, match=r"lines 8 and 13 share the point XP1 but need .*: copy"):
        changed_numbers(found.content, ARM, q, found.position, found.rotation)


def rewritten(found, q, p, R):
    """Files of a program, each with its content when its points are moved there."""
    return changed_texts(found.content.text, changed_numbers(found.content, ARM, q, p, R))


@pytest.fixture(scope="module")
def model(kr500):
    return unsure(kr500)


def corrected(model, path, **asked):
    """A program and its correction under 300 kg."""
    program, _ = with_payload(model, read_program(path, model.arm), 300.0)
    return program, correct_program(model, program, Aim(), **asked)


@pytest.mark.parametrize("name", NAMES)
def test_a_corrected_program_puts_the_loaded_tool_where_the_program_means(name, model, tmp_path):
    """As a table of the same joints is corrected; from one of them into every other language."""
    language, arm = known_languages()[name], model.arm
    q = np.radians([[10, -80.5, 95.25, 5, 30, -10], [12, -80, 95, 6, 31, -10], [14, -79, 94, 7, 32, -11]])
    p, R = tool_poses(model.vjm, q)
    posed = np.array([False, True, True])
    path = tmp_path / f"way{language.suffix}"
    write_moves(path, language, Motion(q, arm.joints, (), posed, posed, p, R))
    program, found = corrected(model, path)
    refuse_corrected(program)
    rows = [[j.display_column for j in arm.joints], *(map(repr, row) for row in np.degrees(q).tolist())]
    (table := tmp_path / "way.csv").write_text("\n".join(map(",".join, rows)))
    wanted = corrected(model, table)[1].found.q
    assert np.abs(wanted - q).max() > 1e-4
    np.testing.assert_allclose(found.found.q, wanted, rtol=0, atol=1e-7)
    at, turned = tool_poses(model.vjm, wanted)
    for form in NAMES if name == "urscript" else (name,):
        out = tmp_path / f"right{known_languages()[form].suffix}"
        write_corrected(found, output_files(out, form, path), form)
        again = read(out)
        [line] = [k for k, text in enumerate(out.read_text().splitlines(), 1) if "Corrected by" in text]
        with pytest.raises(InputError, match=rf"right\.\w+: line {line}: the program was corrected before"):
            refuse_corrected(read_program(out, arm))
        assert re.match(known_languages()[form].begins, out.read_bytes().decode())
        by_pose = again.content.posed
        keeps_poses = form == name or form in ("krl", "rapid")
        np.testing.assert_array_equal(by_pose, posed & keeps_poses)
        np.testing.assert_array_equal(again.content.linear, posed)
        np.testing.assert_allclose(again.q[~by_pose], wanted[~by_pose], rtol=0, atol=ROUND_TRIP)
        if by_pose.any():
            np.testing.assert_allclose(again.position[by_pose], at[by_pose], rtol=0, atol=ROUND_TRIP)
            np.testing.assert_allclose(again.rotation[by_pose], turned[by_pose], rtol=0, atol=ROUND_TRIP)
    write_corrected(found, [tmp_path / "right.csv"], "csv")
    again = read_program(tmp_path / "right.csv", arm)
    np.testing.assert_allclose(again.q, wanted, rtol=0, atol=1e-7)
    with pytest.raises(InputError, match=r"right\.csv: line 1: the program was corrected before"):
        refuse_corrected(again)


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("name", NAMES)
def test_the_remark_that_a_program_was_corrected_is_a_line_of_its_own_in_every_file(name, newline, tmp_path):
    language, path = known_languages()[name], written(tmp_path, PROGRAMS[name][0], newline)
    assert read_motions(path, language).mark is None
    for source in read_motions(path, language).sources:
        lines = with_mark(source.text, language).split(newline)
        [k] = [k for k, line in enumerate(lines) if MARK in line]
        assert lines[k] == language.remark.format(MARK)
        assert newline.join(lines[:k] + lines[k + 1 :]) == source.text
        assert re.match(language.remark_after, lines[k - 1], FLAGS)
        source.path.write_bytes(newline.join(lines).encode(source.encoding))
    assert read_motions(path, language).mark[0] == path
    for source in read_motions(path, language).sources[:1]:  # the file of points says so, too
        source.path.write_text(source.text.replace(MARK, ""), source.encoding, newline="")
    beside = read_motions(path, language).mark
    assert beside == ((path.with_suffix(".dat"), 3) if name == "krl" else None)


def test_a_pose_whose_joint_passes_a_turn_is_named(model, tmp_path):
    q = np.radians([[10, -80.5, 95.25, 0.0, 30, -10]] * 2)
    q[1, 3] = 1e-7
    p, R = tool_poses(model.vjm, q)
    path = tmp_path / "way.src"
    write_moves(path, known_languages()["krl"], Motion(q, ARM.joints, (), None, np.array([True, True]), p, R))
    program, found = corrected(model, path, start=q[0])
    signs = [np.floor(own[:, 3] / (2 * np.pi)) for own in (found.found.programmed_q, found.found.q)]
    expected = [line for line, a, b in zip(program.line, *signs, strict=True) if a != b]
    [note] = turn_notes(found) or [""]
    assert [int(x) for x in re.findall(r"\d+", note)] == expected


FLIPPED = np.radians([[10, -80, 95, 5, 30, -10], [10, -80, 95, -175, -30, 170]])
"""The same pose of the tool by both configurations of the wrist."""


@pytest.mark.parametrize("q", FLIPPED, ids=["near zero", "flipped"])
@pytest.mark.parametrize("name", ["krl", "rapid"])
def test_flags_of_a_joint_move_choose_the_configuration_and_stay(name, q, model, tmp_path):
    """From nothing, and behind joints of the other configuration; a linear move goes on as it was."""
    language, other = known_languages()[name], FLIPPED[FLIPPED[:, 4] != q[4]]
    joints, poses = np.array([other[0], q, q, q + 0.01]), np.array([False, True, True, True])
    p, R = tool_poses(model.vjm, joints)
    path = tmp_path / f"way{language.suffix}"
    for some in (slice(None), slice(1, None)):
        linear = np.array([False, False, False, True])[some]
        motion = Motion(joints[some], ARM.joints, (), linear, poses[some], p[some], R[some])
        write_moves(path, language, motion)
        flags = f"T {sum(2**k for k in range(6) if q[k] < 0)}"
        if name == "krl":
            path.write_text(re.sub(r"(C [-\d.]+)\}", rf"\1,S 2,{flags}}}", path.read_text()))
        _, found = corrected(model, path)
        np.testing.assert_allclose(found.found.programmed_q, joints[some], rtol=0, atol=1e-6)
        write_corrected(found, output_files(tmp_path / f"right{language.suffix}", name, path), name)
        pattern = r"S 2,T \d+" if name == "krl" else r"\],\[(?:-?\d,){3}-?\d\]"
        right = tmp_path / f"right{language.suffix}"
        assert re.findall(pattern, right.read_text()) == re.findall(pattern, path.read_text())
    if name == "krl":
        path.write_text(path.read_text().replace(flags, "T 1"))
        none = r"way\.src: line \d+: no joint angles of this pose have the stated T"
        with pytest.raises(InputError, match=none):
            correct_program(model, read_program(path, model.arm), Aim())


@pytest.mark.parametrize("name", ["fanuc", "inform"])
def test_a_configuration_that_is_not_read_has_to_stay_the_same_and_needs_a_start(name, model, tmp_path):
    language, posed = known_languages()[name], np.array([True, True])
    q = FLIPPED[[0, 0]] + [[0], [0.01]]
    path = tmp_path / f"way{language.suffix}"
    write_moves(path, language, Motion(q, ARM.joints, (), None, posed, *tool_poses(model.vjm, q)))
    program, said = read_program(path, model.arm), language.flags.name
    found = correct_program(model, program, Aim(), start=q[0]).found
    np.testing.assert_allclose(found.programmed_q, q, atol=1e-6)
    begins = rf"line \d+: the program begins with a pose: the .*{said} .*--start"
    with pytest.raises(InputError, match=begins):
        correct_program(model, program, Aim())
    text = path.read_text()
    if name == "fanuc":
        text = "F U T".join(text.rsplit("N U T", 1))
    else:
        text = text.replace("C00001=", "///RCONF 0,0,0,0,0,0,0,0\nC00001=")
    path.write_text(text)
    with pytest.raises(InputError, match=rf"line \d+: {said} is not read: expected one configuration"):
        correct_program(model, read_program(path, model.arm), Aim(), start=q[0])


def test_joints_beside_a_pose_choose_its_configuration(model, tmp_path):
    """As Polyscope writes waypoints; without, and with no joints before, the configuration is not known."""
    p, R = tool_poses(model.vjm, FLIPPED)
    pose = ", ".join(map(repr, np.r_[p[1], Rotation.from_matrix(R[1]).as_rotvec()].tolist()))
    text = f"""def way():
  global W_q=[{", ".join(map(repr, FLIPPED[1].tolist()))}]
  global W_p=p[{pose}]
  movej(get_inverse_kin(W_p, qnear=W_q), a=1.4, v=1.05)
  movel(p[{pose}], a=1.2)
end
"""
    (path := tmp_path / "way.script").write_text(text)
    _, found = corrected(model, path)
    np.testing.assert_allclose(found.found.programmed_q, FLIPPED[[1, 1]], rtol=0, atol=1e-6)
    write_corrected(found, [tmp_path / "right.script"], "urscript")
    before, after = (own.read_text().splitlines() for own in (path, tmp_path / "right.script"))
    assert [k for k, line in enumerate(after[2:], 2) if line != before[k - 1]] == [3, 5]
    path.write_text(text.replace(", qnear=W_q", ""))
    with pytest.raises(InputError, match=r"line 3: the program begins with a pose: .*--start"):
        correct_program(model, read_program(path, model.arm), Aim())


WOBJ = 'PERS wobjdata wFix:=[FALSE,TRUE,"",[[900,200,0],[0.7071068,0,0,0.7071068]],[[0,-100,30],[1,0,0,0]]];'
BASE_OF_KRL = "{FRAME: X 1000,Y 200,Z 30,A 90,B 0,C 0}"
FRAMES = {
    "krl by number": (
        "PTP  XHOME",
        f"TOOL_DATA[2]={BASE_OF_KRL}".replace("30", "9")
        + f"\nBASE_DATA[2]={BASE_OF_KRL}\n$BASE=BASE_DATA[2]\nPTP  XHOME",
    ),
    "krl": ("PTP  XHOME", f"$BASE={BASE_OF_KRL}\nPTP  XHOME"),
    "rapid": ("  PROC main", f"  {WOBJ}\n  PROC main"),
}


@pytest.mark.parametrize("form", FRAMES)
def test_poses_count_in_the_base_whose_numbers_the_program_states(form, tmp_path):
    """The same as with that base in a map, which counts more."""
    name = form.split()[0]
    files = {
        own: text.replace("wobj0", "wFix").replace("BASE_NO 0", "FRAME_NO 0")
        for own, text in PROGRAMS[name][0].items()
    }
    first = next(iter(files))
    plain = read(written(tmp_path, files))
    old, new = FRAMES[form]
    (tmp_path / "more").mkdir()
    path = written(tmp_path / "more", {**files, first: files[first].replace(old, new, 1)})
    base = [1000, 200, 30, *([90, 0, 0] if name == "krl" else [0.7071068, 0, 0, 0.7071068])]
    wanted = read(written(tmp_path, files), controller=Controller(base=base))
    found, posed = read(path), plain.content.posed
    assert np.abs(found.position[posed] - plain.position[posed]).max() > 0.5
    for own in (found, read(path, controller=Controller(base=base))):
        np.testing.assert_allclose(own.position[posed], wanted.position[posed], rtol=0, atol=1e-6)
        np.testing.assert_allclose(own.rotation[posed], wanted.rotation[posed], rtol=0, atol=1e-6)
    assert any(note.startswith("The program's base") for note in found.content.notes)
    at, turned = (np.nan_to_num(own) for own in (found.position, found.rotation))
    for source, content in rewritten(found, found.q, at, turned):
        before = source.path.read_bytes()
        assert content.count(b"1000,Y 200") == before.count(b"1000,Y 200")
        assert content.count(b"[900,200,0]") == before.count(b"[900,200,0]")


RAIL = """\
DEF CELL()
PTP {A1 0,A2 -90,A3 90,A4 0,A5 30,A6 0,E1 0}
LIN {X 2000,Y 0,Z 1500,A 0,B 90,C 0,E1 2500.5,E2 0}
END
"""
TWO_GROUPS = "R =    10.000 deg,\tE1=  700.000 mm\n   GP2:\n\tUF : 0, UT : 1,\n\tJ1= 5.000 deg\n"
MOVED = {
    "krl": ({"cell.src": RAIL}, "E1 0 to 2500.5"),
    "rapid": ({"cell.mod": MOD.replace("[9E9,", "[-250,", 1)}, "eax_a -250 to -250"),
    "fanuc": ({"cell.ls": LS.replace("R =    10.000 deg\n", TWO_GROUPS)}, "E1 700 to 700, GP2"),
}


@pytest.mark.parametrize("name", MOVED)
def test_external_axes_that_the_arm_does_not_have_stay_and_are_named(name, tmp_path):
    files, said = MOVED[name]
    path = written(tmp_path, files)
    found = read(path)
    [note] = [note for note in found.content.notes if note.startswith("External axes are unchanged")]
    assert f": {said}. kr500_l480 has no such joint" in note
    program = read_program(path, ARM)
    [lost, *_] = conversion_notes(program, "csv")
    assert f"does not have the external axes {said.split()[0]}" in lost
    assert conversion_notes(program, name) == ()
    q, p, R = (np.nan_to_num(own) for own in (found.q, found.position, found.rotation))
    [(_, content)] = rewritten(found, q + 1e-3, p + 1e-3, R)
    for kept in (b"E1 2500.5", b"[-250,9E9", b"E1=  700.000 mm", b"J1= 5.000 deg"):
        assert content.count(kept) == path.read_bytes().count(kept)


def test_base_and_station_axes_of_inform_stay(tmp_path):
    text = JBI.replace("//INST", "BC00000=5000\nEC00001=1,2\n//INST").replace(
        "MOVJ C00000", "MOVJ C00000 BC00000"
    )
    path = written(tmp_path, {"cell.jbi": text})
    found, plain = read(path), read(written(tmp_path, {"plain.jbi": JBI}))
    np.testing.assert_array_equal(found.q, plain.q)
    assert any(note.startswith("External axes are unchanged: BC, EC") for note in found.content.notes)
    assert not any("are unchanged" in note for note in plain.content.notes)
    [(_, content)] = rewritten(found, found.q + 1e-3, found.position, found.rotation)
    assert b"BC00000=5000\nEC00001=1,2\n" in content
    assert b"MOVJ C00000 BC00000 VJ=10.00" in content


def test_linear_moves_need_poses_where_the_language_has_no_other(tmp_path):
    motion = Motion(np.zeros((1, 6)) + 0.1, ARM.joints, (), np.array([True]))
    with pytest.raises(BenchError, match="KUKA KRL: expected a pose at every linear move"):
        write_moves(tmp_path / "x.src", known_languages()["krl"], motion)
    with pytest.raises(BenchError, match=r"position \[m\], rotation: expected poses of the tool"):
        write_moves(tmp_path / "x.src", known_languages()["krl"], replace(motion, posed=np.array([True])))
    assert not list(tmp_path.iterdir())


def test_the_example_of_the_docs_adds_a_language_by_two_files(tmp_path):
    page = (ROOT / "docs" / "add_language.md").read_text()
    for kind, name in (("toml", "as.toml"), ("jinja", "as.j2")):
        (tmp_path / name).write_text(re.search(rf"```{kind}\n(.*?)```", page, re.DOTALL)[1])
    language, rng = read_language(tmp_path / "as.toml"), np.random.default_rng(2)
    q, p, R = ARM.draw_poses(rng, 8), rng.uniform(-3, 3, (8, 3)), Rotation.random(8, rng=rng).as_matrix()
    linear, posed = np.arange(8) % 2 == 1, np.arange(8) % 4 > 0
    write_moves(tmp_path / "a.as", language, Motion(q, ARM.joints, ["x"] * 8, linear, posed, p, R), tmp_path)
    found = read_robot_program(tmp_path / "a.as", language, ARM, Controller())
    np.testing.assert_allclose(found.q[~posed], q[~posed], rtol=0, atol=ROUND_TRIP)
    np.testing.assert_allclose(found.position[posed], p[posed], rtol=0, atol=ROUND_TRIP)
    np.testing.assert_allclose(found.rotation[posed], R[posed], rtol=0, atol=ROUND_TRIP)
    text = (tmp_path / "a.as").read_text()
    for statement, said in (
        ("  C1MOVE p", "circular motion is not read, got C1MOVE"),
        ("  JMOVE #p", "got '#p'"),
    ):
        (tmp_path / "b.as").write_text(text.replace(".END", f"{statement}\n.END"))
        with pytest.raises(InputError, match=rf"b\.as: line 18: .*{said}"):
            read_robot_program(tmp_path / "b.as", language, ARM, Controller())
    table = (ROOT / "docs" / "tables" / "language_keys.csv").read_text()
    keys = re.findall(r"`(?:\[+)?([a-z_]+)\]*`", table)
    assert set(type(language).model_fields) - {"name"} <= set(keys)
    (tmp_path / "as.toml").write_text('title = "x"\nangle = "grad"\n')
    with pytest.raises(InputError, match=r"as\.toml: source: this key is missing"):
        read_language(tmp_path / "as.toml")
