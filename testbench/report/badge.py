"""Badge of a run: who wins beside the strongest rival of its class, by how much, and whether that holds.

Ratios and shares are written in words: 8.6; a share with its interval by Wilson, 79 % (70 to 86 %).
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Literal

import numpy as np

from testbench.errors import Array
from testbench.model.structure import JOINTS_ONLY
from testbench.report.markdown import Markdown, as_markdown, counted, listed
from testbench.report.schema import ALIKE
from testbench.report.table import MODEL, Row, Trials, aligned, shared
from testbench.runs.spread import TAIL, Cells, Spread, median_interval, redrawn
from testbench.workflows.model_names import in_words


def ratio(value: float, *beside: float) -> str:
    """Write a ratio in two or three digits: 1.04, 1.7, 8.6, 21, 1,300; in more from 1 to 1.005.

    Args:
        value: The ratio [1].
        beside: Ratios that stand beside it: it has as many decimals as the least of all.

    Returns:
        The number.
    """
    least = min(value, *beside, value)
    decimals = 2 if least < 1.1 else 1 if least < 9.95 else 0
    return f"{value:,.{3 if 1 < least < 1.005 else decimals}f}"


MAX_TIES = 2  #: Most models that a verdict names because they tie: of more, one and a count.
MIN_PAIRS = 6  #: Pairs from which on a sign test can tell at 95 %: five agree in 1 of 16 by chance.
BLOCKS = 500  #: Most that it draws from: of more poses or readings those side by side are one.
SHOWN_AS_SAME = 5e-4  #: Ratio minus 1 below which two errors have the same three digits.
ROUNDING_RATIO = 1000.0  #: Errors below the largest one over this are rounding.
PLACES = "place_mm"  #: Column of errors pose by pose in the rows of a first trial.
POSES = "pose of one arm"  #: What is counted where a run has one trial.

LEAST_SQUARES = ("none", "ridge", "clipped")  #: What methods ask that are incumbents.

Verdict = Literal["holds", "likely", "tie", "undecided", "do not use"]


@dataclass(frozen=True)
class Badge:
    """Hold the answer in one line; `words` are the same wherever they are read."""

    winner: str  #: What is drawn foremost in every picture.
    rival: str  #: The strongest of those that ask for no more than the winner.
    factor: float | None  #: The rival's error over the winner's; None where no pair was judged [1].
    interval: tuple[float, float] | None  #: The same, 95 %; None of too few pairs [1].
    n: int  #: Pairs: trials, poses, runs or points.
    verdict: Verdict
    each: str = "trial"  #: What a pair is.
    what: str = "error"  #: What is compared.
    why: str = ""  #: What speaks against the winner, whatever its error is.
    exact: bool = False  #: Whether the winner's errors are rounding: the factor is then a lower bound.
    ties: tuple[str, ...] = ()  #: All that tie with ours, the rival among them where it does.
    chance: float | None = None  #: That a pair gets better by the winner, where that is not sure [1].
    trials: int = 0  #: Trials that pairs share; 0 where each pair is of its own.
    article: str = ""  #: Before each name in words: "the " if names describe.

    @property
    def words(self) -> Markdown:
        """State the verdict: who wins, by how much, over how many."""
        winner, rival = (as_markdown(self._told(name)) for name in (self.winner, self.rival))
        if self.why:
            return Markdown(f"Do not use {winner}: {as_markdown(self.why)}.")
        if self.factor is None:
            return Markdown(
                f"Undecided: no {self.each.partition(' ')[0]} has errors of both {winner} and {rival}."
            )
        least = "at least " if self.exact else ""
        shown = least + ratio(max(self.factor, 1 / self.factor))
        side = "lower" if self.factor >= 1 else "higher"
        size = f"the {self.what} of {winner} is {shown}x {side}"
        times = f"{size} than that of {rival}"
        first, _, of = self.each.partition(" ")
        shared = f"from {counted(self.trials, 'trial')}" if self.trials else ""
        pairs = " ".join(filter(None, [counted(self.n, first), of, shared]))
        takes = f"a verdict needs {counted(MIN_PAIRS, 'trial' if self.trials else first)}"
        if self.interval is None and abs(self.factor - 1) < SHOWN_AS_SAME:
            return Markdown(f"Undecided: {winner} and {rival} have the same error in {pairs}; {takes}.")
        if self.interval is None:
            return Markdown(f"Undecided: {times} in {pairs}; {takes}.")
        low, high = self.interval
        told = [self._told(name) for name in sorted(self.ties, key=lambda name: name != self.rival)]
        if len(told) > MAX_TIES:
            told = [told[0], counted(len(told) - 1, "other")]
        tied = as_markdown(listed(told))
        seen = pairs if self.exact else f"{pairs}, 95 % interval {{}} to {{}}"
        if self.verdict == "tie":
            near = "" if low <= 1 <= high else f", within {100 * ALIKE:g} %"
            of = "" if len(self.ties) < 2 else f" of {rival} to {winner}"
            size = f"{self.what} ratio{of} {self.factor:.2f}, {seen.format(f'{low:.2f}', f'{high:.2f}')}"
            return Markdown(f"Tie{near}: {winner} matches {tied} ({size}).")
        if self.chance is not None:
            sure = f"a {first} improves with a probability of {100 * self.chance:.0f} %"
            return Markdown(f"Likely: {times}; {sure} (median of {pairs}).")
        head = f"Holds: {times}" if self.verdict == "holds" else f"Do not use {rival}: {size}"
        also = f"; {winner} matches {tied}" if tied else ""
        return Markdown(f"{head} ({seen.format(ratio(low, high), ratio(high, low))}){also}.")

    def _told(self, name: str) -> str:
        """Write a name in a sentence."""
        return f"{self.article}{in_words(name)}"

    @property
    def marked(self) -> str:
        """Name what tables mark: the winner; none on a tie, of too few, or where it is not to be used."""
        return "" if self.why or self.verdict in ("tie", "undecided") else self.winner

    def json(self) -> dict[str, object]:
        """Convert it to JSON data for report.json."""
        return {**asdict(self), "words": self.words}


def decide(
    ours: tuple[str, Sequence[float] | Array],
    theirs: tuple[str, Sequence[float] | Array],
    each: str = "trial",
    why: str = "",
    trials: Cells | None = None,
) -> Badge:
    """Compare two in the same trials, by name and errors, both (n,).

    Of trials the factor is the median of their ratios, its interval that of the sign test, or by trial where
    several cases share one. Of poses, runs or points of one trial it is the ratio of the RMS errors that
    tables show, by a bootstrap over them.

    Args:
        ours: What is asked about; it stays the winner of a tie, of too few pairs that of less error.
        theirs: Its rival.
        each: What a pair is; "trial" or "case" of several, all else is of one.
        why: What speaks against ours, whatever the errors are.
        trials: Labels of the trials, (n,), where several cases share one.

    Returns:
        The badge.
    """
    a, b = (np.asarray(errors, dtype=float) for _, errors in (ours, theirs))
    known = np.isfinite(a) & np.isfinite(b)
    a, b = a[known], b[known]
    own = None if trials is None else np.asarray(trials)[known]
    if not len(a):
        return Badge(ours[0], theirs[0], None, None, 0, "do not use" if why else "undecided", each, why=why)
    least = max(a.max(), b.max()) / ROUNDING_RATIO or 1.0  # nothing over nothing is 1
    exact = bool(min(a.max(), b.max()) <= least < max(a.max(), b.max()))
    a, b = np.maximum(a, least), np.maximum(b, least)
    factor, ends = _of_one(a, b)
    if _several(each):
        factor, ends = float(np.median(b / a)), median_interval(b / a, own)
    names = (ours[0], theirs[0])
    verdict: Verdict = "undecided" if ends is None else "tie"
    if ends is None and factor < 1 and not why:
        names, factor = names[::-1], 1 / factor
    if ends is not None and (ends[0] > 1 < factor - ALIKE):
        verdict = "holds"
    elif ends is not None and ends[1] < 1 < 1 / factor - ALIKE and not why:
        names = names[::-1]
        verdict = "do not use"
        factor = 1 / factor
        ends = (1 / ends[1], 1 / ends[0])
    verdict = "do not use" if why else verdict
    several = 0 if own is None else len(np.unique(own))
    ties = (theirs[0],) if verdict == "tie" else ()
    return Badge(*names, factor, ends, len(a), verdict, each, why=why, exact=exact, ties=ties, trials=several)


Pair = tuple[Array, Array, Cells | None]
"""Errors of ours and of another in the same trials, (n,) both, and labels of trials that cases share."""


def badge_against_all(
    ours: str, pairs: Mapping[str, Pair], each: str = "trial", why: str = ""
) -> Badge | None:
    """Compare one with the strongest of its rivals, and name all that tie with it.

    Args:
        ours: Its name.
        pairs: Errors by the name of the rival.
        each: See `decide`.
        why: What speaks against ours, whatever the errors are.

    Returns:
        The badge; None without rivals.
    """

    def size(name: str) -> float:
        """Median over trials, or mean square over poses, of what is known."""
        a, b = (np.asarray(own, dtype=float) for own in pairs[name][:2])
        errors = b[np.isfinite(a) & np.isfinite(b)]
        if not len(errors):
            return math.inf
        return float(np.median(errors) if _several(each) else np.mean(errors**2))

    sizes = {name: size(name) for name in pairs}
    order = sorted((name for name in pairs if sizes[name] < math.inf), key=lambda name: sizes[name])
    badges = [decide((ours, a), (name, b), each, why, own) for name in order for a, b, own in [pairs[name]]]
    ties = tuple(name for name, badge in zip(order, badges, strict=True) if badge.verdict == "tie")
    return replace(badges[0], ties=ties) if badges else None


def _several(each: str) -> bool:
    """Whether pairs are of several trials, not all of one."""
    return each.partition(" ")[0] in ("trial", "case")


def _of_one(a: Array, b: Array) -> tuple[float, tuple[float, float] | None]:
    """Ratio of two RMS errors over the same poses, (n,) both, and its interval; the same each time."""
    n = len(a)
    times = float(np.sqrt((b**2).sum() / (a**2).sum()))
    if n < MIN_PAIRS:
        return times, None
    k = min(n, BLOCKS)
    ours, theirs = (np.add.reduceat(own**2, np.arange(k) * n // k) for own in (a, b))
    count = redrawn(k)
    low, high = np.quantile(np.sqrt((count @ theirs) / (count @ ours)), (TAIL, 1 - TAIL)).tolist()
    return times, (low, high)


def incumbents(models: Iterable[Row], ours: str) -> list[str]:
    """List the rivals of a model's class: least squares and joint stiffness, with a prior only if it has one.

    Args:
        models: The models.
        ours: Name of the model.

    Returns:
        Names of its rivals.
    """
    known = {m.name: m for m in models}
    prior = bool(known[ours].prior)
    return [
        name
        for name, m in known.items()
        if name != ours
        and (m.constraint in LEAST_SQUARES or m.structure == JOINTS_ONLY)
        and bool(m.prior) <= prior
    ]


def of_models(trials: Trials, models: Sequence[Row], ours: str, value: str) -> Badge | None:
    """Compare a model with the strongest incumbent of its class.

    Args:
        trials: A row a model and trial.
        models: What the names are: structure, constraint, prior.
        ours: Which of them is asked about.
        value: Column of the error.

    Returns:
        The badge; None without an incumbent.
    """
    there = set(trials.values(MODEL))
    rivals = [name for name in incumbents(models, ours) if name in there]
    return of_rivals(trials, ours, rivals, value)


def of_rivals(
    trials: Trials, ours: str, rivals: Sequence[str], value: str, each: str = "trial"
) -> Badge | None:
    """Compare a model with the strongest of some rivals, that of least median error; one trial pose by pose.

    Args:
        trials: Rows of the trials.
        ours: Name of the model.
        rivals: Names of the rivals.
        value: Column of the error.
        each: What a trial is.

    Returns:
        The badge; None without a rival.
    """
    pairs, each = _pairs(trials, ours, rivals, value, each)
    return badge_against_all(ours, pairs, each)


def _pairs(
    trials: Trials, ours: str, others: Sequence[str], value: str, each: str
) -> tuple[dict[str, Pair], str]:
    """Pair the errors of ours with those of others, by their names; and name what a pair is."""
    pairs: dict[str, Pair] = {}
    for name in others:
        a, b = aligned(trials, (ours, name), value).T
        if len(a) == 1 and PLACES in trials:
            a, b = (np.array(trials.where(**{MODEL: own})[PLACES][0]) for own in (ours, name))
            pairs[name], each = (a, b, None), POSES
        elif len(a):
            pairs[name] = (a, b, shared(trials, (ours, name)))
    return pairs, each


def ratios(ours: str, pairs: Mapping[str, Pair], each: str = "trial") -> list[Row]:
    """Compare the errors of several models with those of one in the same trials.

    Args:
        ours: Its name.
        pairs: Errors of ours and of another, by the name of the other.
        each: See `decide`.

    Returns:
        A row for each, ours first: its `name` and the `ratio` of its error to ours, with a 95 % interval
        where there are enough pairs.
    """
    rows = [Row(name=ours, ratio=1.0)]
    for name, (a, b, own) in pairs.items():
        badge = decide((ours, a), (name, b), each, trials=own)
        if badge.factor is None:
            continue
        ends = sorted([badge.factor, *(badge.interval or ())])
        turned = ends if badge.winner == ours else [1 / end for end in ends[::-1]]
        low = turned[0]
        middle = turned[len(turned) // 2]
        high = turned[-1]
        rows.append(Row(name=name, ratio=Spread(middle, low, high) if badge.interval else middle))
    return rows


def ratios_of(trials: Trials, ours: str, value: str) -> list[Row]:
    """Compare all models of trials with ours: see `ratios`; of one trial pose by pose.

    Args:
        trials: Rows of the trials.
        ours: Name of our model.
        value: Column of the error.

    Returns:
        A row for every other model.
    """
    others = [name for name in trials.values(MODEL) if name != ours]
    return ratios(ours, *_pairs(trials, ours, others, value, "trial"))


def drawn(badge: Badge | None, known: Collection[str], *others: str) -> list[str]:
    """List the models of every picture that are there, in the order in which they are drawn.

    Others first, then the rival and joint stiffness alone, the winner last: on top, and by it poses are
    ordered. Table, chart, map and arm of a run show these.

    Args:
        badge: The badge; None for none.
        known: Names of the models that are there.
        others: Names of other models to draw.

    Returns:
        The names.
    """
    names = [*others, *([badge.rival, JOINTS_ONLY, badge.winner] if badge else [JOINTS_ONLY])]
    last = {name: None for name in reversed(names) if name in known}
    return list(last)[::-1]
