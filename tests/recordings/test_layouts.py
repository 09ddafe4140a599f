"""What holds for the recording of every kind of study."""

import functools
import importlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
from read_back import (
    chunks_of,
    columns,
    document,
    layout,
    on,
    panes,
    rerun,
    views,
)
from rerun.chunk import RrdReader

from testbench.bench.campaign import Scenario
from testbench.bench.full_pose import FullPose
from testbench.bench.truths import true_cell
from testbench.report.table import Trials
from testbench.studies.gravity_calibration import trial as gravity
from testbench.studies.gravity_calibration.study import STUDY as GRAVITY
from testbench.studies.run import to_json
from testbench.studies.six_dof_arm import trial as six_dof
from testbench.studies.six_dof_arm.study import STUDY as SIX_DOF
from testbench.studies.study import Run
from testbench.views.schema import show

BUDGET = 2 * 2**20
TIMELINES = {
    "gravity": {"place", "worst_first", "run", "load"},
    "full_pose": {"place", "worst_first", "run", "load"},
}
APPLICATIONS = {"gravity": "calibration", "full_pose": "calibration"}


SMALL = FullPose(arm="arm_6r", poses=6, check_runs=10)
HEAVY = Scenario(arm="kr500_l480", workspace_poses=5)
KINDS = {
    "gravity": (
        GRAVITY,
        gravity.Settings("kr500_l480", Scenario(arm="kr500_l480", workspace_poses=5), 50.0),
        1,
    ),
    "full_pose": (SIX_DOF, six_dof.Settings("arm_6r", "reading", SMALL, 1, 1, 1, 10.0), 2),
}
"""Study, settings and number of seeds."""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Recording, report and writer of a kind, made once."""

    @functools.cache
    def make(kind):
        study, settings, count = KINDS[kind]
        seeds = range(1, 1 + count)
        rows = study.trials(settings, seeds)
        found = study.report(settings, seeds, Trials.of(list(zip(seeds, rows, strict=True))))
        run = Run(study.name, settings, seeds, found, Path(), "{}")

        def write(folder):
            study.write(replace(run, folder=folder))

        folder = tmp_path_factory.mktemp(kind)
        write(folder)
        return folder / "recording.rrd", to_json(found), write

    return make


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param


@pytest.fixture
def file(made, kind):
    return made(kind)[0]


@pytest.fixture
def chunks(file):
    return chunks_of(file)


def test_the_file_is_one_whole_recording_of_a_versioned_layout(file, kind):
    assert "1 file verified without error" in rerun("verify", file)[1]
    assert file.stat().st_size < BUDGET
    (entry,) = RrdReader(file).recordings()
    assert re.fullmatch(rf"testbench_{APPLICATIONS.get(kind, kind)}_[0-9a-f]{{8}}", entry.application_id)


def test_every_view_of_the_blueprint_has_data_under_its_origin_on_one_timeline(file, chunks, kind):
    assert views(file)
    for origin, *_ in views(file):
        under = [c for c in chunks if f"{c.entity_path}/".startswith(f"/{origin}/")]
        found = {t for c in under for t in (TIMELINES[kind] if c.is_static else c.timeline_names)}
        assert found & TIMELINES[kind], origin


@pytest.mark.parametrize("kind", [name for name in KINDS if name != "full_pose"])  # drawn as gravity is
def test_no_pane_is_blank_on_any_timeline(file, blank_panes):
    assert blank_panes(file) == []


def test_a_tab_has_at_most_eight_panes(file):
    assert max(panes(file)) <= 8


def test_timelines_are_exactly_those_of_the_kind(chunks, kind):
    assert {name for chunk in chunks for name in chunk.timeline_names} == TIMELINES[kind]


def test_the_reader_lands_on_a_timeline_of_the_kind(file, kind):
    panel = layout(file)["/time_panel"]
    assert panel["TimePanelBlueprint:timeline"][0][0] in TIMELINES[kind]


def test_all_numbers_are_finite(chunks):
    for chunk in chunks:
        batch = chunk.to_record_batch()
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            while pa.types.is_list(column.type) or pa.types.is_fixed_size_list(column.type):
                column = column.flatten()
            if pa.types.is_floating(column.type):
                assert np.isfinite(column.to_numpy(zero_copy_only=False)).all(), (chunk.entity_path, name)


UNIT = r"(_|/)(mm|um|urad|s|percent|log10_gap)(/|$)"


def test_every_number_has_its_unit_in_its_path_and_its_view_in_its_title(file, chunks):
    for chunk in chunks:
        if {"Scalars:scalars", "BarChart:values"} & set(chunk.to_record_batch().schema.names):
            assert re.search(UNIT, chunk.entity_path), chunk.entity_path
    for origin, kind, name in views(file):
        unit = r"\((%|1|([^()]* )?(m|mm|um|urad|s)(, logarithmic)?|.*log10 .+|1 = true( diagonal)?)\)"
        assert kind == "TextDocument" or re.search(unit, name), (origin, name)


def test_every_line_of_a_plot_has_a_name_and_a_unit_there_or_in_its_path(chunks):
    for chunk in chunks:
        for [name] in columns([chunk], chunk.entity_path).get("SeriesLines:names", []):
            assert name
            unit = re.search(r"\(.*(%|mm|um|log10).*\)", name) or re.search(UNIT, chunk.entity_path)
            assert unit, chunk.entity_path


def test_entities_are_few_and_in_snake_case(chunks):
    paths = {chunk.entity_path for chunk in chunks}
    assert len(paths) < 100
    for path in paths - {"/__properties", "/__properties/study", "/__properties/versions"}:
        assert re.fullmatch(r"(/[a-z][a-z0-9_]*)+|(/[a-z_]+)+/P\d", path), path


def test_seed_scenario_and_versions_are_properties(chunks, made, kind):
    properties = columns(chunks, "/__properties/study")
    assert properties["seed"] == [[1]]
    assert properties["scenario"] == [[made(kind)[1]["scenario"]]]
    versions = columns(chunks, "/__properties/versions")
    assert {"testbench", "mujoco", "pin", "rerun-sdk", "numpy"} <= set(versions)


FITS = {
    "gravity": "testbench.studies.gravity_calibration.trial.results",
    "full_pose": "testbench.studies.six_dof_arm.report.identify",
}
"""What fits the models of a recording; fitted once here, so that the writing alone is compared."""


def test_the_same_numbers_give_the_same_recording(made, kind, tmp_path, monkeypatch):
    if kind in FITS:
        module, _, name = FITS[kind].rpartition(".")
        fit, found = getattr(importlib.import_module(module), name), []

        def once(*args):
            if not found:
                found.append(fit(*args))
            return found[0]

        monkeypatch.setattr(FITS[kind], once)
    folders = [tmp_path / "first", tmp_path / "again"]
    for folder in folders:
        folder.mkdir()
        made(kind)[2](folder)
    assert rerun("compare", "--unordered", *(folder / "recording.rrd" for folder in folders))[0] == 0


def test_a_failure_half_way_closes_the_stream_and_leaves_nothing(made, kind, tmp_path, monkeypatch):
    closed = []
    write = made(kind)[2]  # a recording of its own is written whole

    def fail(*_, **__):
        assert rr.strict_mode()
        raise RuntimeError("half-way")

    original = rr.RecordingStream.disconnect

    def disconnect(stream):
        original(stream)
        closed.append(stream)

    monkeypatch.setattr(rr.RecordingStream, "disconnect", disconnect)
    monkeypatch.setattr(rr.RecordingStream, "send_columns", fail)
    with pytest.raises(RuntimeError, match="half-way"):
        write(tmp_path)
    assert len(closed) == 1
    assert not [*tmp_path.glob("*.rrd*"), *tmp_path.glob(".new-*")]
    assert not rr.strict_mode()


def test_the_summary_asks_and_answers_in_bold(chunks):
    question, answer, *_ = document(chunks, "/summary").split("\n\n")
    assert question.startswith("### ")
    assert question.endswith("?")
    assert re.fullmatch(r"#### \*\*.*\d.*\*\*", answer)
    assert "**Scrub**" in document(chunks, "/summary")


# --- numbers against report.json ---------------------------------------------------------------------------


def table(text):
    """Rows of the first markdown table, by their first cell."""
    block = next(part for part in text.split("\n\n") if part.startswith("|"))
    lines = [[c.strip(" *") for c in x.split("|")[1:-1]] for x in block.split("\n")]
    return {line[0]: line[1:] for line in lines}


def middle(value):
    return value["median"] if isinstance(value, dict) else value


def numbers(cells):
    return [float(cell.split()[0].rstrip("%")) for cell in cells]


def test_full_pose_table_is_the_reports(made):
    file, found, _ = made("full_pose")
    rows = table(document(chunks_of(file), "/summary"))
    for model in found["models"]:
        cells = dict(zip(rows["model"], rows[model["name"]], strict=True))
        shown = numbers([cells["95 % check, true, mm"]])
        assert shown == pytest.approx([middle(model["check_true"]["p95_mm"])], abs=5.1e-4)


def test_full_pose_loads_are_drawn_with_force_and_moment(made):
    data = on(chunks_of(made("full_pose")[0]), "run")
    labels = columns(data, "/world/load/label")["Points3D:labels"]
    assert labels[0] == ["1000 N"]
    assert labels[3] == ["1000 N m"]
    assert labels[-1] == ["1000 N and 1000 N m"]
    vectors = np.array(columns(data, "/world/load/force")["Arrows3D:vectors"])[:, 0]
    assert vectors[0] == pytest.approx([np.linalg.norm(vectors[0]), 0, 0])


def test_errors_of_the_chart_are_those_of_the_report(made):
    file, found, _ = made("gravity")
    labels = columns(chunks_of(file), "/errors_by_model_mm/number")["Points2D:labels"][0]
    names = columns(chunks_of(file), "/errors_by_model_mm/name")["Points2D:labels"][0]
    shown = dict(zip(names, labels, strict=True))
    for words, group in (
        ("RMS check, true", "check_true"),
        ("RMS workspace, true", "workspace"),
    ):
        for model in (m for m in found["models"] if m["constraint"] != "free"):  # least squares once more
            text = shown[f"{words}: {model['name']}"]
            assert numbers([text]) == pytest.approx([model[group]["rms_mm"]], abs=5.1e-4)
            assert ("recommended" in text) == (model["name"] == found["recommended"])


def test_compliances_of_a_calibration_are_those_of_the_true_arm(made, kr500):
    """Seed 1 of the family has links 10 % off tubes, the folder has tubes."""
    text = document(chunks_of(made("gravity")[0]), "/compliance_table")
    true, folder = (true_cell(kr500, name, 1).plant.arm.links[2].compliance for name in ("off_10", "tubes"))
    for k in range(6):
        assert show(true[k, k], ".3e") in text
        assert show(folder[k, k], ".3e") not in text
