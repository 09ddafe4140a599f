"""A robot's program: what acts at its points, where that brings the tool, and the joints that correct it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from testbench.arm.folder import Arm
from testbench.correct.compensated import (
    Compensated,
    InverseKinematics,
    Refusal,
    compensate,
    configurations,
    joints_along_path,
)
from testbench.correct.newton import Aim, CorrectedPart
from testbench.correct.newton import JointMeaning as Meant
from testbench.correct.predicted import (
    LoadExtent,
    Prediction,
    Stiffness,
    compliance_half_widths,
    load_extent,
    predict,
    process_wrench,
    stiffness,
)
from testbench.data.dataset import select_rows
from testbench.errors import Array, BenchError, Ids, InputError, NoEquilibrium
from testbench.files.columns import Columns
from testbench.files.languages import changed_texts, files_of, known_languages, language_of, with_mark
from testbench.files.motion import CSV, Motion, format_of, turn_flags, write_moves
from testbench.files.program import (
    Program,
    RobotMotions,
    changed_numbers,
    flags_agree,
    read_poses,
    read_program,
    refuse_joint_jumps,
    refuse_other_configurations,
    unread_columns,
)
from testbench.files.table import read_table
from testbench.files.write import write_program
from testbench.identify.posterior import ArmModel
from testbench.model.load import Load, weight
from testbench.model.vjm import WorkArea, tool_poses
from testbench.plant.rigid_cell import RigidCell
from testbench.runs.rows import trial_rng
from testbench.runs.whole import Kind, inside
from testbench.workflows.cell import Cell, clear_poses
from testbench.workflows.options import payload_of
from testbench.workflows.plan_input import parse_point, read_loads

T = TypeVar("T")
NAMED = 5  #: Points that a message names; more are counted.
PLACES = 600  #: Poses of the map.
DEFAULT_FORCE = 1000.0  #: Of the map where neither a flag nor the arm's payload says one [N].
OVERLOAD = 1.5  #: Times the payload beyond which a force is said.
SLACK = 1.05  #: Up to so many times the largest load nothing is said.
#: Angles up to which a direction is along an axis, and mostly along it [deg].
ALONG_ANGLE, MOSTLY_ALONG_ANGLE = 10.0, 30.0
PROMISED = "expected_error_mm"  #: Column that only plans have.


@dataclass(frozen=True)
class CorrectedProgram:
    """Hold a program, what acts at its points, and its correction."""

    program: Program
    model: ArmModel
    aim: Aim
    loads: tuple[Load, ...]  #: Each with a row a point.
    found: Compensated

    @property
    def reasons(self) -> tuple[str | None, ...]:
        """Say why points cannot be corrected; None where they are."""
        return tuple(refusal_words(self.model.arm, refusal) for refusal in self.found.refusals)

    @property
    def unreached(self) -> tuple[str, ...]:
        """List points that cannot be corrected, each with its line and its reason."""
        rows = zip(self.program.line, self.program.labels, self.reasons, strict=True)
        return tuple(f"line {line} (point {label}): {why}" for line, label, why in rows if why is not None)


def correct_program(
    model: ArmModel, program: Program, aim: Aim, room: RigidCell | None = None, *, start: Array | None = None
) -> CorrectedProgram:
    """Correct a program, in a room where collisions are to be checked.

    Where it has poses of the tool, `start` are joints near those of the first one, (n,) [rad, m].

    Args:
        model: The model.
        program: The program.
        aim: What is corrected.
        room: Room in which collisions are checked; None for no check.
        start: Joints near those of the first pose, (n,) [rad, m]; None for none.

    Returns:
        The correction.

    Raises:
        InputError: When a set-point is out of the drawn arm's reach, the feed is nowhere, or the arm cannot
            bear a load.
    """
    q = _drawn_joints(model, program, aim, start)
    loads = _loads_of(model, program, aim, q)
    try:
        compensated = compensate(model, q, loads, aim, room)
    except NoEquilibrium as err:
        raise InputError(program.path, "", str(err)) from err
    return CorrectedProgram(program, model, aim, loads, compensated)


def _drawn_joints(model: ArmModel, program: Program, aim: Aim, start: Array | None) -> Array:
    """Joints of the program: its own, or those that bring the drawn arm's tool to its poses."""
    if program.position is None or program.rotation is None:
        assert program.q is not None
        return program.q
    if isinstance(program.content, RobotMotions):
        return _robot_joints(model, program, program.content, start)
    near = start if program.q is None else program.q
    reached = joints_along_path(
        model.vjm, program.position, program.rotation, start=near, point=np.array(aim.tool_point)
    )
    _refuse_far(program, reached, np.arange(program.points))
    if not program.jumps:
        refuse_joint_jumps(program.path, model.arm, program.line, reached.q)
    return reached.q


