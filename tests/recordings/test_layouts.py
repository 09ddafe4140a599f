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
    PLACED,
    chunks_of,
    columns,
    document,
    layout,
    on,
    panes,
    picture,
    plotted,
    rerun,
    series,
    views,
)
from rerun.chunk import RrdReader

from testbench.bench.campaign import Scenario
from testbench.bench.full_pose import FullPose
from testbench.bench.truths import true_cell
from testbench.errors import BenchError
from testbench.studies.gravity_calibration import trial as gravity
from testbench.studies.gravity_calibration.study import STUDY as GRAVITY
from testbench.studies.loaded_stiffness import trial as loaded
from testbench.studies.loaded_stiffness.study import STUDY as LOADED
from testbench.studies.run import found_by, to_json
from testbench.studies.single_link import trial as single_link
from testbench.studies.single_link.study import STUDY as SINGLE_LINK
from testbench.studies.six_dof_arm import trial as six_dof
from testbench.studies.six_dof_arm.study import STUDY as SIX_DOF
from testbench.studies.solver_comparison import trial as solvers
from testbench.studies.solver_comparison.study import STUDY as SOLVERS
from testbench.studies.study import Run
from testbench.studies.wrong_inputs import trial as wrong_inputs
from testbench.studies.wrong_inputs.study import STUDY as WRONG_INPUTS
from testbench.views.colours import look
from testbench.views.recording.compliance import colours
from testbench.views.recording.stream import Header
from testbench.views.recording.sweep import write_sweep
from testbench.views.recording.swept import Point, Sweep
from testbench.views.schema import Column, show

BUDGET = 2 * 2**20
TIMELINES = {
    "gravity": {"place", "worst_first", "run", "load"},
    "full_pose": {"place", "worst_first", "run", "load"},
    "loaded": {"worst_first", "sweep"},
    "single_link": {"sweep"},
    "solver": {"iteration"},
    "planted": {"fault"},
}
APPLICATIONS = {"gravity": "calibration", "full_pose": "calibration", "loaded": "sweep"}


