"""What a dataset can tell of a structure, as report.json holds it: numbers, and the words for them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from testbench.identify.identifiability import Identifiability
from testbench.identify.identifiability_unseen import Direction
from testbench.views.identifiability import names
from testbench.views.identifiability.words import DECIDED, sentences
from testbench.views.schema import Column, Table

MM = 1e3


@dataclass(frozen=True)
class Lost:
    """A direction that is not seen: parameters that take part, those that do a little, and the words."""

    parameters: tuple[str, ...]
    others_a_little: tuple[str, ...]
    text: str


@dataclass(frozen=True)
class Unseen:
    """Directions that no experiment sees, and those that no pose shows under these loads."""

    structure: tuple[Lost, ...]
    loads: tuple[Lost, ...]


@dataclass(frozen=True)
class Parameter:
    """One unknown; `entry` is its row and column in a link's compliance from 1, None for a joint."""

    component: str
    entry: tuple[int, int] | None
    name: str
    data_share: float
    decided_by: Literal["prior", "data and prior"]


@dataclass(frozen=True)
class Block:
    """Unknowns of one link or joint."""

    component: str
    parameters: int
    data_share: float
    decided_by_prior: int


@dataclass(frozen=True)
class Help:
    """One more way to measure; the error is None where nothing fixes the common scale."""

    place: int
    measure: str
    seen: int
    more_directions: int
    expected_error_mm: float | None


@dataclass(frozen=True)
class Seen:
    """What `Identifiability` says, in units of a reader."""

    structure: str
    prior: str
    prior_uncertainty: float
    unknowns: int
    seen: int
    seen_by_these_loads: int
    seen_by_any_experiment: int
    lost_to_structure: int
    lost_to_experiment: int
    lost_to_loads: int
    lost_to_poses: int
    poses: int
    independent_equations: int
    joints_in_links: tuple[str, ...]
    not_loaded: tuple[str, ...]
    unseen: Unseen
    parameters: tuple[Parameter, ...]
    blocks: tuple[Block, ...]
    expected_error_mm: float | None
    expected_deflection_mm: float | None
    help: tuple[Help, ...]
    sentences: tuple[str, ...]


def seen_report(found: Identifiability) -> Seen:
    """The report of what a dataset can tell."""
    parameters = tuple(_parameter(found, k) for k in range(found.structure.n))
    return Seen(
        structure=found.structure.name,
        prior=found.prior,
        prior_uncertainty=found.uncertainty,
        unknowns=found.structure.n,
        seen=found.rank,
        seen_by_these_loads=found.rank_of_loads,
        seen_by_any_experiment=found.rank_of_structure,
        lost_to_structure=len(found.lost_to_structure),
        lost_to_experiment=found.lost_to_experiment,
        lost_to_loads=len(found.lost_to_loads),
        lost_to_poses=found.lost_to_poses,
        poses=found.poses,
        independent_equations=found.equations,
        joints_in_links=found.in_links,
        not_loaded=tuple(parameters[k].name for k in found.not_loaded),
        unseen=Unseen(_lost(found, found.lost_to_structure), _lost(found, found.lost_to_loads)),
        parameters=parameters,
        blocks=_blocks(parameters),
        expected_error_mm=_finite(found.error),
        expected_deflection_mm=_finite(found.deflection),
        help=tuple(
            Help(p.place, p.words, p.rank, p.rank - found.rank, _finite(p.error)) for p in found.proposals
        ),
        sentences=sentences(found),
    )


def _parameter(found: Identifiability, k: int) -> Parameter:
    row, column = (int(i) + 1 for i in found.entry[k])
    return Parameter(
        component=found.component[k],
        entry=(row, column) if row > 0 else None,
        name=names.of(found, [k]),
        data_share=float(found.share[k]),
        decided_by="prior" if found.share[k] < DECIDED else "data and prior",
    )


def _lost(found: Identifiability, lost: Sequence[Direction]) -> tuple[Lost, ...]:
    def each(parameters: Sequence[int]) -> tuple[str, ...]:
        return tuple(names.of(found, [k]) for k in parameters)

    return tuple(Lost(each(d.parameters), each(d.others), names.direction(found, d)) for d in lost)


def _blocks(parameters: Sequence[Parameter]) -> tuple[Block, ...]:
    groups: dict[str, list[Parameter]] = {}
    for p in parameters:
        groups.setdefault(p.component, []).append(p)
    return tuple(
        Block(
            component=name,
            parameters=len(own),
            data_share=sum(p.data_share for p in own) / len(own),
            decided_by_prior=sum(p.decided_by == "prior" for p in own),
        )
        for name, own in groups.items()
    )


def _finite(metres: float) -> float | None:
    return MM * metres if math.isfinite(metres) else None


HELP = (
    Column("place", "", form="d"),
    Column("measure", "measured besides"),
    Column("seen", "seen", form="d"),
    Column("expected_error_mm", "expected error", "mm", short="expected\nerror mm"),
)


def table(seen: Seen) -> Table:
    """What would help, the best first; ties share a place. No error is shown where it has no bound."""
    nothing = {"place": None, "measure": "nothing", "seen": seen.seen}
    return Table(HELP, [{**nothing, "expected_error_mm": seen.expected_error_mm}, *seen.help])
