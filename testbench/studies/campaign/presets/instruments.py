"""Preset `instruments`: what gauges, a ballbar, draw-wires and a camera are worth beside a tracker."""

from collections.abc import Mapping
from dataclasses import replace

from testbench.report.figure import Figure, forest
from testbench.report.report import Report
from testbench.report.schema import columns
from testbench.report.table import Trials
from testbench.studies.campaign import read_by
from testbench.studies.campaign.read_by import INSTRUMENTS, THREE, TRACKER, USUAL
from testbench.studies.campaign.report import ERROR, Preset, TrialTable
from testbench.workflows.models import DEFAULT, JOINTS


def tables(_: read_by.Settings) -> Mapping[str, TrialTable]:
    """List the default by instrument; its error by poses; that of Joints-only."""
    usual = {"name": DEFAULT, "poses": USUAL}
    return {
        "instruments": TrialTable(
            f"{DEFAULT}, {USUAL} poses",
            down="instrument",
            columns="instrument rms_um covered_percent half_mm rank read_percent",
            where=usual,
        ),
        "poses": TrialTable(
            f"{DEFAULT}: RMS error, um", down="instrument", across="poses", where={"name": DEFAULT}
        ),
        "joints": TrialTable(
            f"{JOINTS}: RMS error, um", down="instrument", across="poses", where={"name": JOINTS}
        ),
    }


def _derived(_: read_by.Settings, trials: Trials) -> Trials:
    """Name coverage and half width as other studies do."""
    return trials.add(covered_percent=trials["cover.covered_percent"], half_mm=trials["cover.half_mm"])


def _by_instrument(trials: Trials) -> Trials:
    """Name the rows of the default by their instrument, so that instruments are compared."""
    own = trials.where(name=DEFAULT, poses=USUAL)
    return own.add(name=own["instrument"])


def figures(found: Report) -> Mapping[str, Figure]:
    """Draw the error from every instrument, one pane per number of poses."""
    table, (error,) = found.tables["poses"], columns(ERROR)
    name, *drawn = table.columns
    shown = (name, *(replace(error, key=column.key, form=".0f") for column in drawn))
    panes = {column.key: column.heading for column in drawn}
    reading = "Numbers: medians. Dotted: the tracker."
    return {"instruments.png": forest(replace(table, columns=shown), panes, found.question, reading, TRACKER)}


PRESET = Preset(
    name="instruments",
    page="docs/studies/instruments.md",
    question="How do dial gauges, wires, a ballbar and a camera compare with a laser tracker?",
    how="Every instrument reads the KR 500 under its payload in the same random poses. Gauges are half a "
    "degree off. Their directions are chosen in each pose. Models are judged over the workspace.",
    options=read_by.Options,
    settings=read_by.settings,
    seeds=(100, 8),
    row=read_by.InstrumentRow,
    trial=read_by.trial,
    tables=tables,
    printed="instruments",
    cells=lambda *_: {"": {"instrument": THREE, "poses": USUAL}},
    ours=THREE,
    rivals=(TRACKER,),
    pairs=tuple((name, TRACKER) for name in INSTRUMENTS if name != TRACKER),
    compared=_by_instrument,
    derived=_derived,
    figures=figures,
)
STUDY = PRESET.study()
