"""Entries beside the incumbent arm by arm: ratios of errors with bootstrap intervals, ranks, ties."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import rankdata

from testbench.errors import Array
from testbench.report.table import Row, Trials, number
from testbench.runs.spread import TAIL, spread
from testbench.studies.bench.tasks import DEFAULT, JOINTS
from testbench.studies.bench.trial import DONE, SKIPPED
from testbench.workflows.rows import FAILED

DRAWS = 2000  #: Of the bootstrap, the same in every run.
DECIMALS = 6  #: Of a logarithm of errors: entries nearer than that have one rank.
ERROR = "workspace.rms_mm"
Errors = Mapping[str, Array]  #: Of every entry, arm by arm, (arms,) [mm].


def incumbent(prior: bool) -> str:
    """Name whom a class has to beat: the default of `identify`, without a prior joint stiffness only."""
    return DEFAULT if prior else JOINTS


def begins(rows: Trials, words: str) -> Array:
    """Tell which rows have a status that begins with some words.

    Args:
        rows: Rows of the trials.
        words: First words of the status.

    Returns:
        True for such a row, (rows,).
    """
    return np.array([status.startswith(words) for status in rows["status"].tolist()], dtype=bool)


def errors(rows: Trials) -> dict[str, Array]:
    """Collect errors in one task and class, (arms,) [mm]; who fails errs by the whole deflection.

    To skip is to fail, but for who skips every arm: such entries are left out.
    """
    found = {}
    for (name,), trials in rows.groups("name"):
        done = trials["status"] == DONE
        if done.any() or not begins(trials, SKIPPED).all():
            found[name] = np.fmin(trials[ERROR], trials["deflection_mm"])
    return found


def overall(tasks: Sequence[Errors]) -> dict[str, Array]:
    """Compute geometric means over tasks of those that take part in all of them, (arms,) [mm]."""
    names = [name for name in tasks[0] if all(name in own for own in tasks)]
    return {name: np.exp(np.mean([np.log(own[name]) for own in tasks], axis=0)) for name in names}


def standings(found: Errors, rival: str) -> list[Row]:
    """Rank entries, the best first: errors over the rival's, rank, whether they are tied.

    Both by geometric means over the arms; intervals of 95 % by resampling arms.

    Args:
        found: Errors by entry.
        rival: Name of the rival.

    Returns:
        A row per entry.
    """
    names = list(found)
    L = np.log(np.array([found[name] for name in names])) - np.log(found[rival])
    arms = L.shape[1]
    count = np.random.default_rng(0).multinomial(arms, np.full(arms, 1 / arms), size=DRAWS)
    drawn = count @ L.T / arms  # (draws, names)
    ranks = rankdata(drawn.round(DECIMALS), method="min", axis=1)
    own = rankdata(L.mean(axis=1).round(DECIMALS), method="min")
    ends = np.exp(np.quantile(drawn, (TAIL, 1 - TAIL), axis=0))
    places = np.quantile(ranks, (TAIL, 1 - TAIL), axis=0, method="nearest")
    board: list[Row] = []
    for k in L.mean(axis=1).argsort(kind="stable").tolist():
        place, size = [int(own[k]), *places[:, k].astype(int).tolist()], float(np.exp(L[k].mean()))
        low, high = ends[:, k].tolist()
        row = Row(zip(("rank", "rank_low", "rank_high"), place, strict=True), name=names[k], trials=arms)
        row |= {"ratio": size, "ratio_low": low, "ratio_high": high}
        row |= {"tied": None if names[k] == rival else low <= 1 <= high, "over": spread(np.exp(L[k]))}
        shown = _with(*map("{:.3g}".format, (size, low, high)))
        row |= {"standing": _with(*map(str, place)), "over_default": shown}
        board.append(row)
    return board


def _with(value: str, low: str, high: str) -> str:
    """A number and its interval, where that has a width."""
    return f"{value} ({low} to {high})" if low != high else value


def quantities(rows: Trials) -> Row:
    """Summarise what an entry did beside its ratio, over arms, or over arms and tasks."""
    done, failed = rows.where(status=DONE), int(begins(rows, FAILED).sum() + begins(rows, SKIPPED).sum())
    known = done.pick(np.isfinite(done["cover.covered_percent"].astype(float)))
    return Row(
        rms_mm=number(done[ERROR]) if len(done) else None,
        p95_mm=number(done["workspace.p95_mm"]) if len(done) else None,
        conservative=float(np.mean(done["conservative"].astype(bool))) if len(done) else None,
        covered_percent=float(known["cover.covered_percent"].mean()) if len(known) else None,
        half_mm=float(np.median(known["cover.half_mm"])) if len(known) else None,
        over_ideal=float(np.median(known["cover.half_mm"] / known["cover.ideal_mm"])) if len(known) else None,
        cpu_seconds=float(np.median(done["cpu_seconds"])) if len(done) else None,
        failed=f"{failed} of {len(rows)}" if failed else None,
    )
