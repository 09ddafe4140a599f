"""A program in, a corrected one out: MuJoCo executes what the files say; wrong files change nothing."""

import json
from dataclasses import replace
from functools import partial
from statistics import NormalDist

import numpy as np
import pytest
from model_folders import identified
from page_checks import check_page, check_winner, drawn_in, said, times_of
from read_back import columns, on, series, sound
from reports import check
from run_here import do, fine, refused, table

from testbench.arm.folder import find_arm, load_arm
from testbench.cli.compensate import report
from testbench.correct.compensated import Refusal
from testbench.correct.newton import Aim
from testbench.files.program import read_program
from testbench.identify.estimate import make_estimate
from testbench.identify.prior import PriorUncertainty, cad_prior
from testbench.identify.regression import reduce
from testbench.model.structure import all153
from testbench.model.vjm import tool_poses
from testbench.plant.equilibrium import solve_equilibrium
from testbench.report.program_scene import draw_correction
from testbench.runs import manifest as files
from testbench.workflows.arm_models import load_model
from testbench.workflows.campaign import Scenario, simulate
from testbench.workflows.models import Model, named_models, with_priors
from testbench.workflows.program import correct_program
from testbench.workflows.program_numbers import correction_numbers

TIP, SPINDLE = np.array([0.1, 0.0, 0.05]), np.array([1.0, 0.0, 0.0])
FEED, CROSS, AXIAL = -700.0, 500.0, -900.0
OFF = "/charts/whole_arm/how_far_the_loaded_tool_is_off_at_each_point_mm"
START = np.array([0.3, -1.2, 1.6, 0.3, -0.5, 0.1])
POINTS = 12


def the_truth(C_theta, vjm, structure, data):
    """An estimator that is told: what it is called with does not say it."""
    regression = reduce(vjm, structure, data)
    return make_estimate(regression, structure.parameters_of(C_theta), method="the truth")


@pytest.fixture(scope="module")
def folder(kr500, tmp_path_factory):
    """Models of the true compliances, and of what weights say of joints alone."""
    out = tmp_path_factory.mktemp("models")
    runs = simulate(kr500, Scenario(arm="kr500_l480", workspace_poses=1, check_runs=3), 7).identification
    models = {
        "true": Model("truth", all153(kr500.arm), partial(the_truth, kr500.arm.C_theta)),
        "joints": named_models(kr500, ["Joints"])[0],
        "sure": with_priors(
            kr500.arm, named_models(kr500, ["ALL"]), cad_prior(kr500.arm), PriorUncertainty(0.3)
        )[0],
    }
    for name, model in models.items():
        identified(kr500, model, runs, out / name)
    return out


@pytest.fixture(scope="module")
def bounded(folder, asked, tmp_path_factory, legible):
    """Corrected by a model with a prior: every point has an interval."""
    out = tmp_path_factory.mktemp("bounded")
    with legible():
        fine(
            "compensate",
            folder / "sure",
            joints_csv(out / "mill.csv", asked[0]),
            "--out",
            out / "right.csv",
            "--recording",
        )
    return out


@pytest.fixture(scope="module")
def asked(kr500):
    """Joints of a path and where they have the drawn tool."""
    q = START + np.linspace(0, 1, POINTS)[:, None] * [0.25, 0.05, -0.06, 0.02, 0.1, 0.0]
    return q, *tool_poses(kr500.vjm, q)


def joints_csv(path, q, end=""):
    """A program of joints with a milling force."""
    head = [*(f"joint_{k}_deg" for k in range(1, 7)), "feed_N", "cross_N", "axial_N", "Kommentar"]
    rows = [
        [*map(repr, np.degrees(row).tolist()), FEED, CROSS, AXIAL, f"Punkt {k}"] for k, row in enumerate(q)
    ]
    path.write_text("\n".join(",".join(map(str, row)) for row in [head, *rows]) + "\n" + end)
    return path


def tip_of(rest):
    return rest.tool_positions + rest.tool_rotations @ TIP


def process(position, rotation):
    """The milling force in the world, by hand."""
    spindle = rotation @ SPINDLE
    feed = np.gradient(position + rotation @ TIP, axis=0)
    feed /= np.linalg.norm(feed, axis=1, keepdims=True)
    force = FEED * feed + CROSS * np.cross(spindle, feed) + AXIAL * spindle
    return np.hstack([force, np.zeros_like(force)])


