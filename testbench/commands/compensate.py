"""What `testbench compensate` writes, says and draws: how far off a program is, and what puts it right."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from testbench import files
from testbench.campaign.campaign import Cell
from testbench.campaign.program import CorrectedProgram, more_columns
from testbench.campaign.program_words import extrapolated
from testbench.campaign.rows import MM
from testbench.correct import uncertainty
from testbench.correct.beyond import extent
from testbench.correct.rest import rest
from testbench.data.dataset import Ids
from testbench.data.motion.formats import CSV, WRITERS, write_moves
from testbench.data.program import unread
from testbench.data.write import write_program
from testbench.errors import Array
from testbench.output.whole import whole_file
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.report.columns import columns
from testbench.report.leave import Asked, leave
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, finite
from testbench.trials.spread import ENOUGH
from testbench.views.colours import GCO, LOAD, MEASURED, TASK, Look
from testbench.views.markdown import Markdown, capital, ended
from testbench.views.scene import Layer, Line, Poses, RunChart, Scene, Seen, arrow_scale, of_all, picked
from testbench.views.schema import Table

Places = tuple[Path, str, Path]
"""The corrected program, "csv" or a robots' language as of `format_of`, and the folder of the report."""
COMMAND = "testbench compensate"  #: As manifest.json names it.
WRITTEN, MRAD = ("report.md", "report.json", "compensation.png"), 1e3
FITTED, MOST = 4, 200  #: Points to which a frame is fitted at least, and at most, evenly picked.
SUDDEN = 0.2  #: Change of a force over its size that is sudden [1].
TURNED = 1e-2  #: A turn that is left counts from here [mrad].
JUMPS = 0.2  #: Change of a correction from a point to the next that is said [deg, mm].
OPEN = 0.25  #: Width of what is left over the error from which it is said what keeps it open [1].
MOST_ROWS = 12  #: Points that a table lists.
SHARE, LEAST = 0.15, 0.3  #: Length of most errors over the size of the path, which counts this at least [m].
FORCE = 0.25  #: Length of the force's arrow over that size [1].
BEFORE, AFTER = "as programmed", "corrected, within (95 %)"
FAINT = (150, 205, 190)  #: Of intervals: pale green.
LOOKS = {BEFORE: Look(MEASURED, 1, prior=True), AFTER: Look(GCO, 0, prior=True)}


def write(cell: Cell, found: CorrectedProgram, said: Report, flags: Mapping[str, object], to: Places) -> None:
    """The corrected program and the folder of its report; InputError when they cannot be written."""
    (file, form, folder), (program, q) = to, (found.program, found.found.q)
    with whole_file(file) as part:
        if form == CSV:
            write_program(part, program, q, more_columns(found))
        else:
            write_moves(part, WRITERS[form], q, found.model.arm.joints, program.labels)
        digest = {file.name: files.digest(part)}  # a kill may leave the earlier one beside the report
        arm, name = [cell.arm.rigid.parent], program.path.name
        asked = Asked(COMMAND, name, flags, arm, WRITTEN[-1], more=lambda _: {"corrected": digest})
        leave(folder, asked, said, seen(cell, found, said))


def report(found: CorrectedProgram) -> Report:
    """What there is to say of a corrected program."""
    f = _numbers(found)
    return Report(
        scenario="compensate",
        question=Markdown("Where does the loaded tool go, and what puts it right?"),
        title=say("{program} corrected for {arm}, {points:counted point}", f),
        answer=lines(_answer(f)),
        worst=say(
            "Worst at line {line}, point {label}: off by {before_mm:.3f} mm as programmed, {after}.",
            f.worst,
            after="left as it is" if f.worst.reason else _within(f.worst.half_95_mm),
        ),
        claims=list(_claims(f)),
        numbers=f,
        tables=_tables(f),
        body=[_about_model(f), "sizes", "worst"],
    )


def _within(half: float | None) -> str:
    return "corrected without a bound" if half is None else f"corrected within {half:.3f} mm"