def _refuse_far(program: Program, reached: InverseKinematics, points: Ids) -> None:
    """Refuse poses of the tool at some points, (k,), that the drawn arm does not reach."""
    far = np.flatnonzero(~reached.converged)
    if len(far):
        missing = 1e3 * np.column_stack([reached.distance_error, reached.angle_error])
        names = [
            "line {} by {:,.2f} mm and {:,.2f} mrad".format(program.line[points[k]], *missing[k])
            for k in far[:NAMED]
        ]
        more = f" and {len(far) - NAMED} more" if len(far) > NAMED else ""
        frames = program.content.unknown_frames if isinstance(program.content, RobotMotions) else ""
        hint = f"; [controller] of a map says where the program's {frames} are" if frames else ""
        raise InputError(program.path, "", f"out of the arm's reach: {', '.join(names)}{more}{hint}")


def _robot_joints(model: ArmModel, program: Program, motions: RobotMotions, start: Array | None) -> Array:
    """Joints of a program in a robot language: each run of poses continues from the joints before it.

    Joints that a move states for its configuration count instead. Where the flags of a joint move to
    a pose state another turn, its configuration is the one of these flags.
    """
    assert program.position is not None
    assert program.rotation is not None
    refuse_other_configurations(motions, started=start is not None)
    q = np.full((program.points, model.arm.n_joints), np.nan) if program.q is None else program.q.copy()
    stated = np.isfinite(motions.near[:, 0])
    ends = np.flatnonzero(np.diff(motions.posed) | stated[1:]) + 1
    for run in np.split(np.arange(program.points), ends):
        near, chosen = q[run[0] - 1] if run[0] else start, False
        if stated[run[0]]:
            near = motions.near[run[0]]
        while len(run) and motions.posed[run[0]]:
            reached = joints_along_path(model.vjm, program.position[run], program.rotation[run], start=near)
            _refuse_far(program, reached, run)
            q[run] = reached.q
            # from the first joint move that its flags put into another turn the rest is found anew
            free = ~motions.linear[run]
            free[0] = not chosen and (free[0] or near is None)
            other = free & ~flags_agree(motions, model.arm, run, reached.q)
            if not other.any():
                break
            run, chosen = run[int(other.argmax()) :], True
            near = _of_flags(model, program, motions, int(run[0]))
    return q


def _of_flags(model: ArmModel, program: Program, motions: RobotMotions, k: int) -> Array:
    """Joints of a pose in the turns of its flags, the nearest to zero, (n,) [rad, m]."""
    assert program.position is not None
    assert program.rotation is not None
    every = configurations(model.vjm, program.position[k], program.rotation[k])
    own = every[flags_agree(motions, model.arm, np.full(len(every), k), every)]
    if not len(own):
        flags = motions.text.language.flags
        name = flags.name if flags else ""
        problem = f"no joint angles of this pose have the stated {name}; correct it, or give joints"
        raise InputError(program.path, f"line {program.line[k]}", problem)
    return np.asarray(own[np.linalg.norm(own, axis=1).argmin()])


