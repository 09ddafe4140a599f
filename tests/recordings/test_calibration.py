"""What is drawn of a calibration, and its recording: deflections, errors, loads by their numbers."""

import re
import time

import numpy as np
import pytest
from read_back import columns, on, series, sound

from testbench.bench.campaign import Scenario, simulate
from testbench.bench.error_places import error_places, kept_mm, places_of
from testbench.bench.judged import identify
from testbench.bench.models import named_models
from testbench.bench.rows import fit_row
from testbench.data.dataset import in_order
from testbench.identify.evaluate import deflections
from testbench.plant import settle
from testbench.report.report import Report
from testbench.views.markdown import Markdown
from testbench.views.page.calibration import LEFT, OVER, WHILE, calibration_seen, load_layers
from testbench.views.recording.run import write_run
from testbench.views.recording.stream import Header, snake

NAMES = ("MLS32", "Joints", "MGCO56")
M = 37.0  #: Magnification of deflections.
SAID = Markdown("MGCO56 errs least.")
LONG = Markdown("\n\n".join(["What stands below the first sentences."] * 9))


@pytest.fixture(scope="module")
def made(kr500):
    """A campaign, its results, and the order of its places."""
    campaign = simulate(kr500, Scenario(arm="kr500_l480", workspace_poses=5), 1)
    results = identify(kr500, campaign, named_models(kr500, NAMES), time.perf_counter)
    errors = {result.model.name: kept_mm(result.places) for result in results}
    return campaign, results, error_places(places_of(kr500, campaign.truth), errors, NAMES)


@pytest.fixture(scope="module")
def seen(kr500, made):
    campaign, results, found = made
    rows = [fit_row(result.model.name, result.estimate, result.seconds) for result in results]
    return calibration_seen((kr500, campaign, results), rows, found, M)


@pytest.fixture(scope="module")
def sets(made):
    """Runs of the workspace in the order of the map, and those that were measured."""
    campaign, _, found = made
    number = {run: k for k, run in enumerate(campaign.truth.run.tolist())}
    return in_order(campaign.truth, np.array([number[run] for run in found.run])), campaign.measured


@pytest.fixture(scope="module")
def file(seen, tmp_path_factory):
    path = tmp_path_factory.mktemp("calibration") / "recording.rrd"
    write_run(path, Header("calibration", "{}", 1), Report("c", SAID, SAID, SAID, {}, {}, [LONG]), seen, {})
    return path


def test_arrows_lead_from_where_markers_go_to_where_each_model_has_them(kr500, made, seen, sets):
    """Of every model its own, as many times as long as the title says, on the deflection as it says."""
    _, results, _ = made
    said = re.fullmatch(r"Deflections x (\S+), arrows of errors x (\S+)\.", seen.scene.title)
    moved, arrows = map(float, said.groups())
    assert moved == M
    named = {result.model.name: result.estimate for result in results}
    for group, data in zip(seen.scene.groups, sets, strict=False):
        dots, *errors, load = group.layers
        np.testing.assert_allclose(dots.at, data.before + moved * data.deflection, atol=2e-4)
        assert [layer.name for layer in errors] == [f"error of {name}" for name in NAMES]
        for layer, name in zip(errors, NAMES, strict=True):
            predicted = deflections(kr500.vjm, named[name], data)
            np.testing.assert_allclose(layer.to - layer.at, arrows * (predicted - data.deflection), atol=1e-9)
            np.testing.assert_array_equal(layer.at, dots.at)
        assert load.name == "load"


def test_maps_and_charts_hold_the_errors_of_the_models_in_their_looks(made, seen):
    campaign, results, found = made
    assert [chart.title for chart in seen.runs] == [LEFT, WHILE]
    assert seen.map.title == OVER
    for line, chart, name in zip(seen.map.lines, seen.runs[0].lines, NAMES, strict=True):
        [result] = [own for own in results if own.model.name == name]
        assert line.name == chart.name == name
        assert line.values == pytest.approx(found.error_mm[name], rel=1e-3)  # kept to four digits
        rms = 1e3 * np.sqrt((result.residuals**2).sum(axis=2).mean(axis=1))
        assert chart.values == pytest.approx(rms)
        assert line.look == chart.look
    assert len({line.look for line in seen.map.lines}) == len(NAMES)
    fitted = {name for name in seen.scene.groups[1].names if "fitted" in name}
    assert len(fitted) == campaign.identification.runs
    words = seen.scene.groups[0].words[0]
    assert all(f"{name} {found.error_mm[name][0]:.3f} mm" in words for name in NAMES)


