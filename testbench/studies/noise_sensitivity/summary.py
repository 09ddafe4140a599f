"""The report of the study of noise: every error with its spread, and what they say."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal, TypeVar

import numpy as np

from testbench.bench.rows import UM
from testbench.studies.noise_sensitivity.fits import FitRow
from testbench.studies.noise_sensitivity.instruments import UNWEIGHTED, WEIGHTED
from testbench.studies.noise_sensitivity.report import (
    Costs,
    Extremes,
    Level,
    ModelAt,
    NoiseReport,
    Paired,
    Scores,
    Shares,
    Slope,
    Weighted,
)
from testbench.studies.noise_sensitivity.trial import NAME, TRUTHS, NoiseRow, Part, Settings
from testbench.studies.study import Trials
from testbench.trials.spread import Number, Spread, ends, grouped, middle, spread, wins
from testbench.views.schema import best_of

PARTS: dict[Part, str] = {"six_dof": "108 runs of section 5.2", "gravity": "KR 500, 8 poses"}
NEAREST: dict[Part, float] = {"six_dof": 25.0, "gravity": 50.0}
"""Noise of the paper's trackers [um], sections 5.2 and 6."""
NEAR = 4.0  #: Distance at which instruments are compared [m].
PAIR = ("MGCO56", "MLS56")  #: GCO and least squares of the same structure.
METHODS = {"none": "least squares", "psd": "GCO"}

F = TypeVar("F", bound=FitRow)


def summary(asked: Settings, seeds: range, trials: Trials[NoiseRow]) -> NoiseReport:
    """Medians and spreads by part, model and level."""
    rows = [row for _, own in trials for row in own]
    groups = grouped(rows, lambda row: (row.part, row.model, row.x))
    by_part = grouped([_level(own) for own in groups.values()], lambda level: level.part)
    sweeps = {part: by_part[part] for part in PARTS}
    instruments = [c for part, own in by_part.items() if part not in PARTS for c in own]
    slopes = {part: _slopes(levels) for part, levels in sweeps.items()}
    paired = _paired(groups)
    noisy = [level for levels in sweeps.values() for level in levels if level.x > 0]
    return NoiseReport(
        scenario=NAME,
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        noise=True,
        truth={"six_dof": "linear", "gravity": "nonlinear", "instrument": "both"},
        trials={part: own[0].trials for part, own in by_part.items()},
        sigmas_um=[UM * s for s in asked.sigmas],
        sweeps=sweeps,
        slopes=slopes,
        costs={part: costs(list(own.values())) for part, own in slopes.items()},
        instruments=instruments,
        near_m=NEAR,
        near=extremes({c.model: middle(c.rms_um) for c in by_part["instrument_linear"] if c.x in (0, NEAR)}),
        weighted_over_flat=grouped(_weighted(instruments), lambda row: row.truth),
        gco_over_ls=paired,
        gco_better={part: _shares([p.better_in for p in paired if p.part == part]) for part in PARTS},
        conservative={
            c: _shares([fit.conservative for fit in own])
            for c, own in grouped(noisy, lambda fit: fit.constraint).items()
        },
        models=[model for part, levels in sweeps.items() for model in _models(part, levels)],
        dataset=next(row.measured for row in rows if row.measured is not None),
    )


def summed(rows: Sequence[F]) -> F:
    """A fit over all trials: errors with their spread, truth values as shares."""
    first = rows[0]
    return replace(
        first,
        rms_um=spread([middle(row.rms_um) for row in rows]),
        p95_um=spread([middle(row.p95_um) for row in rows]),
        conservative=float(np.mean([row.conservative for row in rows])),
        solved=float(np.mean([row.solved for row in rows])),
    )


def _level(rows: Sequence[NoiseRow]) -> Level:
    fields = vars(summed(rows))
    del fields["measured"]
    part, x = rows[0].part, rows[0].x
    return Level(**fields, trials=len(rows), truth=TRUTHS[part], sigma_um=UM * x if part in PARTS else None)


def _slopes(levels: Sequence[Level]) -> dict[str, Slope]:
    """Median error without noise, and per noise at the largest one, by model."""
    found = {}
    for name, own in grouped(levels, lambda level: level.model).items():
        errors = {UM * level.x: middle(level.rms_um) for level in own}
        top = max(errors)
        found[name] = Slope(name, own[0].structure, own[0].prior, errors[0.0], errors[top] / top)
    return found


def costs(slopes: Sequence[Slope]) -> Costs:
    """To which models noise costs least and most, and where a prior helps."""
    plain = {s.structure: s for s in slopes if not s.prior}
    filled = {s.structure: s for s in slopes if s.prior}
    return Costs(
        plain=extremes({s.model: s.um_per_um for s in plain.values()}),
        with_prior=extremes({s.model: s.um_per_um for s in filled.values()}),
        lowered=tuple(n for n, s in filled.items() if s.um_per_um < plain[n].um_per_um),
        raised_without_noise=tuple(n for n, s in filled.items() if s.noise_free_um > plain[n].noise_free_um),
    )


def extremes(values: Mapping[str, float]) -> Extremes:
    """The names of the least and of the largest value, all above 0."""
    least, most = best_of(values), best_of({name: 1 / value for name, value in values.items()})
    return Extremes(least.names, least.value, most.names, max(values.values()))


def _weighted(instruments: Sequence[Level]) -> list[Weighted]:
    """Full covariances against flat weights at every distance."""
    errors = {(c.truth, c.model, c.x): middle(c.rms_um) for c in instruments}
    found = []
    for truth, model, x in errors:
        if model == WEIGHTED:
            full, flat = errors[truth, WEIGHTED, x], errors[truth, UNWEIGHTED, x]
            better = best_of({"full covariances": full, "flat weights": flat}).names
            found.append(Weighted(truth, x, full / flat, better))
    return found


def _paired(groups: Mapping[tuple[Part, str, float], Sequence[NoiseRow]]) -> list[Paired]:
    found = []
    for part in PARTS:
        for x in sorted({key[2] for key in groups if key[0] == part and key[2] > 0}):
            ours, theirs = (np.array([middle(row.rms_um) for row in groups[part, n, x]]) for n in PAIR)
            better = wins(ours, theirs) / len(ours)
            found.append(Paired(part, UM * x, spread((ours / theirs).tolist()), better))
    return found


def _shares(values: Sequence[float]) -> Shares:
    return Shares(min(values), max(values))


def _models(part: Part, levels: Sequence[Level]) -> list[ModelAt]:
    """A row a model at the level nearest the paper's trackers."""
    nearest = min({level.x for level in levels}, key=lambda x: abs(UM * x - NEAREST[part]))
    own = [level for level in levels if level.x == nearest]
    return [model_at(level, PARTS[part], "check" if part == "six_dof" else "workspace") for level in own]


def model_at(fit: FitRow, where: str, judged: Literal["check", "workspace"]) -> ModelAt:
    """A fit over all trials as a row of the contract, judged by its check set or over the workspace."""
    scores = Scores(_mm(fit.rms_um), _mm(fit.p95_um))
    return ModelAt(
        name=f"{fit.model}, {where}",
        method=METHODS[fit.constraint],
        constraint=fit.constraint,
        prior=fit.prior,
        conservative=fit.conservative,
        solved=fit.solved,
        check=scores if judged == "check" else None,
        workspace=scores if judged == "workspace" else None,
    )


def _mm(um: Number) -> Spread:
    return Spread(middle(um) / 1e3, *(end / 1e3 for end in ends(um)))
