"""The report of the study of noise: every error with its spread, and what they say."""

from collections.abc import Mapping, Sequence

import numpy as np

from testbench.bench.campaign import Truth
from testbench.bench.rows import UM
from testbench.studies.noise_sensitivity.instruments import UNWEIGHTED, WEIGHTED
from testbench.studies.noise_sensitivity.report import (
    Errors,
    Extremes,
    Instrument,
    Level,
    ModelAt,
    NearInstruments,
    NoiseReport,
    Paired,
    PriorEffect,
    Scores,
    Shares,
    Slope,
    Weighted,
)
from testbench.studies.noise_sensitivity.trial import INSTRUMENT_PARTS, NAME, NoiseRow, Part, Settings
from testbench.studies.study import Trials
from testbench.trials.spread import Spread, grouped, spread
from testbench.views.schema import Best, best_of

PARTS: dict[Part, str] = {"six_dof": "108 runs of section 5.2", "gravity": "KR 500, 8 poses"}
NEAREST: dict[Part, float] = {"six_dof": 25.0, "gravity": 50.0}
"""Noise of the paper's trackers [um], sections 5.2 and 6."""
NEAR = 4.0
"""Distance at which instruments are compared [m]."""
PAIR = ("MGCO56", "MLS56")
"""GCO and least squares of the same structure."""
METHODS = {"none": "least squares", "psd": "GCO"}


def summary(asked: Settings, seeds: range, trials: Trials[NoiseRow]) -> NoiseReport:
    """Medians and spreads by part, model and level."""
    rows = [row for _, own in trials for row in own]
    groups = grouped(rows, lambda row: (row.part, row.model, row.x))
    errors = [_errors(own) for own in groups.values()]
    sweeps = {part: [_level(e) for e in errors if e.part == part] for part in PARTS}
    instruments = [
        Instrument(**vars(e), truth=truth)
        for truth, part in INSTRUMENT_PARTS.items()
        for e in errors
        if e.part == part
    ]
    slopes = {part: _slopes(levels) for part, levels in sweeps.items()}
    paired = _paired(groups)
    every = [level for levels in sweeps.values() for level in levels if level.sigma_um > 0]
    counts: dict[Part, int] = {e.part: e.trials for e in errors if e.part != "instrument_nonlinear"}
    return NoiseReport(
        scenario=NAME,
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        noise=True,
        truth={"six_dof": "linear", "gravity": "nonlinear", "instrument": "both"},
        trials=counts,
        sigmas_um=[UM * s for s in asked.sigmas],
        sweeps=sweeps,
        slopes=slopes,
        extremes=[
            extremes(part, prior, {n: s.um_per_um for n, s in own.items() if s.prior == prior})
            for part, own in slopes.items()
            for prior in (False, True)
        ],
        prior=[effect for own in slopes.values() for effect in effects(list(own.values()))],
        instruments=instruments,
        weighted_over_flat={t: weighted([c for c in instruments if c.truth == t]) for t in INSTRUMENT_PARTS},
        near=near([c for c in instruments if c.truth == "linear"]),
        gco_over_ls=paired,
        gco_better={part: shares([p.better_in for p in paired if p.part == part]) for part in PARTS},
        conservative={
            c: shares([level.conservative for level in every if level.constraint == c])
            for c in ("none", "psd")
        },
        models=[model for part, levels in sweeps.items() for model in _models(part, levels)],
        dataset=next(row.measured for row in rows if row.measured is not None),
    )


def _errors(rows: Sequence[NoiseRow]) -> Errors:
    first = rows[0]
    return Errors(
        part=first.part,
        model=first.model,
        structure=first.structure,
        constraint=first.constraint,
        prior=first.prior,
        x=first.x,
        rms_um=spread([row.rms_um for row in rows]),
        p95_um=spread([row.p95_um for row in rows]),
        conservative=float(np.mean([row.conservative for row in rows])),
        solved=float(np.mean([row.solved for row in rows])),
        trials=len(rows),
    )


def _level(errors: Errors) -> Level:
    return Level(**vars(errors), sigma_um=UM * errors.x)


