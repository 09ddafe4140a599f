"""What tests share: the arms, built once; figures that are not drawn; a disk that is not waited for."""

import gc
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from functools import cache
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
from testbench.runs import manifest
from testbench.studies import run
from testbench.workflows.cell import Cell, build_cell

MODELS = Path(__file__).resolve().parents[1] / "models"
SAVE = views.save

threadpool_limits(1)  # as every command does: several BLAS threads change result bits
gc.set_threshold(GARBAGE)


@pytest.fixture(scope="session", autouse=True)
def lazy_disk() -> Iterator[None]:
    """Files are not waited for until they are on the disk: a loss of power is none of a test."""
    with mock.patch("os.fsync"):
        yield


@pytest.fixture(scope="session", autouse=True)
def same_commit() -> Iterator[None]:
    """The commit of the checkout is asked for once: git takes most of the time of a small run."""
    with mock.patch.object(manifest, "git_commit", cache(manifest.git_commit)):
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