SMALL = FullPose(arm="arm_6r", poses=6, check_runs=10)
HEAVY = Scenario(arm="kr500_l480", workspace_poses=5)
KINDS = {
    "gravity": (
        GRAVITY,
        gravity.Settings("kr500_l480", Scenario(arm="kr500_l480", workspace_poses=5), 50.0),
        1,
    ),
    "full_pose": (SIX_DOF, six_dof.Settings("arm_6r", "reading", SMALL, 1, 1, 1, 10.0), 2),
    "loaded": (LOADED, loaded.Settings(arm="kr500_l480", loads=2, poses=3), 1),
    "single_link": (SINGLE_LINK, single_link.Settings(ordered_below=2), 2),
    "solver": (
        SOLVERS,
        solvers.Settings(
            SMALL,
            "MGCO56",
            m=6,
            generations=3,
            trial_points=10,
            starts=1,
            scs=False,
            minima_starts=2,
            minima_seeds=1,
            first=1,
            short_generations=2,
        ),
        2,
    ),
    "planted": (WRONG_INPUTS, wrong_inputs.Settings(("after_unit", "equal"), 1, 1), 1),
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
        found, *told = found_by(study, settings, seeds, list(zip(seeds, rows, strict=True)))
        run = Run(study.name, settings, seeds, found, *told, Path(), "{}")

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


def test_sweep_has_the_median_and_spread_of_every_row(made):
    file, found, _ = made("loaded")
    data = chunks_of(file)
    drawn = plotted(data, "/error_of_the_tool_um")
    for method, name in (("linear", "Eq. (6)"), ("secant", "Eq. (7) once")):
        rows = [r for r in found["rows"] if (r["truth"], r["method"]) == ("own weight", method)]
        expected = [[r["error_um"][key] for key in ("median", "p05", "p95")] for r in rows]
        np.testing.assert_allclose(drawn[f"{name}, own weight"], expected, rtol=PLACED)
    assert columns(data, "/error_of_the_tool_um/cursor")["sweep"] == [1, 2]


def swept(**changes):
    """LS 3, 12, 2 times as large as GCO over three loads."""
    points = [Point(x, "GCO", y) for x, y in ((1, 2.0), (10, 1.0), (100, 4.0))]
    points += [Point(x, "LS", y) for x, y in ((1, 6.0), (10, 12.0), (100, 8.0))]
    points += [Point(x, "worse", 100.0) for x in (1, 10, 100)]
    looks = {"GCO": look("MGCO56", "psd"), "LS": look("MLS56", "none"), "worse": look("MLS32", "none")}
    axes = Column("load", "load", "N"), Column("error", "error", "mm")
    return replace(Sweep(*axes, points, looks, against=["LS", "worse"]), **changes)


def test_a_sweep_opens_where_the_best_gains_most_over_least_squares_and_says_so(tmp_path):
    write_sweep(tmp_path / "x.rrd", Header("name", "{}", 1), swept(), "### How much?")
    chunks = chunks_of(tmp_path / "x.rrd")
    assert layout(tmp_path / "x.rrd")["/time_panel"]["TimePanelBlueprint:timeline"][0] == ["worst_first"]
    steps = columns(chunks, "/this_step")
    said = dict(zip(steps["worst_first"], steps["TextDocument:text"], strict=True))
    assert said[0][0].startswith(
        "**Load 10 N**: LS 12 mm, 12 times the best, GCO, 1 mm. Here they differ most."
    )
    assert "3 times the best" in said[1][0]
    assert "most" not in said[1][0]
    assert "2 times the best" in said[2][0]
    assert "at load 10 N" in document(chunks, "/summary")
    assert swept(among=["worse"]).widest.best.model == "worse"
    assert swept(against=()).widest.theirs.model == "worse"


def test_a_model_may_lack_values_of_a_sweep_and_has_none_twice():
    whole = swept()
    some = replace(whole, points=whole.points[:-2])
    assert [len(step.points) for step in some.steps] == [3, 2, 2]
    assert some.plot("x").curves[2].x.tolist() == [1]
    assert "| worse | 100 |  |  |" in some.words.block("medians")
    with pytest.raises(BenchError, match="'worse' once at every value of load"):
        replace(whole, points=[*whole.points, replace(whole.points[-1])]).steps  # noqa: B018


def test_matrices_of_the_single_link_are_the_reports(made):
    file, found, _ = made("single_link")
    text = document(chunks_of(file), "/table")
    for C in (
        found["truth_matrix"],
        found["first_draw"]["MGCO21"]["matrix"],
        found["eq_22_23"]["eq_22"]["matrix"],
    ):
        for row in C:
            assert " | ".join(f"{1e6 * x + 0.0:.3f}" for x in row).replace("-0.000", "0.000") in text
    rows = table(document(chunks_of(file), "/summary"))
    for model in found["models"]:
        conservative, *_, position, rotation = rows[model["name"]]
        assert conservative.startswith(f"{100 * model['conservative']:.0f} %")
        expected = [middle(model["prediction"][key]) for key in ("position_rms_um", "rotation_rms_urad")]
        assert numbers([position, rotation]) == pytest.approx(expected, abs=0.51)


def test_truth_of_the_single_link_has_ones_on_the_diagonal_of_its_heatmap(made):
    shown = picture(chunks_of(made("single_link")[0]), "/compliance/truth_eq_21/cells")
    assert shown.shape == (6, 6, 3)
    assert (shown[range(6), range(6)] == colours(np.ones(6))).all()


def test_ways_of_the_solvers_are_the_reports(made):
    file, found, _ = made("solver")
    data = chunks_of(file)
    for key, way in found["convergence"]["points"].items():
        name = key.replace("'", "_short")
        gap = series(data, f"/convergence/log10_gap/solver_{name}", "iteration")
        seconds = series(data, f"/convergence/log10_s/solver_{name}", "iteration")
        assert gap == pytest.approx(np.log10(np.maximum(way, 1e-12))[:, 1].tolist())
        assert seconds == pytest.approx(np.log10(way)[:, 0].tolist())
    rows = table(document(data, "/summary"))
    for row in found["solvers"]:
        assert float(rows[row["key"]][0]) == pytest.approx(middle(row["f_m"]), abs=5.1e-3)
