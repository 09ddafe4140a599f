"""What a user's runs look like before anything is fitted: doubts, and how soft the arm is as a whole."""

from dataclasses import dataclass

from testbench.errors import BenchError
from testbench.identify.doubts import Doubt, HandedIn, doubts, scale
from testbench.identify.metric import metric
from testbench.identify.prior import cad_prior
from testbench.model.structure import all153


@dataclass(frozen=True)
class Looks:
    """What is seen of runs at once."""

    doubts: tuple[Doubt, ...] = ()  #: What may be wrong, the likeliest first.
    #: By what factor the deflections exceed those that the arm's folder says [1]; None where nobody looked.
    scale: float | None = None


UNSEEN = Looks()  #: Of runs that nobody looked at.


def look(given: HandedIn) -> Looks:
    """Doubts about runs, and their factor over the arm's folder.

    Raises:
        BenchError: When the runs are not of this arm.
    """
    prior, vjm = cad_prior(given.vjm.arm), given.found.vjm
    found = doubts(given, prior)
    return Looks(tuple(found), scale(vjm, metric(prior, vjm, all153(vjm.arm)), given.found.data))


def check_strictly(said: tuple[Doubt, ...]) -> None:
    """Refuse runs with a doubt, all of them in one line."""
    if said:
        count = "1 doubt" if len(said) == 1 else f"{len(said)} doubts"
        raise BenchError(f"--strict: {count}: {'; '.join(doubt.sentence for doubt in said)}")
