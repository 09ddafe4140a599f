"""How tests are marked, ordered and run; what they share is in shared.py."""

import gc
from pathlib import Path

import pytest

LOOKS = {"blank_panes", "open_page"}  #: Fixtures that draw recordings and pages.
ATTACKS = {"hostile", "property"} | {
    f"test_{name}.py" for name in "fuzz model_folder trial_engine trial_store two_writers".split()
}
"""Folders and files of tests that attack: by inputs, kills, races, full disks."""
ROOT = Path(__file__).resolve().parents[1]
STUDIES = {file.stem for file in (ROOT / "scenarios").glob("*.py")}
"""Each has a file of tests, which run it and then look at it."""
LONGEST = (
    "test_fuzz test_own_estimator_studies test_pictures test_wheel test_gravity_calibration test_which_model "
    "test_bench test_model_error test_identifiability_study test_real_ur10 test_regimes "
    "test_compensation test_pose_selection test_noise_sensitivity test_trial_engine test_any_files "
    "test_doubts test_samples test_absolute_faults test_distances test_proposed_maps "
    "test_calibrate_command test_new test_campaign_reports test_identify_command test_prior "
    "test_compensate_command test_plan_command test_intervals"
).split()
"""Files that take longest begin first: one that begins last keeps one worker busy while the other waits."""

pytest.register_assert_rewrite("page_checks", "reports", "run_here")


def pytest_configure(config: pytest.Config) -> None:
    """Load what tests share where they run: the process that hands them out to others takes seconds less."""
    if getattr(config.option, "dist", "no") == "no":
        config.pluginmanager.import_plugin("shared")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Do not even import what `make test` leaves to `make attack` and `make studies`: that takes seconds."""
    name, asked = collection_path.name, config.option.markexpr
    later = ("not attack" in asked and name in ATTACKS) or ("not study" in asked and is_of_study(name))
    return True if later else None


def is_of_study(name: str) -> bool:
    """Whether a file of tests runs a study."""
    return name.removesuffix(".py").removeprefix("test_").removesuffix("_study") in STUDIES


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what `make studies`, `make look` and `make attack` run; `make test` runs all others."""
    begins = {f"{name}.py": k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: begins.get(item.path.name, len(begins)))
    for item in items:
        if is_of_study(item.path.name):
            item.add_marker("study")
        elif LOOKS & set(getattr(item, "fixturenames", ())):
            item.add_marker("look")
        elif ATTACKS & set(item.path.parts):
            item.add_marker("attack")


def pytest_collection_finish() -> None:
    """Seek no garbage among what was imported and collected: that takes a tenth of all tests."""
    gc.freeze()


def pytest_sessionfinish() -> None:
    """Nor among what is left when a worker ends, as commands do."""
    gc.freeze()
