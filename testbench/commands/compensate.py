"""What `testbench compensate` writes, says and draws: how far off a program is, and what puts it right."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from testbench import files
from testbench.campaign.campaign import Cell
from testbench.campaign.program import CorrectedProgram, more_columns
from testbench.commands.compensate_drawn import (
    AFTER,
    EXPECTED,
    LOOKS,
    SURE,
    WITHIN,
    badge_of,
    numbers,
    seen,
    within,
)
from testbench.data.motion import CSV, WRITERS, write_moves
from testbench.data.write import write_program
from testbench.output.whole import whole_file
from testbench.report.columns import columns
from testbench.report.leave import Asked, leave
from testbench.report.report import Report, lines, say
from testbench.report.table import Row
from testbench.trials.spread import ENOUGH
from testbench.views.markdown import Markdown, capital, ended
from testbench.views.schema import Table

Places = tuple[Path, str, Path]
"""The corrected program, "csv" or a robots' language as of `format_of`, and the folder of the report."""
COMMAND = "testbench compensate"  #: As manifest.json names it.
WRITTEN = ("report.md", "report.json", "compensation.png")
JUMPS = 0.2  #: Change of a correction from a point to the next that is said [deg, mm].
OPEN = 0.25  #: Width of what is left over the error from which it is said what keeps it open [1].
MOST_ROWS = 12  #: Points that a table lists.


def write(cell: Cell, found: CorrectedProgram, said: Report, flags: Mapping[str, object], to: Places) -> None:
    """The corrected program and the folder of its report; InputError when they cannot be written."""
    (file, form, folder), (program, q) = to, (found.program, found.found.q)
    with whole_file(file) as part:
        if form == CSV:
            write_program(part, program, q, more_columns(found))
        else:
            own = found.model.arm
            write_moves(part, WRITERS[form], own.to_file(q), own.file_joints, program.labels)
        digest = {file.name: files.digest(part)}  # a kill may leave the earlier one beside the report
        arm, name = [cell.arm.rigid.parent], program.path.name
        asked = Asked(COMMAND, name, flags, arm, WRITTEN[-1], more=lambda _: {"corrected": digest})
        leave(folder, asked, said, seen(cell, found, said))


def report(found: CorrectedProgram, tolerance_mm: float | None = None) -> Report:
    """What there is to say of a corrected program, and of a tolerance [mm] which points keep it."""
    f = numbers(found, tolerance_mm)
    return Report(
        scenario="compensate",
        question=Markdown("Where does the loaded tool go, and what puts it right?"),
        title=say("{program} corrected for {arm}, {points:counted point}", f),
        answer=lines(_answer(f)),
        worst=say(
            "Worst at line {line}, point {label}: off by {before_mm:.3f} mm as programmed, {after}.",
            f.worst,
            after="left as it is" if f.worst.reason else within(f.worst.half_95_mm),
        ),
        claims=list(_claims(f)),
        numbers=f,
        tables=_tables(f),
        body=[_about_model(f), "sizes", "worst"],
        badge=badge_of(f),
    )


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
    else:
        yield say("{off}, within {before_most_mm.median:.3f} mm (95 %).", f, off=off)
        yield say(
            "{there} it is within {most_mm.median:.3f} mm (median), {most_mm.max:.3f} mm at most: "
            "95 % intervals along each axis.",
            f,
            there=capital(there),
        )
        if f.chance < SURE:
            yield "The correction is smaller than what is not known: it helps on average, not at every point."


def _claims(f: Row) -> Iterator[Markdown]:
    if own := f.tolerance:
        yield say(
            "Tolerance {mm:g} mm, intervals counted: {failed} of {points} points fail once corrected, "
            "{failed_before} as programmed.",
            own,
            points=f.points,
        )
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


def _order(row: Row, *, judged: bool) -> tuple[bool, float]:
    """The worst first: what is not corrected, then by the error, against a tolerance by what is left."""
    left = np.inf if row.most_mm is None else row.most_mm
    return not row.reason, -float(left if judged else row.before_mm)


def _tables(f: Row) -> dict[str, Table]:
    """How far the tool is off, and the points that are not corrected, then those of the largest error."""
    errors = {WITHIN: f.before_most_mm, AFTER: f.most_mm}
    if f.most_mm is None:
        errors = {EXPECTED: f.before_mm, AFTER: None}
    off = [
        Row({f"{key}_mm": mm for key, mm in (own or {}).items()}, what=name) for name, own in errors.items()
    ]
    sizes_of = columns(f"what median_mm {'p95_mm' if f.loaded >= ENOUGH else ''} max_mm")
    turn, reason = "turn_left_mrad" if f.turned else "", "reason" if f.corrected < f.points else ""
    points = columns(
        f"line label before_mm before_most_mm most_mm {'verdict' if f.tolerance else ''} {turn} {reason}"
    )
    worst = sorted(f.rows, key=lambda row: _order(row, judged=bool(f.tolerance)))[:MOST_ROWS]
    return {
        "sizes": Table(sizes_of, off, "How far the loaded tool is off", headline="median_mm", looks=LOOKS),
        "worst": Table(points, worst, f"Worst points, {len(worst)} of {f.points:,}", headline="before_mm"),
    }
