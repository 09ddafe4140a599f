"""The report of the study of model error: what every disturbance costs, beside the noise."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS, is_least_squares
from testbench.bench.rows import UM
from testbench.studies.model_error.cases import ALL, NONE, PLAIN_COMPENSATOR, STIFF, sizes
from testbench.studies.model_error.report import (
    Beats,
    CaseErrors,
    Claim,
    Gains,
    Held,
    ModelErrorReport,
    Together,
)
from testbench.studies.model_error.trial import FEATURED, NAME, CaseRow, Settings
from testbench.studies.noise_sensitivity.by_arm import ByArm, by_arm, true_arms
from testbench.studies.noise_sensitivity.summary import model_at
from testbench.studies.noise_sensitivity.verdict import BY_CONE, PAIRS
from testbench.studies.paper import MOST
from testbench.studies.study import Rows
from testbench.trials.gain import Gain, gained
from testbench.trials.spread import grouped, middle, spread, wins
from testbench.views.schema import best_of

CLAIM = 0.048
"""Largest difference that the paper quotes between errors with and without a gravity compensator [1]."""

Groups = Mapping[tuple[str, str, float], Sequence[CaseRow]]  #: Rows of all trials by case, model and noise.


def summary(asked: Settings, seeds: range, trials: Rows[CaseRow]) -> ModelErrorReport:
    """Medians and spreads by case, model and noise."""
    rows = [row for _, own in trials for row in own]
    groups = grouped(rows, lambda row: (row.case, row.model, row.noise_um))
    cells = [_errors(own, groups) for own in groups.values()]
    noisy = [cell for cell in cells if cell.noise_um > 0]
    claim = _claims(groups, UM * asked.sigma)
    pairs = together(distinct(noisy))
    best = best_of({p.model: p.all_um for p in pairs}).names
    order = ranking(cells)
    adds = noise_adds(cells)
    return ModelErrorReport(
        scenario=NAME,
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        arm=find_arm(asked.arm).resolve().name,
        noise=True,
        truth="nonlinear",
        true_arm=asked.true_arm,
        true_arms=true_arms(asked.true_arm, seeds),
        sigma_um=UM * asked.sigma,
        scale=asked.scale,
        trials=len(seeds),
        workspace_poses=asked.workspace,
        sizes=sizes(asked.scale, asked.only),
        cells=cells,
        claim=claim,
        claim_percent=100 * CLAIM,
        held=held(claim),
        featured=FEATURED,
        ranking=order,
        noise_adds_um=adds,
        above_noise=tuple(cell.case for cell in order if cell.added_um.median > adds),
        together=pairs,
        best_together=best,
        joints_together_um=next(p.all_um for p in pairs if p.model == JOINTS),
        gains=gains(groups, distinct(noisy), UM * asked.sigma),
        beats=[_beats(groups, *names, UM * asked.sigma) for names in PAIRS],
        together_by_arm=together_by_arm(groups, (*best, FEATURED, JOINTS), UM * asked.sigma),
        claim_by_arm=claim_by_arm(groups, UM * asked.sigma),
        models=[
            model_at(cell, case, "workspace")
            for case in (NONE, ALL)
            for cell in distinct(noisy)
            if cell.case == case
        ],
        dataset=next(row.measured for row in rows if row.measured is not None),
    )


def gains(groups: Groups, noisy: Sequence[CaseErrors], noise_um: float) -> Gains:
    """The featured model beside the best of least squares without a prior and beside joints alone."""
    plain = {
        cell.model: cell.rms_um
        for cell in noisy
        if cell.case == ALL and is_least_squares(cell.structure, cell.constraint, prior=cell.prior)
    }

    def gain(theirs: str) -> Gain:
        a, b = (
            [middle(row.rms_um) / 1e3 for row in groups[ALL, name, noise_um]] for name in (FEATURED, theirs)
        )
        return gained(FEATURED, theirs, a, b)

    return Gains(gain(best_of(plain).names[0]), gain(JOINTS))


def _errors(rows: Sequence[CaseRow], groups: Groups) -> CaseErrors:
    """One case, model and noise; what the case adds is counted trial by trial."""
    fields = dict(vars(rows[0]))
    del fields["measured"], fields["true_arm"]
    for name in ("rms_um", "p95_um", "moved_um"):
        fields[name] = spread([middle(getattr(row, name)) for row in rows])
    for name in ("conservative", "solved"):
        fields[name] = float(np.mean([getattr(row, name) for row in rows]))
    base = groups[NONE, rows[0].model, rows[0].noise_um]
    pairs = zip(rows, base, strict=True)
    added = spread([middle(own.rms_um) - middle(none.rms_um) for own, none in pairs])
    return CaseErrors(**fields, added_um=added)


def _claims(groups: Groups, noise_um: float) -> list[Claim]:
    return [
        _claim(rows, groups[NONE, model, noise])
        for compensator in (PLAIN_COMPENSATOR, STIFF)
        for (case, model, noise), rows in groups.items()
        if case == compensator and noise == noise_um
    ]


def _claim(rows: Sequence[CaseRow], base: Sequence[CaseRow]) -> Claim:
    first = rows[0]
    true = [np.array([middle(row.rms_um) for row in own]) for own in (rows, base)]
    read = [np.sqrt(values**2 + 6 * first.noise_um**2) for values in true]  # two readings of three axes
    seen = read[0] / read[1] - 1
    return Claim(
        case=first.case,
        model=first.model,
        against_truth=spread((true[0] / true[1] - 1).tolist()),
        within_true=float(np.mean(np.abs(true[0] / true[1] - 1) <= CLAIM)),
        against_readings=spread(seen.tolist()),
        within_claim=float(np.mean(np.abs(seen) <= CLAIM)),
    )


def held(claims: Sequence[Claim]) -> list[Held]:
    """For which models the claim holds, by reading of the compensator."""
    return [
        Held(
            case=case,
            featured=next(c for c in own if c.model == FEATURED),
            against_truth=tuple(c.model for c in own if c.within_true >= MOST),
            against_readings=tuple(c.model for c in own if c.within_claim >= MOST),
        )
        for case, own in grouped(claims, lambda claim: claim.case).items()
    ]


def together_by_arm(groups: Groups, names: Iterable[str], noise_um: float) -> list[ByArm]:
    """The errors of these models, all disturbances together, that differ by true arm [um]."""
    own = {name: groups[ALL, name, noise_um] for name in names}
    return [
        row
        for name, rows in own.items()
        for row in by_arm(name, [r.true_arm for r in rows], [middle(r.rms_um) for r in rows])
    ]


def claim_by_arm(groups: Groups, noise_um: float) -> list[ByArm]:
    """What a compensator truly changes of the featured model's error, where that differs by true arm [1]."""
    found = []
    for (case, *rest), rows in groups.items():
        if case in (PLAIN_COMPENSATOR, STIFF) and rest == [FEATURED, noise_um]:
            pairs = zip(rows, groups[NONE, FEATURED, noise_um], strict=True)
            changes = [middle(a.rms_um) / middle(b.rms_um) - 1 for a, b in pairs]
            found += by_arm(case, [row.true_arm for row in rows], changes)
    return found