@pytest.fixture(scope="module")
def corrected(kr500, folder, asked, tmp_path_factory):
    out = tmp_path_factory.mktemp("corrected")
    source = joints_csv(out / "mill.csv", asked[0])
    tip = ("--tip", ",".join(map(str, TIP)))
    return out, fine("compensate", folder / "true", source, "--out", out / "right.csv", "--recording", *tip)


def test_the_true_arm_executes_the_corrected_file_within_a_micrometre(kr500, corrected, asked):
    out, _ = corrected
    q, position, rotation = asked
    found = read_program(out / "right.csv", kr500.arm)
    assert found.labels or found.other
    wrench, at = process(position, rotation), np.tile(TIP, (POINTS, 1))
    wanted = tip_of(solve_equilibrium(kr500.plant, q))
    left = np.linalg.norm(tip_of(solve_equilibrium(kr500.plant, found.q, wrench, at)) - wanted, axis=1)
    before = np.linalg.norm(tip_of(solve_equilibrium(kr500.plant, q, wrench, at)) - wanted, axis=1)
    assert before.min() > 2e-4
    assert left.max() < 1e-6


def test_the_page_has_the_numbers_of_the_model(kr500, corrected, asked):
    out, said = corrected
    report = json.loads((out / "right_report" / "report.json").read_text())
    q, position, rotation = asked
    wrench = process(position, rotation)
    off = tip_of(solve_equilibrium(kr500.plant, q, wrench, np.tile(TIP, (POINTS, 1)))) - tip_of(
        solve_equilibrium(kr500.plant, q)
    )
    assert report["before_mm"]["max"] == pytest.approx(1e3 * np.linalg.norm(off, axis=1).max(), rel=1e-3)
    assert report["corrected"] == report["points"] == POINTS
    names = [f"correction_joint_{k}_deg" for k in range(1, 7)]
    moved = np.array([[float(row[name]) for name in names] for row in table(out / "right.csv")])
    programmed, right = (read_program(out / name, kr500.arm).q for name in ("mill.csv", "right.csv"))
    np.testing.assert_allclose(moved, np.degrees(right - programmed), rtol=0, atol=1e-9)
    assert report["jump"]["size"] == pytest.approx(np.abs(np.diff(moved, axis=0)).max(), rel=1e-9)
    words = " ".join(said.split())
    assert f"{report['before_mm']['median']:.3f} mm as programmed" in words
    assert f"{report['unseen']} points have no bound after correction." in words
    first, push = report["ellipsoids"][0], np.zeros((POINTS, 6))
    push[0, :3] = 100 * np.array(first["directions"][0])
    moved = tip_of(solve_equilibrium(kr500.plant, q, wrench + push, np.tile(TIP, (POINTS, 1))))
    moved -= tip_of(solve_equilibrium(kr500.plant, q, wrench, np.tile(TIP, (POINTS, 1))))
    longest = 100 * first["semi_axes_mm"][0] / report["ellipsoid_force_n"]  # of 100 N
    np.testing.assert_allclose(1e3 * moved[0], push[0, :3] / 100 * longest, atol=0.02 * longest)
    about = json.loads((out / "right_report" / "manifest.json").read_text())
    assert about["corrected"] == {"right.csv": files.digest(out / "right.csv")}
    assert {p.name for p in (out / "right_report").iterdir()} >= {
        "report.md",
        "compensation.png",
        "stiffness.png",
        "report.html",
        "manifest.json",
        "run.log",
    }


def test_set_points_of_the_tool_are_corrected_as_their_joints_are(kr500, folder, corrected, asked, tmp_path):
    q, position, rotation = asked
    head = ",".join(["x_mm,y_mm,z_mm", *(f"rotation_{i}{j}" for i in "123" for j in "123")])
    tips = 1e3 * (position + rotation @ TIP)
    rows = [
        ",".join(map(repr, [*tip.tolist(), *R.ravel().tolist(), FEED, CROSS, AXIAL]))
        for tip, R in zip(tips, rotation, strict=True)
    ]
    (tmp_path / "tool.csv").write_text("\n".join([f"{head},feed_N,cross_N,axial_N", *rows]) + "\n")
    model = load_model(folder / "true", None)
    program = read_program(tmp_path / "tool.csv", model.arm)
    ours = correct_program(model, program, Aim(tool_point=tuple(TIP)), start=q[0]).found.q
    assert np.abs(ours - read_program(corrected[0] / "right.csv", kr500.arm).q).max() < 1e-8