def _loads_of(model: ArmModel, program: Program, aim: Aim, q: Array) -> tuple[Load, ...]:
    """Loads at every point, one at least: the process at the tool or where the file says; what hangs."""
    position, rotation = tool_poses(model.vjm, q)
    tip = np.array(aim.tool_point)
    try:
        names = [f"line {line}" for line in program.line]
        spindle = rotation @ np.array(aim.spindle_axis)
        along = process_wrench(program.along, position + rotation @ tip, spindle, names)
    except BenchError as err:
        raise InputError(program.path, "", str(err)) from err
    wrench, at = program.wrench + along, tip if program.point is None else program.point
    hung = [weight(model.vjm, program.mass)] if program.mass.any() else []
    pulls = [Load(wrench, at).for_poses(len(q))] if wrench.any() or not hung else []
    return (*pulls, *hung)


def output_paths(out: Path, report: Path | None) -> tuple[str, Kind, Path]:
    """Tell what a corrected program is written as, and where its report goes.

    Args:
        out: File of the corrected program.
        report: Folder of the report; None for one beside the file.

    Returns:
        "csv" or a robot's language, the kind of file that may be replaced, the folder of the report.

    Raises:
        InputError: When the file has no name, or lies in the folder of the report.
        BenchError: When its suffix is unknown.
    """
    if not out.name:
        raise InputError(out, "", "expected the name of a file, got a folder")
    if report and inside(out, report):
        raise InputError(out, "", f"expected a place outside of {report}, the folder of --report")
    form, named = format_of(out), out.stem if out.suffix == ".csv" else out.name.replace(".", "_")
    kind = Kind("a corrected program", rb"[^\n]*correction_")
    if form != CSV:
        language = known_languages()[form]
        kind = Kind(f"a program in {language.title} that testbench wrote", language.begins.encode())
    return form, kind, report or out.with_name(f"{named}_report")


def refuse_corrected(program: Program) -> None:
    """Refuse a program that was corrected: it would be corrected twice.

    Args:
        program: The program as it was read.

    Raises:
        InputError: Names the file and the line that say so.
    """
    if program.mark is not None:
        path, line = program.mark
        raise InputError(path, f"line {line}", "the program was corrected before: correct the original")


def refuse_unreached(corrected_program: CorrectedProgram) -> None:
    """Refuse a program with points that cannot be put right.

    Raises:
        InputError: Names the first points with their reasons, and the flag that leaves them as they are.
    """
    if corrected_program.unreached:
        named, more = "; ".join(corrected_program.unreached[:NAMED]), len(corrected_program.unreached) - NAMED
        named += f"; and {more} more" if more > 0 else ""
        problem = f"{named}; --keep-unreachable leaves such points as they are"
        raise InputError(corrected_program.program.path, "", problem)


def aim_of(hold: CorrectedPart, asked: Meant | None, tip: str, spindle: str) -> Aim:
    """Make an aim of flags.

    Args:
        hold: What is corrected.
        asked: What the program means; None for the default of the model.
        tip: Tool point in the frame of the tool, x,y,z [m].
        spindle: Where the spindle points in that frame, an axis with its sign.

    Returns:
        The aim.

    Raises:
        BenchError: Names the flag and what was expected.
    """
    signs = (("", 1.0), ("-", -1.0))
    axes = {f"{sign}{name}": s * np.eye(3)[k] for sign, s in signs for k, name in enumerate("xyz")}
    if spindle not in axes:
        raise InputError(Path("--spindle"), "", f"expected one of {', '.join(axes)}, got {spindle!r}")
    x, y, z = axes[spindle].tolist()
    return Aim(hold, asked, parse_point(tip, "--tip x,y,z [m]"), (x, y, z))


def output_files(out: Path, form: str, program: Path) -> list[Path]:
    """List the files of a corrected program: also that of its points, where the program has one beside it.

    Args:
        out: File of the corrected program.
        form: "csv" or a language, by `format_of`.
        program: The program that is corrected.

    Returns:
        The files, the program first.
    """
    language = language_of(program)
    beside = files_of(program, language)[1:] if language and language.name == form else []
    return [out, *(out.with_suffix(file.suffix) for file in beside)]