def _beats(groups: Groups, ours: str, theirs: str, noise_um: float) -> Beats:
    a, b = (np.array([middle(row.rms_um) for row in groups[ALL, name, noise_um]]) for name in (ours, theirs))
    better, worse = wins(a, b), wins(b, a)
    return Beats(
        ours=ours,
        theirs=theirs,
        cone=(ours, theirs) in BY_CONE,
        better=better,
        alike=len(a) - better - worse,
        ratio=spread((a / b).tolist()),
    )


def distinct(cells: Sequence[CaseErrors]) -> list[CaseErrors]:
    """Without a completion that exists in no trial with noise: that is least squares once more."""
    there = {cell.model for cell in cells if cell.noise_um > 0 and cell.conservative}
    return [cell for cell in cells if cell.constraint != "free" or cell.model in there]


def ranking(cells: Sequence[CaseErrors]) -> list[CaseErrors]:
    """What each disturbance alone does to the featured model without noise, the costliest first."""
    alone = [c for c in cells if c.model == FEATURED and c.noise_um == 0 and c.case not in (NONE, ALL)]
    return sorted(alone, key=lambda cell: -cell.added_um.median)


def noise_adds(cells: Sequence[CaseErrors]) -> float:
    """What noise adds to the featured model's median error without disturbance [um]."""
    calm, noisy = sorted(
        (c for c in cells if c.model == FEATURED and c.case == NONE), key=lambda cell: cell.noise_um
    )
    return middle(noisy.rms_um) - middle(calm.rms_um)


def together(noisy: Sequence[CaseErrors]) -> list[Together]:
    """Every model without disturbance and with all."""
    none, every = ({c.model: c.rms_um for c in noisy if c.case == case} for case in (NONE, ALL))
    return [Together(model, none[model], every[model]) for model in none]
