"""The report of a real arm holds and draws what its ladder and draws hold, of ones that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import at, check_spread, tables_of
from made_up import of_one_trial
from reports import check, check_forest, place_of, read_back, table_of

from testbench.data.dataset import Series
from testbench.identify.absolute.state import Mount, nominal_state
from testbench.identify.registration import Frame
from testbench.model.load import read_body_masses
from testbench.model.vjm import tool_poses
from testbench.report import colours
from testbench.report.markdown import as_markdown, grid
from testbench.report.schema import show
from testbench.report.table import find
from testbench.studies.absolute.real import (
    BLOCKS,
    DRAW,
    GEOMETRY,
    JOINTS,
    LADDER,
    LOOKS,
    PANES,
    SHARED,
    STUDY,
    TWO,
    WAVES,
    RealFitRow,
    RealSettings,
    approach,
    drift,
)
from testbench.studies.study import amid_errors
from testbench.workflows.absolute import PositionErrors
from testbench.workflows.cell import build_cell
from testbench.workflows.model_names import in_words

SEEDS, ORDERS, POSES = range(3, 6), 4, (50, 100)
JUDGED = {"blocks": "AC", "blocks, realigned": "AC", "A to C": "C", "C to A": "A", "both": ""}
SIZES = {GEOMETRY: 8.0, JOINTS: 6.0, WAVES: 2.0, SHARED: 2.0}
"""Mean error in blocks [mm]; from one series to the other joint errors are the worst."""
EFFECTS = tuple(np.array([[1, 2, 3, 4, 60, 5, 7, 40], [5, 6, 7, 8, 25, 9000, 3, 20]], dtype=float).T.ravel())


def rows(seed):
    """Every model on every split in the first seed, and two numbers of random poses."""
    rng, draws = np.random.default_rng(7), np.random.default_rng(seed)
    for model in LADDER if seed == SEEDS[0] else ():
        for split, series in JUDGED.items():
            own = {"waves": tuple(rng.normal(size=12 * ORDERS)), "joints": tuple(rng.uniform(1, 9, 6) * 1e-6)}
            own |= {"effects": EFFECTS * ((split, model) == ("both", SHARED))}
            own |= {
                "kept": ("joint springs",),
                "declined": ("links", "backlash"),
                "left_um": (),
                "error": None,
            }
            row = of_one_trial(RealFitRow, rng, name=model, split=split, judged="", conservative=True, **own)
            yield from () if series else (row,)
            for k, judged in enumerate(series, 1):
                mm = SIZES.get(model, 5.0) if split.startswith("blocks") else 3.0 + (model in (WAVES, SHARED))
                error = of_one_trial(PositionErrors, rng, n=100 * k, mean_mm=mm * k)
                left = (1e3 * mm, 0.0, 0.0) * 30 if split == BLOCKS else ()
                yield replace(row, judged=judged, error=error, left_um=left)
    for poses in POSES:
        for model in TWO:
            for judged in "CA":
                named = {"name": model, "split": DRAW, "judged": judged, "poses": poses, "waves": ()}
                named["effects"] = ()
                yield of_one_trial(
                    RealFitRow, draws, **named, error=of_one_trial(PositionErrors, draws, n=200)
                )


@pytest.fixture(scope="module")
def made():
    asked = RealSettings(100, ORDERS, tuple(LADDER), SEEDS[0], dict.fromkeys(POSES, 3))
    trials = table_of(SEEDS, lambda seed: [*rows(seed)])
    return STUDY.report(asked, SEEDS, trials), trials


def test_means_of_a_model_are_by_the_numbers_of_positions_that_judge(made):
    found, _ = made
    check(found, ["models"])
    f = found.numbers
    means = {row.name: row for row in f["models"]}
    for name, mm in SIZES.items():
        assert means[name].blocks_mm == pytest.approx((100 * mm + 200 * 2 * mm) / 300)  # by their numbers
    assert (found.badge.what, found.badge.each) == ("RMS error", "position of held-out blocks")  # no means
    assert (found.badge.verdict, found.badge.rival, found.badge.ties) == ("tie", WAVES, (WAVES,))
    assert [row.what for row in f["effects"]][4::2] == ["approach, wrist_2_joint", "drift of z, C"]


def test_the_table_of_errors_has_the_ladder_and_the_medians_of_all_draws(made):
    found, trials = made
    f = found.numbers
    for row in f["by_number"]:
        own = trials.where(split=DRAW, name=row.name, judged=row.judged, poses=row.poses)
        check_spread(row.error.mean_mm, own["error.mean_mm"])
        assert row.draws == 3
    [(_, cells)] = tables_of(grid(found.tables["errors"]))
    for row, line in zip([*f["ladder"], *f["by_number"]], cells, strict=True):
        known = [*map(as_markdown, (row.name, row.split, row.judged))]
        sizes = [show(row.error[key]) for key in ("mean_mm", "rms_mm", "p95_mm", "max_mm", "coverage_95")]
        assert (line[:3], line[-5:]) == (known, sizes)


def test_the_figure_draws_the_ladder_in_the_colours_of_its_models(made):
    found, _ = made
    for axes, key in zip(STUDY.figures(read_back(found))["real_ur10.png"].axes, PANES, strict=True):
        means = [at(find(found.numbers["models"], name=name), key) for name in LADDER]
        check_forest(axes, means, [LOOKS[name] for name in LADDER], first=place_of(found, LADDER))
    assert [LOOKS[name].colour for name in TWO] == [colours.JOINTS, colours.JOINTS_PRIOR]


def test_arrows_lead_from_where_a_model_has_the_target_to_the_reading(rng):
    cell, q = build_cell("ur10"), np.linspace(-1, 1, 30).reshape(5, 6)
    errors = {name: rng.uniform(-1e-3, 1e-3, (5, 3)) for name in TWO}
    seen = amid_errors(cell, q, [*"abcde"], errors, LOOKS)
    [poses], [chart] = seen.scene.groups, seen.runs
    scale = float(seen.scene.title.split()[-1].rstrip("."))
    tool, rotation = tool_poses(cell.vjm, q)
    for layer, line, (name, off) in zip(poses.layers, chart.lines, errors.items(), strict=True):
        np.testing.assert_allclose(layer.at[:, 0], tool + rotation @ cell.vjm.markers[0], atol=1e-9)
        np.testing.assert_allclose((layer.to - layer.at)[:, 0], scale * off)
        np.testing.assert_allclose(line.values, 1e3 * np.linalg.norm(off, axis=1))
        assert (layer.name, layer.colour) == (f"error of {in_words(name)}", LOOKS[name].colour)
        assert (line.name, line.look) == (name, LOOKS[name])
    assert poses.first == np.linalg.norm(errors[SHARED], axis=1).argmax()
    assert f"{in_words(JOINTS)} {chart.lines[0].values[1]:.3f} mm" in poses.words[1]
    assert (chart.title, [*chart.labels]) == ("Error at each position (mm)", [*"abcde"])


def test_direction_of_approach_and_drift_are_measured_where_they_are(rng):
    """Of 1200 poses read within 30 um: 60 urad of one joint, and a slow wave of z whose RMS is 28 um."""
    cell, rows, point = build_cell("ur10"), 1200, np.array([0.1, 0.0, 0.2])
    state = nominal_state(cell.vjm, read_body_masses(cell.arm), np.ones(6))
    mount = Mount(point[None], np.eye(3), ("P",))
    state = replace(state, frames={"f": Frame(np.eye(3), np.zeros(3))}, mounts={"t": mount})
    q, every, none = rng.uniform(-2, 2, (rows, 6)), np.arange(rows), np.zeros((rows, 6))
    turned = q.copy()
    turned[1:, 4] += 30e-6 * np.sign(np.diff(q[:, 4]))
    place, rotation = tool_poses(cell.vjm, turned)
    x = place + rotation @ point + 30e-6 * rng.standard_normal((rows, 3))
    still = Series("s", ("P",), "f", "t", every, every, q, none, none[:, :3], x[:, None], 30e-6)
    found = approach(state, still)
    off = np.abs(found[:, 0] - 60e-6 * (np.arange(6) == 4))
    assert (off < 2 * found[:, 1]).all()
    assert found[4, 1] < 20e-6
    wave = 40e-6 * np.sin(2 * np.pi * every / 400)
    moving = replace(still, position=still.position + np.outer(wave, [0, 0, 1])[:, None])
    assert drift(state, moving)[0] == pytest.approx(28e-6, rel=0.1)
    assert drift(state, still)[0] < 5e-6