def input_files(program: Path) -> list[Path]:
    """List the files that a program consists of.

    Args:
        program: A table, or a program in a robot language.

    Returns:
        The file, and that of its points beside it, if there is one.
    """
    language = language_of(program)
    return [program] if language is None else files_of(program, language)


def write_corrected(corrected_program: CorrectedProgram, files: Sequence[Path], form: str) -> None:
    """Write a corrected program, as a table or in a robot's language.

    A program in a robot language stays as it is in its own language, but for the numbers of its points and a
    remark that it was corrected.

    Args:
        corrected_program: The corrected program.
        files: Where it goes, by `output_files`.
        form: "csv" or a language, by `format_of`.

    Raises:
        InputError: If two moves share a point and need different corrections.
        BenchError: If the language has no place for the moves.
    """
    arm = corrected_program.model.arm
    program = corrected_program.program
    q = corrected_program.found.q
    motions = program.content if isinstance(program.content, RobotMotions) else None
    if form == CSV:
        write_program(files[0], program, q, more_columns(corrected_program))
    elif motions is not None and motions.text.language.name == form:
        position, rotation = tool_poses(corrected_program.model.vjm, q)
        changes = changed_numbers(motions, arm, q, position, rotation)
        for file, (source, content) in zip(files, changed_texts(motions.text, changes), strict=True):
            text = with_mark(content.decode(source.encoding), motions.text.language)
            file.write_bytes(text.encode(source.encoding))
    else:
        language = known_languages()[form]
        motion = Motion(arm.to_file_joints(q), arm.file_joints, program.labels, corrected=True)
        if motions is not None and motions.linear.any():
            at = motions.to_program(*tool_poses(corrected_program.model.vjm, q))
            posed = motions.linear & (language.linear_by == "pose")
            motion = replace(motion, linear=motions.linear, posed=posed, position=at[0], rotation=at[1])
        write_moves(files[0], language, motion)


def turn_notes(corrected_program: CorrectedProgram) -> tuple[str, ...]:
    """Name the poses whose flags of turns no longer hold: their corrected joints are in another turn.

    Args:
        corrected_program: The corrected program.

    Returns:
        Sentences without a full stop.
    """
    program, arm = corrected_program.program, corrected_program.model.arm
    if not isinstance(program.content, RobotMotions):
        return ()
    language = program.content.text.language
    hinges = [not joint.prismatic for joint in arm.file_joints]
    before, after = (
        turn_flags(language, arm.to_file_joints(q)[:, hinges])
        for q in (corrected_program.found.programmed_q, corrected_program.found.q)
    )
    turned = program.content.posed & (before != after).any(axis=1)
    if language.flags is None or not turned.any():
        return ()
    lines = ", ".join(map(str, program.line[turned][:NAMED])) + ", ..." * (int(turned.sum()) > NAMED)
    why = "the correction takes a joint past a whole turn"
    return (f"Check {language.flags.name} of the poses in lines {lines}: {why}",)


def conversion_notes(program: Program, form: str) -> tuple[str, ...]:
    """Say what a program in another language, or a table, does not have of the program that it is made from.

    Args:
        program: The program.
        form: "csv" or a language, by `format_of`.

    Returns:
        Sentences, without full stop; none where the program stays in its language.
    """
    motions = program.content
    if not isinstance(motions, RobotMotions) or motions.text.language.name == form:
        return ()
    notes = []
    if motions.kept:
        notes.append(f"The corrected program does not have the external axes {', '.join(motions.kept)}")
    frames = " and ".join(f"{what} {frame.text}" for what, frame in motions.text.frames.items())
    if form != CSV and motions.linear.any() and frames:
        notes.append(f"Poses of the corrected program are in {frames}, which it does not state")
    return tuple(notes)


def configuration_notes(program: Program, start: Array | None) -> tuple[str, ...]:
    """Say which configuration of the arm was chosen where nothing states one.

    Args:
        program: The program.
        start: Joints near those of its first pose, (n,) [rad, m]; None for none.

    Returns:
        A sentence, without full stop; none where the program or the user states a configuration.
    """
    if start is not None or program.q is not None or not isinstance(program.content, Columns):
        return ()
    chosen = "of the arm's configurations, the one with joint values nearest to zero is used"
    another = "Columns of joint values, or compensate --start, choose another"
    return (f"The table has no joint values: {chosen}. {another}",)


