"""A RAW-shooting still camera becomes a luminance meter: import, calibration, evaluation; and what goes wrong."""

import hashlib
import json
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from jsonschema import Draft202012Validator

from labcdp.acquire.import_files import import_session
from labcdp.calibration import Setup, patch_luminance
from labcdp.calibration.colour.conversion import colour_patch_luminance
from labcdp.calibration.colour.fit import fit_colour
from labcdp.core.errors import InputError, SessionError
from labcdp.core.frame import CameraIdentity
from labcdp.core.result import info, warning
from labcdp.evaluate.bench.observe import observe_session
from labcdp.evaluate.bench.recorded import lens_of
from labcdp.report.files import schema
from labcdp.session import EventRecord, Session, SessionConfiguration

from .conftest import picture_files


@pytest.fixture
def files(still_camera):
    return picture_files(still_camera.folder)


@pytest.fixture
def configuration(still_camera):
    return SessionConfiguration.load(still_camera.folder / "bench.toml")


@pytest.fixture
def imported(still_camera, configuration, files):
    """Import files, all unless told otherwise, into a session of that name."""

    def run(of=None, to="session", bench=configuration, readings="readings.csv"):
        folder = still_camera.folder
        return import_session(bench, folder / to, files if of is None else of, folder / readings)

    return run


@pytest.fixture
def session(still_camera):
    """Open what was imported."""
    return lambda name="session": Session.open(still_camera.folder / name)


def test_a_still_camera_becomes_a_luminance_meter(still_camera, labcdp, session):
    done = labcdp(*still_camera.arguments(), "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    Draft202012Validator(schema()).validate(result)
    counts = {row["quantity"]: row["value"] for row in result["tables"]["imported"]["rows"]}
    assert (counts["frames"], counts["readings"], result["findings"]) == (12, 39, [])
    session = session()
    session.verify()
    observed = observe_session(session)
    calibration = fit_colour(
        {plane: [o for group in one.patches.values() for o in group] for plane, one in observed.planes.items()},
        {plane: one.darks for plane, one in observed.planes.items()},
        observed.readings,
        Setup(lens_of(session.configuration), session.configuration.source.spectrum, observed.input_sha256),
        sensitivities=session.configuration.camera.spectral_sensitivity.spectra,
        held_out=("magenta", "foliage", "grey"),
    )
    assert calibration.state.camera == CameraIdentity("Acme", "Still 1", "0815")
    truth = still_camera.luminance_cd_m2
    for name in truth:
        seen = colour_patch_luminance(calibration, {p: one.patches[name] for p, one in observed.planes.items()})
        low, high = seen.interval_95_cd_m2
        assert low < truth[name] < high
        assert seen.luminance_cd_m2 == pytest.approx(truth[name], rel=0.01 if name == "grey" else 0.1)
    # Of a colour that was held out, each plane alone knows less.
    magenta = {row.patch: row.residual_rel for row in calibration.held_out}["magenta"]
    for plane in calibration.planes:
        alone = patch_luminance(plane, observed.planes[plane.state.plane].patches["magenta"]).luminance_cd_m2
        assert abs(magenta) < 0.4 * abs(alone / truth["magenta"] - 1)
    luminance = calibration.to_luminance(session.load(session.frames("light")[2]))
    region = next(p.region() for p in session.configuration.target.patches if p.name == "grey")
    pixels = luminance.select(region)
    assert pixels.mean() == pytest.approx(truth["grey"], rel=0.01)
    random_rel = luminance.random_rel[luminance.scaled(region).window(luminance.shape)]
    assert np.std(pixels) / pixels.mean() == pytest.approx(np.sqrt(np.mean(np.square(random_rel))), rel=0.25)


def test_what_is_imported_in_parts_and_again_is_there_once(still_camera, imported, files, session):
    first = imported([f for f in files if f.role == "light"])
    assert (first.frames, first.findings) == (6, (warning("no-dark-pictures"),))
    assert imported().frames == 6
    again = imported()
    assert (again.frames, again.readings, again.known_frames, again.known_readings) == (0, 0, 12, 39)
    session = session()
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


def test_an_import_that_was_interrupted_is_resumed(imported, session, monkeypatch):
    written, calls = Session.add_frames, []

    def fails_after_one_batch(self, frames):
        calls.append(len(frames))
        if len(calls) > 1:
            raise SessionError("disk full")
        return written(self, frames)

    monkeypatch.setattr(Session, "add_frames", fails_after_one_batch)
    with pytest.raises(SessionError, match="disk full"):
        imported()
    monkeypatch.undo()
    done = imported()
    assert (done.known_frames, done.frames, done.readings) == (calls[0], 12 - calls[0], 39)
    session().verify()
    assert len(session().frames()) == 12


def test_what_is_given_twice_counts_once_and_what_is_alone_is_warned_about(imported, files, still_camera):
    copy = still_camera.folder / "copy.dng"
    shutil.copy(files[0].path, copy)
    done = imported([*files, replace(files[0], path=copy)], "copied")
    assert (done.frames, done.findings) == (12, (info("picture-repeated", str(copy), same_as=str(files[0].path)),))
    done = imported([f for f in files if f.path.name != "400_2.dng"], "alone")
    assert done.findings == tuple(warning("one-picture", role=role, exposure_s=0.0025) for role in ("light", "dark"))
    path = still_camera.folder / "readings.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([*lines, lines[1]]), encoding="utf-8")
    done = imported(to="lines")
    assert (done.readings, done.findings) == (39, (warning("lines-repeated", "white", path=str(path), count=1),))


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"serial": "0816"}, r"camera of .*other\.dng is Acme Still 1 \(0816\), that of .* is Acme Still 1 \(0815\)"),
        ({"iso": 400}, r"gain of .*other\.dng is 12\.04 dB, that of .* is 0 dB"),
        ({"white": 16000}, r"saturation of .*other\.dng is 16000 DN"),
        ({"cfa": "BG"}, r"pixel format of .*other\.dng is BayerBG14, that of .* is BayerRG14"),
        ({"black": (900,)}, r"black level of .*other\.dng is 900 DN"),
    ],
)
def test_pictures_that_do_not_belong_together_are_refused(imported, files, still_camera, new_dng, changes, match):
    dn = np.full((56, 24 * 13), 600, dtype=np.uint16)
    options = {"black": (510, 512, 512, 515), "white": 15000, "iso": 100} | changes
    path = new_dng(still_camera.folder / "other.dng", dn, **options)
    with pytest.raises(InputError, match=match):
        imported([*files, replace(files[0], path=path)])
    assert not (still_camera.folder / "session").exists()


