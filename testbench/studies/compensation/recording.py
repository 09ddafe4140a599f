"""What the study of compensation leaves beside its report: readings, and the tool drawn off and put back."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS
from testbench.bench.campaign import Cell, build_cell
from testbench.bench.rows import MM, UM
from testbench.bench.truths import FAMILY, member, true_cell
from testbench.data.csvfile import write_csv
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.plant import settle
from testbench.studies.compensation.arms import measure, true_arm
from testbench.studies.compensation.jobs import PATTERN, jobs, on_panel
from testbench.studies.compensation.report import CompensationReport
from testbench.studies.compensation.settings import ADVISED, DEFAULT, IDEAL, MILLING, Settings
from testbench.studies.compensation.trial import Work, execute, identified, prior_in_turn, work
from testbench.studies.study import Run
from testbench.views.colours import CHOICE, MEASURED
from testbench.views.colours import JOINTS as BLUE
from testbench.views.markdown import grid
from testbench.views.recording.compensated import (
    CORRECTED,
    NOT_CORRECTED,
    Compensated,
    Off,
    Part,
    write_compensated,
)
from testbench.views.recording.stream import Header

GRID = (25, 17)  #: Points of the drawn panel along y and up it.
EDGE = 0.1  #: What it is larger than the pattern of holes [m].
SHOWN = {JOINTS: BLUE, DEFAULT: CHOICE.colour}
"""Colour of each model that is drawn."""


def write(run: Run[Settings, CompensationReport]) -> None:
    """dataset.csv and recording.rrd: the first trial, undisturbed, the campaign that is advised."""
    asked, seed = run.settings, run.seeds[0]
    cell = build_cell(find_arm(asked.arm))
    true, ways = true_cell(cell, member(FAMILY, seed), seed), asked.ways(IDEAL)
    read = measure(true, true_arm(true, seed, IDEAL), asked, ways, seed)
    data = read[ways.index(ADVISED)]
    write_csv(data, cell.arm, run.folder / "dataset.csv")
    made = scene(true, asked, data, seed)
    words = run.words.summary(run.tables["short"], run.words.block("reading", scale=made.scale))
    tables = f"### undisturbed, both\n\n{grid(run.tables['undisturbed, both'])}"
    header = Header(run.report.scenario, run.parameters, seed)
    write_compensated(run.folder / "recording.rrd", header, replace(made, summary=words, tables=tables))


def scene(true: Cell, asked: Settings, data: Dataset, seed: int) -> Compensated:
    """The jobs of a trial, done by the true arm; without words on the whole."""
    own, arm = work(asked, seed), true_arm(true, seed, IDEAL)
    fits = {fit.name: fit for fit in identified(true, {ADVISED: data}, prior_in_turn(true, seed))}
    shown = [fits[name] for name in SHOWN]
    done = execute(arm, own, shown)
    offs = [Off(NOT_CORRECTED, MEASURED, done.before)]
    for k, fit in enumerate(shown):
        name = f"{CORRECTED}{fit.name}"
        offs.append(Off(name, SHOWN[fit.name], done.after[k], done.orders[k].half))
    bent = [settle(true.plant, own.q, *load) for load in ((own.load.wrench, own.load.point), ())]
    y, s = (np.linspace(-half - EDGE, half + EDGE, n) for half, n in zip(PATTERN, GRID, strict=True))
    at = np.array([(one, up) for up in s for one in y])
    every = jobs()
    return Compensated(
        cell=true,
        q=own.q,
        asked=np.concatenate([one.position for one in every]),
        force=own.load.wrench[:, :3],
        bent=bent[0].theta - bent[1].theta,
        panel=on_panel(at).reshape(len(s), len(y), 3),
        parts=tuple(_part(one.name, part) for one, part in zip(every, own.parts, strict=True)),
        offs=tuple(offs),
        point_words=point_words(own, [one.name for one in every], offs),
        summary="",
        tables="",
    )


def _part(name: str, points: slice) -> Part:
    return Part(name, points, path=name == MILLING, closed=name == MILLING)


def point_words(own: Work, names: Sequence[str], offs: Sequence[Off]) -> list[str]:
    """Markdown of every point: the force, and how far the tool is off."""
    found: list[str] = []
    for name, part, size in zip(names, own.parts, own.sizes, strict=True):
        for k in range(part.stop - part.start):
            each = [_said(off, off.metres[part][k]) for off in offs]
            found.append(f"**{name.capitalize()}, point {k + 1}**, {size:.0f} N: {'; '.join(each)}")
    return found


def _said(off: Off, metres: Array) -> str:
    size = float(np.linalg.norm(metres))
    return f"{off.name} {MM * size:.3f} mm" if off.name == NOT_CORRECTED else f"{off.name} {UM * size:.1f} um"
