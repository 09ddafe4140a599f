"""A mistake as data: what it changes, in how few parameters, what it is called; and the score of all of them.

Every hypothesis is undone, the readings are fitted again, and the two fits are compared by

    nats = loss as handed in - loss with the mistake undone - what its parameters have to earn

Where the mistake b adds Z b to the readings, no second fit is needed: with the residuals e, a projector 1 - P
that takes out all that the fit explains, and b ~ N(0, 1) in the units of Z, the same number is

    g = Z^T (1 - P) e,   M = Z^T (1 - P) Z + 1,   nats = (g^T M^-1 g - log det M) / 2

the logarithm of a Bayes factor (Kass and Raftery 1995). `hypotheses` has the table.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.registered import Registered, with_markers
from testbench.model.vjm import Vjm

MOST = 5  #: Mistakes, or changes of several series at once, that are undone one after the other.
Case = TypeVar("Case")
Data = TypeVar("Data")
Model = TypeVar("Model")


def _nothing() -> Array:
    return np.zeros(0)


@dataclass(frozen=True)
class Issue:
    """Describe what may be wrong with readings; `hypotheses.describe` has the sentence."""

    name: str  #: Of the hypothesis, such as "frame".
    where: tuple[str, ...] = ()  #: Names of what it is in: joints, links, targets, runs, series.
    size: Array = field(default_factory=_nothing)  #: How large it is, (k,), SI.
    numbers: Mapping[str, float] = field(default_factory=dict)  #: Others for the sentence, by name, SI.
    #: By how many nats the readings are likelier with the mistake than without; None for what is plain.
    nats: float | None = None


@dataclass(frozen=True)
class Change(Generic[Case]):
    """Undo a mistake in one way. One that has neither `undone` nor `columns` is plain: it needs no fit."""

    where: tuple[str, ...] = ()  #: As of an `Issue`.
    size: Array = field(default_factory=_nothing)  #: As of an `Issue`; a fit adds what it leaves free.
    numbers: Mapping[str, float] = field(default_factory=dict)  #: As of an `Issue`.
    undone: Case | None = None  #: What was handed in, without the mistake, to be fitted again.
    columns: Array | None = None  #: Z on some rows, (rows, z) [standard deviations].
    rows: tuple[int, int] | None = None  #: The first and the one behind the last of them; None for all.
    unit: float = 1.0  #: Size of one unit of the parameters of Z, SI.
    parameters: int = 0  #: Parameters that the choice among such changes counts as.
    nats: float | None = None  #: Where the change was weighed already.
    large: Callable[[Array], bool] = lambda _: True  #: Whether a size is larger than what sound arms show.


@dataclass(frozen=True)
class Hypothesis(Generic[Case]):
    """One kind of mistake: a row of the table."""

    name: str  #: A word for programs.
    changes: Callable[[Case], Iterable[Change[Case]]]  #: Ways to undo it in what was handed in.
    words: Callable[[Issue, Arm], str]  #: What is seen, by how much.
    remedy: str = ""  #: What to check.
    nats: float = 0.0  #: By how many the readings have to be likelier, of loads.
    loose: bool = False  #: Whether it has so many parameters that others are preferred to it.


@dataclass(frozen=True)
class Submission:
    """What a user handed in: an arm and its runs."""

    vjm: Vjm  #: The arm as its folder has it.
    data: Dataset  #: The runs as they were read.
    found: Registered  #: The same, with frames and targets found from the unloaded readings.
    declared: bool  #: Whether the frame of the readings was stated, not guessed.

    @property
    def filed(self) -> Vjm:
        """The arm with the targets of its folder, and with others where they were found."""
        own = dict(zip(self.vjm.arm.markers, self.vjm.markers, strict=True))
        return with_markers(self.found.vjm, own)


def issues(case: Case, hypotheses: Sequence[Hypothesis[Case]]) -> list[Issue]:
    """Collect mistakes that need no fit, or were weighed already.

    Args:
        case: What was handed in, or what is known of it.
        hypotheses: Rows of the table.

    Returns:
        Every change that they see, in the order of the table.
    """
    return [
        Issue(row.name, one.where, one.size, one.numbers, one.nats)
        for row in hypotheses
        for one in row.changes(case)
    ]


def longer_than(*least: float) -> Callable[[Array], bool]:
    """Ask whether one of the parts of a size, three numbers each, is longer than the least that counts."""
    return lambda size: any(np.linalg.norm(size[3 * k : 3 * k + 3]) > one for k, one in enumerate(least))


def any_above(least: float) -> Callable[[Array], bool]:
    """Ask whether one of the numbers of a size is above the least that counts."""
    return lambda size: bool(np.abs(size).max() > least)


@dataclass(frozen=True)
class Score:
    """Size and likelihood gain of linear hypotheses, of one or of a batch."""

    b: Array  #: Expected sizes, (..., z), in the units of Z.
    gain: Array  #: Twice what they take away from the loss, g^T M^-1 g, (...).
    nats: Array  #: Logarithms of the Bayes factors, (...).


def score_test(g: Array, M: Array) -> Score:
    """Compare readings with and without linear mistakes, by nats = (g^T M^-1 g - log det M) / 2.

    Args:
        g: Z^T (1 - P) e, whitened, (..., z) [1].
        M: Z^T (1 - P) Z, (..., z, z) [1].

    Returns:
        Sizes, gains and nats.
    """
    own = M + np.eye(g.shape[-1])
    b = np.asarray(np.linalg.solve(own, g[..., None])[..., 0])
    gain = np.asarray((b * g).sum(axis=-1))
    return Score(b, gain, np.asarray((gain - np.linalg.slogdet(own)[1]) / 2))


def undo_one_by_one(
    data: Data,
    model: Model,
    undo: Callable[[Data, Model], tuple[Sequence[Issue], Data, Model] | None],
) -> tuple[list[Issue], Data, Model]:
    """Find the worst mistake, undo it, fit again, look for the next.

    Args:
        data: What was read.
        model: Fitted to it.
        undo: The worst mistake, the data without it and the model fitted to these; None where there is none.
            Data that are as they were end the search.

    Returns:
        The mistakes in the order in which they were found, data without them and the last model.
    """
    found: list[Issue] = []
    for _ in range(MOST):
        step = undo(data, model)
        if step is None:
            break
        before = data
        more, data, model = step
        found += more
        if data is before:
            break
    return found, data, model