def test_loading_goes_through_true_equilibria_from_none_to_the_first_place(kr500, seen, sets):
    places, _, loading = seen.scene.groups
    over, _ = sets
    assert (loading.name, loading.sweep, loading.first) == ("Loading", "load", 20)
    for own, other in zip(loading.layers, places.layers, strict=True):
        assert own.at[-1] == pytest.approx(other.at[0], abs=1e-12)
    assert loading.bent.positions[0] == pytest.approx(loading.rigid.positions[0], abs=1e-12)
    q, wrench, point = over.q[:1], over.wrench[:1], over.point[:1]
    half = settle(kr500.plant, q, 0.5 * wrench, point).markers - settle(kr500.plant, q).markers
    before = loading.layers[0].at[0]
    assert loading.layers[0].at[10] - before == pytest.approx(M * half[0], abs=1e-9)
    # not half of the whole: the truth is not linear
    assert np.abs(2 * half[0] - (loading.layers[0].at[-1] - before) / M).max() > 1e-7
    for line, mapped in zip(seen.runs[1].lines, seen.map.lines, strict=True):
        assert line.values[[0, -1]] == pytest.approx([0.0, mapped.values[0]], abs=1e-9)


def test_weights_are_cubes_of_steel_on_slings_of_one_length():
    hook, mass = np.array([[1.0, 2.0, 3.0]] * 3), np.array([0.0, 100.0, 460.3])
    wrench = np.zeros((3, 6))
    wrench[:, 2] = -9.81 * mass
    [load] = load_layers(hook, wrench, 2.0)
    sling, *edges = np.moveaxis(load.to - load.at, 1, 0)
    assert sling == pytest.approx(np.tile([0, 0, -0.4], (3, 1)))
    length = np.linalg.norm(edges, axis=2)
    assert length.shape == (12, 3)
    assert 7850 * length**3 == pytest.approx(np.tile(mass, (12, 1)), abs=1e-9)
    below = np.concatenate([load.at[:, 1:], load.to[:, 1:]], axis=1)
    assert below.max(axis=1)[:, 2] == pytest.approx([2.6] * 3)


def test_forces_and_moments_are_arrows_along_them():
    wrench = np.array([[1000.0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 500.0, 0], [0, -3, 0, 0, 0, 4]])
    force, moment = load_layers(np.zeros((3, 3)), wrench, 2.0)
    assert (force.name, moment.name) == ("force", "moment")
    none = [np.nan] * 3
    assert force.to[:, 0] == pytest.approx(np.array([[0.4, 0, 0], none, [0, -0.4, 0]]), nan_ok=True)
    assert moment.to[:, 0] == pytest.approx(np.array([none, [0, 0.4, 0], [0, 0, 0.4]]), nan_ok=True)


def test_the_recording_has_the_same_numbers_on_every_timeline(file, seen):
    chunks = sound(file, SAID)
    assert {name for chunk in chunks for name in chunk.timeline_names} == {"worst_first", "pose", "load"}
    for chunk in chunks:
        assert chunk.is_static or len(chunk.timeline_names) == 3
    for line in seen.map.lines:
        found = series(chunks, f"/charts/workspace_against_the_truth/{snake(OVER)}/{snake(line.name)}")
        assert found == pytest.approx(line.values)
    for line in seen.runs[1].lines:
        path = f"/charts/loading/{snake(WHILE)}/{snake(line.name)}"
        assert series(chunks, path, "load") == pytest.approx(line.values)
        assert series(chunks, path) == pytest.approx(line.values[::-1])
    at = columns(on(chunks, "load"), "/world/loading/markers_under_load")
    assert at["load"] == list(range(0, 101, 5))
    worst = series(chunks, f"/charts/runs_against_their_readings/{snake(LEFT)}/mgco56")
    assert worst == sorted(seen.runs[0].lines[2].values.tolist(), reverse=True)


def test_no_pane_is_blank_on_any_timeline(file, blank_panes):
    assert blank_panes(file) == []
