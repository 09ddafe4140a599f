"""The report of all trials: which faults are found out, and which sound data sets are doubted."""

from collections import Counter
from collections.abc import Sequence

from testbench.bench.truths import TRUTHS
from testbench.errors import BenchError
from testbench.studies.study import Rows
from testbench.studies.wrong_inputs.faults import FAULTS
from testbench.studies.wrong_inputs.report import (
    Alarm,
    Before,
    Example,
    FaultRow,
    KindRow,
    WrongInputsReport,
    rate,
)
from testbench.studies.wrong_inputs.sound import PAYLOAD
from testbench.studies.wrong_inputs.trial import NAME, SOUND, SetRow, Settings
from testbench.trials.spread import grouped, spread

SELDOM = 0.9  #: Share of a fault's data sets below which the right doubt is first too seldom.
INSTEAD = 2  #: Other doubts that are listed.
KINDS = {"hung": "one hung mass", "levels": "three hung masses", "pressed": "forces in all directions"}
"""Loads in words."""


def summary(_: Settings, seeds: range, trials: Rows[SetRow]) -> WrongInputsReport:
    """Shares over all data sets, by fault and by kind of set.

    Raises:
        BenchError: When no data set can have the faults that were asked for.
    """
    by_seed = dict(trials)
    every = [row for rows in by_seed.values() for row in rows]
    sound, planted = ([row for row in every if (row.case == SOUND) == own] for own in (True, False))
    if not planted:
        raise BenchError("none of these data sets can have the fault: expected more of --seeds and --planted")
    by_fault = grouped(planted, lambda row: row.case)
    faults = sorted((_fault(name, by_fault[name]) for name in FAULTS if name in by_fault), key=_share)
    right, alarms = rate([row.right for row in planted]), rate([not row.right for row in sound])
    shown = max(by_seed, key=lambda seed: _worth(by_seed[seed]))
    measured = by_seed[shown][0].measured
    assert measured is not None  # of a sound one
    return WrongInputsReport(
        scenario=NAME,
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        trials=len(seeds),
        arms=tuple(PAYLOAD),
        truth=tuple(TRUTHS),
        right=right,
        anywhere=rate([row.anywhere for row in planted]),
        silent=rate([row.first is None for row in planted]),
        alarms=alarms,
        before=_before(sound, planted),
        faults=faults,
        lost=[fault for fault in faults if fault.right.share < SELDOM],
        kinds=_kinds(sound, planted),
        false_alarms=[
            Alarm(seed, kind_of(rows[0]), named(rows[0].first), rows[0].evidence, rows[0].said or "")
            for seed, rows in by_seed.items()
            if rows[0].first is not None
        ],
        seconds=spread([row.seconds for row in every]),
        shown=shown,
        examples=[_example(row) for row in sorted(by_seed[shown], key=_interest)],
        dataset=measured,
    )


def named(doubt: str) -> str:
    """The name of a doubt for people."""
    return doubt.replace("_", " ")


def _share(fault: FaultRow) -> float:
    return fault.right.share


def _fault(name: str, rows: Sequence[SetRow]) -> FaultRow:
    fault, right = FAULTS[name], rate([row.right for row in rows])
    silent = sum(row.first is None for row in rows) / len(rows)
    others = Counter(row.first for row in rows if row.first and not row.right)
    based = [row.before for row in rows if not row.tracker]
    return FaultRow(
        name,
        words=fault.words,
        names=" or ".join(map(named, fault.names)),
        right=right,
        anywhere=sum(row.anywhere for row in rows) / len(rows),
        other=sum(others.values()) / len(rows),
        silent=silent,
        instead=", ".join(f"{named(other)} ({count})" for other, count in others.most_common(INSTEAD)),
        before=sum(based) / len(based) if based else None,
    )


def _before(sound: Sequence[SetRow], planted: Sequence[SetRow]) -> Before | None:
    own, faulty = ([row.before for row in rows if not row.tracker] for rows in (sound, planted))
    return Before(rate(faulty), rate(own)) if own and faulty else None


def kinds_of(row: SetRow) -> list[str]:
    """The kinds of a data set in words."""
    return [
        KINDS[row.loads],
        "one target" if row.targets == 1 else f"{row.targets} targets",
        "in a tracker's frame" if row.tracker else "in the base's frame",
        "true arm as the models" if not row.disturbed else "true arm with backlash and the like",
    ]


def kind_of(row: SetRow) -> str:
    """The same as one."""
    return ", ".join(kinds_of(row))


def _kinds(sound: Sequence[SetRow], planted: Sequence[SetRow]) -> list[KindRow]:
    places = range(len(kinds_of(sound[0])))
    names = [name for k in places for name in sorted({kinds_of(row)[k] for row in sound})]
    found = []
    for name in names:
        own, faulty = ([row for row in rows if name in kinds_of(row)] for rows in (sound, planted))
        right = rate([row.right for row in faulty]) if faulty else None
        found.append(KindRow(name, rate([not row.right for row in own]), right))
    return found


def _worth(rows: Sequence[SetRow]) -> tuple[bool, bool, int]:
    """Of showing a trial: one with faults, in the base's frame, with many of them; else the first."""
    return len(rows) > 1, not rows[0].tracker, len(rows)


def _interest(row: SetRow) -> tuple[bool, bool]:
    """Faults before the sound set, those that the first doubt does not name before others."""
    return row.case == SOUND, row.right


def _example(row: SetRow) -> Example:
    words = FAULTS[row.case].words if row.case in FAULTS else "nothing: the sound data set"
    return Example(row.case, words, named(row.first or ""), row.said or "", row.right)
