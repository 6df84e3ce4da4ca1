from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.calibration.emva import INDEX_NAME, load_index, parse_index
from labcdp.core.errors import InputError

HEAD = "v 3.1\nn 12 64 48\n"
GOOD = HEAD + "b 1e6 100\ni a.png\ni b.png\nb 2e6 200\ni c.png\ni d.png\nd 1e6\ni e.png\ni f.png\n"
PATH = Path("set") / INDEX_NAME


@pytest.mark.parametrize("name", ["images/A.PNG", r"C:\data\images\a.png"])
def test_an_image_elsewhere_or_in_other_letters_is_reported(tmp_path, name):
    (tmp_path / INDEX_NAME).write_text(GOOD.replace("a.png", name))
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "a.png").touch()
    told = r"6 of 6 images are missing, .*: a file of that name is in .*pictures, correct the paths of the index"
    with pytest.raises(InputError, match=told):
        load_index(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("b 1e6 100", "x 1e6 100", r"line 3: 'x 1e6 100' begins with none of the letters v, n, b, d, i and #"),
        ("b 1e6 100", "b 1e6", r"line 3: b is followed by '1e6': give exposure in ns and photons"),
        ("b 1e6 100", "b -1 100", r"line 3: the exposure is -1 ns: give a time from 0 ns to a day"),
        ("n 12 64 48\n", "", r"there is no line n: give bits, width and height"),
        ("i b.png\n", "", r"line 3: there are 1 images: give at least 2, the noise comes from their difference"),
        ("d 1e6\n", "b 3e6 300\n", r"there are no dark images, no line begins with d: record them"),
        ("b 2e6 200", "b 1e6 100", r"line 6: the same exposure as in line 3: keep one of the two"),
        ("v 3.1", "i early.png", r"line 1: an image comes before the first line b or d"),
    ],
)
def test_mistakes_are_reported_with_file_and_line(old, new, message):
    assert old in GOOD
    with pytest.raises(InputError, match=rf"EMVA1288_Data\.txt.*{message}") as caught:
        parse_index(GOOD.replace(old, new, 1), PATH)
    assert "\n" not in str(caught.value)


def test_a_folder_without_index_and_a_file_that_is_not_a_text(tmp_path):
    with pytest.raises(InputError, match=rf"has no {INDEX_NAME}: give the index of a data set"):
        load_index(tmp_path)
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(InputError, match=r"picture\.png is not UTF-8 text \(byte 0\)"):
        load_index(tmp_path / "picture.png")
    with pytest.raises(InputError, match=r"nothing\.txt cannot be read \(No such file"):
        load_index(tmp_path / "nothing.txt")


blocks = st.tuples(st.floats(1, 1e12), st.floats(0, 1e9), st.integers(2, 4))


@given(st.lists(blocks, min_size=2, max_size=6, unique_by=lambda b: b[0]))
def test_what_is_written_is_read(written):
    lines = [HEAD]
    for number, (exposure_ns, photons, count) in enumerate(written):
        for letter, values in (("b", f"{exposure_ns!r} {photons!r}"), ("d", f"{exposure_ns!r}")):
            lines.append(f"{letter} {values}\n")
            lines += [f"i {letter}{number}_{image}.png\n" for image in range(count)]
    index = parse_index("".join(lines), PATH)
    bright = [(b.exposure_ns, b.photons, len(b.images)) for b in index.blocks if b.kind == "bright"]
    assert bright == written
    assert [b.exposure_ns for b in index.blocks if b.kind == "dark"] == [b[0] for b in written]
    assert (index.release, index.bits, index.width, index.height) == ("3.1", 12, 64, 48)
    first = index.blocks[0]
    assert (first.line, first.image_lines[0], first.images[0]) == (3, 4, Path("set/b0_0.png"))
