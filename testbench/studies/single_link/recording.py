"""What section 5.1 leaves beside its report: the readings of the first draw, and a recording."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import build_cell
from testbench.data.csvfile import write_csv
from testbench.studies.single_link.report import LinkReport
from testbench.studies.single_link.tables import ORDER, POSITION, ROTATION, matrices
from testbench.studies.single_link.trial import GCO, NAME, Settings, measure
from testbench.studies.study import Run
from testbench.views.colours import look
from testbench.views.markdown import grid
from testbench.views.recording.chart import Chart, dots
from testbench.views.recording.pen import snake
from testbench.views.recording.plane import TITLE, WHOLE
from testbench.views.recording.single_link import Matrices, write_single_link
from testbench.views.recording.stream import Header
from testbench.views.recording.swept import Sweep, points
from testbench.views.schema import Column, Table


def write(run: Run[Settings, LinkReport]) -> None:
    """dataset.csv and recording.rrd."""
    draw = measure(build_cell(find_arm(NAME)), run.settings, run.seeds[0])
    write_csv(draw.identification, (), run.folder / "dataset.csv")
    write_recording(run, run.folder / "recording.rrd")


def write_recording(run: Run[Settings, LinkReport], path: Path) -> None:
    """The recording alone."""
    report, tables = run.report, run.tables
    shown = Matrices(
        documents={
            "summary": run.words.summary(tables["recorded"], then=("statements", "pictures")),
            "eigenvalue": f"### Eigenvalues\n\n{grid(tables['eigenvalues'])}\n\n{report.which_m}",
            "table": "\n\n".join(grid(tables[f"matrix {name}"]) for name in matrices(report)),
        },
        matrices={name: np.array(C) for name, C in list(matrices(report).items())[:-1]},
        errors=[_errors(run, column) for column in (POSITION, ROTATION)],
        orders=[_over_m(run, column) for column in (ORDER[2], POSITION)],
    )
    write_single_link(path, Header(report.scenario, run.parameters, report.seed), shown)


def _errors(run: Run[Settings, LinkReport], column: Column) -> Chart:
    """Errors model by model, with their spread over draws."""
    models = run.report.models
    table = Table((*run.tables["errors"].columns[:1], column), models)
    colours = [look(m.structure, m.constraint).colour for m in models]
    title = f"RMS {column.heading} ({column.unit}), logarithmic"
    path = f"error_{column.unit}/{snake(column.heading)}"
    return Chart(path, title, dots(table, colours), (WHOLE[0], WHOLE[1] / 2 - TITLE))


def _over_m(run: Run[Settings, LinkReport], column: Column) -> Sweep:
    """A quantity of GCO over the order m."""
    ours, x = run.report.model(GCO), replace(ORDER[0], heading="order m", unit="")
    own = points(run.report.order, Column("name", ""), x, column)
    return Sweep(x, column, own, {ours.name: look(ours.structure, ours.constraint)})
