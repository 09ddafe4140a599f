"""Preset `model_error`: what unknown disturbances cost beside the noise, and which model bears them best."""

from collections.abc import Mapping, Sequence

import numpy as np

from testbench.report.figure import Figure, ranges
from testbench.report.report import Report
from testbench.report.schema import true_arm_label
from testbench.report.table import TRIAL, Row, Trials, aligned, matched, merged, number
from testbench.runs.spread import middle, wins
from testbench.studies.campaign import disturbed
from testbench.studies.campaign.disturbed import ALL, IN_FAMILY, NONE, STIFF, DisturbanceSettings
from testbench.studies.campaign.report import ERROR, Preset, TrialTable, lines
from testbench.studies.campaign.trial import worst_tenth
from testbench.workflows.model_names import FILLED
from testbench.workflows.models import DEFAULT, JOINTS
from testbench.workflows.rows import UM

CLAIM_PERCENT = 4.8  #: Largest difference in error by a gravity compensator that the paper quotes [%].
RIVALS = {"Joints": JOINTS, "same_prior": f"MLS56{FILLED}"}
KINDS = (
    "kind default_um Joints_um same_prior_um covered_percent worst_tenth_percent beats_joints "
    "beats_same_prior removed_percent trials"
)
CLAIM = "case name true_change_percent true_within read_change_percent read_within"


def tables(asked: DisturbanceSettings) -> Mapping[str, TrialTable]:
    """Tabulate the default by kind of arm, errors by disturbance, what each adds, and the paper's claim."""
    noise, family = UM * asked.sigma, {"part": IN_FAMILY}
    shown = ("noisy", noise, f"with noise of {noise:g} um"), ("calm", 0.0, "without noise")
    errors = {
        name: TrialTable(
            f"RMS error, um, {words}", "case", "name", by="sigma_um", where=family | {"sigma_um": um}
        )
        for name, um, words in shown
    }
    return {
        "kinds": TrialTable(
            f"All disturbances if not stated otherwise, noise of {noise:g} um: median RMS errors",
            columns=KINDS,
            where={"sigma_um": noise},
            rows=kinds,
        ),
        **errors,
        "ranking": TrialTable(
            f"{DEFAULT}, without noise",
            columns="case moved_um added_um",
            where=family | {"sigma_um": 0.0, "name": DEFAULT},
            rows=ranking,
        ),
        "claim": TrialTable(
            "Errors with the compensator over those without, less 100 %",
            columns=CLAIM,
            where=family | {"sigma_um": noise, "case": {disturbed.PLAIN_COMPENSATOR, STIFF}},
            rows=lambda held: merged(held.keep(*CLAIM.split()), "case", "name"),
        ),
    }


def _derived(_: DisturbanceSettings, trials: Trials) -> Trials:
    """Add what a case adds to the error of the same trial without disturbance, and by how much it changes it.

    Against readings the noise of two readings of three axes stands in quadrature in both errors.
    """
    member = trials["part"] == IN_FAMILY
    own, none = trials.pick(member), np.full(len(trials), np.nan)
    none[member] = matched(own, own.where(case=NONE), ERROR, ("name", "sigma_um", TRIAL))
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


def ranking(alone: Trials) -> Sequence[Row]:
    """Rank what each disturbance does to the default, the costliest first; last what is no disturbance."""
    rows = merged(alone.keep("case", "moved_um", "added_um"), "case")
    return sorted((row for row in rows if row.case not in (NONE, ALL)), key=lambda r: -middle(r.added_um))


def kinds(noisy: Trials) -> list[Row]:
    """Summarise the family, each kind held out, other sizes, each kind of the family, and other cases."""
    family = noisy.where(part=IN_FAMILY, case=ALL)
    beside, own = noisy.where(part=disturbed.BESIDE_IT), family.values("true_arm")
    parts = {"the family": family}
    parts |= {true_arm_label(arm): beside.where(true_arm=arm, size=1.0) for arm in disturbed.kinds_held_out()}
    parts |= {f"disturbances times {x:g}": beside.where(size=x) for x in beside.values("size") if x != 1}
    parts |= {true_arm_label(arm): family.where(true_arm=arm) for arm in own if len(own) > 1}
    parts["undisturbed family"] = noisy.where(part=IN_FAMILY, case=NONE)
    parts[f"{STIFF} alone"] = noisy.where(part=IN_FAMILY, case=STIFF)
    return [_of_kind(kind, part) for kind, part in parts.items() if len(part)]


def _of_kind(kind: str, part: Trials) -> Row:
    """What the default does on arms of one kind, beside its rivals on the same ones."""
    default = part.where(name=DEFAULT)
    ours, *theirs = aligned(part, (DEFAULT, *RIVALS.values()), ERROR).T
    covered, n = default["cover.covered_percent"], len(default)
    return Row(
        {f"{name}_um": number(own) for name, own in zip(RIVALS, theirs, strict=True)},
        **{f"beats_{name.lower()}": wins(ours, own) / n for name, own in zip(RIVALS, theirs, strict=True)},
        kind=kind,
        trials=n,
        default_um=number(ours),
        covered_percent=float(covered.mean()),  # every arm has as many components
        worst_tenth_percent=worst_tenth(covered),
        removed_percent=number(100 * (1 - default[ERROR] / default["deflection_um"])),
    )


def figures(found: Report) -> Mapping[str, Figure]:
    """Draw errors of every model by disturbance, without noise and with it."""
    panes = {
        found.tables[name].title: lines(found, name, "case name", lambda r: r.name != f"{JOINTS}{FILLED}")
        for name in ("calm", "noisy")
    }
    reading = "RMS errors over the workspace. Dots: medians; lines: their spread. Filled: with a prior."
    return {"model_error.png": ranges(panes, found.question, reading)}


PRESET = Preset(
    name="model_error",
    page="docs/studies/model_error.md",
    question="How much do errors grow with disturbances that the model lacks?",
    how="Poses and weight are those of section 6, with and without noise. Models are judged in other poses.",
    options=disturbed.DisturbanceOptions,
    settings=disturbed.settings,
    seeds=(100, 2),
    row=disturbed.DisturbedRow,
    trial=disturbed.trial,
    tables=tables,
    printed="noisy",
    cells=lambda settings, _: {
        case: {"part": IN_FAMILY, "case": case, "sigma_um": UM * settings.sigma} for case in (ALL, NONE)
    },
    derived=_derived,
    figures=figures,
    size=2,
)
STUDY = PRESET.study()
