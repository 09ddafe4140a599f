"""Models fitted to runs and judged, and which to take: runs that are held, or two passes over very many."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.campaign.campaign import Cell
from testbench.campaign.evaluation import of_model
from testbench.campaign.model_selection import Recommendation, by_structure, errors_of, recommended
from testbench.campaign.models import Model
from testbench.campaign.runs import Many, Runs
from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.identify import Estimate, Method
from testbench.identify.crossval import divided, parts_of
from testbench.identify.evaluate import Score, deflections, judge, score
from testbench.identify.weighed import MOST_READINGS

Clock = Callable[[], float]  #: Wall time [s].


@dataclass(frozen=True)
class Found:
    """Models fitted to runs; one entry a model."""

    runs: Runs  #: Of very many those that are looked at one by one, the worst among them.
    models: Sequence[Model]
    estimates: Sequence[Estimate]
    seconds: Sequence[float]  #: Of the fit; the runs were reduced for all models before.
    used: Sequence[Score]  #: Errors on the runs that were fitted.
    check: Sequence[Score | None]  #: On those held back.
    taken: Recommendation


def fit_all(cell: Cell, models: Sequence[Model], runs: Runs, clock: Clock) -> Found:
    """Fit, judge and choose models; BenchError when a method cannot fit its structure."""
    many, estimates, seconds = runs.many, [], []
    if many is not None and not all(map(_plain, models)):
        readings = many.every.runs
        raise BenchError(f"robust fit: expected at most {MOST_READINGS} readings, got {readings} runs")
    data = runs.used if many is None else many.every
    part = divided(runs.used) if many is None else parts_of(many.every.pose, many.every.level, many.used)
    reduced = by_structure(cell.vjm, models, data, part)
    for model in models:
        start = clock()
        plain = _plain(model)
        if plain:
            estimates += plain.of(cell.vjm, [reduced[model.structure.name].together()])
        else:
            estimates.append(of_model(cell, model, runs.used))
        seconds.append(clock() - start)

    def errors(model: Model) -> Array:
        return errors_of(cell, model, reduced[model.structure.name], (runs.used, part))

    poses = len(np.unique(runs.used.pose)) if many is None else many.poses
    taken = recommended(cell, models, poses, errors)
    if many is not None:
        return _judged(cell, Found(runs, models, estimates, seconds, (), (), taken), many)
    used = [_errors(cell, own, runs.used) for own in estimates]
    check = [None if runs.check is None else _errors(cell, own, runs.check) for own in estimates]
    return Found(runs, models, estimates, seconds, used, check, taken)


def _plain(model: Model) -> Method | None:
    """Its method, where that needs no more than what the runs were reduced to."""
    method = model.estimator
    return method if isinstance(method, Method) and method.loss == "plain" else None


def _errors(cell: Cell, estimate: Estimate, data: Dataset) -> Score:
    return score(deflections(cell.vjm, estimate, data)[data.seen], data.deflection[data.seen])


def _judged(cell: Cell, found: Found, many: Many) -> Found:
    """Models judged on very many runs; of these those that are looked at, the worst among them."""
    best = next(k for k, m in enumerate(found.models) if m.name == found.taken.name)
    used, worst = judge(cell.vjm, found.estimates, many.every, many.used, best)
    held = None if many.used.all() else judge(cell.vjm, found.estimates, many.every, ~many.used, best)
    worst = worst if held is None else np.union1d(worst, held[1])
    every, fitted, held_back = many.looked_at(worst)
    note = (
        f"all {many.every.runs} runs are fitted and judged; doubts, intervals, tables and pictures are of "
        f"{every.runs} of them, evenly out of all and those of which most is left"
    )
    notes = (*found.runs.notes, note)
    shown = replace(found.runs, every=every, used=fitted, check=held_back, notes=notes)
    check = [None] * len(found.models) if held is None else held[0]
    return replace(found, runs=shown, used=used, check=check)
