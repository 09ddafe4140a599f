"""Flags of studies that are wrong: one line, exit code 2, and nothing is left."""

import pytest
from run_here import ROOT, app_of_study, here, is_refused

LINK = str(ROOT / "models" / "single_link")
WRONG = [
    ("absolute_calibration", "--arm rust", "got 'rust'"),
    ("absolute_calibration", "--arm ur10 --arm ur10", "each once, got"),
    ("compensation", "--arm ur10", "expected kr500_l480"),
    ("gravity_calibration", "--nonsense", "No such option: --nonsense"),
    ("gravity_calibration", "--true-arm steel", "--true-arm"),
    ("gravity_calibration", "--payload-kg nan", "payload"),
    ("gravity_calibration", "--sigma-um 0", "sigma"),
    (
        "gravity_calibration",
        "--arm no/arm",
        "no/arm: expected the folder of an arm, with rigid.xml and elastic.toml",
    ),
    ("identifiability", "--campaigns 0", "--campaigns"),
    ("identifiability", f"--arm {LINK}", "expected an arm of at least 4 links"),
    ("loaded_stiffness", "--max-load-n nan", "--max-load-n"),
    ("loaded_stiffness", "--arm arm_6r --max-load-n 90000", "too soft for its load"),
    ("model_error", "--scale -1", "scale"),
    ("model_error", "--sigma-um 0", "sigma-um"),
    ("model_error", "--arm x", "folder"),
    ("model_error", "--arms tubes", "--arms: expected some of stiffer_3, "),
    ("model_error", "--only rust", "no disturbance 'rust'; disturbances are own weight"),
    ("noise_sensitivity", "--sigma-um -1", "--sigma-um: expected different values of 0 to 10000, got -1"),
    ("noise_sensitivity", "--sigma-um 5 --sigma-um 5", "--sigma-um"),
    ("noise_sensitivity", "--sigma-um 0", "--sigma-um: expected at least one level above 0"),
    ("pose_selection", "--seeds 0", "seeds"),
    ("pose_selection", "--workers 0", "workers"),
    ("pose_selection", "--arm nowhere", "expected the folder of an arm"),
    ("regimes", "--truth joints --truth rust", "--truth: expected some of tubes, off_10"),
    ("single_link", "--seeds 0", "--seeds: expected at least 1, got '0'"),
    ("single_link", "--seeds two", "--seeds: expected an integer, got 'two'"),
    ("single_link", "--loads both", "--loads"),
    ("six_dof_arm", "--per pose", "--per"),
    ("six_dof_arm", f"--arm {LINK}", "no model 'MLS56' of single_link, 0 joints; models are"),
    ("solver_comparison", "--m 7", "--m"),
    ("solver_comparison", "--generations 0", "--generations"),
    ("solver_comparison", "--model MGCO99", "no model 'MGCO99'; models are"),
    ("solver_comparison", "--model MLS56", "expected one that GCO identifies"),
    ("which_model", "--arm x", "folder"),
    ("which_model", "--poses 9", "poses"),
]


@pytest.mark.study
@pytest.mark.parametrize(("study", "flags", "said"), WRONG)
def test_wrong_flags_are_one_line_and_leave_nothing(study, flags, said, tmp_path):
    is_refused(here(app_of_study(study), "--out", tmp_path / "out", "--quick", *flags.split()), said)
    assert not [*tmp_path.iterdir()]
