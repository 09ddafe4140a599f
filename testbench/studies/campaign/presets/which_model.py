"""Preset `which_model`: the method to use by default, whatever the true arm and the prior are."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from testbench.plant.true_arms import TRUTHS
from testbench.report.colours import CHOICE
from testbench.report.figure import Figure, forest
from testbench.report.report import Report
from testbench.report.schema import KNOWN, TRUE_ARM_LABELS, columns
from testbench.report.table import SHARED, TRIAL, Cells, Row, Trials, matched, number
from testbench.studies.campaign import family
from testbench.studies.campaign.family import (
    CHOSEN,
    POSES,
    SAID,
    FamilyMethodRow,
    FamilyOptions,
    FamilySettings,
    said_of_prior,
)
from testbench.studies.campaign.report import ERROR, Preset, TrialTable, Where, by_case
from testbench.workflows.models import JOINTS, PRIORS, UNPERTURBED

MARGIN = 0.05  #: Share by which an error must exceed that of joints alone for a method to lose.
MOVES = 0.05  #: Share of the true deflection over the workspace from which a link is said to move it.
PROMISES = f"where cases covered_percent half_mm over_ideal {' '.join(SAID)}"


def tables(_: FamilySettings) -> Mapping[str, TrialTable]:
    """Tabulate methods by poses, the default over joints alone by true arm and prior, and its promises."""
    few = {"name": CHOSEN, "poses": POSES[0]}
    return {
        "short": TrialTable("RMS error over the workspace, um", across="poses"),
        "cells": TrialTable(
            f"The default's error over that of Joints-only, {POSES[0]} poses",
            down="true_arm",
            across="prior_error",
            value="over_joints",
            where=few,
        ),
        "losses": TrialTable(
            f"Cases in which a method errs over {100 * MARGIN:g} % more than Joints-only",
            columns="name poses over_joints loses",
            by="poses",
        ),
        "promises": TrialTable(
            "Intervals and warnings of the default", columns=PROMISES, where={"name": CHOSEN}, rows=promises
        ),
    }


def _derived(_: FamilySettings, trials: Trials) -> Trials:
    """Sort cases as readers expect them; add errors over those of joints alone in the same case."""
    places = [
        [list(known).index(word) for word in trials[name]]
        for name, known in {"prior_error": PRIORS, "true_arm": TRUTHS}.items()
    ]
    own = trials.pick(np.lexsort(places))
    over = own[ERROR] / matched(own, own.where(name=JOINTS), ERROR, (TRIAL, "true_arm", "poses"))
    return by_case(own.add(over_joints=over, loses=over > 1 + MARGIN), "true_arm")


def promises(default: Trials) -> Iterator[Row]:
    """Count whether intervals hold and doubts are right: of all cases, by poses, prior, true arm and link."""
    judged = default.add(**said_of_prior(default))
    share, percent = judged["link_share"], f"{100 * MOVES:.0f} % of the deflection"
    parts, called = {"all": judged}, KNOWN["prior_error"].called
    parts |= {f"{n} poses": own for (n,), own in judged.groups("poses")}
    parts |= {f"prior {called[name]}": judged.where(prior_error=name) for name in PRIORS}
    parts[f"prior right, {TRUE_ARM_LABELS['tubes']}"] = judged.where(
        prior_error=UNPERTURBED, true_arm="tubes"
    )
    parts[f"a link off, less than {percent}"] = judged.pick(share <= MOVES)
    parts[f"a link off, more than {percent}"] = judged.pick(share > MOVES)
    parts |= {TRUE_ARM_LABELS[name]: judged.where(true_arm=name) for name in TRUTHS}
    for where, trials in parts.items():
        if not len(trials):
            continue
        covered, half, ideal = (trials[f"cover.{key}"] for key in ("covered_percent", "half_mm", "ideal_mm"))
        yield Row(
            where=where,
            cases=len(trials),
            covered_percent=covered.mean(),  # every case has as many components
            half_mm=number(half, trials[SHARED]),
            ideal_mm=number(ideal, trials[SHARED]),
            over_ideal=number(half / ideal, trials[SHARED]),
            **{key: _share(trials[key]) for key in SAID},
        )


def _share(cells: Cells) -> float | None:
    """Of the cases that count; None where there is none."""
    known = cells[np.isfinite(cells)]
    return float(known.mean()) if len(known) else None


def _cells(_: FamilySettings, trials: Trials) -> Mapping[str, Where]:
    """Choose the cases with fewest poses."""
    return {"": {"poses": min(trials.values("poses"))}}


def figures(found: Report) -> Mapping[str, Figure]:
    """Draw the error of every method over the family, a pane a number of poses."""
    table = found.tables["short"]
    name, *drawn = table.columns
    [error] = columns(ERROR)
    shown = (name, *(replace(error, key=column.key, form=".0f") for column in drawn))
    looks = {**table.looks, CHOSEN: CHOICE}
    reading = "Larger dots: what testbench chooses from the readings. Filled: with a prior."
    panes = {column.key: column.heading for column in drawn}
    table = replace(table, columns=shown, looks=looks)
    return {"which_model.png": forest(table, panes, found.question, reading, JOINTS)}


PRESET = Preset(
    name="which_model",
    page="docs/studies/which_model.md",
    question="Which method should be the default with 8, 12 or 20 poses?",
    how="Each arm is read under its payload, in two runs per pose. MuJoCo gives the true deflections. Models "
    "are judged over the workspace. In every trial, each of six true arms gets a different one of six "
    "priors.",
    options=FamilyOptions,
    settings=family.settings,
    seeds=(102, 6),
    row=FamilyMethodRow,
    trial=family.trial,
    tables=tables,
    printed="short",
    cells=_cells,
    ours=CHOSEN,
    pairs=((CHOSEN, JOINTS), ("MGCO56", "MLS56")),
    derived=_derived,
    figures=figures,
)
STUDY = PRESET.study()
