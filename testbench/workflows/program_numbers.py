"""Numbers of a corrected program, point by point, and of a prediction: poses that move most, a map."""

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import NormalDist

import numpy as np

from testbench.arm.folder import ArmJoint
from testbench.correct.newton import equilibrium
from testbench.correct.predicted import (
    LoadedPoses,
    largest_uncertainty,
    load_extent,
    relative_half_widths,
    stiffness,
)
from testbench.data.dataset import select_evenly
from testbench.errors import Array, Ids
from testbench.files.program import unread_columns
from testbench.files.table import as_cell
from testbench.identify.posterior import CONFIDENCE, student_quantile
from testbench.model.vjm import add_law_deflections, tool_poses
from testbench.runs.rows import Row, finite
from testbench.workflows.error_places import ErrorMeaning, error_places, places_at
from testbench.workflows.program import (
    DEFAULT_FORCE,
    CorrectedProgram,
    Predicted,
    direction_words,
    extrapolation_warnings,
)
from testbench.workflows.rows import MM

# --- Stiffness ellipsoids along a path: over which a force of any direction moves the loaded tool -----------

COUNT = 8  #: Poses along a path that have an ellipsoid, at most.


def ellipsoids(
    compliance: Array, lever: Array, position: Array, labels: Sequence[str], force: float
) -> list[Row]:
    """Describe the ellipsoids over which a force of any direction moves a point of the tool.

    The point p is at r from the tool's origin. By a force f it moves by T C T^T f with T = [I, -[r]x].

    Args:
        compliance: Compliance C at the tool's origin, twist = C @ wrench, world axes, (poses, 6, 6)
            [m/N, rad/N, rad/(N m)].
        lever: r, world axes, (poses, 3) [m].
        position: Where the point is, (poses, 3) [m].
        labels: What the poses are called.
        force: Size of the force [N].

    Returns:
        A row for each pose: its `label`, `at_m`, `semi_axes_mm` from the longest to the shortest, and their
        unit vectors `directions`, one per row.
    """
    turned = np.cross(lever[:, None], np.eye(3))
    T = np.concatenate([np.broadcast_to(np.eye(3), turned.shape), turned], axis=2)
    directions, give, _ = np.linalg.svd(T @ compliance @ T.transpose(0, 2, 1))
    return [
        Row(
            label=label,
            at_m=at.tolist(),
            semi_axes_mm=(MM * force * sizes).tolist(),
            directions=axes.T.tolist(),
        )
        for label, at, sizes, axes in zip(labels, position, give, directions, strict=True)
    ]


# --- Numbers of a corrected program, point by point, and of a prediction: poses that move most, a map -------

MRAD = 1e3
MIN_FITTED, MAX_FITTED = 4, 200  #: Points to which a frame is fitted at least, and at most, evenly picked.
JUMPS = 0.2  #: Change of a correction from a point to the next that raises a warning [deg, mm].
UNDETERMINED_SHARE = 0.25  #: Half width over the error from which the part that keeps it open is named [1].
SUDDEN = 0.2  #: Change of a force over its size that is sudden [1].
TURNED = 1e-2  #: A turn that is left counts from here [mrad].


