"""What reports of factorial campaigns share: errors by factor, ratios fit by fit, gains over incumbents."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.campaign.model_selection import DEFAULT
from testbench.campaign.models import JOINTS
from testbench.campaign.true_arms import CALLED, FAMILY
from testbench.identify import Constraint
from testbench.report.campaigns import pairs
from testbench.report.columns import columns
from testbench.report.report import say
from testbench.report.table import SHARED, TRIAL, Row, Trials, matched, merged
from testbench.studies.rivals import SAME
from testbench.trials.spread import Number, Spread, middle, wins
from testbench.views.gains import beside
from testbench.views.markdown import Markdown
from testbench.views.schema import Table, best_of, pivot

ERROR = "rms_um"  #: What models are judged by.
RMS = replace(columns(ERROR)[0], form=".0f")
FIT = ("parameters", "rank", "min_eigenvalue", "f_m", "f_m_floor", "duality_gap", "solve_seconds")
JUDGED = (
    *("name", "structure", "constraint", "prior", ERROR, "p95_um", "max_um", "conservative", "solved"),
    *FIT,
    "identification.",
)
"""Columns of a row whatever the factors are."""
BY_CONE = (("MGCO56", "MLS56"), (DEFAULT, SAME))
DUELS = (*BY_CONE, ("MGCO56", JOINTS), ("MGCO56 + prior", JOINTS), (DEFAULT, JOINTS))
"""What the cone does without a prior and to the default, then GCO and the default against the incumbent."""
METHODS: Mapping[Constraint, str] = {
    "none": "least squares",
    "psd": "GCO",
    "free": "least squares, conservative of equal fit",
    "ridge": "ridge regression",
    "clipped": "least squares, clipped to the cone",
    "own": "own estimator",
}


def cells(trials: Trials, *by: str, also: Sequence[str] = ()) -> list[Row]:
    """Medians and spreads of every model in every cell of some factors.

    Args:
        trials: A row a fit.
        by: The factors.
        also: Other columns to merge.
    """
    return merged(trials.keep(*JUDGED, *by, *also, SHARED), "name", *by)


def head(seeds: Sequence[int], trials: Trials, asked: str = FAMILY) -> Row:
    """What report.json says first; asked for are the family of true arms, or one of it."""
    arms = {arm: len(own.values(TRIAL)) for (arm,), own in trials.keep("true_arm", TRIAL).groups("true_arm")}
    seed = list(seeds) if len(seeds) > 1 else seeds[0]
    return Row(
        seed=seed, noise=True, trials=len(seeds), true_arm=asked, true_arms=arms, dataset=dataset(trials)
    )


def arms_told(f: Row) -> Markdown:
    """True arms in words, with their trials."""
    if f.true_arm != FAMILY:
        return say("True arm: {arm}.", arm=CALLED[f.true_arm])
    return say(
        "True arms in turn: {arms}.", arms=", ".join(f"{CALLED[arm]} ({n})" for arm, n in f.true_arms.items())
    )


def gains(trials: Trials, models: Sequence[Row], ours: str = DEFAULT) -> Row:
    """One model beside the best least squares without a prior and beside joints alone, in one cell.

    Args:
        trials: Of the cell.
        models: The same merged, a row a model.
        ours: Name of the model.
    """
    squares = {m.name: m.rms_um for m in models if m.constraint == "none" and not m.prior}
    squares.pop(JOINTS)
    rival = max(best_of(squares).names)  # MLS32 is MLS56 without what no reading tells
    return pairs(trials, {"least_squares": (ours, rival), "joints": (ours, JOINTS)}, ERROR, 1e-3)


def by_case(trials: Trials, *by: str) -> Trials:
    """Rows with a name of their own for every case of a trial that has several: these columns tell them."""
    keys = zip(*(trials[name].tolist() for name in (TRIAL, *by)), strict=True)
    return trials.add(**{TRIAL: [" ".join(map(str, key)) for key in keys], SHARED: trials[TRIAL]})


def beside_rivals(gains: Row, each: str = "trial") -> Iterator[Markdown]:
    """The errors of these gains, a sentence each rival that is not ours; each is what a trial is called."""
    first = next(iter(gains.values()))
    squares, joints = gains.get("least_squares"), gains.get("joints")
    rival = ", least squares without prior {other:.0f} um; {it:less}" if squares else ""
    other = squares and 1e3 * middle(squares.theirs_mm)
    yield say(
        f"{{ours}} {{own:.0f}} um{rival}.", first, own=1e3 * middle(first.ours_mm), it=squares, other=other
    )
    if joints:
        sentence = f"Joint stiffness only {{other:.0f}} um, {{it:more {each}}}."
        yield say(sentence, it=joints, other=1e3 * middle(joints.theirs_mm))


def gains_told(gains: Row) -> str:
    """The same for the title of a figure."""
    rivals = {
        "least squares without prior": gains.get("least_squares"),
        "joint stiffness only": gains.get("joints"),
    }
    return beside(rivals, "um")


def duels(
    trials: Trials,
    asked: Sequence[tuple[str, str]],
    *by: str,
    of: str = "name",
    within: Sequence[str] = (),
) -> list[Row]:
    """Two on the same readings, by cell: ratio of errors, shares of trials in which ours is less, or alike.

    Args:
        trials: Of all cells.
        asked: Ours and theirs.
        by: The factors; rows of a cell are alike in these.
        of: The column of ours and theirs.
        within: What else tells a fit of a cell and trial from another.
    """
    found = []
    for ours, theirs in asked:
        own = trials.where(**{of: ours})
        a, b = own[ERROR], matched(own, trials.where(**{of: theirs}), ERROR, (*by, *within, TRIAL))
        for key, case in own.keep(*by, TRIAL).add(a=a, b=b, ratio=a / b).groups(*by):
            [row] = merged(case.add(**{SHARED: case[TRIAL]}).keep("ratio", SHARED))
            won, lost = wins(case["a"], case["b"]), wins(case["b"], case["a"])
            n = len(case)
            cell = Row(zip(by, key, strict=True))
            tied = (n - won - lost) / n
            found.append(Row(cell, **row, won=won / n, tied=tied, ours=ours, theirs=theirs, trials=n))
    return found


def by_cone(where: str, found: Sequence[Row]) -> Markdown:
    """What the cone does by itself in one cell, without a prior and to the default.

    Args:
        where: The cell.
        found: Its duels.
    """
    plain, filled = (next(d for d in found if (d.ours, d.theirs) == pair) for pair in BY_CONE)
    same = ", both err the same in {tied:share {trials}}" if filled.tied else ""
    return say(
        "The cone by itself{where}: {plain.ours} beats {plain.theirs} in {plain.won:share {trials}} of "
        "{trials} trials. {ours} beats {theirs}, the same without the cone, in {won:share {trials}}"
        f"{same}; its error is {{ratio:~.3f}} times theirs.",
        filled,
        plain=plain,
        where=where,
    )


def existing(rows: Sequence[Row]) -> list[Row]:
    """Models by case, without a completion that exists in no trial with noise: least squares once more."""
    there = {row.name for row in rows if row.sigma_um > 0 and row.conservative is not False}
    return [row for row in rows if row.constraint != "free" or row.name in there]


def errors(rows: Sequence[Row], down: str, across: str, title: str, last: str = "") -> Table:
    """Errors by two factors, or by model and factor, as a table of both; last stand columns of other keys."""
    return pivot(Table((), rows, title), *columns(f"{down} {across}"), RMS, *columns(last))


def contract(models: Sequence[Row], judged: str = "workspace", where: str = "") -> list[Row]:
    """Rows of report.json's `models` of one cell, judged by the check set or over the workspace."""
    none = {"check": None, "workspace": None, "paper": None}
    return [
        Row(
            m | none,
            name=f"{m.name}, {where}" if where else m.name,
            method=METHODS[m.constraint],
            **{judged: Row({f"{key}_mm": _mm(m[f"{key}_um"]) for key in ("rms", "p95", "max")})},
        )
        for m in models
    ]


def _mm(um: Number) -> Number:
    return um.scaled(1e-3) if isinstance(um, Spread) else middle(um) / 1e3


def dataset(trials: Trials) -> Row | None:
    """What the dataset of the first seed holds that has one."""
    known = trials.keep("measured.")
    shown = np.isfinite(known["measured.runs"]).nonzero()[0][:1] if "measured.runs" in known else np.array([])
    return merged(known.pick(shown))[0].measured if len(shown) else None
