"""What the trials say: which faults are found out, and which sound data sets are doubted."""

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from testbench.bench.truths import TRUTHS
from testbench.data.csvfile import write_csv
from testbench.errors import BenchError
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Cells, Row, Trials, merged, number
from testbench.studies.study import Run
from testbench.studies.wrong_inputs.faults import FAULTS
from testbench.studies.wrong_inputs.figure import bars
from testbench.studies.wrong_inputs.sound import PAYLOAD
from testbench.studies.wrong_inputs.trial import SOUND, Settings, cases, cells_of
from testbench.views.figure import Figure
from testbench.views.markdown import Markdown, counted
from testbench.views.schema import Table

Z = 1.959964  #: Of a normal quantity, within which 95 % of it lie.
SELDOM = 90.0  #: Percent of a fault's data sets below which the right doubt is first too seldom.
INSTEAD = 2  #: Other doubts that are listed.
KINDS = {"hung": "one hung mass", "levels": "three hung masses", "pressed": "forces in all directions"}
"""Loads in words."""
OF_FAULT = (
    "planted names right.of right.share_percent right.low_percent right.high_percent anywhere_percent "
    "other_percent silent_percent instead before_percent"
)
OF_KIND = (
    "kind alarms.of alarms.share_percent alarms.high_percent right.of right.share_percent right.low_percent"
)
DRAWN = Markdown("![wrong_inputs](wrong_inputs.png)")
OF_ALARM = ("seed", "evidence", "said")
READING = Markdown(
    "The right doubt is first, at least and at most with 95 %; anywhere: first or later. Instead: other "
    "doubts that are first most often, with how many times. All faults of a trial are planted in the same "
    "sound data set, so that the interval over all faults is narrower than that of new arms. A fault is "
    "planted where it can be seen: one load shows no sensor's zero, on one target no names are exchanged, "
    "and readings that are said to be in a tracker's frame have no wrong frame.\n\n"
    "The two checks before: the unloaded targets lie more than 0.2 m (median) from where the rigid arm has "
    "them, or targets move against the force in more than half of the runs. They see sets in the base's "
    "frame; of readings in a tracker's frame the first one always speaks."
)
OF_ALARMS = Markdown("Evidence: by how many nats the readings are likelier with the mistake than without.")


def report(_: Settings, seeds: range, trials: Trials) -> Report:
    """Shares over all data sets, by fault and by kind of set.

    Raises:
        BenchError: When no data set can have the faults that were asked for.
    """
    sound, planted = trials.where(case=SOUND), trials.pick(trials["case"] != SOUND)
    if not len(planted):
        raise BenchError("none of these data sets can have the fault: expected more of --seeds and --planted")
    by_fault = {name: own for (name,), own in planted.groups("case")}
    faults = sorted(
        (_fault(name, by_fault[name]) for name in FAULTS if name in by_fault),
        key=lambda fault: float(fault.right.share_percent),
    )
    shown = max((own for _, own in trials.groups("seed")), key=_worth)
    f = Row(
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        trials=len(seeds),
        arms=list(PAYLOAD),
        truth=list(TRUTHS),
        right=rate(planted["right"]),
        anywhere=rate(planted["anywhere"]),
        silent=rate(_silent(planted)),
        alarms=rate(~sound["right"]),
        before=_before(sound, planted),
        faults=faults,
        lost=[fault for fault in faults if fault.right.share_percent < SELDOM],
        kinds=_kinds(sound, planted),
        false_alarms=[
            Row(kind=", ".join(kinds_of(row)), first=named(row.first), **{key: row[key] for key in OF_ALARM})
            for row in rows_of(sound.pick(~_silent(sound)))
        ],
        seconds=number(trials["seconds"]),
        shown=int(shown["seed"][0]),
        examples=[_example(row) for row in sorted(rows_of(shown), key=_interest)],
        dataset=merged(shown.where(case=SOUND).keep("measured."))[0].measured,
    )
    return Report(
        scenario="wrong_inputs",
        question=Markdown("Are wrong inputs found out, and sound ones left alone?"),
        title=_title(f),
        answer=lines(_answer(f)),
        worst=_worst(faults[0]),
        claims=list(_claims(f)),
        numbers=f,
        tables=_tables(f),
        body=[
            DRAWN,
            "faults",
            READING,
            "kinds",
            "alarms",
            *([OF_ALARMS] if f.false_alarms else []),
            "examples",
        ],
    )