def correction_numbers(corrected_program: CorrectedProgram, tolerance_mm: float | None = None) -> Row:
    """Collect all numbers of a corrected program by their keys in report.json.

    Args:
        corrected_program: The corrected program.
        tolerance_mm: Largest error that passes, the interval counted; None without a tolerance [mm].

    Returns:
        The numbers.
    """
    compensated = corrected_program.found
    model = corrected_program.model
    program = corrected_program.program
    points = _points(corrected_program, tolerance_mm)
    loaded = [row for row in points if row.before_mm > 0]
    before, half = ([row[key] for row in loaded or points] for key in ("before_mm", "half_95_mm"))
    unseen = sum(row.half_95_mm is None for row in points)
    force = np.linalg.norm(sum(load.wrench[:, :3] for load in corrected_program.loads), axis=1)
    absolute = model.is_absolute and compensated.joint_meaning == "drawn"
    held = (compensated.at_limit & compensated.corrected[:, None]).sum(axis=0)
    before_mm, half_mm = error_statistics(before), None if unseen else error_statistics(half)
    most = [[row[key] for row in loaded or points] for key in ("before_most_mm", "most_mm")]
    tool_point = np.array(corrected_program.aim.tool_point)
    uncertain = largest_uncertainty(model, compensated.q, corrected_program.loads, tool_point, absolute)
    return Row(
        program=program.path.name,
        arm=model.arm.name,
        method=model.origin.method,
        absolute=model.is_absolute,
        asked=compensated.joint_meaning,
        hold=corrected_program.aim.corrected_part,
        points=program.points,
        corrected=int(compensated.corrected.sum()),
        force_n=[float(force.min()), float(force.max())],
        before_mm=before_mm,
        half_95_mm=half_mm,
        before_most_mm=None if unseen else error_statistics(most[0]),
        most_mm=None if unseen else error_statistics(most[1]),
        chance=None if unseen or not loaded else float(np.median(_chances(before, half))),
        harmful=bool(loaded) and half_mm is None,
        half_fitted_mm=_fitted(corrected_program) if absolute else None,
        loaded=len(loaded),
        unseen=unseen,
        **_turns(corrected_program),
        jump=_jump(corrected_program),
        worst=max(points, key=lambda row: float(row.before_mm)),
        extrapolated=extrapolation_warnings(
            load_extent(model, compensated.programmed_q, corrected_program.loads)
        ),
        open=uncertain and Row(name=uncertain.name, share=uncertain.variance_share, joint=uncertain.is_joint),
        doubts=model.origin.warnings,
        unread=unread_columns(program),
        held={joint.name: int(n) for joint, n in zip(model.arm.joints, held, strict=True) if n},
        tolerance=None if tolerance_mm is None else _kept(points, tolerance_mm),
        ellipsoid_force_n=(largest := float(force.max()) or DEFAULT_FORCE),
        ellipsoids=_ellipsoids_of_program(corrected_program, largest),
        rows=points,
    )


def _ellipsoids_of_program(corrected_program: CorrectedProgram, force: float) -> list[Row]:
    """Describe over which ellipsoid a force [N] moves the loaded tool point, along the program."""
    compensated, model = corrected_program.found, corrected_program.model
    some = select_evenly(np.arange(corrected_program.program.points), COUNT)
    q, labels = compensated.q[some], [corrected_program.program.labels[k] for k in some]
    tool = stiffness(model, q, [load.select(some) for load in corrected_program.loads])
    lever = tool_poses(model.vjm, q)[1] @ np.array(corrected_program.aim.tool_point)
    return ellipsoids(tool.compliance, lever, compensated.target.position[some], labels, force)


def correction_warnings(f: Row) -> Iterator[str]:
    """List how the program was read, points and joints that are not corrected, loads, jumps, doubts."""
    yield from f.unread
    if f.corrected < f.points:
        yield f"{f.points - f.corrected} of {f.points} points are not corrected"
    yield from f.extrapolated
    if f.open and (not f.half_95_mm or f.half_95_mm.median > UNDETERMINED_SHARE * f.before_mm.median):
        share = f"{100 * f.open.share:.0f} %"
        yield f"{share} of the variance of the corrected tool position comes from {f.open.name}"
    if f.turned:
        most = f.turn_left_mrad
        yield (
            f"Points near a singular pose whose orientation is not fully corrected: {f.turned}, "
            f"by at most {most:.3f} mrad"
        )
    yield from (f"Points where {joint} stops at its limit: {n}" for joint, n in f.held.items())
    if (jump := f.jump) and not jump.load and jump.size > JUMPS:
        yield f"The correction of {jump.joint} jumps by {jump.size:.2f} {jump.unit} after line {jump.line}"
    yield from (f"Warning of the model: {text}" for text in f.doubts)