def _numbers(found: CorrectedProgram) -> Row:
    own, model, program = found.found, found.model, found.program
    points = _points(found)
    loaded = [row for row in points if row.before_mm > 0]
    before, half = ([row[key] for row in loaded or points] for key in ("before_mm", "half_95_mm"))
    unseen = sum(row.half_95_mm is None for row in points)
    force = np.linalg.norm(sum(load.wrench[:, :3] for load in found.loads), axis=1)
    absolute = model.absolute and own.asked == "drawn"
    held = (own.held & own.corrected[:, None]).sum(axis=0)
    before_mm, half_mm = sizes(before), None if unseen else sizes(half)
    return Row(
        program=program.path.name,
        arm=model.arm.name,
        method=model.about.method,
        absolute=model.absolute,
        asked=own.asked,
        hold=found.aim.hold,
        points=program.points,
        corrected=int(own.corrected.sum()),
        force_n=[float(force.min()), float(force.max())],
        before_mm=before_mm,
        half_95_mm=half_mm,
        harmful=bool(loaded) and (half_mm is None or half_mm.median >= before_mm.median),
        half_fitted_mm=_fitted(found) if absolute else None,
        loaded=len(loaded),
        unseen=unseen,
        **_turns(found),
        jump=_jump(found),
        worst=max(points, key=lambda row: float(row.before_mm)),
        extrapolated=extrapolated(extent(model, own.start, found.loads)),
        open=uncertainty.most_open(model, own.q, found.loads, np.array(found.aim.point), absolute),
        doubts=model.about.doubts,
        unread=unread(program),
        held={joint.name: int(n) for joint, n in zip(model.arm.joints, held, strict=True) if n},
        rows=points,
    )


def _points(found: CorrectedProgram) -> list[Row]:
    """A row a point: `half_95_mm` along its worst axis, None if nothing bounds it; corrections in deg, mm."""
    own, program = found.found, found.program
    shown = np.array([joint.shown for joint in found.model.arm.joints])
    before, half = MM * np.linalg.norm(own.before, axis=1), MM * own.half.max(axis=1)
    return [
        Row(
            line=int(program.line[k]),
            label=program.labels[k],
            before_mm=float(before[k]),
            half_95_mm=finite(half[k]),
            correction=(shown * (own.q[k] - own.start[k])).tolist(),
            turn_left_mrad=float(MRAD * np.linalg.norm(own.turned[k])),
            reason=own.refused[k],
        )
        for k in range(program.points)
    ]


def sizes(values: Sequence[float] | Array) -> Row:
    """Median, 95th percentile and largest of errors."""
    return Row(zip(("median", "p95", "max"), np.percentile(values, (50, 95, 100)).tolist(), strict=True))


def _turns(found: CorrectedProgram) -> Row:
    """How far the tool turns where nothing holds it, and what is left of its turn where that is held."""
    own = found.found
    turned = MRAD * np.linalg.norm(own.turned, axis=1) * own.corrected
    free = turned * (found.aim.hold == "position")
    left = (turned - free) * ~own.held.any(axis=1)
    return Row(
        turns_mrad=float(free.max()), turned=int((left > TURNED).sum()), turn_left_mrad=float(left.max())
    )


def _jump(found: CorrectedProgram) -> Row | None:
    """Where a correction changes most from a point to the next; None with one point."""
    own, joints = found.found, found.model.arm.joints
    if len(own.q) < 2:
        return None
    steps = np.abs(np.diff(own.q - own.start, axis=0))
    k, j = np.unravel_index(int(steps.argmax()), steps.shape)
    load = np.sum([load.wrench[:, :3] for load in found.loads], axis=0)
    change, size = np.linalg.norm(load[k + 1] - load[k]), np.linalg.norm(load[k : k + 2], axis=1).max()
    return Row(
        joint=joints[j].name,
        size=joints[j].shown * float(steps[k, j]),
        unit=joints[j].shown_unit,
        line=int(found.program.line[k]),
        load=bool(change > SUDDEN * size),
    )


def _fitted(found: CorrectedProgram) -> Row | None:
    """Intervals relative to one another, a frame fitted to the points; None for few points."""
    own, count = found.found, len(found.found.q)
    if count < FITTED:
        return None
    some = np.unique(np.linspace(0, count - 1, min(MOST, count)).round().astype(int))
    stand = uncertainty.Poses(own.q, found.loads).of(some)
    half = MM * uncertainty.fitted_half_widths(found.model, stand, np.array(found.aim.point)).max(axis=1)
    return sizes(half) if np.isfinite(half).all() else None


