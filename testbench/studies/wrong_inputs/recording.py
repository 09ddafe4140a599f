"""What the study of wrong inputs leaves beside its report: a sound dataset, and its faults on the arm."""

from collections.abc import Mapping

import numpy as np

from testbench.data.csvfile import write_csv
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.studies.study import Run
from testbench.studies.wrong_inputs.report import WrongInputsReport
from testbench.studies.wrong_inputs.sound import Sound
from testbench.studies.wrong_inputs.trial import SOUND, Settings, cases, cells_of
from testbench.views.data.nominal import magnification, nominal_markers
from testbench.views.recording.planted import Planted, write_planted
from testbench.views.recording.stream import Header

VALUES = ("q", "wrench", "point", "before", "after")  #: Of a run.


def write(run: Run[Settings, WrongInputsReport]) -> None:
    """dataset.csv and recording.rrd."""
    sets = dict(cases(run.settings, cells_of(), run.report.shown))
    sound = sets[SOUND]
    write_csv(sound.data, sound.cell.arm, run.folder / "dataset.csv")
    write_recording(run, sets)


def write_recording(run: Run[Settings, WrongInputsReport], sets: Mapping[str, Sound]) -> None:
    """Of every data set of the trial that is shown the run that the fault changes most."""
    sound, report = sets[SOUND], run.report
    own = [sets[example.case] for example in report.examples]
    runs = [most_changed(sound.data, one.data) for one in own]
    nominal = [nominal_markers(one.cell, one.data)[r] for one, r in zip(own, runs, strict=True)]
    shown = Planted(
        cell=sound.cell,
        data=together([one.data for one in own], runs),
        nominal=np.array(nominal),
        scale=magnification(sound.data, nominal_markers(sound.cell, sound.data)),
        texts=[run.words.block("example", example=example) for example in report.examples],
    )
    header = Header(report.scenario, run.parameters, report.shown)
    write_planted(run.folder / "recording.rrd", header, shown, run.words.summary(run.tables["kinds"]))


def most_changed(sound: Dataset, faulty: Dataset) -> int:
    """The run that a fault changes most; the first if it changes none."""
    return int(np.argmax(sum(_change(getattr(sound, name), getattr(faulty, name)) for name in VALUES)))


def _change(before: Array, after: Array) -> Array:
    """By how much the values of each run change, over the largest, (runs,) [1]."""
    change = np.abs(after - before).reshape(len(before), -1).max(axis=1)
    return np.asarray(change / (np.abs(before).max() or 1.0))


def together(sets: list[Dataset], runs: list[int]) -> Dataset:
    """One run of each data set, one below the other."""
    count = np.arange(len(sets)) + 1

    def of(name: str) -> Array:
        return np.array([getattr(own, name)[r] for own, r in zip(sets, runs, strict=True)])

    return Dataset(
        markers=sets[0].markers,
        run=count,
        pose=count,
        q=of("q"),
        wrench=of("wrench"),
        point=of("point"),
        before=of("before"),
        after=of("after"),
        sigma=sets[0].sigma,
    )
