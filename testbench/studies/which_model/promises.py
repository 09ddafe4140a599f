"""What the default promises: whether its intervals hold, whether its doubts about the prior are right."""

from collections.abc import Mapping

import numpy as np

from testbench.bench.truths import CALLED, TRUTHS
from testbench.bench.wrong_prior import PRIORS, PRIORS_CALLED, RIGHT
from testbench.report.table import Cells, Row, Trials, number

EVERY = "all"  #: All cases, in words.
MOVES = 0.05  #: Share of the true deflection over the workspace from which a link is said to move it.
SAID = ("doubted", "told", "unchecked", "otherwise", "either")  #: Columns of what is said of a prior.


def coverage(trials: Trials) -> list[Row]:
    """Intervals over all cases, by number of poses, by prior and by true arm, by method."""
    judged = trials.pick(np.isfinite(trials["cover.half_mm"]))
    parts = {EVERY: judged}
    parts |= {f"{n} poses": own for (n,), own in judged.groups("poses")}
    parts |= {f"prior {PRIORS_CALLED[name]}": judged.where(prior_error=name) for name in PRIORS}
    parts |= {CALLED[name]: judged.where(true_arm=name) for name in TRUTHS}
    found = []
    for where, part in parts.items():
        for (name,), own in part.groups("name"):
            covered, half, ideal = (own[f"cover.{key}"] for key in ("covered_percent", "half_mm", "ideal_mm"))
            found.append(
                Row(
                    where=where,
                    name=name,
                    cases=len(own),
                    covered_percent=covered.mean(),  # every case has as many components
                    by_case_percent=number(covered),
                    half_mm=number(half),
                    ideal_mm=number(ideal),
                    over_ideal=number(half / ideal),
                )
            )
    return found


def doubts(default: Trials) -> list[Row]:
    """By prior, the right one by true arm too, a wrong link by its deflection and name; by poses, and all."""
    trials, found = default.add(**_said(default)), []
    for prior in PRIORS:
        own = trials.where(prior_error=prior)
        share, percent = own["link_share"], f"{100 * MOVES:.0f} % of the deflection"
        parts = {EVERY: own}
        parts |= {CALLED[arm]: own.where(true_arm=arm) for arm in TRUTHS if prior == RIGHT}
        parts |= {
            f"less than {percent}": own.pick(share <= MOVES),
            f"more than {percent}": own.pick(share > MOVES),
        }
        linked = own.pick(np.isfinite(share))
        parts |= {link: linked.where(wrong=link) for link in sorted(linked.values("wrong"))}
        for where, cases in parts.items():
            counts = {None: cases} | {n: cases.where(poses=n) for n in sorted(cases.values("poses"))}
            found += [
                Row(_shares(some), prior_error=prior, where=where, poses=n, cases=len(some))
                for n, some in counts.items()
                if len(some)
            ]
    return found


def _said(default: Trials) -> Mapping[str, Cells]:
    """Of every case what is said of its prior, 0 or 1; NaN where nothing can be."""
    wrong, heard, left = (default[key] for key in ("wrong", "doubted.contradicted", "doubted.unchecked"))
    told = np.array([link in names if link else np.nan for link, names in zip(wrong, heard, strict=True)])
    named = np.array(
        [np.nan if open_ is None else link in open_ for link, open_ in zip(wrong, left, strict=True)]
    )
    asked = [(link, open_) for link, open_ in zip(wrong, left, strict=True) if open_ is not None and link]
    others = {  # how often a link is named where another one is wrong
        link: np.mean(own)
        for link in dict(asked)
        if (own := [link in open_ for other, open_ in asked if other != link])
    }
    return {
        "doubted": np.array([bool(names) for names in heard]),
        "told": told,
        "unchecked": named,
        "otherwise": np.array(
            [
                np.nan if open_ is None else others.get(link, np.nan)
                for link, open_ in zip(wrong, left, strict=True)
            ]
        ),
        "either": np.where(np.isnan(named), np.nan, np.fmax(told, named)),
    }


def _shares(own: Trials) -> dict[str, float | None]:
    """Shares of the cases that count; None where there is none."""
    known = {name: own[name][np.isfinite(own[name])] for name in SAID}
    return {name: float(cells.mean()) if len(cells) else None for name, cells in known.items()}
