"""Configurations from TOML and back, and what is said about wrong ones."""

import tomllib
from datetime import date

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.errors import ConfigurationError
from labcdp.roi import Roi
from labcdp.session import GuessConfiguration, PlanConfiguration, SessionConfiguration
from labcdp.toml_text import toml_text

GUESS = """
[guess]
quantum_efficiency = 0.4
k_dn_per_e = 1.0
f_number = 2.6
transmittance = 0.9
pixel_pitch_m = 3.45e-6
dark_dn = 16
"""


def test_values_arrive_with_their_defaults(bench):
    configuration = SessionConfiguration.from_toml(bench + GUESS, "bench.toml")
    assert configuration.operator == "A. Müller"
    assert configuration.camera.pixel_pitch_m == 3.45e-6
    assert configuration.camera.address is None
    assert configuration.meter.calibration_date == date(2025, 3, 31)
    assert [patch.name for patch in configuration.target.patches] == ["upper left", "upper right"]
    assert configuration.contrasts[0].epsilon == 0.5
    assert configuration.plan == PlanConfiguration(
        exposures_s=(0.005, 0.02),
        gain_db=0,
        pixel_format="Mono12",
        frames_per_exposure=2,
        dark_frames_per_exposure=2,
        readings_per_patch=3,
    )
    assert isinstance(configuration.guess, GuessConfiguration)
    assert configuration.guess.dark_dn == 16


def test_a_date_may_stand_in_quotes(bench):
    quoted = SessionConfiguration.from_toml(bench.replace("2025-03-31", '"2025-03-31"'), "bench.toml")
    assert quoted == SessionConfiguration.from_toml(bench, "bench.toml")


def test_written_and_read_again_is_the_same(bench):
    configuration = SessionConfiguration.from_toml(bench + GUESS, "bench.toml")
    assert SessionConfiguration.from_toml(configuration.to_toml(), "again") == configuration


def test_written_text_reads_naturally(configuration):
    text = configuration.to_toml()
    for line in (
        "[camera]",
        "[[target.patch]]",
        "roi = [2.0, 3.0, 4.0, 5.0]",
        "corners = [[10.0, 3.0], [14.0, 3.0], [12.0, 8.5]]",
        "[[contrast]]",
        "exposures_s = [0.005, 0.02]",
        "calibration_date = 2025-03-31",
        'operator = "A. Müller"',
    ):
        assert line in text.splitlines()


def test_load_reads_a_file(tmp_path, bench, configuration):
    (tmp_path / "bench.toml").write_text(bench, encoding="utf-8")
    assert SessionConfiguration.load(tmp_path / "bench.toml") == configuration


def test_patches_become_regions(configuration):
    rectangle, polygon = (patch.region() for patch in configuration.target.patches)
    assert rectangle == Roi.rectangle("upper left", 2, 3, 4, 5)
    assert polygon == Roi("upper right", ((10, 3), (14, 3), (12, 8.5)))


def test_a_configuration_cannot_be_changed(configuration):
    with pytest.raises(ValueError, match="frozen"):
        configuration.name = "other"


PATCH = '[[target.patch]]\nname = "{}"\nroi = [0, 0, 1, 1]\n'
EXPOSURES = "exposures_s = [0.005, 0.02]"

METER = 'model = "LS-110"'

