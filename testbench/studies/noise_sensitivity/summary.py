"""The report of the study of noise: every error with its spread, and what they say."""

from collections.abc import Sequence
from typing import Literal, cast

import numpy as np

from testbench.bench.baselines import JOINTS
from testbench.bench.default import DEFAULT
from testbench.bench.rows import UM
from testbench.identify import Constraint
from testbench.studies.noise_sensitivity.by_arm import true_arms
from testbench.studies.noise_sensitivity.fits import FitRow, Fits
from testbench.studies.noise_sensitivity.instruments import NEAR
from testbench.studies.noise_sensitivity.report import Level, ModelAt, NoiseReport, Scores
from testbench.studies.noise_sensitivity.trial import (
    INSTRUMENT,
    INSTRUMENT_PARTS,
    NAME,
    TRUTHS,
    NoiseRow,
    Part,
    Settings,
)
from testbench.studies.noise_sensitivity.verdict import (
    Groups,
    compared,
    costs,
    errors_by_arm,
    extremes,
    gains,
    leaders,
    nearest,
    paired,
    shares,
    slopes,
    weighted,
    weighted_by_arm,
    worst,
)
from testbench.studies.study import Rows
from testbench.trials.groups import by_group
from testbench.trials.spread import Number, Spread, grouped, middle, spread

PARTS: dict[Part, str] = {"gravity": "KR 500, 8 poses", "six_dof": "108 runs of section 5.2"}
METHODS: dict[Constraint, str] = {
    "none": "least squares",
    "psd": "GCO",
    "free": "least squares, conservative of equal fit",
}


def summary(asked: Settings, seeds: range, trials: Rows[NoiseRow]) -> NoiseReport:
    """Medians and spreads by part, model and level."""
    groups = cast(Groups, by_group(trials, ("part", "model", "x"), Fits))
    by_part = grouped([_level(*key, own) for key, own in groups.items()], lambda level: level.part)
    sweeps = {part: by_part[part] for part in PARTS}
    instruments = [level for part in INSTRUMENT_PARTS.values() for level in by_part[part]]
    cost = {part: slopes(groups, part) for part in PARTS}
    pairs = {part: paired(groups, part) for part in PARTS}
    led = {part: leaders(part, levels) for part, levels in sweeps.items()}
    gain = {part: gains(groups, part, own) for part, own in sweeps.items()}
    noisy = [level for levels in sweeps.values() for level in levels if level.x > 0]
    near = {
        name: own
        for (part, name, x), own in groups.items()
        if part == INSTRUMENT_PARTS["linear"] and x in (0, NEAR)
    }
    return NoiseReport(
        scenario=NAME,
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        noise=True,
        truth={"six_dof": "linear", "gravity": "nonlinear", "instrument": "both"},
        true_arm=asked.true_arm,
        true_arms=true_arms(asked.true_arm, seeds),
        default=DEFAULT,
        trials={part: own[0].trials for part, own in by_part.items()},
        sigmas_um=[UM * s for s in asked.sigmas],
        sweeps=sweeps,
        slopes=cost,
        costs={part: costs(list(own.values())) for part, own in cost.items()},
        instruments=instruments,
        instruments_by=INSTRUMENT,
        near_m=NEAR,
        near=extremes({name: spread(own.rms_um) for name, own in near.items()}),
        weighted_over_flat=grouped(weighted(groups), lambda row: row.truth),
        leaders=led,
        gains=gain,
        worst={part: worst(own, gain[part].least_squares.theirs) for part, own in sweeps.items()},
        by_arm={part: errors_by_arm(groups, part, own) for part, own in led.items()},
        weighted_by_arm=weighted_by_arm(groups, NEAR),
        paired=[row for own in pairs.values() for row in own],
        compared={part: compared(own) for part, own in pairs.items()},
        conservative={
            words: shares([fit.conservative for fit in own]) for words, own in grouped(noisy, _method).items()
        },
        models=[model for part, levels in sweeps.items() for model in _models(part, levels)],
        dataset=next(row.measured for _, own in trials for row in own if row.measured is not None),
    )


def _level(part: Part, model: str, x: float, fits: Fits) -> Level:
    """Errors with their spread, truth values as shares."""
    return Level(
        model=model,
        structure=fits.structure[0],
        constraint=fits.constraint[0],
        prior=bool(fits.prior[0]),
        rms_um=spread(fits.rms_um),
        p95_um=spread(fits.p95_um),
        conservative=float(np.mean(fits.conservative)),
        solved=float(np.mean(fits.solved)),
        part=part,
        x=x,
        trials=len(fits.rms_um),
        truth=TRUTHS[part],
        sigma_um=UM * x if part in PARTS else None,
    )


def _method(fit: FitRow) -> str:
    """Whose shares of conservative fits belong together, in words."""
    words = "joints alone" if fit.structure == JOINTS else METHODS[fit.constraint]
    return f"{words} with prior" if fit.prior else words


def _models(part: Part, levels: Sequence[Level]) -> list[ModelAt]:
    """A row a model at the level nearest the paper's trackers."""
    where: Literal["check", "workspace"] = "check" if part == "six_dof" else "workspace"
    return [model_at(level, PARTS[part], where) for level in nearest(part, levels)]


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


def _mm(um: Number) -> Number:
    return um.scaled(1e-3) if isinstance(um, Spread) else middle(um) / 1e3