def _answer(f: Row) -> Iterator[str]:
    if not f.loaded:
        yield "Nothing acts at any point: the program stays as it is."
        return
    if f.harmful:
        yield "Do not run this: the model does not know enough to promise an improvement."
    tool = "loaded tool" if f.force_n[1] else "tool"
    off = say(
        f"As programmed the {tool} is off by {{before_mm.median:.3f}} mm (median{{which}})",
        f,
        which=f" of the {f.loaded} points where something acts" if f.loaded < f.points else "",
    )
    there = "corrected" if f.corrected == f.points else say("at {corrected} of {points} points corrected", f)
    if f.half_95_mm is None:
        yield say(
            "{off}; {there}, nothing bounds the error at {unseen:counted point}.", f, off=off, there=there
        )
    elif f.harmful:
        yield say("{off}; {there} it is within {half_95_mm.median:.3f} mm (95 %).", f, off=off, there=there)
    else:
        yield say("{off}, {before_mm.max:.3f} mm at most.", f, off=off)
        yield say(
            "{there} it is within {half_95_mm.median:.3f} mm (median), {half_95_mm.max:.3f} mm at most: "
            "95 % intervals along each axis.",
            f,
            there=capital(there),
        )


def _claims(f: Row) -> Iterator[Markdown]:
    for sentence in f.unread:
        yield say("{text}.", text=sentence)
    if f.half_fitted_mm:
        yield say(
            "Relative to one another, as a work frame fitted to these points sees them, the points are "
            "within {half_fitted_mm.median:.3f} mm (median), {half_fitted_mm.max:.3f} mm at most.",
            f,
        )
    if left := f.points - f.corrected:
        yield say("**Not corrected**: {left:counted point}, the reason beside each.", left=left)
    for text in f.extrapolated:
        yield say("{text}. Intervals do not count what no model foresees there.", text=capital(text))
    if f.open and (not f.half_95_mm or f.half_95_mm.median > OPEN * f.before_mm.median):
        advice = ": identify it under loads that turn it" if f.open.joint else ""
        share = 100 * f.open.share
        yield say(f"{{share:.0f}} % of what stays open comes from {{open.name}}{advice}.", f, share=share)
    yield from _moves(f)
    for doubt in f.doubts:
        yield say("Doubt of the model: {text}", text=ended(doubt))


def _moves(f: Row) -> Iterator[Markdown]:
    """What joints cannot do, and what they do suddenly."""
    if f.turned:
        yield say(
            "Near singular poses the tool keeps its position and is not turned back: {turned:counted point}, "
            "{turn_left_mrad:.3f} mrad at most.",
            f,
        )
    if f.turns_mrad:
        yield say("Its orientation is not held: the tool turns by {turns_mrad:.3f} mrad at most.", f)
    for joint, n in f.held.items():
        stops = "{joint} stops at its limit in {n:counted point}; there the tool keeps its position alone."
        yield say(stops, joint=joint, n=n)
    if f.jump and f.jump.load and f.points > 2:
        yield say("The load jumps, and the correction with it: most from line {line} to the next.", f.jump)
    elif f.jump and f.jump.size > JUMPS:
        yield say(
            "**The correction of {joint} jumps** by {size:.2f} {unit} from line {line} to the next: a "
            "singular pose lies between.",
            f.jump,
        )


def _about_model(f: Row) -> Markdown:
    knows = "geometry, joint errors, compliances and own weight"
    if not f.absolute:
        own = "own weight by the masses of the folder" if f.asked == "drawn" else "no own weight"
        knows = f"compliances, {own}: errors of geometry stay"
    return say("Model: {method}. It knows {knows}.", f, knows=knows)


def _tables(f: Row) -> dict[str, Table]:
    """How far the tool is off, and the points that are not corrected, then those of the largest error."""
    errors = {BEFORE: f.before_mm, AFTER: f.half_95_mm}
    off = [
        Row({f"{key}_mm": mm for key, mm in own.items()}, what=name) for name, own in errors.items() if own
    ]
    sizes_of = columns(f"what median_mm {'p95_mm' if f.loaded >= ENOUGH else ''} max_mm")
    turn, reason = "turn_left_mrad" if f.turned else "", "reason" if f.corrected < f.points else ""
    points = columns(f"line label before_mm half_95_mm {turn} {reason}")
    worst = sorted(f.rows, key=lambda row: (not row.reason, -float(row.before_mm)))[:MOST_ROWS]
    return {
        "sizes": Table(sizes_of, off, "How far the loaded tool is off", headline="median_mm", looks=LOOKS),
        "worst": Table(points, worst, f"Worst points, {len(worst)} of {f.points:,}", headline="before_mm"),
    }


