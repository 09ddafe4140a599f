"""One trial: a sound data set, and in the first trials every fault, planted in it one by one."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import typer

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import Cell, build_cell, stream
from testbench.bench.rows import DatasetRow, dataset_row
from testbench.errors import BenchError
from testbench.identify.doubts import Doubt, HandedIn, doubts, open_places
from testbench.identify.registered import registered
from testbench.studies.wrong_inputs.before import noticed
from testbench.studies.wrong_inputs.faults import FAULTS
from testbench.studies.wrong_inputs.sound import PAYLOAD, Sound, sound

SOUND = "sound"  #: Case of a data set without a fault.
REFUSED = "refused"  #: What is said first where no frame is found, and no mistake that explains it.
QUICK = 8  #: With --quick: trials at most, each with every eighth fault.


@dataclass(frozen=True)
class Options:
    """Flags of the study."""

    fault: Annotated[
        list[str] | None, typer.Option(help="Fault to plant; again for more. All if not given.")
    ] = None
    planted: Annotated[
        int, typer.Option(min=1, help="In how many of the sound data sets faults are planted.")
    ] = 120


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    faults: tuple[str, ...]
    first: int  #: Seed of the first trial.
    planted: int  #: Trials from the first one on in which faults are planted.
    turns: int = 1  #: In each of these every so manieth fault.

    def planted_in(self, seed: int) -> list[str]:
        """Faults that are planted in the data set of a seed, where it can have them."""
        if seed >= self.first + self.planted:
            return []
        return [fault for k, fault in enumerate(self.faults) if (k - seed) % self.turns == 0]


@dataclass(frozen=True)
class SetRow:
    """What is said of one data set."""

    case: str  #: Name of the fault, or SOUND.
    arm: str
    true_arm: str  #: One of TRUTHS.
    loads: str  #: One of LOADS.
    targets: int
    tracker: bool  #: Whether the sound set is in a tracker's frames, and said so.
    disturbed: bool  #: Whether the true arm does what models do not know.
    first: str | None  #: Name of the first doubt.
    said: str | None  #: Its sentence.
    evidence: float | None  #: By how many nats the readings are likelier with the mistake.
    right: bool  #: Whether the first doubt names the fault; of a sound set, whether there is none.
    anywhere: bool  #: Whether any does.
    before: bool  #: Whether one of the two checks before notices anything.
    seconds: float
    measured: DatasetRow | None  #: The dataset, of a sound one.


def settings(options: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for.

    Raises:
        BenchError: When there is no such fault, or one is there twice.
    """
    faults = tuple(options.fault or FAULTS)
    for name in faults:
        if name not in FAULTS or faults.count(name) > 1:
            raise BenchError(f"--fault: expected different ones of {', '.join(FAULTS)}, got {name!r}")
    return Settings(faults, seeds.start, options.planted, min(QUICK, len(faults)) if quick else 1)


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[SetRow]]:
    """Rows of some seeds: the sound data set, then one a fault."""
    cells = cells_of()
    return [[row(case, own) for case, own in cases(asked, cells, seed)] for seed in seeds]


def cells_of() -> dict[str, Cell]:
    """The arms that data sets are drawn of."""
    return {name: build_cell(find_arm(name)) for name in PAYLOAD}


def cases(asked: Settings, cells: Mapping[str, Cell], seed: int) -> Iterator[tuple[str, Sound]]:
    """The data sets of a trial by case."""
    own = sound(cells, seed)
    yield SOUND, own
    for name in asked.planted_in(seed):
        if FAULTS[name].possible(own):
            yield name, FAULTS[name].plant(own, stream(seed, 40))


def row(case: str, own: Sound) -> SetRow:
    """What is said of a data set."""
    start = time.perf_counter()
    found = said(own)
    seconds = time.perf_counter() - start
    first = found[0] if found else None
    names = FAULTS[case].names if case != SOUND else ()
    return SetRow(
        case,
        arm=own.cell.arm.name,
        true_arm=own.true_arm,
        loads=own.loads,
        targets=len(own.data.markers),
        tracker=own.tracker,
        disturbed=own.disturbed,
        first=first.name if first else None,
        said=first.sentence if first else None,
        evidence=first.evidence if first else None,
        right=first.name in names if first else case == SOUND,
        anywhere=any(doubt.name in names for doubt in found) or (case == SOUND and not found),
        before=noticed(own.cell, own.data),
        seconds=seconds,
        measured=dataset_row(own.data) if case == SOUND else None,
    )


def said(own: Sound) -> list[Doubt]:
    """Doubts about a data set, as `testbench identify` finds them."""
    vjm, data = own.cell.vjm, own.data
    try:
        found = registered(vjm, data, "tracker" if own.declared else "auto")
    except BenchError as why:
        return [open_places(vjm, data) or Doubt(REFUSED, str(why))]
    return doubts(HandedIn(vjm, data, found, own.declared), own.prior)
