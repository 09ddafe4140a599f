"""What `testbench compensate` tells of a program, point by point, and draws: as programmed, and corrected."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.special import ndtr

from testbench.campaign.campaign import Cell
from testbench.campaign.program import CorrectedProgram, extrapolated
from testbench.campaign.rows import MM
from testbench.correct import uncertainty
from testbench.correct.beyond import extent
from testbench.correct.rest import rest
from testbench.data.program import unread
from testbench.errors import Array, Ids
from testbench.identify.posterior import CONFIDENCE, quantile
from testbench.model.vjm import turns
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.report.badge import Badge, decide
from testbench.report.report import Report
from testbench.report.table import Row, finite
from testbench.views.colours import GCO, LOAD, MEASURED, TASK, Colour, Look
from testbench.views.markdown import counted
from testbench.views.scene import Layer, Line, Poses, RunChart, Scene, Seen, arrow_scale, of_all, picked

MRAD = 1e3
FITTED, MOST = 4, 200  #: Points to which a frame is fitted at least, and at most, evenly picked.
SUDDEN = 0.2  #: Change of a force over its size that is sudden [1].
TURNED = 1e-2  #: A turn that is left counts from here [mrad].
BEFORE, CORRECTED = "uncorrected program", "corrected program"
WITHIN, EXPECTED = f"{BEFORE}, within (95 %)", f"{BEFORE}, expected"
AFTER = f"{CORRECTED}, within (95 %)"
LOOKS = {name: Look(MEASURED, 1, prior=True) for name in (EXPECTED, WITHIN)} | {
    AFTER: Look(GCO, 0, prior=True)
}
SURE = 0.95  #: Chance that the median point gets better from which on the correction is sure to help [1].


def numbers(found: CorrectedProgram, tolerance_mm: float | None = None) -> Row:
    """report.json of a corrected program; of a tolerance [mm] which points keep it."""
    own, model, program = found.found, found.model, found.program
    points = _points(found, tolerance_mm)
    loaded = [row for row in points if row.before_mm > 0]
    before, half = ([row[key] for row in loaded or points] for key in ("before_mm", "half_95_mm"))
    unseen = sum(row.half_95_mm is None for row in points)
    force = np.linalg.norm(sum(load.wrench[:, :3] for load in found.loads), axis=1)
    absolute = model.absolute and own.asked == "drawn"
    held = (own.held & own.corrected[:, None]).sum(axis=0)
    before_mm, half_mm = sizes(before), None if unseen else sizes(half)
    most = [[row[key] for row in loaded or points] for key in ("before_most_mm", "most_mm")]
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
        before_most_mm=None if unseen else sizes(most[0]),
        most_mm=None if unseen else sizes(most[1]),
        chance=None if unseen or not loaded else float(np.median(_chances(before, half))),
        harmful=bool(loaded) and half_mm is None,
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
        tolerance=None if tolerance_mm is None else _kept(points, tolerance_mm),
        rows=points,
    )


def _chances(before: Sequence[float], half: Sequence[float]) -> Array:
    """Chance that a point gets better by its correction, at least (n,) [1].

    The true error e along the correction b is normal around it, its deviation s at most: |e - b| < |e| where
    e > b / 2.

    Args:
        before: Length of what is corrected, (n,) [mm].
        half: Half width of the 95 % interval along the worst axis, (n,) [mm].
    """
    with np.errstate(divide="ignore"):  # what has no error at all is sure
        return np.asarray(ndtr(quantile(np.inf, (1 + CONFIDENCE) / 2) * np.divide(before, half) / 2))


def _kept(points: Sequence[Row], mm: float) -> Row:
    """How many points keep a tolerance, corrected and as programmed, their intervals counted."""
    before = [row.half_95_mm is not None and row.before_mm + row.half_95_mm <= mm for row in points]
    return Row(mm=mm, failed=sum(row.verdict == "fail" for row in points), failed_before=before.count(False))


def _points(found: CorrectedProgram, tolerance_mm: float | None) -> list[Row]:
    """A row a point: `half_95_mm` along its worst axis, None if nothing bounds it; corrections in deg, mm.

    `most_mm` is what the model leaves and that half width: a point within a tolerance passes.
    `before_most_mm` is the same of the program as it is.
    """
    own, program, reasons = found.found, found.program, found.reasons
    arm = found.model.arm
    correction = arm.scale * arm.change_to_file(own.q - own.start)
    before, half = MM * np.linalg.norm(own.before, axis=1), MM * own.half.max(axis=1)
    after = MM * np.linalg.norm(own.after, axis=1)
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
            turn_left_mrad=float(MRAD * np.linalg.norm(own.turned[k])),
            reason=reasons[k],
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
    own, arm, joints = found.found, found.model.arm, found.model.arm.file_joints
    if len(own.q) < 2:
        return None
    steps = np.abs(np.diff(arm.change_to_file(own.q - own.start), axis=0))
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


def badge_of(f: Row) -> Badge | None:
    """How far off the tool is at most, corrected and not, over the points where something acts."""
    loaded = [row for row in f.rows if row.before_mm > 0]
    if not loaded:
        return None
    before, after = (
        np.array([row[key] for row in loaded], dtype=float) for key in ("before_most_mm", "most_mm")
    )
    why = "the model does not know enough to promise an improvement" if f.harmful else ""
    if not why and f.tolerance and f.tolerance.failed:
        why = f"{counted(f.tolerance.failed, 'point')} may be off by more than {f.tolerance.mm:g} mm"
    own = replace(decide((CORRECTED, after), (BEFORE, before), "point", why), what="95 % bound")
    if own.verdict == "holds" and f.chance < SURE:
        return replace(own, verdict="likely", chance=f.chance)
    return own


def within(half: float | None) -> str:
    """How far off a corrected point is at most [mm], in words."""
    return "corrected without a bound" if half is None else f"corrected within {half:.3f} mm"


TOLERANCE = "tolerance"
SHARE, LEAST = 0.15, 0.3  #: Length of most errors over the size of the path, which counts this at least [m].
FORCE = 0.25  #: Length of the force's arrow over that size [1].
FAINT = (150, 205, 190)  #: Of intervals: pale green.


def seen(cell: Cell, found: CorrectedProgram, said: Report) -> Seen:
    """The path, where loads draw the tool off it, and the arm that does so."""
    points = said.numbers["rows"]
    some = picked(np.linalg.norm(found.found.before, axis=1), np.arange(len(points)), far=1)
    rows = [points[k] for k in some]
    keys = {EXPECTED: "before_mm", WITHIN: "before_most_mm", AFTER: "most_mm"}
    values = {name: np.array([row[key] for row in rows], dtype=float) for name, key in keys.items()}
    bounded = np.isfinite(values[AFTER]).any()  # bound beside bound: the solver's residual is no success
    shown = (WITHIN, AFTER) if bounded else (EXPECTED, AFTER)
    errors = [Line(name, LOOKS[name], values[name]) for name in shown]
    tolerance = said.numbers["tolerance"]
    note, labels = of_all(len(some), len(points), "points"), [row.label for row in rows]
    off = "How far the loaded tool is off at each point (mm)"
    chart = RunChart(off, 0, "point", labels, errors, tolerance and tolerance.mm, note, limit_is=TOLERANCE)
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
    ways = {"path asked": (asked, TASK), BEFORE: (off, MEASURED), f"{CORRECTED}, by the model": (back, GCO)}
    half = M * np.where(np.isfinite(own.half[some]), own.half[some], np.nan)
    spans = half[:, None, :] * np.eye(3)  # along each axis of the world
    low, high = ((back[:, None] + side * spans).reshape(1, -1, 3) for side in (-1, 1))
    near = Poses(
        name="Path, from near",
        names=[f"Point {row.label}, line {row.line}" for row in rows],
        words=[_words(row) for row in rows],
        rigid=rigid_frames(cell.room, q),
        bent=elastic_frames(cell.plant, q, M * _bent(found, some)),
        layers=[
            Layer("where it may be, 95 %", FAINT, "lines", low, high),
            *(Layer(name, colour, "lines", x[None, :-1], x[None, 1:]) for name, (x, colour) in ways.items()),
            Layer("tool asked", TASK, "dots", asked[:, None]),
            Layer("tool drawn off", MEASURED, "arrows", asked[:, None], off[:, None]),
            Layer("force", LOAD, "arrows", (off - FORCE * size / most * force)[:, None], off[:, None]),
            *_judged(rows, asked),
        ],
        first=int(np.argmax([row.before_mm for row in rows])),
        near=np.vstack([asked, off, asked.mean(axis=0) + LEAST / 2 * np.vstack([np.eye(3), -np.eye(3)])]),
    )
    return M, [replace(near, bent=None), replace(near, name="Whole arm", near=None)]


def _judged(rows: Sequence[Row], asked: Array) -> list[Layer]:
    """Those of the path, (n, 3) [m], that keep the tolerance once corrected, small; others are large."""
    kinds: tuple[tuple[Literal["specks", "dots"], str, Colour], ...] = (
        ("specks", "pass", GCO),
        ("dots", "fail", MEASURED),
    )
    return [
        Layer(f"{CORRECTED}, points that {verdict}", colour, kind, asked[None, own])
        for kind, verdict, colour in kinds
        if (own := [k for k, row in enumerate(rows) if row.verdict == verdict])
    ]


def _bent(found: CorrectedProgram, some: Ids) -> Array:
    """Virtual joints as programmed, less what the program knows of, (points, n_theta) [m, rad]."""
    state, q = found.model.state, found.found.start[some]
    loaded = rest(state, q, [load.of(some) for load in found.loads]).theta
    own = loaded if found.found.asked == "drawn" else loaded - rest(state, q).theta
    return turns(state.vjm, own)


def _words(row: Row) -> str:
    """What is said of a point."""
    after = "nothing bounds what is left" if row.half_95_mm is None else f"{within(row.half_95_mm)} (95 %)"
    after = f"left as it is: {row.reason}" if row.reason else after
    judged = f" Tolerance: {row.verdict}." if row.verdict else ""
    return f"{row.before_mm:.3f} mm off as programmed; {after}.{judged}"