def _chances(before: Sequence[float], half: Sequence[float]) -> Array:
    """Chance that a point gets better by its correction, at least (n,) [1].

    The true error e along the correction b is normal around it, its deviation s at most: |e - b| < |e| where
    e > b / 2.

    Args:
        before: Length of what is corrected, (n,) [mm].
        half: Half width of the 95 % interval along the worst axis, (n,) [mm].
    """
    with np.errstate(divide="ignore"):  # what has no error at all is sure
        deviations = student_quantile(np.inf, (1 + CONFIDENCE) / 2) * np.divide(before, half) / 2
    return np.array([NormalDist().cdf(x) for x in deviations.tolist()])


def _kept(points: Sequence[Row], mm: float) -> Row:
    """How many points keep a tolerance, corrected and as programmed, their intervals counted."""
    before = [row.half_95_mm is not None and row.before_mm + row.half_95_mm <= mm for row in points]
    return Row(mm=mm, failed=sum(row.verdict == "fail" for row in points), failed_before=before.count(False))


def _points(corrected_program: CorrectedProgram, tolerance_mm: float | None) -> list[Row]:
    """A row a point: `half_95_mm` along its worst axis, None if nothing bounds it; corrections in deg, mm.

    `most_mm` is what the model leaves and that half width: a point within a tolerance passes.
    `before_most_mm` is the same of the program as it is.
    """
    compensated = corrected_program.found
    program = corrected_program.program
    reasons = corrected_program.reasons
    arm = corrected_program.model.arm
    correction = arm.display_factors * arm.to_file_joint_change(compensated.q - compensated.programmed_q)
    before, half = (
        MM * np.linalg.norm(compensated.error_before, axis=1),
        MM * compensated.error_half_width.max(axis=1),
    )
    after = MM * np.linalg.norm(compensated.error_after, axis=1)
    verdicts: list[str | None] = [None] * program.points
    if tolerance_mm is not None:
        verdicts = np.where(after + half <= tolerance_mm, "pass", "fail").tolist()
    return [
        Row(
            line=int(program.line[k]),
            label=program.labels[k],
            before_mm=float(before[k]),
            half_95_mm=finite(half[k]),
            after_mm=float(after[k]),
            most_mm=finite(after[k] + half[k]),
            before_most_mm=finite(before[k] + half[k]),
            verdict=verdicts[k],
            correction=correction[k].tolist(),
            turn_left_mrad=float(MRAD * np.linalg.norm(compensated.rotation_error[k])),
            reason=reasons[k],
        )
        for k in range(program.points)
    ]


def error_statistics(values: Sequence[float] | Array) -> Row:
    """Find median, 95th percentile and largest of errors."""
    return Row(zip(("median", "p95", "max"), np.percentile(values, (50, 95, 100)).tolist(), strict=True))


def _turns(corrected_program: CorrectedProgram) -> Row:
    """How far the tool turns where nothing holds it, and what is left of its turn where that is held."""
    compensated = corrected_program.found
    turned = MRAD * np.linalg.norm(compensated.rotation_error, axis=1) * compensated.corrected
    free = turned * (corrected_program.aim.corrected_part == "position")
    left = (turned - free) * ~compensated.at_limit.any(axis=1)
    return Row(
        turns_mrad=float(free.max()), turned=int((left > TURNED).sum()), turn_left_mrad=float(left.max())
    )


def _jump(corrected_program: CorrectedProgram) -> Row | None:
    """Where a correction changes most from a point to the next; None with one point."""
    compensated = corrected_program.found
    arm = corrected_program.model.arm
    joints = corrected_program.model.arm.file_joints
    if len(compensated.q) < 2:
        return None
    steps = np.abs(np.diff(arm.to_file_joint_change(compensated.q - compensated.programmed_q), axis=0))
    k, j = np.unravel_index(int(steps.argmax()), steps.shape)
    load = np.sum([load.wrench[:, :3] for load in corrected_program.loads], axis=0)
    change, size = np.linalg.norm(load[k + 1] - load[k]), np.linalg.norm(load[k : k + 2], axis=1).max()
    return Row(
        joint=joints[j].name,
        size=joints[j].display_factor * float(steps[k, j]),
        unit=joints[j].display_unit,
        line=int(corrected_program.program.line[k]),
        load=bool(change > SUDDEN * size),
    )


