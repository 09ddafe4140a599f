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
from testbench.identify.registered import RegisteredDataset, with_markers
from testbench.model.vjm import Vjm

MAX_ROUNDS = 5  #: Most rounds of undoing mistakes one after the other.
Case = TypeVar("Case")
Data = TypeVar("Data")
Model = TypeVar("Model")


def _nothing() -> Array:
    return np.zeros(0)


@dataclass(frozen=True)
class Issue:
    """Hold one suspected mistake in readings; `hypotheses.describe` puts it into a sentence."""

    name: str  #: Name of the hypothesis, such as "frame".
    where: tuple[str, ...] = ()  #: Names of the joints, links, targets, runs or series that it concerns.
    size: Array = field(default_factory=_nothing)  #: Size of the mistake, (k,), SI.
    #: Other numbers for the sentence, by name, SI.
    numbers: Mapping[str, float] = field(default_factory=dict)
    #: Log-likelihood gained by assuming the mistake [nats]; None for a plain mistake.
    nats: float | None = None


@dataclass(frozen=True)
class Change(Generic[Case]):
    """Hold one way to undo a mistake.

    A change with `undone` is fitted again; one with `columns` is weighed by the score test. One that has
    neither is plain and needs no fit.
    """

    where: tuple[str, ...] = ()  #: As in `Issue`.
    size: Array = field(default_factory=_nothing)  #: As in `Issue`; a fit adds its free parameters.
    numbers: Mapping[str, float] = field(default_factory=dict)  #: As in `Issue`.
    undone: Case | None = None  #: The data without the mistake, to be fitted again.
    columns: Array | None = None  #: Z of the score test on `rows`, (rows, z) [standard deviations].
    rows: tuple[int, int] | None = None  #: First row, and the one after the last; None for all.
    unit: float = 1.0  #: Size of one unit of the parameters of Z: their prior deviation, SI.
    parameters: int = 0  #: Number of parameters that the choice of this change counts as.
    nats: float | None = None  #: As in `Issue`, if the change was weighed already.
    large: Callable[[Array], bool] = lambda _: True  #: Tells whether a size is larger than on sound arms.


@dataclass(frozen=True)
class Hypothesis(Generic[Case]):
    """Define one kind of mistake: a row of the table."""

    name: str  #: A word for programs.
    changes: Callable[[Case], Iterable[Change[Case]]]  #: Ways to undo the mistake in the data.
    words: Callable[[Issue, Arm], str]  #: Puts an issue into words: what is wrong, by how much.
    remedy: str = ""  #: What the user should check.
    nats: float = 0.0  #: Log-likelihood that a mistake of loads has to gain [nats].
    loose: bool = False  #: Whether it has so many parameters that others are preferred to it.


@dataclass(frozen=True)
class Submission:
    """Hold what a user submits: an arm and its runs."""

    vjm: Vjm  #: The arm as its folder has it.
    data: Dataset  #: The runs as they were read.
    #: The runs in the base's frame, with targets found from the unloaded readings.
    registered: RegisteredDataset
    declared: bool  #: Whether the frame of the readings was stated, not guessed.

    @property
    def folder_model(self) -> Vjm:
        """Build the model with targets where the arm's folder has them.

        Targets that the folder lacks are where the registration found them.
        """
        own = dict(zip(self.vjm.arm.markers, self.vjm.markers, strict=True))
        return with_markers(self.registered.vjm, own)


def listed_issues(case: Case, hypotheses: Sequence[Hypothesis[Case]]) -> list[Issue]:
    """List the mistakes that need no fit, or that were weighed already.

    Args:
        case: What the hypotheses look at, such as the submitted runs.
        hypotheses: Rows of the table.

    Returns:
        One issue per change that they find, in the order of the table.
    """
    return [
        Issue(row.name, change.where, change.size, change.numbers, change.nats)
        for row in hypotheses
        for change in row.changes(case)
    ]


def longer_than(*least: float) -> Callable[[Array], bool]:
    """Make a test of whether a vector of a size is longer than its limit, one per three numbers, SI."""
    return lambda size: any(np.linalg.norm(size[3 * k : 3 * k + 3]) > one for k, one in enumerate(least))


def any_above(least: float) -> Callable[[Array], bool]:
    """Make a test of whether any number of a size is larger than a limit in magnitude, SI."""
    return lambda size: bool(np.abs(size).max() > least)


@dataclass(frozen=True)
class Score:
    """Hold size and likelihood gain of linear mistakes, for one or for a batch."""

    b: Array  #: Expected sizes, in units of their prior deviation, (..., z) [1].
    gain: Array  #: Twice the decrease of the loss, g^T (M + I)^-1 g, (...) [1].
    nats: Array  #: Logarithms of the Bayes factors, (...) [nats].


def score_test(g: Array, M: Array) -> Score:
    """Compare readings with and without a linear mistake b ~ N(0, 1), without a second fit.

    With H = M + I, the expected size is b = H^-1 g, and the logarithm of the Bayes factor is

        nats = (g^T H^-1 g - log det H) / 2

    Args:
        g: Z^T W e, with e the residuals and W = 1 - P on whitened equations, (..., z) [1].
        M: Z^T W Z, (..., z, z) [1].

    Returns:
        Expected sizes, gains g^T H^-1 g and nats (Kass and Raftery 1995).
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
    """Find the worst mistake, undo it, fit again and look for the next, up to MAX_ROUNDS times.

    Args:
        data: The readings.
        model: Model fitted to them.
        undo: Function of data and model. It returns the worst mistakes, the data without them and the model
            fitted to these; None when it finds no mistake. The search ends when it returns the same data.

    Returns:
        The mistakes in the order in which they were found, the data without them and the last model.
    """
    found: list[Issue] = []
    for _ in range(MAX_ROUNDS):
        step = undo(data, model)
        if step is None:
            break
        before = data
        more, data, model = step
        found += more
        if data is before:
            break
    return found, data, model
