import numpy as np
import pytest

from labcdp.errors import InputError
from labcdp.evaluate.sweep_journal import FILE_NAME, SweepJournal

SWEEP = {"axes": {"a.b": [1, 2, 3]}, "seed": 0}


@pytest.fixture
def recorded(tmp_path):
    journal = SweepJournal.open(tmp_path, SWEEP)
    journal.add(0, np.array([[0.1, np.nan, np.inf]]))
    journal.add(1, np.array([[0.2, 1.0, 2.0], [0.3, 4.0, 5.0]]))
    journal.close()
    return tmp_path


def finished(folder, sweep=SWEEP):
    journal = SweepJournal.open(folder, sweep)
    journal.close()
    return journal.finished


def test_blocks_come_back_with_every_bit(recorded):
    (first, one), (second, two) = finished(recorded)
    assert (first, second) == (0, 1)
    np.testing.assert_array_equal(one, [[0.1, np.nan, np.inf]])
    np.testing.assert_array_equal(two, [[0.2, 1.0, 2.0], [0.3, 4.0, 5.0]])


def test_journal_cut_anywhere_loses_only_the_line_that_was_cut(recorded):
    path = recorded / FILE_NAME
    whole = path.read_bytes()
    ends = [index + 1 for index, byte in enumerate(whole) if byte == ord("\n")]
    for cut in range(len(whole) + 1):
        path.write_bytes(whole[:cut])
        expected = max(0, sum(end <= cut for end in ends) - 1)
        assert len(finished(recorded)) == expected
        # What was cut off is gone, so that the next block begins on a line of its own.
        assert path.read_bytes().endswith(b"\n")


def test_another_sweep_is_refused_and_left_alone(recorded):
    before = (recorded / FILE_NAME).read_bytes()
    with pytest.raises(InputError, match=r"holds another sweep \(another seed\): give another folder, or remove"):
        SweepJournal.open(recorded, SWEEP | {"seed": 1})
    assert (recorded / FILE_NAME).read_bytes() == before


def test_journal_without_a_finished_cell_binds_nobody(tmp_path):
    SweepJournal.open(tmp_path, SWEEP).close()
    other = SWEEP | {"seed": 1}
    journal = SweepJournal.open(tmp_path, other)
    journal.add(0, np.array([[0.5]]))
    journal.close()
    assert len(finished(tmp_path, other)) == 1


def test_damaged_line_is_named(recorded):
    path = recorded / FILE_NAME
    lines = path.read_bytes().split(b"\n")
    lines[1] = b"garbage"
    path.write_bytes(b"\n".join(lines))
    with pytest.raises(InputError, match=r"sweep\.jsonl is damaged \('garbage'\): remove it, and start"):
        SweepJournal.open(recorded, SWEEP)


def test_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(InputError, match=r"sweep\.jsonl cannot be used \(.*\): give a folder you can write to"):
        SweepJournal.open(tmp_path / "taken", SWEEP)