def _slopes(levels: Sequence[Level]) -> dict[str, Slope]:
    """Median error without noise, and per noise at the largest one, by model."""
    top = max(level.sigma_um for level in levels)
    found = {}
    for name, own in grouped(levels, lambda level: level.model).items():
        by_sigma = {level.sigma_um: level.rms_um.median for level in own}
        first = own[0]
        found[name] = Slope(
            first.part, name, first.structure, first.prior, by_sigma[0.0], by_sigma[top] / top
        )
    return found


def extremes(part: Part, prior: bool, slopes: Mapping[str, float]) -> Extremes:
    """The models to which noise costs least and most."""
    least, most = best_of(slopes), _worst_of(slopes)
    return Extremes(part, prior, least.names, least.value, most.names, 1 / most.value)


def near(instruments: Sequence[Instrument]) -> NearInstruments:
    """The best and the worst instrument at NEAR; the flat one is as good anywhere."""
    errors = {c.model: c.rms_um.median for c in instruments if c.x in (0.0, NEAR)}
    least, most = best_of(errors), _worst_of(errors)
    return NearInstruments(NEAR, least.names, least.value, most.names, 1 / most.value)


def _worst_of(values: Mapping[str, float]) -> Best:
    """The names of largest value; `value` is its inverse."""
    return best_of({name: 1 / value for name, value in values.items()})


def effects(slopes: Sequence[Slope]) -> list[PriorEffect]:
    """What a prior does to every structure that is fitted with and without one."""
    plain = {s.structure: s for s in slopes if not s.prior}
    return [
        PriorEffect(
            part=s.part,
            structure=s.structure,
            lower_with_noise=s.um_per_um < plain[s.structure].um_per_um,
            lower_without_noise=s.noise_free_um < plain[s.structure].noise_free_um,
        )
        for s in slopes
        if s.prior
    ]


def weighted(instruments: Sequence[Instrument]) -> list[Weighted]:
    """Full covariances against flat weights at every distance."""
    errors = {(c.model, c.x): c.rms_um.median for c in instruments}
    truths: dict[float, Truth] = {c.x: c.truth for c in instruments if c.model == WEIGHTED}
    found = []
    for x, truth in truths.items():
        full, flat = errors[WEIGHTED, x], errors[UNWEIGHTED, x]
        better = best_of({"full covariances": full, "flat weights": flat}).names
        found.append(Weighted(truth, x, full / flat, better))
    return found


def _paired(groups: Mapping[tuple[Part, str, float], Sequence[NoiseRow]]) -> list[Paired]:
    found = []
    for part in PARTS:
        for x in sorted({key[2] for key in groups if key[0] == part and key[2] > 0}):
            ours, theirs = (np.array([row.rms_um for row in groups[part, name, x]]) for name in PAIR)
            better = float(np.mean(ours < theirs))
            found.append(Paired(part, UM * x, spread((ours / theirs).tolist()), better))
    return found


def shares(values: Sequence[float]) -> Shares:
    """The least and the largest of some shares of trials."""
    return Shares(min(values), max(values))


def _models(part: Part, levels: Sequence[Level]) -> list[ModelAt]:
    """A row a model at the level nearest the paper's trackers."""
    nearest = min({level.sigma_um for level in levels}, key=lambda s: abs(s - NEAREST[part]))
    found = []
    for level in (own for own in levels if own.sigma_um == nearest):
        scores = Scores(in_mm(level.rms_um), in_mm(level.p95_um))
        found.append(
            ModelAt(
                name=f"{level.model}, {PARTS[part]}",
                method=METHODS[level.constraint],
                constraint=level.constraint,
                prior=level.prior,
                conservative=level.conservative,
                solved=level.solved,
                check=scores if part == "six_dof" else None,
                workspace=scores if part == "gravity" else None,
            )
        )
    return found


def in_mm(um: Spread) -> Spread:
    """Micrometres in millimetres."""
    return Spread(um.median / 1e3, um.p05 / 1e3, um.p95 / 1e3)
