"""What models leave of very many runs, in one pass: errors over all of them, and where they are largest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset, Ids, Mask
from testbench.errors import Array
from testbench.identify.cells import Blocks, in_threads
from testbench.identify.estimate import Estimate
from testbench.identify.evaluate import Score, all_deflections
from testbench.model.vjm import Vjm

BINS, LEAST, DECADES = 30_000, 1e-12, 15
"""Of the counts by which quantiles are found: each is 0.12 % wide."""
FAR = 40  #: Runs that are remembered for what is left of them.


@dataclass(frozen=True)
class Judged:
    """Models on some runs."""

    scores: tuple[Score, ...]  #: Of every model.
    worst: Ids  #: Indices of the runs of which one of the models leaves most, in rising order.


def judge(vjm: Vjm, estimates: Sequence[Estimate], blocks: Blocks, which: Mask, taken: int) -> Judged:
    """Errors of models on runs.

    Args:
        vjm: The model.
        estimates: What was identified.
        blocks: The runs.
        which: Those that count, (runs,).
        taken: Which model's largest errors are remembered.
    """

    def work(share: Sequence[int]) -> _Sums:
        found = _Sums(len(estimates))
        for k in share:
            runs, data = blocks.block(k)
            if which[runs].any():
                found.add(all_deflections(vjm, estimates, data), data, (runs, which[runs]), taken)
        return found

    one, *more = in_threads(blocks, work)
    for other in more:
        one.join(other)
    return Judged(tuple(map(one.score, range(len(estimates)))), np.sort(one.worst))


class _Sums:
    """What is counted of errors, absolute [m] and relative [1], model by model."""

    def __init__(self, models: int) -> None:
        self.points, self.square = 0, np.zeros(models)
        self.most = np.zeros((2, models))
        self.counts = np.zeros((2, models, BINS), dtype=np.int64)
        self.worst, self.size = np.array([], dtype=int), np.array([])

    def add(self, moved: Array, data: Dataset, counted: tuple[Ids, Mask], taken: int) -> None:
        """Deflections of a block by every model, (models, runs, m, 3) [m]; indices of runs, which count."""
        runs, use = counted
        seen = data.seen & use[:, None]
        if not seen.any():
            return
        left = np.linalg.norm(moved - data.deflection, axis=-1)
        size = np.linalg.norm(data.deflection, axis=-1)[seen]
        largest = np.where(seen, left[taken], 0.0).max(axis=1)
        far = np.argsort(-largest, kind="stable")[:FAR]
        self._remember(runs[far[use[far]]], largest[far[use[far]]])
        self.points += int(seen.sum())
        for k, own in enumerate(left[:, seen]):
            self.square[k] += (own**2).sum()
            for kind, values in enumerate((own, own[size > 0] / size[size > 0])):
                if len(values):
                    self.most[kind, k] = max(self.most[kind, k], values.max())
                    self.counts[kind, k] += np.bincount(_bin(values), minlength=BINS)

    def join(self, other: "_Sums") -> None:
        """What another thread counted."""
        self.points += other.points
        self.square += other.square
        self.most = np.maximum(self.most, other.most)
        self.counts += other.counts
        self._remember(other.worst, other.size)

    def _remember(self, runs: Ids, size: Array) -> None:
        runs, size = np.append(self.worst, runs), np.append(self.size, size)
        order = np.lexsort([runs, -size])[:FAR]
        self.worst, self.size = runs[order], size[order]

    def score(self, k: int) -> Score:
        """Of a model; quantiles are the middle of their bin."""
        moved = self.counts[1, k].any()
        return Score(
            rms=float(np.sqrt(self.square[k] / self.points)),
            p95=_quantile(self.counts[0, k], 0.95),
            max=float(self.most[0, k]),
            p95_relative=_quantile(self.counts[1, k], 0.95) if moved else None,
            max_relative=float(self.most[1, k]) if moved else None,
        )


def _bin(values: Array) -> Ids:
    place = (np.log10(np.maximum(values, LEAST) / LEAST) * (BINS / DECADES)).astype(int)
    return np.asarray(np.minimum(place, BINS - 1))


def _quantile(counts: Ids, share: float) -> float:
    place = int(np.searchsorted(np.cumsum(counts), share * (counts.sum() - 1), side="right"))
    return float(LEAST * 10 ** ((place + 0.5) * DECADES / BINS))