def rate(held: Cells | Sequence[bool]) -> Row:
    """How often something holds, at least one, with its 95 % interval (Wilson's score)."""
    n, share = len(held), float(np.mean(held))
    middle = (share + Z**2 / (2 * n)) / (1 + Z**2 / n)
    half = Z / (1 + Z**2 / n) * np.sqrt(share * (1 - share) / n + Z**2 / (4 * n**2))
    return Row(
        of=n,
        count=int(np.sum(held)),
        share_percent=100 * share,
        low_percent=100 * max(0.0, float(middle - half)),
        high_percent=100 * min(1.0, float(middle + half)),
    )


def rows_of(trials: Trials) -> list[Row]:
    """Each as it is."""
    cells = {name: own.tolist() for name, own in trials.columns.items()}
    return [Row(zip(cells, own, strict=True)) for own in zip(*cells.values(), strict=True)]


def named(doubt: str | None) -> str:
    """The name of a doubt for people, empty for none."""
    return (doubt or "").replace("_", " ")


def _silent(trials: Trials) -> Cells:
    """Where nothing is noticed."""
    return np.array([first is None for first in trials["first"]], dtype=bool)


def _percent(held: Cells) -> float | None:
    return 100 * float(held.mean()) if len(held) else None


def _fault(name: str, own: Trials) -> Row:
    """One fault over all data sets that it was planted in."""
    fault, other = FAULTS[name], ~(own["right"] | _silent(own))
    instead = Counter(own["first"][other].tolist()).most_common(INSTEAD)
    return Row(
        fault=name,
        planted=fault.words,
        names=" or ".join(map(named, fault.names)),
        right=rate(own["right"]),
        anywhere_percent=_percent(own["anywhere"]),
        other_percent=_percent(other),
        silent_percent=_percent(_silent(own)),
        instead=", ".join(f"{named(doubt)} ({count})" for doubt, count in instead),
        before_percent=_percent(own.where(tracker=False)["before"]),
    )


def _before(sound: Trials, planted: Trials) -> Row | None:
    """The two checks before, on sets in the base's frame: they notice, but name nothing."""
    alarms, noticed = (own.where(tracker=False)["before"] for own in (sound, planted))
    return Row(noticed=rate(noticed), alarms=rate(alarms)) if len(alarms) and len(noticed) else None


def kinds_of(row: Row) -> tuple[str, ...]:
    """The kinds of a data set in words."""
    return (
        KINDS[row.loads],
        "one target" if row.targets == 1 else f"{row.targets} targets",
        "in a tracker's frame" if row.tracker else "in the base's frame",
        "true arm with backlash and the like" if row.disturbed else "true arm as the models",
    )


def _kinds(sound: Trials, planted: Trials) -> list[Row]:
    """Sound sets with a doubt, and faults named right first, of one kind."""
    kinds = [[kinds_of(row) for row in rows_of(own)] for own in (sound, planted)]
    found = []
    for name in [name for place in zip(*kinds[0], strict=True) for name in sorted(set(place))]:
        own, faulty = (
            trials.pick(np.array([name in words for words in every], dtype=bool))["right"]
            for trials, every in zip((sound, planted), kinds, strict=True)
        )
        found.append(Row(kind=name, alarms=rate(~own), right=rate(faulty) if len(faulty) else None))
    return found


def _worth(own: Trials) -> tuple[bool, bool, int]:
    """Of showing a trial: one with faults, in the base's frame, with many of them; else the first."""
    return len(own) > 1, not own["tracker"][0], len(own)


def _interest(row: Row) -> tuple[bool, bool]:
    """Faults before the sound set, those that the first doubt does not name before others."""
    return row.case == SOUND, row.right


def _example(row: Row) -> Row:
    """What is said of one data set."""
    planted = FAULTS[row.case].words if row.case in FAULTS else "nothing: the sound data set"
    first, said = named(row.first), row.said or ""
    return Row(case=row.case, planted=planted, first=first, said=said, found_out=row.right)