def seen(cell: Cell, found: CorrectedProgram, said: Report) -> Seen:
    """The path, where loads draw the tool off it, and the arm that does so."""
    points = said.numbers["rows"]
    some = picked(np.linalg.norm(found.found.before, axis=1), np.arange(len(points)), far=1)
    rows = [points[k] for k in some]
    before, half = (np.array([row[key] for row in rows], dtype=float) for key in ("before_mm", "half_95_mm"))
    errors = [Line(name, LOOKS[name], mm) for name, mm in ((BEFORE, before), (AFTER, half))]
    note, labels = of_all(len(some), len(points), "points"), [row.label for row in rows]
    off = "How far the loaded tool is off at each point (mm)"
    chart = RunChart(off, 0, "point", labels, errors, note=note)
    scale, groups = _groups(cell, found, rows, some)
    return Seen(Scene(cell, f"What is off, and how the arm bends, x {scale:g}.", groups), runs=[chart])


def _groups(cell: Cell, found: CorrectedProgram, rows: Sequence[Row], some: Ids) -> tuple[float, list[Poses]]:
    """The arm along its program, seen from near and as a whole; how much is magnified."""
    own, q = found.found, found.found.start[some]
    asked = own.target.position[some]
    size = max(LEAST, float(np.linalg.norm(np.ptp(asked, axis=0))))
    M = arrow_scale(own.before[some], SHARE * size)
    off, back = (asked + M * metres[some] for metres in (own.before, own.after))
    force = np.sum([load.wrench[some, :3] for load in found.loads], axis=0)
    most = float(np.linalg.norm(force, axis=1).max()) or 1.0
    ways = {"path asked": (asked, TASK), BEFORE: (off, MEASURED), "corrected, by the model": (back, GCO)}
    half = M * np.where(np.isfinite(own.half[some]), own.half[some], np.nan)
    spans = half[:, None, :] * np.eye(3)  # along each axis of the world
    low, high = ((back[:, None] + side * spans).reshape(1, -1, 3) for side in (-1, 1))
    near = Poses(
        name="Path, from near",
        names=[f"Point {row.label}, line {row.line}" for row in rows],
        words=[_said(row) for row in rows],
        rigid=rigid_frames(cell.room, q),
        bent=elastic_frames(cell.plant, q, M * _bent(found, some)),
        layers=[
            Layer("where it may be, 95 %", FAINT, "lines", low, high),
            *(Layer(name, colour, "lines", x[None, :-1], x[None, 1:]) for name, (x, colour) in ways.items()),
            Layer("tool asked", TASK, "dots", asked[:, None]),
            Layer("tool drawn off", MEASURED, "arrows", asked[:, None], off[:, None]),
            Layer("force", LOAD, "arrows", (off - FORCE * size / most * force)[:, None], off[:, None]),
        ],
        first=int(np.argmax([row.before_mm for row in rows])),
        near=np.vstack([asked, off, asked.mean(axis=0) + LEAST / 2 * np.vstack([np.eye(3), -np.eye(3)])]),
    )
    return M, [replace(near, bent=None), replace(near, name="Whole arm", near=None)]


def _bent(found: CorrectedProgram, some: Ids) -> Array:
    """Virtual joints as programmed, less what the program knows of, (points, n_theta) [m, rad]."""
    state, q = found.model.state, found.found.start[some]
    loaded = rest(state, q, [load.of(some) for load in found.loads]).theta
    return loaded if found.found.asked == "drawn" else loaded - rest(state, q).theta


def _said(row: Row) -> str:
    after = "nothing bounds what is left" if row.half_95_mm is None else f"{_within(row.half_95_mm)} (95 %)"
    after = f"left as it is: {row.reason}" if row.reason else after
    return f"{row.before_mm:.3f} mm off as programmed; {after}."
