"""Whatever a dataset holds comes back bit by bit; whatever a file holds, only InputError may escape."""

import tempfile
from dataclasses import fields
from pathlib import Path
from random import Random

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from refused import one_line

from testbench.arm.folder import load_arm
from testbench.data.dataset import Dataset, select, split
from testbench.data.names import LARGEST, LEAST
from testbench.data.read_pairs import read_csv
from testbench.data.scatter import SIGMA_RANGE
from testbench.data.write import write_csv
from testbench.errors import InputError

ARM = load_arm(Path(__file__).parents[2] / "models" / "kr500_l480")
JOINTS = tuple(j.name for j in ARM.joints)
EXAMPLE = Path(__file__).parents[2] / "docs" / "example_dataset.csv"
HEADER = EXAMPLE.read_text(encoding="utf-8").partition("\n")[0]
LOWER, UPPER = ARM.limits
REPEATABLE = settings(deadline=None, derandomize=True, database=None, max_examples=40)
FUZZ = settings(REPEATABLE, max_examples=120)

MOST = min(LARGEST.values())
ANY = st.floats(-MOST, MOST).filter(lambda x: x == 0 or abs(x) >= LEAST)
SIGMA = st.floats(*SIGMA_RANGE)
ID = st.integers(-(2**63), 2**63 - 1)


@st.composite
def datasets(draw: st.DrawFn) -> Dataset:
    """One to four runs of any numbers that are read, extreme ones too; orientations and set-ups or none."""
    runs, m = draw(st.integers(1, 4)), draw(st.integers(1, 3))

    def numbers(*shape: int) -> np.ndarray:
        return draw(arrays(float, shape, elements=ANY))

    def places(*shape: int) -> np.ndarray:
        """Of targets: three equal coordinates are none."""
        found = numbers(*shape, 3)
        equal = (found == found[..., :1]).all(axis=-1)
        found[..., 0] = np.where(equal, found[..., 0] == 0, found[..., 0])
        return found

    turned = draw(st.booleans())
    return Dataset(
        markers=tuple(draw(st.permutations(ARM.markers))[:m]),
        run=np.array(draw(st.lists(ID, min_size=runs, max_size=runs, unique=True))),
        pose=np.array(draw(st.lists(ID, min_size=runs, max_size=runs))),
        q=LOWER + (UPPER - LOWER) * draw(arrays(float, (runs, 6), elements=st.floats(0, 1))),
        wrench=numbers(runs, 6),
        point=numbers(runs, 3),
        before=places(runs, m),
        after=places(runs, m),
        sigma=draw(SIGMA),
        rotation_before=numbers(runs, 3) if turned else None,
        rotation_after=numbers(runs, 3) if turned else None,
        sigma_rotation=draw(SIGMA) if turned else None,
        station=np.array(draw(st.lists(ID, min_size=runs, max_size=runs))) if draw(st.booleans()) else None,
        taken_off=draw(arrays(bool, runs)) if draw(st.booleans()) else None,
    )


def bits(data: Dataset) -> list[object]:
    values = [getattr(data, f.name) for f in fields(Dataset)]
    return [(x.dtype, x.shape, x.tobytes()) if isinstance(x, np.ndarray) else x for x in values]


@REPEATABLE
@given(datasets())
def test_any_dataset_survives_its_file_bit_by_bit(data: Dataset) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "dataset.csv"
        write_csv(data, JOINTS, file)
        assert bits(read_csv(file, ARM)) == bits(data)
        assert len(list(Path(folder).iterdir())) == 1


@REPEATABLE
@given(datasets(), st.randoms(use_true_random=False))
def test_order_of_columns_means_nothing(data: Dataset, random: Random) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "dataset.csv"
        write_csv(data, JOINTS, file)
        rows = [line.split(",") for line in file.read_text().splitlines()]
        order = list(range(len(rows[0])))
        random.shuffle(order)
        file.write_text("\n".join(",".join(row[k] for k in order) for row in rows))
        assert bits(read_csv(file, ARM)) == bits(data)


@REPEATABLE
@given(datasets(), st.data())
def test_split_parts_the_poses_and_keeps_every_run(data: Dataset, choose: st.DataObject) -> None:
    poses = np.unique(data.pose)
    chosen = choose.draw(st.sets(st.sampled_from(poses.tolist()), max_size=len(poses) - 1))
    if not chosen:
        return
    inside, outside = split(data, np.array(sorted(chosen)))
    assert set(inside.pose.tolist()) == chosen
    assert set(outside.pose.tolist()) == set(poses.tolist()) - chosen
    mask = np.isin(data.pose, sorted(chosen))
    assert bits(select(data, mask)) == bits(inside)
    assert bits(select(data, ~mask)) == bits(outside)


def check_reading(content: bytes) -> None:
    """Either a sound dataset or an InputError of one line that names the file."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "dataset.csv"
        file.write_bytes(content)
        try:
            data = read_csv(file, ARM)
        except InputError as err:
            one_line(err, file)
            return
        assert data.runs >= 1
        assert set(data.markers) <= set(ARM.markers)
        assert len(set(data.run.tolist())) == data.runs
        assert (data.q >= LOWER - 1e-6).all()
        assert (data.q <= UPPER + 1e-6).all()
        write_csv(data, JOINTS, file)  # what was read can be written and read again
        assert bits(read_csv(file, ARM)) == bits(data)


@FUZZ
@given(st.one_of(st.binary(max_size=300), st.text(max_size=300).map(lambda s: s.encode("utf-8", "replace"))))
def test_no_bytes_crash_the_reader(content: bytes) -> None:
    check_reading(content)


@FUZZ
@given(st.text(alphabet='0123456789.-e,\n"P', max_size=300))
def test_nothing_below_a_right_header_crashes_the_reader(body: str) -> None:
    check_reading(f"{HEADER}\n{body}".encode())
