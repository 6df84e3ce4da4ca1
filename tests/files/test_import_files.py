"""A RAW-shooting still camera becomes a luminance meter: import, calibration, evaluation; and what goes wrong."""

import hashlib
import shutil
from dataclasses import replace
from datetime import datetime

import cv2
import numpy as np
import openpyxl
import pytest

from labcdp.acquire.import_files import import_session
from labcdp.calibration.colour.conversion import colour_patch_luminance
from labcdp.calibration.frames.measure import split
from labcdp.core.errors import InputError
from labcdp.core.frame import CameraIdentity
from labcdp.core.result import info, warning
from labcdp.evaluate.bench.calibrate import calibrate_session
from labcdp.evaluate.bench.observe import observe_session
from labcdp.session import EventRecord, Session, SessionConfiguration

from ..conftest import valid
from .conftest import BLACK_DN, WHITE_LEVEL_DN, picture_files, write_dng


@pytest.fixture
def folder(still_camera):
    return still_camera.folder


@pytest.fixture
def files(folder):
    return picture_files(folder)


@pytest.fixture
def imported(folder, files):
    """Import files, all unless told otherwise, into a session; with other values of tables of the configuration."""

    def run(of=files, to="session", readings="readings.csv", **tables):
        bench = SessionConfiguration.load(folder / "bench.toml")
        changed = {name: getattr(bench, name).model_copy(update=values) for name, values in tables.items()}
        return import_session(bench.model_copy(update=changed), folder / to, of, folder / readings)

    return run


def test_a_still_camera_becomes_a_luminance_meter(still_camera, labcdp):
    # What systems and cameras put there besides.
    for name in ("Thumbs.db", "desktop.ini", "notes.txt", ".DS_Store", "IMG_1.JPG"):
        (still_camera.folder / "light" / name).write_bytes(b"nothing")
    done = labcdp("import", "bench.toml", "session", "--light", "light", "--dark", "dark", "--readings", "readings.csv",
                  "--json")  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "light: 4 files skipped, since their names are not those of pictures: IMG_1.JPG, " in done.stderr
    result = valid(done.stdout)
    counts = {row["quantity"]: row["value"] for row in result["tables"]["imported"]["rows"]}
    assert (counts["frames"], counts["readings"], result["findings"]) == (12, 39, [])
    session = Session.open(still_camera.folder / "session")
    session.verify()
    calibration = calibrate_session(observed := observe_session(session))
    assert calibration.state.camera == CameraIdentity("Acme", "Still 1", "0815")
    for name, truth in still_camera.luminance_cd_m2.items():
        seen = colour_patch_luminance(
            calibration, {p: patches[name] for p, patches in observed.patches_by_plane.items()}
        )
        low, high = seen.interval_95_cd_m2
        assert low < truth < high
        assert seen.luminance_cd_m2 == pytest.approx(truth, rel=0.01 if name == "grey" else 0.1)
    # A pixel's random uncertainty is what pixels of one patch differ by: 256 pixels, 25 % are 5 sigma.
    luminance = calibration.to_luminance(session.load(session.frames("light")[2]))
    region = next(p.region() for p in session.configuration.target.patches if p.name == "grey")
    pixels, window = luminance.select(region), luminance.scaled(region).window(luminance.shape)
    random_rel = np.sqrt(np.mean(np.square(luminance.random_rel[window])))
    assert np.std(pixels) / pixels.mean() == pytest.approx(random_rel, rel=0.25)


def test_what_is_imported_in_parts_and_again_is_there_once(folder, imported, files):
    first = imported([f for f in files if f.role == "light"])
    assert (first.frames, first.findings) == (6, (warning("no-dark-pictures"),))
    assert imported().frames == 6
    again = imported()
    assert (again.frames, again.readings, again.known_frames, again.known_readings) == (0, 0, 12, 39)
    session = Session.open(folder / "session")
    frame = session.load(session.frames("light")[0])
    assert (frame.exposure_s, frame.gain_db, frame.colour_filter, frame.saturation_dn) == (1 / 100, 0.0, "RG", 15000)
    assert tuple(one.black_level_dn for one in split(frame).values()) == (510, 512, 512, 515)
    assert session.exposures_s == (1 / 400, 1 / 100, 1 / 25)
    events = [one for one in session.records if isinstance(one, EventRecord) and one.kind == "imported"]
    sources = [file for event in events for file in event.content["files"]]
    assert [file["number"] for file in sources] == list(range(1, 13))
    assert sources[0]["sha256"] == hashlib.sha256((folder / "light" / "100_1.dng").read_bytes()).hexdigest()