def _fitted(corrected_program: CorrectedProgram) -> Row | None:
    """Intervals relative to one another, a frame fitted to the points; None for few points."""
    compensated, count = corrected_program.found, len(corrected_program.found.q)
    if count < MIN_FITTED:
        return None
    some = select_evenly(np.arange(count), MAX_FITTED)
    stand = LoadedPoses(compensated.q, corrected_program.loads).select(some)
    half = MM * relative_half_widths(
        corrected_program.model, stand, np.array(corrected_program.aim.tool_point)
    ).max(axis=1)
    return error_statistics(half) if np.isfinite(half).all() else None


def predicted_bending(corrected_program: CorrectedProgram, some: Ids) -> Array:
    """Find how the arm bends as programmed, less what the program knows of.

    Args:
        corrected_program: The corrected program.
        some: Numbers of the points, (points,).

    Returns:
        Virtual joints, (points, n_theta) [m, rad].
    """
    state, q = corrected_program.model.state, corrected_program.found.programmed_q[some]
    loaded = equilibrium(state, q, [load.select(some) for load in corrected_program.loads]).theta
    own = loaded if corrected_program.found.joint_meaning == "drawn" else loaded - equilibrium(state, q).theta
    return add_law_deflections(state.vjm, own)


TABLE = "predictions.csv"
LISTED_POSES = 14  #: Poses that a report lists.
MOVED_BY, HALF_WIDTH = "moved by the force", "half width, 95 %"  #: What a map tells of a place.


def prediction_columns(joints: Sequence[ArmJoint]) -> list[str]:
    """List the columns of predictions.csv, in order; docs/formats.md says what each holds."""
    names = ["pose", "line", "point", *(joint.file_column for joint in joints)]
    names += [f"{axis}_m" for axis in "xyz"]
    names += [f"{what}_{axis}_m" for what in ("position_half_95", "deflection", "half_95") for axis in "xyz"]
    names += [f"rotation_{axis}_rad" for axis in "xyz"]
    return [*names, *(f"stiffness_{k}_N_per_m" for k in (1, 2, 3)), *(f"softest_{axis}" for axis in "xyz")]


def write_predictions(made: Predicted, folder: Path) -> None:
    """Write predictions.csv: all poses and points.

    What no reading has seen, and a stiffness where nothing gives, is blank.

    Args:
        made: The prediction.
        folder: Where the file goes.
    """
    prediction, tool = made.found, made.stiffness
    of_tool = np.hstack([prediction.rotation_vector, tool.principal_stiffness, tool.softest_direction])
    parts = (
        prediction.position,
        prediction.position_half_width,
        prediction.deflection,
        prediction.half_width,
    )
    names = [as_cell(name) for name in made.names]
    with (folder / TABLE).open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        arm = made.model.arm
        rows.writerow(prediction_columns(arm.file_joints))
        for k, label in enumerate(made.asked.labels):
            first = [as_cell(label), str(made.asked.line[k])]
            joints, last = [*map(repr, arm.to_file_joints(made.asked.q[k]).tolist())], _cells(of_tool[k])
            for m, name in enumerate(names):
                own = _cells(*(values[k, m] for values in parts))
                rows.writerow([*first, name, *joints, *own, *last])


def _cells(*values: Array) -> list[str]:
    """Ten digits of each, blank where infinite."""
    return [f"{x:.10g}" if np.isfinite(x) else "" for part in values for x in part.tolist()]


