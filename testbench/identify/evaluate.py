"""How good a model is: errors of predicted deflections, of runs that are held or of very many in one pass."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError, Ids, Mask
from testbench.identify.estimate import Estimate
from testbench.identify.fold import BLOCK_RUNS, Blocks, in_threads
from testbench.model.laws import as_loaded, vjm_of
from testbench.model.vjm import Vjm, chain, generalised_load, marker_points, translation_rows

BINS, LEAST, DECADES = 30_000, 1e-12, 15
"""Of the counts by which quantiles are found: each is 0.12 % wide."""
FAR = 40  #: Runs that are remembered for what is left of them.


@dataclass(frozen=True)
class Score:
    """Distance errors of predicted deflections over a set of runs."""

    rms: float  #: Root mean square of the distance error over all points [m].
    p95: float  #: 95th percentile [m].
    max: float  #: Largest [m].
    #: 95th percentile of the error as a share of the measured deflection of its point [1]; None where no
    #: point moved.
    p95_relative: float | None
    max_relative: float | None  #: The largest such share [1].


def deflections(vjm: Vjm, estimate: Estimate, data: Dataset) -> Array:
    """Deflections of a dataset's markers by a model, Eq. (11).

    Args:
        vjm: The model's kinematics.
        estimate: The identified compliances.
        data: Gives poses, loads and markers; its readings are not used.

    Returns:
        World x, y and z of every marker in every run, (runs, m, 3) [m].
    """
    return np.asarray(all_deflections(vjm, [estimate], data)[0])


def all_deflections(vjm: Vjm, estimates: Sequence[Estimate], data: Dataset) -> Array:
    """The same by several models, (models, runs, m, 3) [m]; J_p C_theta J_F^T w, block by block."""
    points, found = marker_points(vjm, data.markers), []
    vjm = vjm_of(vjm, max((own.structure for own in estimates), key=lambda s: s.n_theta))
    for first in range(0, data.runs, BLOCK_RUNS):  # so that memory does not grow with the runs
        runs = slice(first, first + BLOCK_RUNS)
        where = chain(as_loaded(vjm, data.taken_off, runs), data.q[runs])
        load = generalised_load(where, data.wrench[runs], data.point[runs])
        rows = translation_rows(where, points)
        turns = [own.C_theta @ load[: len(own.C_theta)] for own in estimates]
        moved = [np.einsum("ptr,tr->rp", rows[:, : len(own)], own) for own in turns]
        found.append(np.array(moved).reshape(len(moved), -1, len(points), 3))
    return np.concatenate(found, axis=1)


def score(predicted: Array, reference: Array) -> Score:
    """Distance errors of predictions against measured (or true) deflections.

    Args:
        predicted: Such as `deflections` returns, (runs, m, 3) [m].
        reference: Such as `Dataset.deflection`, (runs, m, 3) [m]; index both with `Dataset.seen` where
            targets were lost.

    Returns:
        Root mean square, 95th percentile and largest error, absolute and relative.

    Raises:
        BenchError: When the shapes differ, or a number is not finite.
    """
    if np.shape(predicted) != np.shape(reference):
        raise BenchError(f"score: expected equal shapes, got {np.shape(predicted)} and {np.shape(reference)}")
    for name, values in (("predicted", predicted), ("reference", reference)):
        if not np.isfinite(values).all():
            raise BenchError(f"score: {name} [m]: expected finite numbers")
    error = np.linalg.norm(predicted - reference, axis=-1).ravel()
    size = np.linalg.norm(reference, axis=-1).ravel()
    share = error[size > 0] / size[size > 0]
    return Score(
        rms=float(np.sqrt(np.mean(error**2))),
        p95=float(np.percentile(error, 95)),
        max=float(error.max()),
        p95_relative=float(np.percentile(share, 95)) if share.size else None,
        max_relative=float(share.max()) if share.size else None,
    )


def judge(
    vjm: Vjm, estimates: Sequence[Estimate], blocks: Blocks, which: Mask, taken: int
) -> tuple[tuple[Score, ...], Ids]:
    """Errors of models on runs.

    Args:
        vjm: The model.
        estimates: What was identified.
        blocks: The runs.
        which: Those that count, (runs,).
        taken: Which model's largest errors are remembered.

    Returns:
        Scores of every model, and the runs of which one of them leaves most, by index in rising order.
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
    return tuple(map(one.score, range(len(estimates)))), np.sort(one.far[:, 1]).astype(int)


class _Sums:
    """What is counted of errors, absolute [m] and relative [1], model by model."""

    def __init__(self, models: int) -> None:
        self.square, self.most = np.zeros(models), np.zeros((2, models))
        self.counts = np.zeros((2, models, BINS), dtype=np.int64)
        self.far = np.zeros((0, 2))  #: Largest error of a run below zero, and its index: the FAR worst.

    def add(self, moved: Array, data: Dataset, counted: tuple[Ids, Mask], taken: int) -> None:
        """Deflections of a block by every model, (models, runs, m, 3) [m]; indices of runs, which count."""
        runs, use = counted
        seen = data.seen & use[:, None]
        left = np.linalg.norm(moved - data.deflection, axis=-1)
        size = np.linalg.norm(data.deflection, axis=-1)[seen]
        self._remember(np.column_stack([-np.where(seen, left[taken], 0.0).max(axis=1), runs])[use])
        for k, own in enumerate(left[:, seen]):
            self.square[k] += (own**2).sum()
            for kind, values in enumerate((own, own[size > 0] / size[size > 0])):
                self.most[kind, k] = max(self.most[kind, k], values.max(initial=0.0))
                bins = np.log10(np.maximum(values, LEAST) / LEAST) * (BINS / DECADES)
                self.counts[kind, k] += np.bincount(bins.astype(int).clip(max=BINS - 1), minlength=BINS)

    def join(self, other: "_Sums") -> None:
        """What another thread counted."""
        self.square += other.square
        self.most = np.maximum(self.most, other.most)
        self.counts += other.counts
        self._remember(other.far)

    def _remember(self, far: Array) -> None:
        both = np.vstack([self.far, far])
        self.far = both[np.lexsort((both[:, 1], both[:, 0]))[:FAR]]

    def score(self, k: int) -> Score:
        """Of a model; quantiles are the middle of their bin."""
        sums = [(np.cumsum(counts), 0.95 * (counts.sum() - 1)) for counts in self.counts[:, k]]
        places = [np.searchsorted(*one, side="right") + 0.5 for one in sums]
        p95, share = (float(LEAST * 10 ** (place * DECADES / BINS)) for place in places)
        moved = self.counts[1, k].any()
        return Score(
            rms=float(np.sqrt(self.square[k] / self.counts[0, k].sum())),
            p95=p95,
            max=float(self.most[0, k]),
            p95_relative=share if moved else None,
            max_relative=float(self.most[1, k]) if moved else None,
        )