def _tables(f: Row) -> dict[str, Table]:
    """By fault, by kind of data set, false alarms, and one trial."""
    return {
        "faults": Table(columns(OF_FAULT), f.faults, "By fault"),
        "kinds": Table(
            columns(OF_KIND),
            f.kinds,
            "sound data sets doubted, and faults named right first",
            headline="right.share_percent",
        ),
        "alarms": Table(columns("seed kind first evidence said"), f.false_alarms, "False alarms"),
        "examples": Table(columns("planted first said found_out"), f.examples, f"One trial: seed {f.shown}"),
    }


def _title(f: Row) -> Markdown:
    """What was planted in what."""
    return say(
        "{faults} planted one by one in simulated readings, loads and folders: {planted} with a fault, "
        "{sound}. Arms {arms:list}, {kinds} kinds of true arm, folders wrong by a common factor and axis by "
        "axis. Shares with 95 % intervals (Wilson).",
        faults=counted(len(f.faults), "fault"),
        planted=counted(f.right.of, "data set"),
        sound=counted(f.alarms.of, "sound one"),
        arms=f.arms,
        kinds=len(f.truth),
    )


def _between(of: Row) -> Markdown:
    return say("{share_percent:.1f} % ({low_percent:.1f} to {high_percent:.1f})", of)


def _answer(f: Row) -> Iterator[str]:
    """How often faults are named, and sound sets doubted."""
    right, alarms = f.right, f.alarms
    yield say(
        "The right doubt is first in {share} of {sets} with a fault.",
        share=_between(right),
        sets=counted(right.of, "data set"),
    )
    yield say(
        "Of {sets} {share} raise a doubt.", share=_between(alarms), sets=counted(alarms.of, "sound data set")
    )


def _worst(fault: Row) -> Markdown:
    """The fault that is named most seldom."""
    if fault.right.count == fault.right.of:
        return Markdown("Every kind of fault is named by the right doubt first wherever it was planted.")
    return say(
        "Worst named: {planted}. The right doubt is first in {right.share_percent:.1f} % of {sets}, nothing "
        "is noticed in {silent_percent:.1f} %.",
        fault,
        sets=counted(fault.right.of, "data set"),
    )


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    yield say(
        "The right doubt is among those raised in {anywhere.share_percent:.1f} %; nothing at all is noticed "
        "in {silent.share_percent:.1f} %.",
        f,
    )
    if f.before:
        yield say(
            "The two checks before notice {noticed.share_percent:.1f} % of data sets with a fault in the "
            "base's frame, and doubt {alarms.share_percent:.1f} % of the sound ones.",
            f.before,
        )
    seldom = "is first in less than nine of ten data sets"
    if f.lost:
        yield say(
            f"The right doubt {seldom} for {{lost}} of {{faults}} faults, listed below.",
            lost=len(f.lost),
            faults=len(f.faults),
        )
    else:
        yield Markdown(f"There is no fault of which the right doubt {seldom}.")
    yield say("One data set takes {seconds:~.2f} s.", f)
    for fault in f.lost:
        yield _lost(fault)


def _lost(fault: Row) -> Markdown:
    """A fault that is named too seldom, and what is said instead."""
    instead = "; first instead: {instead}" if fault.instead else ""
    silent = "; not noticed in {silent_percent:.1f} %" if fault.silent_percent else ""
    return say(
        "Named too seldom: {planted}. The right doubt is first in {right.share_percent:.1f} % of {sets}"
        f"{instead}{silent}.",
        fault,
        sets=counted(fault.right.of, "data set"),
    )


def figures(found: Report) -> dict[str, Figure]:
    """One bar a fault."""
    return {"wrong_inputs.png": bars(Row(found.numbers))}


def write(run: Run[Settings]) -> None:
    """dataset.csv: the sound one of the trial that is shown."""
    sound = dict(cases(run.settings, cells_of(), run.report.numbers["shown"]))[SOUND]
    write_csv(sound.data, sound.cell.arm, run.folder / "dataset.csv")
