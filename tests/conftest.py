"""What several tests share: the arms, built once, and a way to make a broken copy of one."""

import gc
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import IO
from unittest import mock

import numpy as np
import pytest
from chromium import browser, open_page, pytest_pyfunc_call  # noqa: F401
from legible import check_legible
from matplotlib.figure import Figure
from panes import blank_panes, viewer  # noqa: F401
from PIL import Image
from serial_arms import turned_arm
from threadpoolctl import threadpool_limits

from testbench.cli import GARBAGE
from testbench.report import figure as views
from testbench.studies import run
from testbench.workflows.cell import Cell, build_cell

LOOKS = {"blank_panes", "open_page"}  #: Fixtures that draw recordings and pages.
ATTACKS = {"hostile", "property"} | {
    f"test_{name}.py" for name in "fuzz model_folder trial_engine trial_store two_writers".split()
}
"""Folders and files of tests that attack: by inputs, kills, races, full disks."""
ROOT = Path(__file__).resolve().parents[1]
MODELS = ROOT / "models"
STUDIES = {file.stem for file in (ROOT / "scenarios").glob("*.py")}
"""Each has a file of tests, which run it and then look at it."""
SAVE = views.save
LONGEST = (
    "test_fuzz test_own_estimator_studies test_pictures test_wheel test_gravity_calibration test_which_model "
    "test_bench test_model_error test_docs_site test_identifiability_study test_real_ur10 test_regimes "
    "test_compensation test_pose_selection test_noise_sensitivity test_trial_engine test_any_files "
    "test_doubts test_absolute_faults test_plan_command test_proposed_maps test_intervals test_prior"
).split()
"""Files that take longest begin first: one that begins last keeps one worker busy while the other waits."""

pytest.register_assert_rewrite("page_checks", "reports", "run_here")
threadpool_limits(1)  # as every command does: several BLAS threads change result bits
gc.set_threshold(GARBAGE)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what `make studies`, `make look` and `make attack` run; `make test` runs all others."""
    begins = {f"{name}.py": k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: begins.get(item.path.name, len(begins)))
    for item in items:
        if item.path.stem.removeprefix("test_").removesuffix("_study") in STUDIES:
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


@pytest.fixture(scope="session", autouse=True)
def lazy_disk() -> Iterator[None]:
    """Files are not waited for until they are on the disk: a loss of power is none of a test."""
    with mock.patch("os.fsync"):
        yield


@pytest.fixture(scope="session", autouse=True)
def undrawn() -> Iterator[None]:
    """Figures are made, but those of commands are not drawn: that takes a third of a command's time.

    Those of studies are laid out and looked at; `legible` and `pixels` have more drawn.
    """
    with mock.patch.object(views, "save", _blank), mock.patch.object(run, "save", _look_at):
        yield


def _blank(_: Figure, file: Path | IO[bytes]) -> None:
    """Write a picture of any colours in the place of a figure."""
    Image.linear_gradient("L").convert("RGB").point([*range(256), *[0] * 512]).save(file, "PNG")


def _look_at(figure: Figure, file: Path | IO[bytes]) -> None:
    """Lay a figure out and check what a reader must find."""
    figure.draw_without_rendering()
    check_legible(figure)
    _blank(figure, file)


@pytest.fixture(scope="session")
def legible(undrawn: None) -> Callable[[], AbstractContextManager[object]]:
    """A context in which figures of commands are laid out and looked at."""
    return lambda: mock.patch.object(views, "save", _look_at)


@pytest.fixture(scope="session")
def pixels(undrawn: None) -> Callable[[], AbstractContextManager[object]]:
    """A context in which figures of commands are drawn after all."""
    return lambda: mock.patch.object(views, "save", SAVE)


@pytest.fixture(scope="session")
def kr500() -> Cell:
    """The heavy arm."""
    return build_cell(MODELS / "kr500_l480")


@pytest.fixture(scope="session")
def arm_6r() -> Cell:
    """The illustrative arm of section 5.2."""
    return build_cell(MODELS / "arm_6r")


@pytest.fixture(scope="session")
def ur10() -> Cell:
    """A light arm, that of the real readings."""
    return build_cell(MODELS / "ur10")


@pytest.fixture
def rng() -> np.random.Generator:
    """One stream for all tests; what they claim does not depend on it."""
    return np.random.default_rng(2021)


@pytest.fixture(scope="session")
def single_link() -> Cell:
    """The single link of section 5.1."""
    return build_cell(MODELS / "single_link")


@pytest.fixture(params=["kr500", "arm_6r", "slides"])
def cell(request: pytest.FixtureRequest) -> Cell:
    """The heavy arm, the illustrative one, one with slides."""
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def slides(tmp_path_factory: pytest.TempPathFactory) -> Cell:
    """An arm of two slides and three hinges, every body turned at random, on a turned mount."""
    return build_cell(
        turned_arm(tmp_path_factory.mktemp("arm") / "slides", np.random.default_rng(5), "zZyXz")
    )
