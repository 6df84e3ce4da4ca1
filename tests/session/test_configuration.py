"""Configurations from TOML and back, and what is said about wrong ones."""

import re
import string
import tomllib
from datetime import date

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.disk.text import toml_text
from labcdp.core.errors import ConfigurationError
from labcdp.core.spectra import SpectralTable
from labcdp.session import PlanConfiguration, Session, SessionConfiguration

from .conftest import BENCH

GUESS = """
[guess]
quantum_efficiency = 0.4
k_dn_per_e = 1.0
f_number = 2.6
transmittance = 0.9
pixel_pitch_m = 3.45e-6
dark_dn = 16
"""


def test_written_and_read_again_is_the_same():
    configuration = SessionConfiguration.from_toml(BENCH + GUESS, "bench.toml")
    assert SessionConfiguration.from_toml(configuration.to_toml(), "again") == configuration
    assert (configuration.operator, configuration.camera.pixel_pitch_m) == ("A. Müller", 3.45e-6)
    assert (configuration.meter.calibration_date, configuration.guess.dark_dn) == (date(2025, 3, 31), 16)
    assert configuration.contrasts[0].epsilon == 0.5
    assert configuration.plan == PlanConfiguration(exposures_s=(0.005, 0.02))


EXPOSURES = "exposures_s = [0.005, 0.02]"
PITCH = "pixel_pitch_m = 3.45e-6\n"
METER = 'model = "LS-110"\n'
CERTIFICATE = METER + (
    'certificate = {number = "1", laboratory = "PTB", date = 2026-03-31, due_date = 2027-04-01, '
    "expanded_uncertainty_rel = 0.01}\n"
)

WRONG = [
    # (what to replace, by what, what the message names after "bench.toml: ")
    (EXPOSURES, "exposures_s = [0.005, -0.01]", "plan.exposures_s[1] is -0.01 s"),
    (EXPOSURES, "exposures_s = [0.1, 0.1005]", "plan.exposures_s has 0.1 s and 0.1005 s, which a camera may round to"),
    (EXPOSURES, EXPOSURES + "\n'a b' = 1", 'plan."a b" is not a known key'),
    (PITCH, PITCH + "saturation_dn = 40\nblack_level = 64\n", "camera.saturation_dn is 40 DN, camera.black_level 64"),
    (METER, METER + 'entry = "csv"\n', "meter lacks file"),
    (METER, METER + 'entry = "by hand"\nrepeatability_rel = 0.01\n', "meter lacks scale_half_width_rel, digits"),
    (METER, CERTIFICATE.replace("2027", "2025"), "meter.certificate has due_date 2025-04-01"),
    (METER, CERTIFICATE.replace("2026", "2024"), "meter has calibration_date 2025-03-31, later than its certificate"),
    (
        METER,
        CERTIFICATE.replace("2027-04-01", '2027-04-01, serial = "8"'),
        "meter has the certificate of another meter: the certificate 1 is of the meter LS-110 8, not of LS-110",
    ),
    (
        METER,
        CERTIFICATE.replace("0.01", "0.01, range_cd_m2 = [9, 1]"),
        "meter.certificate has range_cd_m2 in the wrong",
    ),
    ("roi = [2, 3, 4, 5]", "", "target.patch[0] (upper left) has neither roi nor corners"),
    ('name = "upper right"', 'name = "upper left"', "target.patch has the name 'upper left' 2 times"),
    ('dark = "upper right"', 'dark = "upper left"', "contrast[0] has 'upper left' as bright and as dark"),
    ("[plan]", GUESS.replace("k_dn_per_e = 1.0", "k_dn_per_e = -1.0") + "[plan]", "guess.k_dn_per_e is -1.0 DN/e⁻"),
]


@pytest.mark.parametrize(("old", "new", "message"), WRONG, ids=[row[2] for row in WRONG])
def test_a_wrong_configuration_is_refused_in_one_line(old, new, message):
    with pytest.raises(ConfigurationError, match=rf"^bench\.toml: {re.escape(message)}.*: \w+.*$"):
        SessionConfiguration.from_toml(BENCH.replace(old, new, 1), "bench.toml")


def test_all_missing_keys_are_named_at_once():
    text = BENCH.replace(METER, "").replace(PITCH, "").replace(", f_number = 2.6", "")
    with pytest.raises(ConfigurationError) as caught:
        SessionConfiguration.from_toml(text, "bench.toml")
    first, others = str(caught.value).split("; also missing: ")
    assert re.fullmatch(r"bench\.toml: camera\.pixel_pitch_m is missing: give .+", first)
    assert others == "lens.f_number, meter.model"


SCALARS = (
    st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False)
    | st.text(st.characters(codec="utf-8"))
    | st.dates()
)
KEYS = st.text(string.ascii_letters + string.digits + "_-", min_size=1, max_size=5)
TABLES = st.recursive(
    st.dictionaries(KEYS, SCALARS | st.lists(SCALARS, max_size=3), max_size=4),
    lambda tables: st.dictionaries(KEYS, SCALARS | tables | st.lists(tables, min_size=1, max_size=3), max_size=4),
    max_leaves=5,
)


@given(TABLES)
def test_toml_text_is_read_back_by_the_standard_library(document):
    assert tomllib.loads(toml_text(document)) == document


def test_spectra_that_a_configuration_names_become_part_of_it_and_of_the_session(tmp_path):
    (tmp_path / "rgb.csv").write_text("wavelength_nm,R,G,B\n380,0,0,0\n500,0.1,1,0.5\n600,1,0.2,0\n780,0,0,0\n")
    (tmp_path / "lamp.csv").write_text("wavelength_nm,lamp\n380,0\n560,1\n780,0\n")
    text = BENCH.replace("[camera]\n", '[camera]\nspectral_sensitivity = "rgb.csv"\n')
    (tmp_path / "bench.toml").write_text(text.replace('"LED-B4"', '"LED-B4", spectrum_file = "lamp.csv"'))
    configuration = SessionConfiguration.load(tmp_path / "bench.toml")
    green = configuration.camera.spectral_sensitivity.spectra["G"]
    assert green == SpectralTable((380, 500, 600, 780), (0, 1, 0.2, 0))
    assert configuration.source.light == SpectralTable((380, 560, 780), (0, 1, 0))
    Session.create(tmp_path / "session", configuration).close()
    (tmp_path / "rgb.csv").unlink()
    assert Session.open(tmp_path / "session").configuration == configuration