def prediction_numbers(made: Predicted) -> Row:
    """Collect all numbers but those of every pose, which are in predictions.csv; keys of report.json."""
    prediction, size = made.found, MM * made.found.deflection_length
    origin, extent = made.model.origin, made.extent
    some = np.array([made.stiffness.displacement_per_force[:, 0].argmax(), *made.worst_first[:LISTED_POSES]])
    poses = [_pose(made, int(k), half) for k, half in zip(some, made.push_halves(some), strict=True)]
    return Row(
        arm=made.model.arm.name,
        absolute=made.model.is_absolute,
        method=origin.method,
        file=made.asked.path.name,
        loads=made.asked.words or "no load",
        poses=len(size),
        confidence_percent=100 * CONFIDENCE,
        least_mm=float(size[:, 0].min()),
        median_mm=float(np.median(size[:, 0])),
        most_mm=float(size[:, 0].max()),
        unseen_percent=float(100 * np.isinf(prediction.half_width).any(axis=2).mean()),
        other_off_mm=float(MM * prediction.linearisation_error.max()),
        position_half_mm=finite(MM * np.median(prediction.position_half_width[:, 0].max(axis=1))),
        force_n=extent.force,
        moment_nm=extent.moment,
        force_ratio=finite(extent.force_ratio),
        moment_ratio=finite(extent.moment_ratio),
        extrapolated=extrapolation_warnings(extent),
        doubts=origin.warnings,
        notes=made.asked.notes,
        softest=poses[0],
        worst=poses[1:],
        map=_map(made),
        ellipsoids=_ellipsoids_of_file(made),
    )


def _ellipsoids_of_file(made: Predicted) -> list[Row]:
    """Describe over which ellipsoid the force of the map moves the loaded tool, in some poses of the file."""
    some = select_evenly(np.arange(len(made.asked.q)), COUNT)
    position, labels = made.found.position[some, 0], [made.asked.labels[k] for k in some]
    compliance = made.stiffness.compliance[some]
    return ellipsoids(compliance, 0 * position, position, labels, made.map.force)


def _pose(made: Predicted, k: int, push_half: float) -> Row:
    """How far its loads move the tool in a pose, by its number from 0, and how stiff the tool is there.

    None where the data of the model see nothing, or where nothing gives. Half widths are the widest along x,
    y, z. `push_mm` is how far the force of the map moves the loaded tool in its softest direction; its half
    width is that of this force.
    """
    prediction = made.found
    file_poses = made.asked
    direction = made.stiffness.softest_direction[k]
    half = finite(MM * prediction.largest_half_width[k, 0])
    return Row(
        pose=file_poses.labels[k],
        line=int(file_poses.line[k]),
        joints=made.model.arm.pose_text(file_poses.q[k]),
        tool_m=prediction.position[k, 0].tolist(),
        deflection_mm=float(MM * prediction.deflection_length[k, 0]),
        deflections_mm=(MM * prediction.deflection[k, 0]).tolist(),
        half_mm=half,
        half_words="not determined" if half is None else f"{half:.3f}",
        halves_mm=[finite(x) for x in MM * prediction.half_width[k, 0]],
        turn_mrad=float(1e3 * np.linalg.norm(prediction.rotation_vector[k])),
        stiffness_n_per_um=[finite(x) for x in 1e-6 * made.stiffness.principal_stiffness[k]],
        softest=direction_words(direction),
        softest_direction=direction.tolist(),
        push_mm=float(MM * made.map.force * made.stiffness.displacement_per_force[k, 0]),
        push_half_mm=finite(MM * push_half),
    )


def _map(made: Predicted) -> Row:
    """The worst deflection under a force in any direction, over poses of the workspace, the softest first."""
    stiffness_map = made.map
    worst: Array = MM * stiffness_map.worst
    workspace_poses = places_at(made.model.arm, stiffness_map.q, stiffness_map.position, stiffness_map.worst)
    values = {MOVED_BY: worst, HALF_WIDTH: MM * stiffness_map.half.max(axis=1)}
    words = f"of the tool by {stiffness_map.force:,.0f} N in the worst direction, and its 95 % half width"
    return Row(
        force_n=stiffness_map.force,
        places=len(worst),
        median_mm=float(np.median(worst)),
        p95_mm=float(np.percentile(worst, 95)),
        worst_mm=float(worst[0]),
        half_mm=finite(MM * stiffness_map.half[0].max()),
        unseen_percent=float(100 * np.isinf(stiffness_map.half).any(axis=1).mean()),
        at_m=stiffness_map.position[0].tolist(),
        joints=made.model.arm.pose_text(stiffness_map.q[0]),
        softest=direction_words(stiffness_map.direction[0]),
        errors=error_places(workspace_poses, values, [MOVED_BY], ErrorMeaning("movement", words, "median")),
    )
