"""Numbers of `testbench compensate`: how far off a program is, and once corrected, point by point."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.campaign.program import CorrectedProgram, extrapolated
from testbench.campaign.rows import MM
from testbench.correct import uncertainty
from testbench.correct.beyond import extent
from testbench.data.program import unread
from testbench.errors import Array
from testbench.report.badge import Badge, decide
from testbench.report.table import Row, finite
from testbench.views.colours import GCO, MEASURED, Look
from testbench.views.markdown import counted

MRAD = 1e3
FITTED, MOST = 4, 200  #: Points to which a frame is fitted at least, and at most, evenly picked.
SUDDEN = 0.2  #: Change of a force over its size that is sudden [1].
TURNED = 1e-2  #: A turn that is left counts from here [mrad].
BEFORE, CORRECTED = "as programmed", "corrected program"
AFTER = f"{CORRECTED}, within (95 %)"
LOOKS = {BEFORE: Look(MEASURED, 1, prior=True), AFTER: Look(GCO, 0, prior=True)}


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
        tolerance=None if tolerance_mm is None else _kept(points, tolerance_mm),
        rows=points,
    )


def _kept(points: Sequence[Row], mm: float) -> Row:
    """How many points keep a tolerance, corrected and as programmed, their intervals counted."""
    before = [row.half_95_mm is not None and row.before_mm + row.half_95_mm <= mm for row in points]
    return Row(mm=mm, failed=sum(row.verdict == "fail" for row in points), failed_before=before.count(False))


def _points(found: CorrectedProgram, tolerance_mm: float | None) -> list[Row]:
    """A row a point: `half_95_mm` along its worst axis, None if nothing bounds it; corrections in deg, mm.

    `most_mm` is what the model leaves and that half width: a point within a tolerance passes.
    """
    own, program, reasons = found.found, found.program, found.reasons
    shown = np.array([joint.shown for joint in found.model.arm.joints])
    before, half = MM * np.linalg.norm(own.before, axis=1), MM * own.half.max(axis=1)
    after = MM * np.linalg.norm(own.after, axis=1)
    return [
        Row(
            line=int(program.line[k]),
            label=program.labels[k],
            before_mm=float(before[k]),
            half_95_mm=finite(half[k]),
            after_mm=float(after[k]),
            most_mm=finite(after[k] + half[k]),
            verdict=_verdict(after[k] + half[k], tolerance_mm),
            correction=(shown * (own.q[k] - own.start[k])).tolist(),
            turn_left_mrad=float(MRAD * np.linalg.norm(own.turned[k])),
            reason=reasons[k],
        )
        for k in range(program.points)
    ]


def _verdict(most_mm: float, tolerance_mm: float | None) -> str | None:
    if tolerance_mm is None:
        return None
    return "pass" if most_mm <= tolerance_mm else "fail"


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


def badge_of(f: Row) -> Badge | None:
    """What the correction leaves at most beside what it corrects, over the points where something acts."""
    loaded = [row for row in f.rows if row.before_mm > 0]
    if not loaded:
        return None
    before, half = (
        np.array([row[key] for row in loaded], dtype=float) for key in ("before_mm", "half_95_mm")
    )
    why = "the model does not know enough to promise an improvement" if f.harmful else ""
    if not why and f.tolerance and f.tolerance.failed:
        why = f"{counted(f.tolerance.failed, 'point')} may be off by more than {f.tolerance.mm:g} mm"
    return replace(decide((CORRECTED, half), (BEFORE, before), "point", why), what="promised error")


def within(half: float | None) -> str:
    """How far off a corrected point is at most [mm], in words."""
    return "corrected without a bound" if half is None else f"corrected within {half:.3f} mm"
