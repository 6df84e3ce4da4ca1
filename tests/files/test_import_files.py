"""A RAW-shooting still camera becomes a luminance meter: import, calibration, evaluation; and what goes wrong."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import replace
from math import sqrt

import cv2
import numpy as np
import pytest
from jsonschema import Draft202012Validator

from labcdp.acquire.imports.check import ImportFile
from labcdp.acquire.imports.files import import_session
from labcdp.calibration import Setup, patch_luminance
from labcdp.calibration.colour.conversion import colour_patch_luminance
from labcdp.calibration.colour.fit import fit_colour
from labcdp.core.errors import InputError, SessionError
from labcdp.core.finding import info, warning
from labcdp.core.frame import CameraIdentity
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.recorded import lens_of
from labcdp.report.envelope import schema
from labcdp.session import EventRecord, Session, SessionConfiguration


@pytest.fixture
def files(still_camera):
    return [
        ImportFile(path, role) for role in ("light", "dark") for path in sorted((still_camera.folder / role).iterdir())
    ]


@pytest.fixture
def configuration(still_camera):
    return SessionConfiguration.load(still_camera.folder / "bench.toml")


@pytest.fixture
def imported(still_camera, configuration, files):
    def run(to="session", of=None, **changes):
        wanted = changes.get("configuration", configuration)
        readings = changes.get("readings", still_camera.folder / "readings.csv")
        return import_session(wanted, still_camera.folder / to, files if of is None else of, readings)

    return run


def test_a_still_camera_becomes_a_luminance_meter(still_camera, labcdp):
    done = labcdp(*still_camera.arguments(), "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    Draft202012Validator(schema()).validate(result)
    counts = {row["quantity"]: row["value"] for row in result["tables"]["imported"]["rows"]}
    assert (counts["frames"], counts["readings"], result["findings"]) == (12, 39, [])
    session = Session.open(still_camera.folder / "session")
    session.verify()
    observed = observe_session(session)
    sensitivity = session.configuration.camera.spectral_sensitivity
    assert sensitivity is not None
    held_out = ("magenta", "foliage", "grey")
    calibration = fit_colour(
        {plane: [o for group in one.patches.values() for o in group] for plane, one in observed.planes.items()},
        {plane: one.darks for plane, one in observed.planes.items()},
        observed.readings,
        Setup(lens_of(session.configuration), session.configuration.source.spectrum, observed.input_sha256),
        sensitivities=sensitivity.spectra,
        held_out=held_out,
    )
    assert calibration.state.camera == CameraIdentity("Acme", "Still 1", "0815")
    for name, truth in still_camera.luminance_cd_m2.items():
        seen = colour_patch_luminance(calibration, {p: one.patches[name] for p, one in observed.planes.items()})
        low, high = seen.interval_95_cd_m2
        assert low < truth < high
        assert seen.luminance_cd_m2 == pytest.approx(truth, rel=0.01 if name == "grey" else 0.1)
    magenta = {row.patch: row.residual_rel for row in calibration.held_out}["magenta"]
    alone = [
        patch_luminance(plane, observed.planes[plane.state.plane].patches["magenta"]).luminance_cd_m2
        / still_camera.luminance_cd_m2["magenta"]
        - 1
        for plane in calibration.planes
    ]
    assert abs(magenta) < 0.4 * np.abs(alone).min()
    frame = session.load(session.frames("light")[2])
    luminance = calibration.to_luminance(frame)
    region = next(p.region() for p in session.configuration.target.patches if p.name == "grey")
    pixels = luminance.select(region)
    assert pixels.mean() == pytest.approx(still_camera.luminance_cd_m2["grey"], rel=0.01)
    assert np.std(pixels) / pixels.mean() == pytest.approx(
        sqrt(float(np.mean(np.square(luminance.random_rel[luminance.scaled(region).window(luminance.shape)])))),
        rel=0.25,
    )


def test_frames_are_the_pixels_of_the_files(still_camera, imported, dn):
    imported()
    session = Session.open(still_camera.folder / "session")
    frame = session.load(session.frames("light")[0])
    assert (frame.exposure_s, frame.gain_db, frame.colour_filter, frame.saturation_dn) == (1 / 100, 0.0, "RG", 15000)
    assert frame.plane_black_levels_dn == (510, 512, 512, 515)
    assert session.exposures_s == (1 / 400, 1 / 100, 1 / 25)
    events = [one for one in session.records if isinstance(one, EventRecord) and one.kind == "imported"]
    sources = [file for event in events for file in event.content["files"]]
    assert [file["number"] for file in sources] == list(range(1, 13))
    first = (still_camera.folder / "light" / "100_1.dng").read_bytes()
    assert sources[0]["sha256"] == hashlib.sha256(first).hexdigest()
    assert {record.patch for record in session.readings()} == {p.name for p in session.configuration.target.patches}


def test_the_same_import_again_adds_nothing(imported):
    imported()
    again = imported()
    assert (again.frames, again.readings, again.known_frames, again.known_readings) == (0, 0, 12, 39)


def test_an_import_that_was_interrupted_is_resumed(still_camera, imported, files, monkeypatch):
    written = Session.add_frames
    calls = []

    def fails_after_one_batch(self, frames):
        calls.append(len(frames))
        if len(calls) > 1:
            raise SessionError("disk full")
        return written(self, frames)

    monkeypatch.setattr(Session, "add_frames", fails_after_one_batch)
    with pytest.raises(SessionError, match="disk full"):
        imported()
    monkeypatch.setattr(Session, "add_frames", written)
    done = imported()
    assert (done.known_frames, done.frames, done.readings) == (4, 8, 39)
    session = Session.open(still_camera.folder / "session")
    session.verify()
    assert len(session.frames()) == 12


def test_the_same_picture_twice_counts_once(imported, files, still_camera):
    copy = still_camera.folder / "copy.dng"
    shutil.copy(files[0].path, copy)
    done = imported(of=[*files, ImportFile(copy, "light")])
    assert done.frames == 12
    assert done.findings == (info("picture-repeated", str(copy), same_as=str(files[0].path)),)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"serial": "0816"}, r"camera of .*other\.dng is Acme Still 1 \(0816\), that of .* is Acme Still 1 \(0815\)"),
        ({"iso": 400}, r"gain of .*other\.dng is 12\.04 dB, that of .* is 0 dB"),
        ({"white": 16000}, r"saturation of .*other\.dng is 16000 DN"),
        ({"pattern": "BG"}, r"pixel format of .*other\.dng is BayerBG14, that of .* is BayerRG14"),
        ({"black": (900,)}, r"black level of .*other\.dng is 900 DN"),
    ],
)
def test_pictures_that_do_not_belong_together_are_refused(imported, files, still_camera, new_dng, changes, match):
    dn = np.full((56, 24 * 13), 600, dtype=np.uint16)
    options = {"black": (510, 512, 512, 515), "white": 15000, "iso": 100} | changes
    path = new_dng(still_camera.folder / "other.dng", dn, **options)
    with pytest.raises(InputError, match=match):
        imported(of=[*files, ImportFile(path, "light")])
    assert not (still_camera.folder / "session").exists()


@pytest.mark.parametrize(
    ("table", "changes", "match"),
    [
        ("camera", {"serial": "4711"}, r"by a camera with serial '0815', the configuration says '4711': correct"),
        ("lens", {"f_number": 4.0}, r"was taken with f_number 2\.8, the configuration says 4: correct lens\.f_number"),
        ("lens", {"focal_length_m": 0.035}, r"was taken with focal_length_m 0\.05, the configuration says 0\.035"),
    ],
)
def test_pictures_of_another_bench_are_refused(imported, configuration, table, changes, match):
    other = configuration.model_copy(
        update={table: getattr(configuration, table).model_copy(update=changes)},
    )
    with pytest.raises(InputError, match=match):
        imported(configuration=other)


def test_readings_in_foot_lamberts_are_converted(imported, still_camera):
    names = [line.split(";")[0] for line in (still_camera.folder / "readings.csv").read_text().splitlines()[1:14]]
    text = "\n".join(["patch;luminance_fL", *(f"{name};12,5" for name in names)])
    (still_camera.folder / "readings.csv").write_text(text, encoding="utf-8")
    imported()
    reading = Session.open(still_camera.folder / "session").readings()[0].reading
    assert (reading.unit, reading.luminance_cd_m2) == ("fL", pytest.approx(12.5 * 3.42625910))
    # LS-110: +-1 digit from 10 on, with 2 % and 0.2 %.
    assert (reading.digits_half_width, reading.scale_half_width_rel, reading.repeatability_rel) == (0.1, 0.02, 0.002)


@pytest.mark.parametrize(
    ("edit", "match"),
    [
        (lambda lines: [*lines, "mauve;12,5;2026-03-01 12:00"], r"has readings of patch 'mauve', the target has white"),
        (lambda lines: [x for x in lines if not x.startswith("white")], r"has no reading of patch 'white': add one"),
    ],
)
def test_readings_of_other_patches_are_refused(imported, still_camera, edit, match):
    path = still_camera.folder / "readings.csv"
    path.write_text("\n".join(edit(path.read_text(encoding="utf-8").splitlines())), encoding="utf-8")
    with pytest.raises(InputError, match=match):
        imported()
    assert not (still_camera.folder / "session").exists()


def test_patches_shown_one_by_one_name_their_pictures(imported, configuration, files):
    target = configuration.target.model_copy(update={"presentation": "one by one"})
    one_by_one = configuration.model_copy(update={"target": target})
    with pytest.raises(InputError, match=r"shows which patch\? .* give --light PATCH=FILE"):
        imported(configuration=one_by_one)
    with pytest.raises(InputError, match=r"there is no patch 'mauve' for .*: choose from white"):
        imported(configuration=one_by_one, of=[replace(files[0], patch="mauve")])
    with pytest.raises(InputError, match=r"is given for patch 'white', but the target's patches are shown together"):
        imported(of=[replace(files[0], patch="white")])
    dark = [f for f in files if f.role == "dark"]
    assert imported(configuration=one_by_one, of=[replace(files[0], patch="white"), *dark]).frames == 7


def test_images_of_other_programs_are_imported(still_camera, labcdp):
    folder = still_camera.folder
    text = (folder / "bench.toml").read_text(encoding="utf-8")
    (folder / "bench.toml").write_text(text.replace("[plan]\n", '[plan]\npixel_format = "Mono12"\n'), encoding="utf-8")
    rng = np.random.default_rng(1)
    for name in ("a", "b", "c", "dark"):
        cv2.imwrite(str(folder / f"{name}.png"), rng.integers(50, 70, (56, 312)).astype(np.uint16))
    arguments = ["import", "bench.toml", "s", "--readings", "readings.csv", "--dark", "dark.png"]
    arguments += ["--light", "[abc].png", "--json"]
    failed = labcdp(*arguments)
    assert failed.returncode == 1
    assert (
        failed.stderr.strip() == "labcdp: a.png does not state its exposure time: give it with --exposure, in seconds"
    )
    failed = labcdp(*arguments, "--exposure", "d.png=0.1")
    assert failed.stderr.strip() == (
        "labcdp: --exposure names d.png, which is not among the imported pictures: correct the name"
    )
    done = labcdp(*arguments, "--exposure", "0.01", "--exposure", "c.png=0.02")
    assert done.returncode == 0, done.stderr
    frames = Session.open(folder / "s").frames("light")
    assert [(r.exposure_s, r.pixel_format, r.camera.model) for r in frames] == [
        (0.01, "Mono12", "Still 1"),
        (0.01, "Mono12", "Still 1"),
        (0.02, "Mono12", "Still 1"),
    ]


def test_zeros_that_a_spreadsheet_drops_make_no_reading_coarser(imported, still_camera):
    """An LS-110 shows 10.00 and 225.0; a list in which some number has two decimals was not rounded."""
    lines = ["patch,luminance_cd_m2"]
    lines += [f"{name},{round(value, 2):g}" for name, value in still_camera.luminance_cd_m2.items()]
    path = still_camera.folder / "dropped.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    imported(readings=path)
    with Session.open(still_camera.folder / "session") as session:
        seen = {record.patch: record.reading for record in session.readings()}
    assert (seen["black"].resolution, seen["black"].digits_half_width) == (0.01, 0.01)
    assert (seen["white"].resolution, seen["white"].digits_half_width) == (0.1, 0.1)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        (["--light", "none.dng"], r"none.dng cannot be read (No such file or directory): give an image file"),
        (["--light", "no/*.NEF"], "--light no/*.NEF matches no file: check folder and pattern"),
        (["--light", "light", "--exposure", "fast"], "--exposure is 'fast': give seconds above 0, or FILE=SECONDS"),
        (["--dark", "dark"], "no picture of the target: give --light with a file, folder or pattern"),
        (["--light", "=a.dng"], "--light is '=a.dng': give FILE, or PATCH=FILE"),
    ],
)
def test_mistakes_are_one_line(labcdp, still_camera, changes, line):
    done = labcdp("import", "bench.toml", "session", "--readings", "readings.csv", *changes)
    assert (done.returncode, done.stderr.strip()) == (1, f"labcdp: {line}")
    assert not (still_camera.folder / "session").exists()


def test_later_pictures_complete_a_session(imported, files):
    first = imported(of=[f for f in files if f.role == "light"])
    assert first.findings == (warning("no-dark-pictures"),)
    assert imported().frames == 6


def test_one_frame_at_an_exposure_is_warned_about(imported, files):
    done = imported(of=[f for f in files if f.path.name != "400_2.dng"])
    assert done.findings == tuple(warning("one-picture", role=role, exposure_s=0.0025) for role in ("light", "dark"))


def test_lines_that_are_there_twice_count_once(imported, still_camera):
    path = still_camera.folder / "readings.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([*lines, lines[1]]), encoding="utf-8")
    done = imported()
    assert done.readings == 39
    assert done.findings == (warning("lines-repeated", "white", path=str(path), count=1),)
