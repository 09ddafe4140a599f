"""Models fitted to runs and judged, and which to take: runs that are held, or two passes over very many."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.campaign.campaign import Cell
from testbench.campaign.evaluation import of_model
from testbench.campaign.model_selection import Recommendation, errors_of, recommend, recommended
from testbench.campaign.models import Model
from testbench.campaign.runs import Many, Runs
from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.identify import Estimate, Method
from testbench.identify.crossval import folds, parts_of
from testbench.identify.evaluate import Score, deflections, judge, score
from testbench.identify.fold import reduce_parts
from testbench.identify.weighed import MOST_READINGS

Clock = Callable[[], float]  #: Wall time [s].


@dataclass(frozen=True)
class Found:
    """Models fitted to runs; one entry a model."""

    runs: Runs  #: Of very many those that are looked at one by one, the worst among them.
    models: Sequence[Model]
    estimates: Sequence[Estimate]
    seconds: Sequence[float]  #: Of the fit; very many runs were reduced for all models before.
    used: Sequence[Score]  #: Errors on the runs that were fitted.
    check: Sequence[Score | None]  #: On those held back.
    taken: Recommendation


def fit_all(cell: Cell, models: Sequence[Model], runs: Runs, clock: Clock) -> Found:
    """Fit, judge and choose models; BenchError when a method cannot fit its structure."""
    if runs.many is not None:
        return _fit_many(cell, models, runs, runs.many, clock)
    estimates, seconds = [], []
    for model in models:
        start = clock()
        estimates.append(of_model(cell, model, runs.used))
        seconds.append(clock() - start)
    used = [_errors(cell, own, runs.used) for own in estimates]
    check = [None if runs.check is None else _errors(cell, own, runs.check) for own in estimates]
    return Found(runs, models, estimates, seconds, used, check, recommend(cell, models, runs.used))


def _errors(cell: Cell, estimate: Estimate, data: Dataset) -> Score:
    return score(deflections(cell.vjm, estimate, data)[data.seen], data.deflection[data.seen])


def _fit_many(cell: Cell, models: Sequence[Model], runs: Runs, many: Many, clock: Clock) -> Found:
    methods = {model.name: _plain(model, many) for model in models}
    part = np.full(many.every.runs, -1)
    part[many.used] = parts_of(many.every.pose[many.used], many.every.level[many.used])
    structures = list({m.structure.name: m.structure for m in models}.values())
    reduced = {own.structure.name: own for own in reduce_parts(cell.vjm, structures, many.every, part)}
    there, estimates, seconds = np.unique(part[many.used]), [], []
    for model in models:
        start = clock()
        together = reduced[model.structure.name].together(there.tolist())
        estimates += methods[model.name].of(cell.vjm, [together])
        seconds.append(clock() - start)

    def held_out_errors(model: Model) -> Array:
        return errors_of(cell, methods[model.name], folds(reduced[model.structure.name], there))

    taken = recommended(cell, models, many.poses, held_out_errors)
    best = next(k for k, m in enumerate(models) if m.name == taken.name)
    used = judge(cell.vjm, estimates, many.every, many.used, best)
    held = None if many.used.all() else judge(cell.vjm, estimates, many.every, ~many.used, best)
    worst = used.worst if held is None else np.union1d(used.worst, held.worst)
    every, fitted, held_back = many.looked_at(worst)
    note = (
        f"all {many.every.runs} runs are fitted and judged; doubts, intervals, tables and pictures are of "
        f"{every.runs} of them, evenly out of all and those of which most is left"
    )
    shown = replace(runs, every=every, used=fitted, check=held_back, notes=(*runs.notes, note))
    check = [None] * len(models) if held is None else held.scores
    return Found(shown, models, estimates, seconds, used.scores, check, taken)


def _plain(model: Model, many: Many) -> Method:
    method = model.estimator
    if not isinstance(method, Method) or method.loss != "plain":
        readings = many.every.runs
        raise BenchError(f"robust fit: expected at most {MOST_READINGS} readings, got {readings} runs")
    return method
