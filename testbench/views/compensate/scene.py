"""A corrected program as a scene for the Rerun viewer; importing this module imports rerun."""

from dataclasses import replace

import numpy as np

from testbench.bench.campaign import Cell
from testbench.bench.compensate import CorrectedProgram
from testbench.bench.compensate_report import CompensationReport, PointRow
from testbench.correct.rest import rest
from testbench.views.colours import GCO, MEASURED
from testbench.views.compensate.words import words
from testbench.views.picked import picked
from testbench.views.recording.compensated import CORRECTED, NOT_CORRECTED, Compensated, Off, Part


def scene(cell: Cell, found: CorrectedProgram, report: CompensationReport) -> Compensated:
    """The arm along its program: where the loaded tool would go, and where it goes corrected."""
    own, state = found.found, found.model.state
    some = picked(np.linalg.norm(own.before, axis=1), np.arange(found.program.points), far=1)
    loads = [load.of(some) for load in found.loads]
    q = own.start[some]
    off = Off(NOT_CORRECTED, MEASURED, own.before[some])
    corrected = Off(f"{CORRECTED}by the model", GCO, own.after[some], own.half[some], foretold=True)
    text = words(report)
    made = Compensated(
        cell=cell,
        q=q,
        asked=own.target.position[some],
        force=np.sum([load.wrench[:, :3] for load in loads], axis=0),
        bent=rest(state, q, loads).theta - (0 if own.asked == "drawn" else rest(state, q).theta),
        panel=None,
        parts=(Part("program", slice(0, len(some)), path=len(some) > 1),),
        offs=(off, corrected),
        point_words=[_said(report.rows[k]) for k in some],
        summary="",
        tables=text.block("joints"),
    )
    return replace(made, summary=text.summary(text.block("how_to_read", scale=made.scale)))


def _said(row: PointRow) -> str:
    """Markdown of a point."""
    half = (
        "nothing bounds what is left" if row.half_95_mm is None else f"within {row.half_95_mm:.3f} mm (95 %)"
    )
    after = f"left as it is: {row.reason}" if row.reason else f"corrected {half}"
    return f"**Point {row.label}**, line {row.line}: {row.before_mm:.3f} mm as programmed; {after}"
