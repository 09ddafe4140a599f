"""What disturbances cost a model that does not know them, beside the noise, and who bears them best."""

from collections.abc import Iterator, Sequence
from dataclasses import is_dataclass

import numpy as np

from testbench.arm.folder import find_arm
from testbench.campaign.model_selection import DEFAULT, FILLED
from testbench.campaign.models import JOINTS
from testbench.campaign.rows import UM
from testbench.campaign.true_arms import FAMILY
from testbench.report.badge import of_models
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import TRIAL, Row, Trials, matched, merged
from testbench.studies.factorial import compare
from testbench.studies.factorial.compare import DUELS, ERROR, RMS
from testbench.studies.model_error import kinds, settings, trial
from testbench.studies.model_error.settings import ALL, NONE, PLAIN_COMPENSATOR, STIFF, Options, Settings
from testbench.studies.model_error.trial import IN_FAMILY
from testbench.studies.study import Study
from testbench.trials.spread import middle, span
from testbench.views.figure import Figure, ranges
from testbench.views.markdown import Markdown, counted
from testbench.views.schema import Table

CLAIM_PERCENT = 4.8
"""Largest difference that the paper quotes of errors with and without a gravity compensator."""
RANKING = "case moved_um added_um"
CLAIM = "case name true_change_percent true_within read_change_percent read_within"
HOW = Markdown(
    "## How it was done\n\n"
    "Moves: how far the disturbance alone moves the deflections to be predicted, RMS. Adds: trial by trial, "
    "error with it less error without. The claim of the paper: at most 4.8 %. Against readings: "
    "sqrt(error^2 + 6 sigma^2), the noise of two readings of three axes added in quadrature to both errors, "
    "as the paper measures. The model and the prior stay those of the arm's folder. Frames, joint sensors "
    "and hanging point: standard deviations along or about each axis. All together are all cases but the "
    "stiff compensator."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads by case, model and noise."""
    sigma_um = UM * asked.sigma
    by_kind = kinds.kinds(trials, sigma_um)
    trials = _with_changes(trials.where(part=IN_FAMILY))
    cells = compare.cells(trials, "case", "sigma_um", also=("moved_um", "added_um"))
    together = trials.where(case=ALL, sigma_um=sigma_um)
    every = [row for row in compare.existing(cells) if (row.case, row.sigma_um) == (ALL, sigma_um)]
    noisy = [row for row in compare.existing(cells) if row.sigma_um > 0]
    held = trials.where(sigma_um=sigma_um, case={PLAIN_COMPENSATOR, STIFF})
    ranking, adds = _ranking(cells), _noise_adds(cells)
    f = Row(
        compare.head(seeds, trials, asked.true_arm),
        arm=find_arm(asked.arm).resolve().name,
        truth="nonlinear",
        sigma_um=sigma_um,
        scale=asked.scale,
        workspace_poses=asked.workspace,
        cells=cells,
        claim=[
            Row(row, true_within=float(row.true_within), read_within=float(row.read_within))
            for row in merged(held.keep(*CLAIM.split()), "case", "name")
        ],
        claim_percent=CLAIM_PERCENT,
        featured=DEFAULT,
        ranking=ranking,
        noise_adds_um=adds,
        above_noise=[row.case for row in ranking if middle(row.added_um) > adds],
        gains=compare.gains(together, every),
        beats=compare.duels(together, DUELS),
        kinds=by_kind,
        models=[
            model
            for case in (NONE, ALL)
            for model in compare.contract([row for row in noisy if row.case == case], where=case)
        ],
    )
    at = say("Disturbed in every way, {sigma_um:g} um of noise:", f)
    return Report(
        scenario=STUDY.name,
        question=say("{arm}: what do disturbances cost that the model does not know?", f),
        title=_title(f),
        answer=lines([at, *compare.beside_rivals(f.gains)]),
        worst=_worst(ranking),
        claims=list(_claims(f)),
        numbers=f,
        tables=(tables := _tables(f)),
        body=[*tables, HOW, kinds.HOW, _sizes(asked)],
        badge=of_models(together, every, DEFAULT, ERROR),
    )


def _with_changes(trials: Trials) -> Trials:
    """What a case adds to the error of the same trial without disturbance, and by how much it changes it.

    Against readings the noise of two readings of three axes stands in quadrature in both errors.
    """
    none = matched(trials, trials.where(case=NONE), ERROR, ("name", "sigma_um", TRIAL))
    noise = 6 * trials["sigma_um"] ** 2
    true = 100 * (trials[ERROR] / none - 1)
    read = 100 * (np.sqrt(trials[ERROR] ** 2 + noise) / np.sqrt(none**2 + noise) - 1)
    return trials.add(
        added_um=trials[ERROR] - none,
        true_change_percent=true,
        true_within=np.abs(true) <= CLAIM_PERCENT,
        read_change_percent=read,
        read_within=np.abs(read) <= CLAIM_PERCENT,
    )


def _ranking(cells: Sequence[Row]) -> list[Row]:
    """What each disturbance alone does to the default without noise, the costliest first."""
    alone = [c for c in cells if (c.name, c.sigma_um) == (DEFAULT, 0) and c.case not in (NONE, ALL)]
    return sorted(alone, key=lambda row: -middle(row.added_um))


def _noise_adds(cells: Sequence[Row]) -> float:
    """What noise adds to the default's median error without disturbance [um]."""
    own = [row for row in cells if (row.name, row.case) == (DEFAULT, NONE)]
    calm, noisy = (middle(row.rms_um) for row in sorted(own, key=lambda row: row.sigma_um))
    return noisy - calm


def _title(f: Row) -> Markdown:
    """What was simulated."""
    scaled = " Disturbances that have a size are {scale:g} times their typical one." if f.scale != 1 else ""
    arms = "" if f.true_arm == FAMILY else f" {compare.arms_told(f)}"  # the table has those of the family
    return say(
        "{arm}, poses and weight of section 6, {n}: RMS errors of predicted deflection in {workspace_poses} "
        f"poses never measured, without noise and with {{sigma_um:g}} um.{scaled}{arms} Medians "
        "({ends}).",
        f,
        n=counted(f.trials, "trial"),
        ends=span(f.trials),
    )


def _worst(ranking: Sequence[Row]) -> Markdown:
    """The costliest disturbances."""
    first, *others = ranking
    if middle(first.added_um) <= 0:
        return say("Costliest without noise: no disturbance adds to the error of {name}.", first)
    more = ", ".join(say('"{case}" {added_um:~+.0f} um', row) for row in others[:2])
    verb = "comes" if len(others) == 1 else "come"
    return say(
        'Costliest without noise, medians: "{case}" adds {added_um:~.0f} um to the error of {name}'
        + (f"; then {verb} {more}." if more else "."),
        first,
    )


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    yield from kinds.claims(f.kinds)
    yield say(
        "Noise of {sigma_um:g} um adds {noise_adds_um:.0f} um to the error of {featured} on the undisturbed "
        "arm. {above} of {n} disturbances alone add more.",
        f,
        above=len(f.above_noise),
        n=len(f.ranking),
    )
    yield compare.by_cone("", f.beats)
    for row in f.claim:
        if row.name == DEFAULT:
            yield say(
                '"{case}" changes the true error of {name} by {true_change_percent:~+.1f} %; against '
                "readings it looks like {read_change_percent:~+.1f} %.",
                row,
            )


def _tables(f: Row) -> dict[str, Table]:
    """The default by kind of arm; errors by disturbance and model with noise; what each adds; the claim."""
    return {
        "kinds": kinds.table(f.kinds, f.sigma_um),
        "noisy": compare.errors(_shown(f, noisy=True), "case", "name", f"RMS error, um, {_noise(f)}"),
        "ranking": Table(columns(RANKING), f.ranking, f"{DEFAULT}, without noise"),
        "claim": Table(columns(CLAIM), f.claim, "Errors with the compensator over those without, less 100 %"),
    }


def _noise(f: Row) -> str:
    return f"with noise of {f.sigma_um:g} um"


def _shown(f: Row, *, noisy: bool) -> list[Row]:
    """Models that differ: with a prior joints alone err as they do without."""
    own = [row for row in compare.existing(f.cells) if row.name != f"{JOINTS}{FILLED}"]
    return [row for row in own if (row.sigma_um > 0) == noisy]


def _sizes(asked: Settings) -> Markdown:
    """What each case switches on, a line each."""
    words = {field: (scale, told) for field, scale, told in settings.SWITCHES.values()}
    found = []
    for name, case in settings.disturbances(asked.scale, asked.only).items():
        for field, value in vars(case).items() if name not in (NONE, ALL) else ():
            if value:
                scale, sentence = words[field]
                own = vars(value) if is_dataclass(value) else {"size": value}
                known = {key: scale * size for key, size in own.items() if isinstance(size, float)}
                found.append(say(f"- {name}: {sentence}", known))
    return Markdown("\n".join(["## What each case switches on", "", *found]))


def figures(found: Report) -> dict[str, Figure]:
    """Errors of every model by disturbance, without noise and with it."""
    f = Row(found.numbers)
    drawn = (*columns("case name"), RMS)
    panes = {
        "without noise": Table(drawn, _shown(f, noisy=False)),
        _noise(f): Table(drawn, _shown(f, noisy=True)),
    }
    where = f"{f.arm}, all disturbances together, {f.sigma_um:g} um of noise:"
    reading = (
        "RMS errors over the workspace. Dots: medians, lines: "
        f"{span(f.trials)} of {f.trials} trials. Filled: with a prior."
    )
    return {"model_error.png": ranges(panes, f"{where} {compare.gains_told(f.gains)}", reading)}


STUDY = Study(
    name="model_error",
    about="Identify an arm that does what the model does not know, with noise and without.",
    options=Options,
    settings=settings.settings,
    seeds=(100, 2),
    row=trial.DisturbedRow,
    trials=trial.trials,
    report=report,
    printed=("noisy",),
    figures=figures,
    size=2,
    models="name",
)
