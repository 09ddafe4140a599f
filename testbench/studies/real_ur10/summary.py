"""The report over the ladder and all draws of poses."""

from collections.abc import Sequence

import numpy as np

from testbench.bench.rows import MM, UM
from testbench.data.series import Series
from testbench.studies.real_ur10.joints import TRAINED, compliances, joint_reports
from testbench.studies.real_ur10.ladder import CHOSEN, LADDER
from testbench.studies.real_ur10.prototype import KNOWN, Known
from testbench.studies.real_ur10.readings import ARM, SPLITS, read
from testbench.studies.real_ur10.report import (
    ChosenReport,
    KnownReport,
    LadderLine,
    ModelReport,
    NumberLine,
    RealReport,
    SeriesReport,
)
from testbench.studies.real_ur10.rows import LadderRow, SubsetRow
from testbench.studies.real_ur10.settings import NAME, Settings
from testbench.studies.study import Rows
from testbench.trials.spread import grouped, merge


def summary(asked: Settings, seeds: range, trials: Rows[SubsetRow]) -> RealReport:
    """The ladder as it is, the numbers of poses over the seeds."""
    readings, ladder = read(asked.thin), asked.ladder
    numbers = by_number([row for _, rows in trials for row in rows])
    lines = [
        LadderLine(row.model, row.split, row.judged, row.poses, row.error)
        for row in ladder
        if row.error is not None and row.judged is not None
    ]
    return RealReport(
        scenario=NAME,
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=ARM,
        dataset=[_series(one) for one in readings.series],
        splits={name: words for name, words in SPLITS.items() if any(row.split == name for row in ladder)},
        models=[_model(name, ladder) for name in asked.models],
        ladder=lines,
        by_number=numbers,
        joints=joint_reports(readings.cell.arm.joints, readings.series, ladder),
        compliances=compliances(ladder),
        chosen=[
            ChosenReport(TRAINED.get(row.split, f"half of the {row.split}"), row.kept, row.declined)
            for row in ladder
            if row.model == CHOSEN.name and row.judged is None
        ],
        known=[_known(one, numbers) for one in KNOWN],
    )


def by_number(rows: Sequence[SubsetRow]) -> list[NumberLine]:
    """Medians and spread of every number of poses, model and judging series."""
    cases = grouped(rows, lambda row: (row.judged, row.model, row.poses))
    return [merge([NumberLine(**vars(row), seeds=len(own)) for row in own]) for own in cases.values()]


def _series(series: Series) -> SeriesReport:
    x = series.position[:, 0]
    own = series.precision
    sigma = series.sigma if own is None else np.sqrt(np.median(3 / np.trace(own, axis1=2, axis2=3)))
    return SeriesReport(
        name=series.name,
        poses=series.rows,
        sigma_um=float(UM * sigma),
        reach_mm=float(MM * np.linalg.norm(x.max(axis=0) - x.min(axis=0))),
    )


def _model(name: str, ladder: Sequence[LadderRow]) -> ModelReport:
    own = [row for row in ladder if row.model == name and row.judged is None]
    gaps = [row.duality_gap for row in own if row.duality_gap is not None]
    return ModelReport(
        name=name,
        words=next(model.words for model in LADDER if model.name == name),
        method=own[0].method,
        parameters=max(row.parameters for row in own),
        conservative=all(row.conservative for row in own),
        min_eigenvalue=min(row.min_eigenvalue for row in own),
        duality_gap=max(gaps, default=None),
    )


def _known(one: Known, numbers: Sequence[NumberLine]) -> KnownReport:
    ours = [
        line.mean_mm
        for line in numbers
        if (line.poses, line.model, line.judged) == (one.poses, one.model, one.judged)
    ]
    return KnownReport(one.model, one.trained, one.judged, one.mean_mm, ours[0] if ours else None)