def more_columns(corrected_program: CorrectedProgram) -> dict[str, Array | Sequence[str]]:
    """Collect what a corrected program says beside its joints, by column."""
    compensated, arm = corrected_program.found, corrected_program.model.arm
    moved = arm.to_file_joint_change(compensated.q - compensated.programmed_q)
    columns: dict[str, Array | Sequence[str]] = {
        f"correction_{joint.display_column}": joint.display_factor * moved[:, k]
        for k, joint in enumerate(arm.file_joints)
    }
    columns |= {f"before_{x}_mm": 1e3 * compensated.error_before[:, k] for k, x in enumerate("xyz")}
    half = np.where(np.isfinite(compensated.error_half_width), compensated.error_half_width, np.nan)
    columns |= {f"half_95_{x}_mm": 1e3 * half[:, k] for k, x in enumerate("xyz")}
    columns["turn_left_mrad"] = 1e3 * np.linalg.norm(compensated.rotation_error, axis=1)
    columns["left_out"] = [reason or "" for reason in corrected_program.reasons]
    return columns


@dataclass(frozen=True, eq=False)
class PosesWithLoads:
    """Hold poses and their loads."""

    path: Path  #: The file.
    line: Ids  #: Line of every pose in it, (poses,).
    labels: tuple[str, ...]  #: What every pose is called.
    q: Array  #: Joints, (poses, n) [rad, m].
    loads: tuple[Load, ...]  #: With a row a pose.
    hung: Array  #: Mass that hangs, part of the loads, (poses,) [kg].
    notes: tuple[str, ...] = ()  #: How the file was read, sentences without a full stop.

    @property
    def words(self) -> str:
        """Say what acts, for people."""
        loads = self.loads[: -1 if self.hung.any() else None]
        force, moment = (
            np.linalg.norm(sum((load.wrench[:, part] for load in loads), np.zeros((1, 3))), axis=1)
            for part in (slice(0, 3), slice(3, 6))
        )
        parts = ((self.hung, "kg"), (force, "N"), (moment, "N m"))
        return " and ".join(f"{_between(size)} {unit}" for size, unit in parts if size.any())