@pytest.mark.parametrize(
    ("table", "changes", "match"),
    [
        ("camera", {"serial": "4711"}, r"by a camera with serial '0815', the configuration says '4711': correct"),
        ("lens", {"f_number": 4.0}, r"was taken with f_number 2\.8, the configuration says 4: correct lens\.f_number"),
        ("lens", {"focal_length_m": 0.035}, r"was taken with focal_length_m 0\.05, the configuration says 0\.035"),
        ("target", {"presentation": "one by one"}, r"shows which patch\? .* give --light PATCH=FILE"),
    ],
)
def test_pictures_of_another_bench_are_refused(imported, configuration, table, changes, match):
    changed = getattr(configuration, table).model_copy(update=changes)
    with pytest.raises(InputError, match=match):
        imported(bench=configuration.model_copy(update={table: changed}))


def test_patches_shown_one_by_one_name_their_pictures(imported, configuration, files):
    target = configuration.target.model_copy(update={"presentation": "one by one"})
    one_by_one = configuration.model_copy(update={"target": target})
    with pytest.raises(InputError, match=r"there is no patch 'mauve' for .*: choose from white"):
        imported([replace(files[0], patch="mauve")], bench=one_by_one)
    with pytest.raises(InputError, match=r"is given for patch 'white', but the target's patches are shown together"):
        imported([replace(files[0], patch="white")])
    dark = [f for f in files if f.role == "dark"]
    assert imported([replace(files[0], patch="white"), *dark], bench=one_by_one).frames == 7


def test_readings_of_other_patches_are_refused(imported, still_camera):
    path = still_camera.folder / "readings.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    for changed, match in (
        ([*lines, "mauve;12,5;2026-03-01 12:00"], r"has readings of patch 'mauve', the target has white"),
        ([x for x in lines if not x.startswith("white")], r"has no reading of patch 'white': add one"),
    ):
        path.write_text("\n".join(changed), encoding="utf-8")
        with pytest.raises(InputError, match=match):
            imported()
    assert not (still_camera.folder / "session").exists()


def test_readings_have_the_digits_and_accuracy_of_the_meter_in_any_unit(imported, still_camera, session):
    """LS-110: +-1 digit, with 2 % and 0.2 %; a list in which some number has two decimals was not rounded."""
    luminances = still_camera.luminance_cd_m2
    # Foot-lamberts; and a spreadsheet that drops zeros of 10.00 and 225.0, which makes no reading coarser.
    for name, header, rows in (
        ("fl", "patch;luminance_fL", [f"{name};12,5" for name in luminances]),
        ("dropped", "patch,luminance_cd_m2", [f"{name},{round(value, 2):g}" for name, value in luminances.items()]),
    ):
        (still_camera.folder / f"{name}.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
        imported(to=name, readings=f"{name}.csv")
    reading = session("fl").readings()[0].reading
    assert (reading.unit, reading.luminance_cd_m2) == ("fL", pytest.approx(12.5 * 3.42625910))
    assert (reading.digits_half_width, reading.scale_half_width_rel, reading.repeatability_rel) == (0.1, 0.02, 0.002)
    seen = {record.patch: record.reading for record in session("dropped").readings()}
    digits = [(seen[name].resolution, seen[name].digits_half_width) for name in ("black", "white")]
    assert digits == [(0.01, 0.01), (0.1, 0.1)]


def test_images_of_other_programs_are_imported(still_camera, labcdp, session):
    folder, rng = still_camera.folder, np.random.default_rng(1)
    text = (folder / "bench.toml").read_text(encoding="utf-8")
    (folder / "bench.toml").write_text(text.replace("[plan]\n", '[plan]\npixel_format = "Mono12"\n'), encoding="utf-8")
    for name in ("a", "b", "c", "dark"):
        cv2.imwrite(str(folder / f"{name}.png"), rng.integers(50, 70, (56, 312)).astype(np.uint16))
    arguments = ["import", "bench.toml", "s", "--readings", "readings.csv", "--dark", "dark.png"]
    arguments += ["--light", "[abc].png", "--json"]
    assert "a.png does not state its exposure time: give it with --exposure, in seconds" in labcdp(*arguments).stderr
    done = labcdp(*arguments, "--exposure", "0.01", "--exposure", "c.png=0.02")
    assert done.returncode == 0, done.stderr
    frames = [(r.exposure_s, r.pixel_format, r.camera.model) for r in session("s").frames("light")]
    assert frames == [(exposure_s, "Mono12", "Still 1") for exposure_s in (0.01, 0.01, 0.02)]