@pytest.mark.study
def test_a_program_without_loads_bears_the_payload_as_in_predict(folder, asked, tmp_path):
    """One rule for both: what the arm states hangs, or what --load says."""
    q, *_ = asked
    bare = tmp_path / "bare.csv"
    rows = [",".join(map(repr, np.degrees(row).tolist())) for row in q]
    bare.write_text("\n".join([",".join(f"joint_{k}_deg" for k in range(1, 7)), *rows]) + "\n")
    found = {}
    for name, flags in {"stated": (), "same": ("--load", "460.3kg"), "none": ("--load", 0)}.items():
        said = fine("compensate", folder / "true", bare, "--out", tmp_path / f"{name}.csv", *flags)
        found[name] = read_program(tmp_path / f"{name}.csv", load_arm(find_arm("kr500_l480"))).q, said
    assert "The file gives no load, so the rated payload of 460.3 kg is assumed" in found["stated"][1]
    assert "The file gives no load: 460.3 kg of --load hang in every pose" in found["same"][1]
    assert "Neither the file nor --load gives a load" in found["none"][1]
    np.testing.assert_array_equal(found["stated"][0], found["same"][0])
    np.testing.assert_allclose(found["none"][0], q, atol=1e-9)
    assert np.abs(found["stated"][0] - q).max() > 1e-4


def test_a_point_that_is_stated_counts_even_where_it_is_the_tools_origin(folder, corrected, tmp_path):
    out, _ = corrected
    head, *rows = (out / "mill.csv").read_text().splitlines()
    (tmp_path / "origin.csv").write_text("\n".join([f"{head},point_x_mm", *(f"{row},0" for row in rows)]))
    model = load_model(folder / "true", None)
    program = read_program(tmp_path / "origin.csv", model.arm)
    ours = correction_numbers(correct_program(model, program, Aim(tool_point=tuple(TIP))))
    tips = json.loads((out / "right_report" / "report.json").read_text())
    assert abs(ours.before_mm.max / tips["before_mm"]["max"] - 1) > 0.01


@pytest.mark.study
def test_weights_do_not_turn_joint_1_and_the_page_says_so(folder, corrected, tmp_path):
    out, _ = corrected
    assert "joint_1" in fine(
        "compensate", folder / "joints", out / "mill.csv", "--out", tmp_path / "right.csv"
    )
    report = json.loads((tmp_path / "right_report" / "report.json").read_text())
    assert report["open"]["name"] == "joint_1"
    assert report["half_95_mm"] is None
    assert report["unseen"] == POINTS


def test_a_robots_own_program_stays_but_for_its_numbers_and_the_true_arm_executes_it(
    kr500, folder, asked, tmp_path, monkeypatch
):
    """Its points are in a second file; the true arm under the weight is where the program means."""
    about = {}
    monkeypatch.setattr(
        "testbench.cli.compensate.write_run", lambda out, run, *_: about.update(run.more(out))
    )
    q = asked[0][:3]
    rows = [",".join(f"A{k} {x!r}" for k, x in enumerate(row, 1)) for row in np.degrees(q).tolist()]
    points = "".join(f"DECL E6AXIS XP{k}={{{row},E1 0.0}}\r\n" for k, row in enumerate(rows, 1))
    moves = "".join(f"PTP XP{k} C_PTP ; {k}\r\n" for k in range(1, 4))
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "cell.src").write_bytes(f"DEF cell()\r\nPTP XHOME\r\n{moves}END\r\n".encode())
    (tmp_path / "in" / "cell.dat").write_bytes(f"DEFDAT cell\r\n{points}ENDDAT\r\n".encode())
    source, out = tmp_path / "in" / "cell.src", tmp_path / "out" / "cell.src"
    flags = ("compensate", folder / "true", source, "--load", "300kg", "--out", out)
    said = do(*flags).stdout
    assert "Moves to XHOME are unchanged" in said
    assert f"corrected{out},{out.with_suffix('.dat')}" in "".join(said.split())
    remark = b"; Corrected by testbench\r\n"
    assert out.read_bytes() == source.read_bytes().replace(b"()\r\n", b"()\r\n" + remark)
    text = out.with_suffix(".dat").read_text()
    assert text.count("E1 0.0}") == 3
    found = read_program(out, kr500.arm)
    assert found.labels == ("XP1", "XP2", "XP3")
    wrench = np.tile([0, 0, -300 * 9.81, 0, 0, 0], (3, 1))
    load = np.tile(kr500.vjm.load_point, (3, 1))
    rest = solve_equilibrium(kr500.plant, found.q, wrench, load)
    free = solve_equilibrium(kr500.plant, q)
    assert (
        np.linalg.norm(
            solve_equilibrium(kr500.plant, q, wrench, load).tool_positions - free.tool_positions, axis=1
        ).min()
        > 2e-4
    )
    assert np.linalg.norm(rest.tool_positions - free.tool_positions, axis=1).max() < 1e-6
    assert about["corrected"] == {own.name: files.digest(own) for own in (out, out.with_suffix(".dat"))}
    refused(*flags[:-1], source, said="is read by this command", below=tmp_path)
    twice = (*flags[:2], out, "--out", tmp_path / "twice.src")
    refused(*twice, said="cell.src: line 2: the program was corrected before", below=tmp_path)
    source.write_bytes(source.read_bytes().replace(b"PTP XP2 C_PTP", b"CIRC XP1,XP2 "))
    refused(*flags, "--force", said="cell.src: line 4: circular motion is not read, got CIRC", below=tmp_path)