def test_what_is_given_twice_counts_once_and_what_is_alone_is_warned_about(imported, files, folder):
    copy, path = folder / "copy.dng", folder / "readings.csv"
    shutil.copy(files[0].path, copy)
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([*lines, lines[1]]), encoding="utf-8")
    done = imported([*(f for f in files if f.path.name != "400_2.dng"), replace(files[0], path=copy)])
    assert (done.frames, done.readings) == (10, 39)
    assert set(done.findings) == {
        info("picture-repeated", str(copy), same_as=str(files[0].path)),
        warning("lines-repeated", path=str(path), count=1, patches=["white"]),
        *(warning("one-picture", role=role, exposure_s=0.0025) for role in ("light", "dark")),
    }


@pytest.mark.parametrize(
    ("other", "tables", "match"),
    [
        ({"serial": "0816"}, {}, "camera of"),
        ({"cfa": "BG"}, {}, "pixel format of"),
        ({}, {"camera": {"serial": "4711"}}, r"serial '0815', the configuration says '4711'"),
        ({}, {"lens": {"f_number": 4.0}}, r"was taken with f_number 2\.8, the configuration says 4"),
        ({}, {"target": {"presentation": "one by one"}}, r"shows which patch\?"),
        ({"patch": "white"}, {}, r"is given for patch 'white', but the target's patches are shown together"),
    ],
)
def test_what_does_not_belong_together_is_refused_and_nothing_is_written(folder, imported, files, other, tables, match):
    options = {"black": tuple(BLACK_DN.values()), "white": WHITE_LEVEL_DN, "iso": 100} | other
    patch = options.pop("patch", None)
    path = write_dng(folder / "other.dng", np.full((56, 24 * 13), 600, dtype=np.uint16), **options)
    with pytest.raises(InputError, match=match):
        imported([*files, replace(files[0], path=path, patch=patch)], **tables)
    assert not (folder / "session").exists()


def test_equal_readings_without_a_time_are_readings_of_their_own(folder, imported, files):
    path = folder / "readings.csv"
    lines = [line.rpartition(";")[0] for line in path.read_text(encoding="utf-8").splitlines()]
    path.write_text("\n".join([*lines, lines[1]]), encoding="utf-8")
    done, again = imported(files[:1]), imported(files[:1])
    assert (done.readings, again.readings, again.known_readings) == (40, 0, 40)
    assert not {one.code for one in done.findings} & {"lines-repeated"}


def test_the_same_readings_in_another_table_are_not_new(folder, imported, files):
    first = imported(files[:1])
    _, *rows = (line.split(";") for line in (folder / "readings.csv").read_text(encoding="utf-8").splitlines())
    table = ["time\tpatch\tluminance_cd_m2", *("\t".join((time, patch, value)) for patch, value, time in rows)]
    (folder / "again.csv").write_text("\n".join(table), encoding="utf-16")
    again = imported(files[:1], readings="again.csv")
    assert (first.readings, again.readings, again.known_readings) == (39, 0, 39)
    # Cells have no time zone: dates and times are local.
    book = openpyxl.Workbook()
    book.active.append(["time", "patch", "Luminance (cd/m²)"])
    for patch, value, time in rows:
        local = datetime.fromisoformat(time).astimezone().replace(tzinfo=None)
        book.active.append([local, patch, float(value.replace(",", "."))])
    book.save(folder / "again.xlsx")
    again = imported(files[:1], readings="again.xlsx")
    assert (again.readings, again.known_readings) == (0, 39)


