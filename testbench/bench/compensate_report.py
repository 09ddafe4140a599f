"""What there is to say of a corrected program: report.json's fields."""

from dataclasses import dataclass

import numpy as np

from testbench.bench.compensate import CorrectedProgram
from testbench.bench.rows import MM
from testbench.correct.beyond import extent
from testbench.correct.newton import Mask
from testbench.correct.open import Open, most_open
from testbench.correct.sure import Stand, fitted_half_widths
from testbench.data.program import unread
from testbench.errors import Array

MRAD = 1e3
FITTED, MOST = 4, 200  #: Points to which a frame is fitted at least, and at most, evenly picked.
SUDDEN = 0.2  #: Change of a force over its size that is sudden.
TURNED = 1e-5  #: A turn that is left counts from here [rad].


@dataclass(frozen=True)
class Sizes:
    """Sizes of errors over all points."""

    median: float
    p95: float
    max: float


@dataclass(frozen=True)
class PointRow:
    """One point."""

    line: int  #: In the program's file.
    label: str
    before_mm: float  #: How far the loaded tool is from where it was asked to be.
    half_95_mm: (
        float | None
    )  #: What is left is at most this far off along the worst axis, 95 %; None if unseen.
    correction: tuple[float, ...]  #: Of every joint [deg, mm].
    turn_left_mrad: float
    reason: str | None  #: Why it is not corrected; None where it is.


@dataclass(frozen=True)
class Jump:
    """Where a correction changes most."""

    joint: str
    size: float  #: Of the change [deg, mm].
    unit: str
    line: int  #: After which it is.
    load: bool  #: Whether the load changes there as well.


@dataclass(frozen=True)
class CompensationReport:
    """A corrected program."""

    program: str  #: Name of the file.
    arm: str
    method: str  #: Of the model.
    absolute: bool  #: Whether the model knows geometry too.
    asked: str  #: What joints of the program mean, "unloaded" or "drawn".
    hold: str  #: What of the tool is put right.
    points: int
    corrected: int
    force_n: tuple[float, float]  #: Least and largest force on the tool.
    before_mm: Sizes  #: Without correction.
    turns_mrad: float  #: How far the tool turns where its orientation is not held, at most.
    half_95_mm: Sizes | None  #: Of the intervals of these; None where some are unseen.
    #: The same relative to one another, a frame fitted to the points; None but where positions are known.
    half_fitted_mm: Sizes | None
    loaded: int  #: Points at which something acts, or is put right; `before_mm` is of these.
    unseen: int  #: Points at which the model has not seen what decides.
    solver_mm: float  #: Farthest that the solver leaves the tool by the model.
    largest: tuple[float, ...]  #: Largest correction of every joint [deg, mm].
    joints: tuple[str, ...]
    units: tuple[str, ...]  #: Of every joint's correction.
    turned: int  #: Points where part of the tool's turn is left.
    turn_left_mrad: float  #: The largest.
    held: dict[str, int]  #: Points at which a joint stops at its limit, by joint.
    jump: Jump | None  #: Largest change of a correction from a point to the next; None with one point.
    worst: PointRow  #: Of the largest error without correction.
    extrapolated: tuple[str, ...]  #: Loads beyond those of the identification, sentences.
    open: Open | None  #: The link or joint that keeps intervals wide.
    data: tuple[str, ...]  #: What the model was identified from.
    doubts: tuple[str, ...]  #: Of the model.
    unread: tuple[str, ...]  #: Columns of the program that count for nothing, sentences.
    output: str  #: Name of the corrected file.
    rows: tuple[PointRow, ...]

    @property
    def harmful(self) -> bool:
        """Whether what is left may be as large as what is put right: nobody should run the program."""
        return bool(self.loaded) and (
            self.half_95_mm is None or self.half_95_mm.median >= self.before_mm.median
        )

    @property
    def verdict(self) -> str:
        """What to do with the program, a sentence."""
        warning = "Do not run this: the model does not know enough to promise an improvement."
        return warning if self.harmful else ""


