"""What there is to say of a corrected program: report.json's fields."""

from dataclasses import dataclass

import numpy as np

from testbench.bench.compensate import CorrectedProgram
from testbench.bench.rows import MM
from testbench.correct.beyond import extent
from testbench.correct.newton import Mask
from testbench.correct.open import Open, most_open
from testbench.errors import Array
from testbench.model.structure import Ids

MRAD = 1e3
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
    half_95_mm: (
        Sizes | None
    )  #: Half the widest interval of what is left, by axis; None where some are unseen.
    unseen: int  #: Points at which the model has not seen what decides.
    solver_mm: float  #: Farthest that the solver leaves the tool by the model.
    largest: tuple[float, ...]  #: Largest correction of every joint [deg, mm].
    joints: tuple[str, ...]
    units: tuple[str, ...]  #: Of every joint's correction.
    turned: int  #: Points where part of the tool's turn is left.
    turn_left_mrad: float  #: The largest.
    held: dict[str, int]  #: Points at which a joint stops at its limit, by joint.
    jump_mm: float  #: Largest change of the correction from a point to the next.
    jump_line: int | None  #: The line after which it is; None with one point.
    worst: PointRow  #: Of the largest error without correction.
    extrapolated: tuple[str, ...]  #: Loads beyond those of the identification, sentences.
    open: Open | None  #: The link or joint that keeps intervals wide.
    data: tuple[str, ...]  #: What the model was identified from.
    doubts: tuple[str, ...]  #: Of the model.
    rows: tuple[PointRow, ...]


def report(found: CorrectedProgram) -> CompensationReport:
    """The report of a corrected program."""
    own, model, program = found.found, found.model, found.program
    good, rows = own.corrected, rows_of(found)
    force = np.linalg.norm(sum(load.wrench[:, :3] for load in found.loads), axis=1)
    before = MM * np.linalg.norm(own.before, axis=1)
    half = MM * own.half.max(axis=1)
    seen = np.isfinite(half)
    turned = MRAD * np.linalg.norm(own.turned, axis=1) * good * (found.aim.hold != "position")
    shown = np.array([joint.shown for joint in model.arm.joints])
    jump, line = _jump(own.before, program.line)
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
        before_mm=sizes(before),
        half_95_mm=sizes(half) if seen.all() else None,
        unseen=int((~seen).sum()),
        solver_mm=float(MM * np.linalg.norm(own.after, axis=1)[good].max(initial=0.0)),
        largest=tuple((shown * np.abs(own.q - own.start).max(axis=0)).tolist()),
        joints=tuple(joint.name for joint in model.arm.joints),
        units=tuple(joint.shown_unit for joint in model.arm.joints),
        turned=int((turned > MRAD * TURNED).sum()),
        turn_left_mrad=float(turned.max()),
        held=_held(found, good),
        jump_mm=jump,
        jump_line=line,
        worst=rows[int(before.argmax())],
        extrapolated=extent(model, own.start, found.loads).sentences,
        open=most_open(
            model, own.q, found.loads, np.array(found.aim.point), model.absolute and own.asked == "drawn"
        ),
        data=model.about.data,
        doubts=model.about.doubts,
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


def _jump(before: Array, line: Ids) -> tuple[float, int | None]:
    steps = MM * np.linalg.norm(np.diff(before, axis=0), axis=1)
    if not len(steps):
        return 0.0, None
    return float(steps.max()), int(line[int(steps.argmax())])


def _held(found: CorrectedProgram, good: Mask) -> dict[str, int]:
    counts = (found.found.held & good[:, None]).sum(axis=0).tolist()
    names = [joint.name for joint in found.model.arm.joints]
    return {name: count for name, count in zip(names, counts, strict=True) if count}