def test_readings_have_the_digits_and_accuracy_of_the_meter_in_any_unit(imported, still_camera, folder, files):
    """LS-110: +-1 digit, with 2 % and 0.2 %; a list in which some number has two decimals was not rounded."""
    luminances = still_camera.luminance_cd_m2
    # Foot-lamberts; and a spreadsheet that drops zeros of 10.00 and 225.0, which makes no reading coarser.
    for name, header, rows in (
        ("fl", "patch;luminance_fL", [f"{name};12,5" for name in luminances]),
        ("dropped", "patch,luminance_cd_m2", [f"{name},{round(value, 2):g}" for name, value in luminances.items()]),
    ):
        (folder / f"{name}.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
        imported(files[:1], to=name, readings=f"{name}.csv")
    reading = Session.open(folder / "fl").readings()[0].reading
    assert (reading.unit, reading.luminance_cd_m2) == ("fL", pytest.approx(12.5 * 3.42625910))
    assert (reading.digits_half_width, reading.scale_half_width_rel, reading.repeatability_rel) == (0.1, 0.02, 0.002)
    seen = {record.patch: record.reading for record in Session.open(folder / "dropped").readings()}
    digits = [(seen[name].resolution, seen[name].digits_half_width) for name in ("black", "white")]
    assert digits == [(0.01, 0.01), (0.1, 0.1)]


def test_images_of_other_programs_are_imported(folder, labcdp):
    rng = np.random.default_rng(1)
    text = (folder / "bench.toml").read_text(encoding="utf-8")
    (folder / "bench.toml").write_text(text.replace("[plan]\n", '[plan]\npixel_format = "Mono12"\n'), encoding="utf-8")
    for name in ("a", "b", "c", "dark"):
        cv2.imwrite(str(folder / f"{name}.png"), rng.integers(50, 70, (56, 312)).astype(np.uint16))
    arguments = ["import", "bench.toml", "s", "--readings", "readings.csv", "--dark", "dark.png", "--light", "?.png"]
    assert "a.png does not state its exposure time: give it with --exposure" in labcdp(*arguments).stderr
    done = labcdp(*arguments, "--exposure", "10ms", "--exposure", "c.png=20ms")
    assert done.returncode == 0, done.stderr
    frames = Session.open(folder / "s").frames("light")
    found = [(r.exposure_s, r.pixel_format, r.camera.model) for r in frames]
    assert found == [(exposure_s, "Mono12", "Still 1") for exposure_s in (0.01, 0.01, 0.02)]


def test_raw_dumps_and_arrays_are_imported_as_the_same_frames(folder, labcdp):
    """Mono12Packed, two pixels in three bytes, equals the array of its values."""
    rng, shape = np.random.default_rng(1), (56, 312)
    text = (folder / "bench.toml").read_text(encoding="utf-8")
    plan = '[plan]\npixel_format = "Mono12Packed"\n'
    (folder / "bench.toml").write_text(text.replace("[plan]\n", plan), encoding="utf-8")
    for name in ("a", "dark"):
        dn = rng.integers(50, 4000 if name == "a" else 60, shape).astype(np.uint16)
        np.save(folder / f"{name}.npy", dn)
        first, second = dn.ravel()[::2], dn.ravel()[1::2]
        # GigE Vision 2.0, figure 26-9: high bits of both pixels, the low ones of both between them.
        packed = np.stack([first >> 4, (second & 15) << 4 | first & 15, second >> 4], axis=1).astype(np.uint8)
        packed.tofile(folder / f"{name}.raw")
    found = []
    for kind, more in (("raw", ("--size", "312x56")), ("npy", ())):
        done = labcdp(
            "import", "bench.toml", kind, "--readings", "readings.csv", "--light", f"a.{kind}", "--dark",
            f"dark.{kind}", "--exposure", "10ms", *more,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        session = Session.open(folder / kind)
        found.append([session.load(record).dn for record in session.frames()])
    np.testing.assert_array_equal(*found)
    np.testing.assert_array_equal(found[0][0], np.load(folder / "a.npy"))
    done = labcdp("import", "bench.toml", "x", "--readings", "readings.csv", "--light", "a.raw", "--size", "300x56")
    assert "a.raw has 26208 bytes, 300 x 56 pixels of Mono12Packed take 25200" in done.stderr


def test_temperatures_are_stated_for_all_for_a_kind_or_for_one_picture(folder, labcdp, imported, files):
    arguments = ["import", "bench.toml", "s", "--light", "light", "--dark", "dark", "--readings", "readings.csv"]
    for wrong, message in (
        (["hot"], "--temperature is 'hot': give degrees Celsius from -100 to 200"),
        (["300"], "--temperature is '300': give degrees Celsius from -100 to 200"),
        (["none.dng=3"], "--temperature names none.dng"),
        (["30", "31"], "--temperature without a file is given twice"),
    ):
        refused = labcdp(*arguments, *(word for text in wrong for word in ("--temperature", text)))
        assert refused.returncode != 0
        assert message in refused.stderr
    given = ["--temperature", "31.5", "--temperature", "dark=-3", "--temperature", "light/100_1.dng=29"]
    done = labcdp(*arguments, *given)
    assert done.returncode == 0, done.stderr
    session = Session.open(folder / "s")
    assert sorted(r.metadata["temperature_c"] for r in session.frames("light")) == [29.0, *[31.5] * 5]
    assert [session.load(r).temperature_c for r in session.frames("dark")] == [-3.0] * 6
    # Repeated without temperatures it adds nothing; other ones are no others of the same frames.
    assert labcdp(*arguments).returncode == 0
    with pytest.raises(InputError, match=r"is in .* with 29 °C, and given with 30 °C"):
        imported([replace(f, temperature_c=30.0) for f in files], to="s")
