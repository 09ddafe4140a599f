"""What the hostile tests share: a warm process, and a folder with sound inputs to spoil."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import fuzz
import pytest
from attack import Attack, warm


@pytest.fixture(scope="session")
def attack() -> Iterator[Attack]:
    """Runs a command line in a folder: attack(folder, "check", "arm").refused("rigid.xml")."""
    with warm() as run:
        yield run


@pytest.fixture(scope="session")
def stock(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fuzz.make_stock(tmp_path_factory.mktemp("stock") / "lab").folder


@pytest.fixture
def lab(stock: Path, tmp_path: Path) -> Path:
    """A folder with arm/, data.csv, poses.csv, tasks.csv, map.toml, frame.toml and robot.urdf, all sound."""
    return Path(shutil.copytree(stock, tmp_path / "lab"))
