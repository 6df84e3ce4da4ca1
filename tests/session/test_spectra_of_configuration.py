"""Spectra that a configuration names become part of it, so that a session needs no other file."""

import pytest

from labcdp.core.errors import ConfigurationError
from labcdp.core.spectra import SpectralTable
from labcdp.session import Session, SessionConfiguration

RGB = "wavelength_nm,R,G,B\n380,0,0,0\n500,0.1,1,0.5\n600,1,0.2,0\n780,0,0,0\n"
LAMP = "wavelength_nm,lamp\n380,0\n560,1\n780,0\n"


@pytest.fixture
def folder(tmp_path, bench):
    (tmp_path / "rgb.csv").write_text(RGB, encoding="utf-8")
    (tmp_path / "lamp.csv").write_text(LAMP, encoding="utf-8")
    text = bench.replace("[camera]\n", '[camera]\nspectral_sensitivity = "rgb.csv"\n')
    text = text.replace("[source]\n", '[source]\nspectrum_file = "lamp.csv"\n')
    (tmp_path / "bench.toml").write_text(text, encoding="utf-8")
    return tmp_path


def test_files_are_sought_next_to_the_configuration(folder, monkeypatch):
    monkeypatch.chdir("/")
    configuration = SessionConfiguration.load(folder / "bench.toml")
    sensitivity = configuration.camera.spectral_sensitivity
    assert (sensitivity.file, len(sensitivity.sha256)) == ("rgb.csv", 64)
    assert sensitivity.spectra["G"] == SpectralTable((380, 500, 600, 780), (0, 1, 0.2, 0))
    assert configuration.source.light == SpectralTable((380, 560, 780), (0, 1, 0))


def test_a_session_keeps_the_spectra_without_their_files(folder):
    configuration = SessionConfiguration.load(folder / "bench.toml")
    Session.create(folder / "session", configuration).close()
    (folder / "rgb.csv").unlink()
    (folder / "lamp.csv").unlink()
    assert Session.open(folder / "session").configuration == configuration


def test_a_missing_file_is_named_with_its_key(folder):
    (folder / "rgb.csv").unlink()
    match = r"bench\.toml: camera\.spectral_sensitivity: .*rgb\.csv cannot be read \(No such file or directory\)"
    with pytest.raises(ConfigurationError, match=match):
        SessionConfiguration.load(folder / "bench.toml")