def _between(values: Array) -> str:
    low, high = (f"{x:.4g}" if abs(x) < 1000 else f"{x:,.0f}" for x in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"


def read_pose_file(path: Path, model: ArmModel, mapping: Path | None, mass: float | None) -> PosesWithLoads:
    """Read poses of a plan or of a program; of a corrected program the commanded joints.

    Args:
        path: Path of the file.
        model: The calibrated arm.
        mapping: Map of the names of a program's columns; None for none.
        mass: Mass that hangs in every pose if the file gives no load [kg]; None for the rated payload.

    Returns:
        The poses with their loads.
    """
    if language_of(path) is None and PROMISED in read_table(path, lambda name: name == PROMISED).names:
        return _of_plan(path, model, mass)
    program = read_program(path, model.arm, mapping, jumps=True)
    aim, notes = Aim(), unread_columns(program)
    if program.corrected:
        notes += ("The program was corrected before, so its points are used as they are",)
        if program.q is not None and not isinstance(program.content, RobotMotions):  # poses are commands, too
            program = replace(program, position=None, rotation=None)
    notes += configuration_notes(program, None)
    program, said = with_payload(model, program, mass)
    q = _drawn_joints(model, program, aim, None)
    loads = _loads_of(model, program, aim, q)
    return PosesWithLoads(path, program.line, program.labels, q, loads, program.mass, (*notes, *said))


def with_payload(model: ArmModel, program: Program, mass: float | None) -> tuple[Program, tuple[str, ...]]:
    """Hang a mass on the tool in every point of a program that gives no load.

    Args:
        model: The calibrated arm.
        program: The program.
        mass: The mass [kg]; None for the rated payload.

    Returns:
        The program, and notes.
    """
    if program.mass.any() or program.wrench.any() or program.along.any():
        return program, ()
    hung, note = _without_load(model, mass)
    return replace(program, mass=np.full(program.points, hung)), (note,)


def _of_plan(path: Path, model: ArmModel, mass: float | None) -> PosesWithLoads:
    """Poses that `testbench plan` wrote, in which a weight hangs or a force pulls."""
    q, (hung, pulls) = read_poses(path, model.arm), read_loads(path)
    notes: tuple[str, ...] = ()
    if hung is None:
        assumed, note = _without_load(model, mass)
        hung, notes = np.full(len(q), assumed), (note,)
    labels = tuple(map(str, range(1, len(q) + 1)))
    forces = (
        [] if pulls is None else [Load(np.hstack([pulls, 0 * pulls]), model.vjm.load_point).for_poses(len(q))]
    )
    return PosesWithLoads(
        path, np.arange(len(q)) + 2, labels, q, (*forces, weight(model.vjm, hung)), hung, notes
    )


def _without_load(model: ArmModel, mass: float | None) -> tuple[float, str]:
    """Find the mass that hangs [kg] if a file gives no load, and say where it is from."""
    hung = payload_of(model.arm, mass, "--load")
    if mass is None:
        return hung, f"The file gives no load, so the rated payload of {hung:g} kg is assumed"
    if not hung:
        return hung, "Neither the file nor --load gives a load"
    return hung, f"The file gives no load: {hung:g} kg of --load hang in every pose"


def _carried(file_poses: PosesWithLoads, some: slice, compute: Callable[[Array, list[Load]], T]) -> T:
    """What follows from some poses and loads; InputError names the line of the first that has no rest."""
    try:
        return compute(file_poses.q[some], [load.select(some) for load in file_poses.loads])
    except NoEquilibrium as err:
        if some.stop - some.start == 1:
            raise InputError(file_poses.path, f"line {file_poses.line[some.start]}", str(err)) from err
        middle = (some.start + some.stop) // 2
        _carried(file_poses, slice(some.start, middle), compute)  # ends here where one of these has none
        return _carried(file_poses, slice(middle, some.stop), compute)


@dataclass(frozen=True)
class StiffnessMap:
    """Hold poses all over the workspace, the softest first."""

    force: float  #: [N].
    q: Array  #: Joints, (places, n) [rad, m].
    position: Array  #: Tool, (places, 3) [m].
    worst: Array  #: How far the force moves the tool in the worst direction, (places,) [m].
    direction: Array  #: That direction, unit vectors, (places, 3).
    #: Half widths of how far it moves the tool along the principal axes, the softest first, (places, 3) [m].
    half: Array


@dataclass(frozen=True, eq=False)
class Predicted:
    """Hold all that is known of the poses that were asked for."""

    model: ArmModel
    cell: Cell  #: The same arm and its room.
    asked: PosesWithLoads
    found: Prediction
    stiffness: Stiffness  #: Of the loaded tool.
    extent: LoadExtent  #: How large the loads are.
    map: StiffnessMap

    @property
    def names(self) -> tuple[str, ...]:
        """Name the points: the tool's origin, then the markers."""
        return (self.model.arm.tool, *self.model.arm.markers)

    @property
    def worst_first(self) -> Ids:
        """Order poses by the deflection of the tool, the largest first, (poses,)."""
        return np.argsort(-self.found.deflection_length[:, 0], kind="stable")

    def push_halves(self, poses: Ids) -> Array:
        """Find half widths of how far the map's force moves the loaded tool along its softest axis.

        Args:
            poses: Numbers of the poses, (k,).

        Returns:
            Half widths, (k,) [m].
        """
        tool = select_rows(self.stiffness, poses)
        return compliance_half_widths(self.model, self.asked.q[poses], tool, self.map.force)[:, 0]


def predict_file(
    model: ArmModel, file_poses: PosesWithLoads, force: float, area: WorkArea | None = None
) -> Predicted:
    """Predict all poses of a file by the equilibrium behind Eq. (7), and map what a force does [N].

    Args:
        model: The calibrated arm.
        file_poses: Poses of the file.
        force: Force of the map [N].
        area: Area of the map; None for the workspace.

    Returns:
        The predictions.

    Raises:
        InputError: When a pose has no equilibrium; names its line.
        PoseError: When too few poses have their tool in the area of the map.
    """
    cell, every = Cell(model.arm, model.vjm), slice(0, len(file_poses.q))

    def both(q: Array, loads: list[Load]) -> tuple[Prediction, Stiffness]:
        own = predict(model, q, loads)
        return own, stiffness(model, q, loads, own.theta)

    prediction, tool = _carried(file_poses, every, both)
    return Predicted(
        model=model,
        cell=cell,
        asked=file_poses,
        found=prediction,
        stiffness=tool,
        extent=load_extent(model, file_poses.q, file_poses.loads),
        map=_map(model, cell, force, area),
    )


def _map(model: ArmModel, cell: Cell, force: float, area: WorkArea | None) -> StiffnessMap:
    """The compliance of Eq. (7) under own weight alone, times a force, at clear poses drawn at random."""
    q = clear_poses(cell, area, PLACES, trial_rng(0))
    found = stiffness(model, q)
    position, _ = tool_poses(model.vjm, q)
    half = compliance_half_widths(model, q, found, force)
    worst: Array = force * found.displacement_per_force[:, 0]
    order = np.argsort(-worst, kind="stable")
    return StiffnessMap(force, *(x[order] for x in (q, position, worst, found.softest_direction, half)))


def extrapolation_warnings(found: LoadExtent) -> tuple[str, ...]:
    """Warn of loads beyond those of the model's data, or the payload, with their number."""
    if found.force_ratio is not None and np.isinf(found.force_ratio):
        said = [f"extrapolated: {found.force:,.0f} N, but the model was identified under own weight only"]
    else:
        sizes = (
            (found.force, "N", found.force_ratio, "force"),
            (found.moment, "N m", found.moment_ratio, "moment"),
        )
        said = [
            f"extrapolated: a {what} of {value:,.0f} {unit} is {ratio:.1f} times the largest one of the "
            "identification"
            for value, unit, ratio, what in sizes
            if ratio is not None and ratio > SLACK
        ]
    if found.payload_ratio is not None and found.payload_ratio > OVERLOAD:
        said.append(
            f"{found.force:,.0f} N are {found.payload_ratio:.1f} times the payload that the arm states"
        )
    return tuple(said)


def refusal_words(arm: Arm, refusal: Refusal | None) -> str | None:
    """Say why a point cannot be corrected.

    Args:
        arm: Description of the arm.
        refusal: Why it was refused; None where it was not.

    Returns:
        The reason; None where there is none.
    """
    if refusal is None:
        return None
    if refusal.reason == "limit":
        joint = next(joint for joint in arm.joints if joint.name in refusal.involved_names)
        beyond = f"{joint.display_factor * refusal.excess:.3g} {joint.display_unit}"
        return f"{joint.name} would pass its limit by {beyond}"
    if refusal.reason == "collision":
        return f"{refusal.involved_names[0]} would collide with {refusal.involved_names[1]}"
    return (
        f"out of reach by {1e3 * refusal.excess:,.2f} mm" if refusal.reason == "reach" else "no equilibrium"
    )


def direction_words(direction: Array) -> str:
    """Name a direction in world axes, (3,), such as "mostly along y" or "between x and -z"."""
    size = np.abs(direction) / np.linalg.norm(direction)
    first, second = np.argsort(-size)[:2]
    angle = float(np.degrees(np.arccos(min(size[first], 1.0))))
    if angle <= ALONG_ANGLE:
        return f"along {'xyz'[first]}"
    if angle <= MOSTLY_ALONG_ANGLE:
        return f"mostly along {'xyz'[first]}"
    side = "" if direction[first] * direction[second] > 0 else "-"
    return f"between {'xyz'[first]} and {side}{'xyz'[second]}"