WRONG = {
    "a path that jumps": (lambda q: q + np.eye(POINTS)[5][:, None] * 1.2, (), "line 7"),
    "another arm's model": (lambda q: q, ("--arm", "ur10"), "another arm"),
    "a tip that is none": (lambda q: q, ("--tip", "1,2"), "--tip"),
    "an unknown language": (
        lambda q: q,
        ("--out", "right.bas"),
        "--out: right.bas: expected a name that ends with one of",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_one_line_and_nothing_is_written(folder, asked, tmp_path, name):
    spoil, flags, said = WRONG[name]
    source = joints_csv(tmp_path / "mill.csv", spoil(asked[0]))
    args = ("compensate", folder / "true", source, "--out", tmp_path / "right.csv", *flags)
    refused(*args, said=said, below=tmp_path)


def test_a_file_that_is_no_corrected_program_is_not_replaced(folder, corrected, tmp_path):
    mill = corrected[0] / "mill.csv"
    (tmp_path / "mine.csv").write_text("x,y\n1,2\n")
    for flags, line in (
        (["--out", tmp_path / "mine.csv"], "mine.csv"),
        (["--out", mill], "is read by this command"),
        (["--out", tmp_path / "in" / "x.csv", "--report", tmp_path / "in"], "the folder of --report"),
    ):
        refused("compensate", folder / "true", mill, *flags, said=line, below=tmp_path)


def test_the_page_opens_at_the_point_farthest_off_and_no_pane_is_blank(corrected, open_page, blank_panes):
    folder = corrected[0] / "right_report"
    assert blank_panes(folder / "recording.rrd") == []
    report = json.loads((folder / "report.json").read_text())
    told = [f"{report['before_mm'][key]:.3f}" for key in ("median", "max")]
    check_winner(folder)
    words = said(check_page(open_page, folder / "report.html", told))
    assert words.startswith(f"Point {report['worst']['label']}, line {report['worst']['line']}.")
    assert f"{report['worst']['before_mm']:.3f} mm off as programmed" in words


def test_the_pages_path_lies_off_by_the_columns_of_the_corrected_file(corrected):
    """As many times as its title says, to the side that the file says."""
    out, _ = corrected
    rows = table(out / "right.csv")
    off = np.array([[float(row[f"before_{x}_mm"]) for x in "xyz"] for row in rows]) / 1e3
    drawn = drawn_in(out / "right_report" / "report.html")["scene"]
    [times, _] = times_of(drawn["title"])
    layers = {layer["name"]: layer for layer in drawn["groups"][0]["layers"]}
    asked, programmed = (path(layers[name]) for name in ("intended path", "uncorrected program"))
    np.testing.assert_allclose((programmed - asked) / times, off, atol=2e-4 / times + 1e-7)


def test_page_and_recording_draw_where_the_corrected_tool_may_be(bounded):
    """Lines along each axis of the world, as far as the file says, as many times as all else is drawn."""
    out = bounded
    half = [[float(row[f"half_95_{x}_mm"]) / 1e3 for x in "xyz"] for row in table(out / "right.csv")]
    page = drawn_in(out / "right_report" / "report.html")["scene"]
    [times, _] = times_of(page["title"])
    [layer] = [own for own in page["groups"][2]["layers"] if own["name"].startswith("where it may be")]
    at, to = (np.array(layer[key][0]).reshape(-1, 3, 3) / 1e4 for key in ("at", "to"))
    wanted = 2 * np.array(half)[:, :, None] * np.eye(3)
    np.testing.assert_allclose((to - at) / times, wanted, atol=2e-4 / times)
    chunks = on(sound(out / "right_report" / "recording.rrd", "mm as programmed"), "typical_first")
    lines = columns(chunks, "/world/corrected_program_from_near/where_it_may_be_95")["LineStrips3D:strips"][0]
    strips = np.array(lines).reshape(-1, 3, 2, 3)
    np.testing.assert_allclose((strips[:, :, 1] - strips[:, :, 0]) / times, wanted, atol=1e-6)


def test_a_recording_of_what_nobody_measured_plots_the_interval_and_no_success(folder, bounded, tmp_path):
    """The model's own residual is a solver's digits: drawn, it would be a success that nobody has seen."""
    chunks = sound(bounded / "right_report" / "recording.rrd", "mm as programmed")
    report = json.loads((bounded / "right_report" / "report.json").read_text())
    programmed_mm, corrected_mm = (report[key]["median"] for key in ("before_most_mm", "most_mm"))
    bounds = f"{programmed_mm:.3f} mm as programmed, {corrected_mm:.3f} mm corrected."
    assert report["said"]["answer"].endswith(bounds)  # bound beside bound
    within = {"uncorrected_program_95": "before_most_mm", "corrected_program_95": "most_mm"}
    for name, key in within.items():  # a bound beside a bound
        found = series(chunks, f"{OFF}/{name}")
        np.testing.assert_allclose(found, [row[key] for row in report["rows"]], rtol=1e-6)
    assert {c.entity_path for c in chunks if c.entity_path.startswith("/charts")} == {
        f"{OFF}/{name}" for name in within
    }
    flags = ("--out", tmp_path / "right.csv", "--recording")
    unseen = fine("compensate", folder / "joints", bounded / "mill.csv", *flags)
    assert unseen.startswith("Do not use the corrected program: the correction may make the error larger")
    chunks = sound(tmp_path / "right_report" / "recording.rrd", "12 points have no bound")
    assert np.isnan(series(chunks, f"{OFF}/corrected_program_95")).all()
    for name in ("report.html", "report.md"):
        text = (tmp_path / "right_report" / name).read_text()
        assert text.index("Do not use the corrected program") < text.index("have no bound"), name


@pytest.fixture(scope="module")
def sure(folder, bounded):
    """The same program, corrected by the library."""
    model = load_model(folder / "sure", None)
    return correct_program(model, read_program(bounded / "mill.csv", model.arm), Aim())


def test_a_tolerance_judges_point_by_point_and_the_worst_comes_first(sure):
    most = 1e3 * (np.linalg.norm(sure.found.error_after, axis=1) + sure.found.error_half_width.max(axis=1))
    limit = float(np.median(most))
    said = report(sure, limit)
    assert [row.verdict for row in said.numbers["rows"]] == ["pass" if mm <= limit else "fail" for mm in most]
    fails = int((most > limit).sum())
    assert 0 < fails < len(most)
    assert said.numbers["tolerance"].failed == fails
    assert said.badge.verdict == "do not use"
    told = {row.what: row.value for row in said.tables["numbers"].rows if "outside" in str(row.what)}
    assert [told[what] for what in told if what.endswith(", corrected")] == [fails]
    shown = [row.most_mm for row in said.tables["worst"].rows]
    assert shown == sorted(shown, reverse=True)
    assert shown[0] == pytest.approx(most.max())
    check(said, ["worst"])
    assert report(sure, 2 * float(most.max())).numbers["tolerance"].failed == 0


def test_one_point_beyond_the_tolerance_is_enough_to_exit_with_1(folder, bounded, tmp_path, monkeypatch):
    """And no point is beyond one that all keep. The page is another test's."""
    monkeypatch.setattr("testbench.cli.compensate.write_run", lambda *_: None)
    rows = table(bounded / "right.csv")
    half = [max(float(row[f"half_95_{x}_mm"]) for x in "xyz") for row in rows]
    asked = ("compensate", folder / "sure", bounded / "mill.csv", "--out", tmp_path / "right.csv")
    for limit, code in ((float(np.median(half)), 1), (2 * max(half), 0)):
        done = do(*asked, "--tolerance", limit)
        assert (done.returncode, done.stderr) == (code, "")


def test_tables_have_the_numbers_of_the_corrected_file(bounded):
    rows = table(bounded / "right.csv")
    before = [np.linalg.norm([float(row[f"before_{x}_mm"]) for x in "xyz"]) for row in rows]
    half = [max(float(row[f"half_95_{x}_mm"]) for x in "xyz") for row in rows]
    most = np.add(before, half)
    sizes = {"uncorrected program, 95 %": most, "corrected program, 95 %": half}
    text = (bounded / "right_report" / "report.md").read_text()
    for line in (
        "| line | point | expected error, as programmed, mm | 95 % bound, as programmed, mm | 95 % bound, "
        "corrected, mm |",
        "\n".join(
            f"| {k + 2} | {k + 1} | {before[k]:.3f} | {most[k]:.3f} | {half[k]:.3f} |"
            for k in np.argsort(before)[::-1]
        ),
        "| what | median over the points, mm | largest, mm |",
        *(f"| {name} | {np.median(mm):.3f} | {max(mm):.3f} |" for name, mm in sizes.items()),
    ):
        assert f"{line}\n" in f"{text}\n", line


def test_a_refused_point_is_as_far_off_as_it_was_and_a_bound_stands_beside_a_bound(kr500, sure):
    """What the correction leaves counts: a refused point is as far off as it was."""
    own = sure.found
    after = own.error_after.copy()
    after[3] = own.error_before[3]
    refused = (*own.refusals[:3], Refusal("reach"), *own.refusals[4:])
    found = replace(sure, found=replace(own, error_after=after, refusals=refused))
    said = report(found)
    [chart] = draw_correction(kr500, found, said).runs
    before, half = 1e3 * np.linalg.norm(own.error_before, axis=1), 1e3 * own.error_half_width.max(axis=1)
    uncorrected, corrected = (line.values for line in chart.lines)
    np.testing.assert_allclose(uncorrected, before + half, rtol=1e-9)
    np.testing.assert_allclose(corrected, 1e3 * np.linalg.norm(after, axis=1) + half, rtol=1e-9)
    assert corrected[3] == pytest.approx(uncorrected[3])
    assert said.numbers["most_mm"].max == pytest.approx(corrected.max())


def test_what_is_less_sure_than_the_correction_is_large_is_likely_not_harmful(sure):
    """Ten times less sure: bounds still shrink, the chance is that of a normal error along the correction."""
    own = sure.found
    before, half = np.linalg.norm(own.error_before, axis=1), own.error_half_width.max(axis=1)
    widened = own.error_half_width * (1.2 * before / half)[:, None]
    said = report(replace(sure, found=replace(own, error_half_width=widened)))
    chance = NormalDist().cdf(1.959964 / 1.2 / 2)
    assert said.numbers["chance"] == pytest.approx(chance, rel=1e-5)
    assert (said.badge.verdict, said.numbers["harmful"]) == ("likely", False)


def test_what_joints_cannot_do_raises_a_warning_with_its_numbers(sure):
    """One point is refused, a joint stops in three, one turn is left, and a correction jumps."""
    own = sure.found
    held, turned, q = np.zeros_like(own.at_limit), np.zeros_like(own.rotation_error), own.q.copy()
    held[5:8, 4], turned[9, 1], q[8:, 3] = True, 2e-3, own.q[8:, 3] + 0.1
    refused = (*own.refusals[:3], Refusal("reach", excess=0.02), *own.refusals[4:])
    own = replace(own, at_limit=held, rotation_error=turned, q=q, refusals=refused)
    said = report(replace(sure, found=own))
    off, moved = (
        np.linalg.norm(own.error_before, axis=1),
        np.degrees(np.abs(np.diff(q - own.programmed_q, axis=0)).max()),
    )
    text = check(said, ["worst"])
    for warning in (
        "1 of 12 points are not corrected.",
        "Points near a singular pose whose orientation is not fully corrected: 1, by at most 2.000 mrad.",
        "Points where joint_5 stops at its limit: 3.",
        f"The correction of joint_4 jumps by {moved:.2f} deg after line 9.",
    ):
        assert warning in said.claims
    assert f"| 5 | 4 | {1e3 * off[3]:.3f} |" in text
    free = replace(sure, aim=Aim("position"), found=replace(own, at_limit=0 * held > 1))
    assert correction_numbers(free).turns_mrad == pytest.approx(2.0)


def path(layer):
    """Points of a line that is cut into pieces [m]."""
    at, to = (np.array(layer[key][0]).reshape(-1, 3) / 1e4 for key in ("at", "to"))
    return np.vstack([at, to[-1:]])
