"""What section 5.1 leaves beside its report: the readings of the first draw, and a recording."""

from pathlib import Path

import numpy as np

from testbench.arm.library import find_arm
from testbench.bench.campaign import build_cell
from testbench.data.csvfile import write_csv
from testbench.studies.single_link.report import LinkReport
from testbench.studies.single_link.tables import ORDER, POSITION, ROTATION, matrices
from testbench.studies.single_link.trial import GCO, NAME, Settings, measure
from testbench.studies.study import Run
from testbench.views.colours import look
from testbench.views.markdown import grid
from testbench.views.recording.single_link import Matrices, write_single_link
from testbench.views.recording.sweep import Sweep, points
from testbench.views.schema import Column, Table


def write(run: Run[Settings, LinkReport]) -> None:
    """dataset.csv and recording.rrd."""
    draw = measure(build_cell(find_arm(NAME)), run.settings, run.seeds[0])
    write_csv(draw.identification, (), run.folder / "dataset.csv")
    write_recording(run, run.folder / "recording.rrd")


def write_recording(run: Run[Settings, LinkReport], path: Path) -> None:
    """The recording alone."""
    report, words = run.report, run.words
    found = {name: np.array(C) for name, C in list(matrices(report).items())[:-1]}
    shown = Matrices(
        scenario=report.scenario,
        parameters=run.parameters,
        seed=report.seed,
        documents={
            "summary": "\n\n".join(
                [
                    f"### {words.block('question')}",
                    f"#### **{words.block('answer')}**",
                    grid(run.tables["recorded"]),
                    words.block("statements"),
                    words.block("pictures"),
                ]
            ),
            "eigenvalue": f"### Eigenvalues\n\n{grid(run.tables['eigenvalues'])}\n\n{report.which_m}",
            "table": "\n\n".join(grid(run.tables[f"matrix {name}"]) for name in matrices(report)),
        },
        matrices=found,
        looks=[look(m.structure, m.constraint) for m in report.models],
        errors=Table((*run.tables["errors"].columns[:1], POSITION, ROTATION), report.models),
        orders=[_over_m(run, column) for column in (ORDER[2], POSITION)],
    )
    write_single_link(path, shown)


def _over_m(run: Run[Settings, LinkReport], column: Column) -> Sweep:
    """A quantity of GCO over the order m."""
    ours = run.report.model(GCO)
    return Sweep(
        scenario=run.report.scenario,
        parameters=run.parameters,
        seed=run.report.seed,
        question="",
        answer="",
        swept="order m",
        swept_unit="",
        measured=column.heading,
        unit=column.unit,
        points=points(run.report.order, Column("name", ""), ORDER[0], column),
        colours={},
        looks={ours.name: look(ours.structure, ours.constraint)},
    )