WRONG = [
    # (what to replace, by what, the message after "bench.toml: ")
    (EXPOSURES, "exposures_s = [0.005, -0.01]", "plan.exposures_s[1] is -0.01 s: give exposures above 0 s"),
    (EXPOSURES, "exposures_s = [0]", "plan.exposures_s[0] is 0 s: give exposures above 0 s"),
    (EXPOSURES, "exposures_s = [nan]", "plan.exposures_s[0] is nan s: give exposures above 0 s"),
    (EXPOSURES, "exposures_s = [inf]", "plan.exposures_s[0] is inf s: give exposures above 0 s"),
    (EXPOSURES, 'exposures_s = ["5 ms"]', "plan.exposures_s[0] is '5 ms': give exposures above 0 s"),
    (EXPOSURES, "exposures_s = [true]", "plan.exposures_s[0] is true: give exposures above 0 s"),
    (EXPOSURES, "exposures_s = []", "plan.exposures_s is a list of 0: give exposures above 0 s"),
    (
        EXPOSURES,
        "exposures_s = 0.005",
        "plan.exposures_s is 0.005 s: give a list in square brackets, exposures above 0 s",
    ),
    (EXPOSURES, "exposures_s = [0.1, 0.2, 0.1]", "plan.exposures_s has 0.1 s 2 times: give each exposure once"),
    (EXPOSURES, "interval_s = -1", "plan.interval_s is -1 s: give a time of at least 0 s"),
    (
        EXPOSURES,
        "drift_check = 1",
        "plan.drift_check is 1: give true to read the first patch also before the frames, or false",
    ),
    (EXPOSURES, "largest_flicker_rel = 0", "plan.largest_flicker_rel is 0: give a fraction above 0, up to 1"),
    (
        'name = "checkerboard"',
        'name = "checkerboard"\npresentation = "all"',
        'target.presentation is \'all\': give "together" for patches in one image, "one by one" for one patch after '
        "another",
    ),
    (EXPOSURES, "exposure_s = [0.1]", "plan.exposure_s is not a known key: did you mean exposures_s?"),
    (
        EXPOSURES,
        EXPOSURES + "\n'a b' = 1",
        'plan."a b" is not a known key: known here are exposures_s, gain_db, pixel_format, frames_per_exposure, '
        "dark_frames_per_exposure, readings_per_patch, interval_s, drift_check, largest_flicker_rel, largest_drift_rel",
    ),
    (
        EXPOSURES,
        EXPOSURES + "\nframes_per_exposure = 0",
        "plan.frames_per_exposure is 0: give a whole number of at least 2",
    ),
    (
        EXPOSURES,
        EXPOSURES + "\nframes_per_exposure = 2.0",
        "plan.frames_per_exposure is 2.0: give a whole number of at least 2",
    ),
    (EXPOSURES, EXPOSURES + "\ngain_db = nan", "plan.gain_db is nan dB: give a finite number of dB"),
    ("format = 1", "format = 2", "format is 2: give 1, the format this labcdp knows, or update labcdp"),
    ('name = "Four patches"', 'name = " "', "name is ' ': give a name as text"),
    ('name = "Four patches"', 'name = "a\\nb"', "name is 'a\\nb': give a name as text"),
    ("3.45e-6", "0", "camera.pixel_pitch_m is 0 m: give a distance of pixel centres above 0 m"),
    ('"503363706"', "503363706", "camera.serial is 503363706: give the serial number as text, in quotes"),
    ("[lens]", "[lense]", "lense is not a known key: did you mean lens?"),
    ("f_number = 2.6", "", "lens.f_number is missing: give an f-number above 0"),
    (
        "f_number = 2.6",
        "f_number = 2.6\ntransmittance = 96",
        "lens.transmittance is 96: give a fraction above 0, up to 1",
    ),
    (
        '"LS-110"',
        '"LS-150"',
        'meter has model \'LS-150\': give "LS-110" or "LS-100", or entry = "by hand" or "csv" for another instrument',
    ),
    (METER, METER + '\nentry = "csv"', 'meter lacks file: give the path of a CSV file with entry = "csv"'),
    (METER, METER + '\nentry = "by hand"\nfile = "a.csv"', 'meter has file: leave it out with entry = "by hand"'),
    (
        METER,
        METER + '\nentry = "by hand"\nrepeatability_rel = 0.01',
        'meter lacks scale_half_width_rel: with entry = "by hand" give the accuracy of the instrument',
    ),
    (
        METER,
        METER + '\nentry = "by hand"\nport = "x"',
        'meter has port, which belongs to entry = "serial": leave it out',
    ),
    (METER, METER + "\ndigits = 1", 'meter has digits, which belongs to entry = "by hand" or "csv": leave it out'),
    ("2025-03-31", '"31.3.2025"', "meter.calibration_date is '31.3.2025': give an ISO date such as 2025-03-31"),
    ("2025-03-31", "20250331", "meter.calibration_date is 20250331: give an ISO date such as 2025-03-31"),
    ('[source]\nspectrum = "LED-B4"', "", "source is missing: give a [source] table"),
    ("format = 1", 'format = 1\nguess = "none"', "guess is 'none': give a [guess] table"),
    (
        "roi = [2, 3, 4, 5]",
        "roi = [2, 3, 4, 0]",
        "target.patch[0].roi[3] is 0: give [x, y, width, height] in pixels: x and y of at least 0, width and height "
        "above 0",
    ),
    (
        "roi = [2, 3, 4, 5]",
        "roi = [2, 3, 4]",
        "target.patch[0].roi[3] is missing: give [x, y, width, height] in pixels: x and y of at least 0, width and "
        "height above 0",
    ),
    (
        "roi = [2, 3, 4, 5]",
        "",
        "target.patch[0] (upper left) has neither roi nor corners: give one of them",
    ),
    (
        "corners",
        "roi = [1, 1, 1, 1]\ncorners",
        "target.patch[1] (upper right) has both roi and corners: give one of them",
    ),
    (
        "[[10, 3], [14, 3], [12, 8.5]]",
        "[[10, 3], [14, 3]]",
        "target.patch[1].corners is a list of 2: give at least three [x, y] corners in pixels, x and y of at least 0",
    ),
    (
        "nominal_luminance_cd_m2 = 356",
        "nominal_luminance_cd_m2 = -1",
        "target.patch[0].nominal_luminance_cd_m2 is -1 cd/m2: give a luminance above 0 cd/m2",
    ),
    (
        "nominal_luminance_cd_m2",
        "nominal_luminance",
        "target.patch[0].nominal_luminance is not a known key: did you mean nominal_luminance_cd_m2?",
    ),
    (
        'name = "upper right"',
        'name = "upper left"',
        "target.patch has the name 'upper left' 2 times: give each patch its own name",
    ),
    ("[target]", "[target]\npatches = []", "target.patches is not a known key: did you mean patch?"),
    (
        'dark = "upper right"',
        'dark = "lower"',
        "contrast[0].dark is 'lower': give the name of a patch, one of upper left, upper right",
    ),
    (
        'dark = "upper right"',
        'dark = "upper left"',
        "contrast[0] has 'upper left' as bright and as dark: give two patches",
    ),
    (
        "contrast = 3.7",
        "contrast = 0",
        "contrast[0].contrast is 0: give a Weber contrast above 0, as a fraction (1.0 is 100 %)",
    ),
    ("contrast = 3.7", "contrast = 3.7\nepsilon = 1.5", "contrast[0].epsilon is 1.5: give a fraction above 0, up to 1"),
    ("[[contrast]]", "[[contrasts]]", "contrasts is not a known key: did you mean contrast?"),
    ("[plan]", "[guess]\n[plan]", "guess.quantum_efficiency is missing: give a fraction above 0, up to 1"),
    (
        "[plan]",
        GUESS.replace("k_dn_per_e = 1.0", "k_dn_per_e = -1.0") + "[plan]",
        "guess.k_dn_per_e is -1.0 DN/e-: give a system gain above 0 DN/e-",
    ),
    (
        "[plan]",
        GUESS.replace("dark_dn = 16", "dark_dn = -16") + "[plan]",
        "guess.dark_dn is -16 DN: give a dark value of at least 0 DN",
    ),
]