def report(found: CorrectedProgram, output: str) -> CompensationReport:
    """The report of a corrected program, written to a file of this name."""
    own, model, program = found.found, found.model, found.program
    good, rows = own.corrected, rows_of(found)
    force = np.linalg.norm(sum(load.wrench[:, :3] for load in found.loads), axis=1)
    before = MM * np.linalg.norm(own.before, axis=1)
    acts = before > 0 if before.any() else np.ones(len(before), dtype=bool)
    half = MM * own.half.max(axis=1)
    seen = np.isfinite(half)
    turned = MRAD * np.linalg.norm(own.turned, axis=1) * good
    free = turned * (found.aim.hold == "position")
    turned = (turned - free) * ~own.held.any(axis=1)
    shown = np.array([joint.shown for joint in model.arm.joints])
    return CompensationReport(
        program=program.path.name,
        arm=model.arm.name,
        method=model.about.method,
        absolute=model.absolute,
        asked=own.asked,
        hold=found.aim.hold,
        points=program.points,
        corrected=int(good.sum()),
        force_n=(float(force.min()), float(force.max())),
        before_mm=sizes(before[acts]),
        turns_mrad=float(free.max()),
        half_95_mm=sizes(half[acts]) if seen.all() else None,
        half_fitted_mm=_fitted(found),
        loaded=int((before > 0).sum()),
        unseen=int((~seen).sum()),
        solver_mm=float(MM * np.linalg.norm(own.after, axis=1)[good].max(initial=0.0)),
        largest=tuple((shown * np.abs(own.q - own.start).max(axis=0)).tolist()),
        joints=tuple(joint.name for joint in model.arm.joints),
        units=tuple(joint.shown_unit for joint in model.arm.joints),
        turned=int((turned > MRAD * TURNED).sum()),
        turn_left_mrad=float(turned.max()),
        held=_held(found, good),
        jump=_jump(found),
        worst=rows[int(before.argmax())],
        extrapolated=extent(model, own.start, found.loads).sentences,
        open=most_open(
            model, own.q, found.loads, np.array(found.aim.point), model.absolute and own.asked == "drawn"
        ),
        data=model.about.data,
        doubts=model.about.doubts,
        unread=unread(program),
        output=output,
        rows=rows,
    )


def rows_of(found: CorrectedProgram) -> tuple[PointRow, ...]:
    """A row a point."""
    own, program = found.found, found.program
    shown = np.array([joint.shown for joint in found.model.arm.joints])
    before, half = MM * np.linalg.norm(own.before, axis=1), MM * own.half.max(axis=1)
    return tuple(
        PointRow(
            line=int(program.line[k]),
            label=program.labels[k],
            before_mm=float(before[k]),
            half_95_mm=float(half[k]) if np.isfinite(half[k]) else None,
            correction=tuple((shown * (own.q[k] - own.start[k])).tolist()),
            turn_left_mrad=float(MRAD * np.linalg.norm(own.turned[k])),
            reason=own.refused[k],
        )
        for k in range(program.points)
    )


def sizes(values: Array) -> Sizes:
    """Median, 95th percentile and largest."""
    return Sizes(float(np.median(values)), float(np.percentile(values, 95)), float(values.max()))


def _jump(found: CorrectedProgram) -> Jump | None:
    own, joints = found.found, found.model.arm.joints
    if len(own.q) < 2:
        return None
    steps = np.abs(np.diff(own.q - own.start, axis=0))
    k, j = np.unravel_index(int(steps.argmax()), steps.shape)
    load = np.sum([load.wrench[:, :3] for load in found.loads], axis=0)
    change, size = np.linalg.norm(load[k + 1] - load[k]), np.linalg.norm(load[k : k + 2], axis=1).max()
    return Jump(
        joint=joints[j].name,
        size=joints[j].shown * float(steps[k, j]),
        unit=joints[j].shown_unit,
        line=int(found.program.line[k]),
        load=bool(change > SUDDEN * size),
    )


def _fitted(found: CorrectedProgram) -> Sizes | None:
    """Of a model that knows positions, where these are asked for; None for few points."""
    own, model = found.found, found.model
    if not model.absolute or own.asked != "drawn" or len(own.q) < FITTED:
        return None
    some = np.unique(np.linspace(0, len(own.q) - 1, min(MOST, len(own.q))).round().astype(int))
    stand = Stand(own.q[some], [load.of(some) for load in found.loads])
    half = MM * fitted_half_widths(model, stand, np.array(found.aim.point)).max(axis=1)
    return sizes(half) if np.isfinite(half).all() else None


def _held(found: CorrectedProgram, good: Mask) -> dict[str, int]:
    counts = (found.found.held & good[:, None]).sum(axis=0).tolist()
    names = [joint.name for joint in found.model.arm.joints]
    return {name: count for name, count in zip(names, counts, strict=True) if count}
