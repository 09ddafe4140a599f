"""Runs that are too many to hold, fitted by several models in two passes over them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.campaign.campaign import Cell
from testbench.campaign.model_selection import Recommendation, errors_of, recommended
from testbench.campaign.models import Model
from testbench.data.dataset import Dataset, Ids, Mask, select
from testbench.data.spool import Campaign
from testbench.data.stream import some
from testbench.errors import BenchError
from testbench.identify import Estimate, Method
from testbench.identify.cells import reduce_cells
from testbench.identify.crossval import FOLDS, divided, load_parts, pose_parts
from testbench.identify.evaluate import Score
from testbench.identify.judged import judge
from testbench.identify.readings import MOST_READINGS


@dataclass(frozen=True, eq=False)
class Many:
    """Runs block by block."""

    every: Campaign  #: All of them, in the base's frame.
    used: Mask  #: Those to fit, (runs,).

    @property
    def poses(self) -> int:
        """How many poses those to fit are in."""
        return len(np.unique(self.every.pose[self.used]))

    def looked_at(self, worst: Ids) -> tuple[Dataset, Dataset, Dataset | None]:
        """Runs that are looked at one by one, these worst among them: all, those to fit, those held back."""
        place = np.arange(self.every.runs)
        kept = [some(place[own]) for own in (self.used, ~self.used) if own.any()]
        runs = np.unique(np.concatenate([*kept, worst]))
        data = self.every.pick(runs)
        used = self.used[runs]
        return data, select(data, used), None if used.all() else select(data, ~used)


@dataclass(frozen=True)
class ManyFitted:
    """Models fitted to many runs."""

    estimates: tuple[Estimate, ...]  #: Of every model.
    seconds: tuple[float, ...]  #: Its solve; all were reduced together before.
    taken: Recommendation
    used: tuple[Score, ...]  #: Errors on the runs that were fitted.
    check: tuple[Score, ...] | None  #: On those held back.
    worst: Ids  #: Indices of the runs of which the model to take leaves most.


def fit_many(cell: Cell, models: Sequence[Model], many: Many, clock: Callable[[], float]) -> ManyFitted:
    """Fit, choose and judge models.

    Raises:
        BenchError: When a method needs the readings one by one, or cannot fit its structure.
    """
    methods = [_plain(model, many) for model in models]
    pose, cells = many.every.pose, np.full(many.every.runs, -1)
    parts = load_parts(many.every.level[many.used])
    if many.poses > 1:
        parts = FOLDS * pose_parts(pose[many.used]) + parts
    cells[many.used] = parts
    structures = list({m.structure.name: m.structure for m in models}.values())
    reduced = reduce_cells(cell.vjm, structures, many.every, cells)
    by_name = {own.structure.name: own for own in reduced}
    there = np.unique(parts)
    estimates, seconds = [], []
    for model, method in zip(models, methods, strict=True):
        start = clock()
        estimates += method.of(cell.vjm, [by_name[model.structure.name].together(there.tolist())])
        seconds.append(clock() - start)
    taken = recommended(
        cell,
        models,
        many.poses,
        lambda m: errors_of(cell, _plain(m, many), divided(by_name[m.structure.name], there)),
    )
    best = next(k for k, m in enumerate(models) if m.name == taken.name)
    used = judge(cell.vjm, estimates, many.every, many.used, best)
    held = None if many.used.all() else judge(cell.vjm, estimates, many.every, ~many.used, best)
    worst = used.worst if held is None else np.union1d(used.worst, held.worst)
    return ManyFitted(
        tuple(estimates), tuple(seconds), taken, used.scores, None if held is None else held.scores, worst
    )


def _plain(model: Model, many: Many) -> Method:
    method = model.estimator
    if not isinstance(method, Method) or method.loss != "plain":
        readings = many.every.runs
        raise BenchError(f"robust fit: expected at most {MOST_READINGS} readings, got {readings} runs")
    return method