@pytest.mark.parametrize(("old", "new", "message"), WRONG, ids=[row[2][:50] for row in WRONG])
def test_a_wrong_configuration_is_refused_in_one_line(bench, old, new, message):
    assert old in bench
    with pytest.raises(ConfigurationError) as caught:
        SessionConfiguration.from_toml(bench.replace(old, new, 1), "bench.toml")
    assert str(caught.value) == f"bench.toml: {message}"


@pytest.mark.parametrize(
    ("text", "where"),
    [('name = "a"\nplan = 5 ms\n', "line 2, column 10"), ('name = "a"\nplan = [\n', "end of document")],
)
def test_a_syntax_error_says_where(text, where):
    with pytest.raises(ConfigurationError, match=rf"^bench.toml: not valid TOML: .* \(at {where}\): correct it there$"):
        SessionConfiguration.from_toml(text, "bench.toml")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigurationError, match=r"none.toml: cannot be read \(No such file or directory\)"):
        SessionConfiguration.load(tmp_path / "none.toml")


def test_a_file_that_is_not_utf_8_is_named(tmp_path):
    (tmp_path / "bench.toml").write_bytes('name = "Müller"'.encode("latin-1"))
    with pytest.raises(ConfigurationError, match=r"bench.toml: byte 9 is not UTF-8 text: save the file as UTF-8"):
        SessionConfiguration.load(tmp_path / "bench.toml")


SCALARS = (
    st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False)
    | st.text(st.characters(exclude_categories=["Cs"]))
    | st.dates()
)
KEYS = st.from_regex(r"\A[A-Za-z0-9_-]+\Z")
TABLES = st.recursive(
    st.dictionaries(KEYS, SCALARS | st.lists(SCALARS)),
    lambda tables: st.dictionaries(KEYS, SCALARS | tables | st.lists(tables, min_size=1)),
    max_leaves=10,
)


@given(TABLES)
def test_toml_text_is_read_back_by_the_standard_library(document):
    assert tomllib.loads(toml_text(document)) == document


@given(st.data(), TABLES | SCALARS | st.lists(SCALARS))
def test_any_value_anywhere_is_taken_or_refused_in_one_line(data, value):
    document = tomllib.loads(BASE)
    table = document
    while True:
        key = data.draw(st.sampled_from(sorted(table)))
        inner = table[key][0] if isinstance(table[key], list) else table[key]
        if not isinstance(inner, dict) or data.draw(st.booleans()):
            break
        table = inner
    table[key] = value
    try:
        SessionConfiguration.from_toml(toml_text(document), "bench.toml")
    except ConfigurationError as error:
        message = str(error)
    else:
        return
    assert message.startswith("bench.toml: ")
    assert "\n" not in message


BASE = """
name = "n"
operator = "o"
[camera]
pixel_pitch_m = 1e-6
[lens]
model = "m"
serial = "s"
focal_length_m = 0.1
f_number = 2
[meter]
model = "LS-100"
serial = "s"
[source]
spectrum = "D65"
[target]
name = "t"
[[target.patch]]
name = "A"
roi = [0, 0, 1, 1]
[[target.patch]]
name = "B"
corners = [[0, 0], [1, 1], [0, 1]]
[[contrast]]
bright = "A"
dark = "B"
contrast = 1
[plan]
exposures_s = [1]
"""
