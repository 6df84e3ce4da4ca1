"""The command spectra: f1' and mismatch factors of a camera."""

import json

import pytest

from labcdp.photometry import spectral_weights

NM, _, V = spectral_weights("E")


@pytest.fixture
def sensitivity(tmp_path):
    rows = [f"{nm:g},{v:.9g}" for nm, v in zip(NM, V, strict=True)]
    (tmp_path / "v.csv").write_text("\n".join(["wavelength_nm,V", *rows]), encoding="utf-8")
    return "v.csv"


def test_v_lambda_needs_no_correction(labcdp, sensitivity):
    done = labcdp("spectra", "--sensitivity", sensitivity, "--json")
    result = json.loads(done.stdout)
    assert result["f1_prime"] < 1e-8
    assert set(result["mismatch_factors"]) >= {"A", "D65", "LED-B1", "LED-B4", "FL11"}
    assert all(abs(factor - 1) < 1e-8 for factor in result["mismatch_factors"].values())


def test_a_camera_with_filters_gets_weights(labcdp, tmp_path):
    rows = [
        f"{nm:g},{v * (nm > 560):.9g},{v * (nm <= 560):.9g},{float(nm < 480):g}" for nm, v in zip(NM, V, strict=True)
    ]
    (tmp_path / "rgb.csv").write_text("\n".join(["wavelength_nm,R,G,B", *rows]), encoding="utf-8")
    result = json.loads(labcdp("spectra", "--sensitivity", "rgb.csv", "--source", "LED-B4", "--json").stdout)
    assert result["f1_prime"] < 1e-6
    assert result["weights"] == pytest.approx({"R": 1, "G": 1, "B": 0}, abs=1e-6)
    assert result["f1_prime_of_planes"]["B"] > 1
    text = labcdp("spectra", "--sensitivity", "rgb.csv")
    assert "f1' = 0.00%" in text.stderr
    assert "LED-B4" in text.stdout


def test_a_measured_light_can_be_given(labcdp, tmp_path, sensitivity):
    rows = [f"{nm:g},1" for nm in NM]
    (tmp_path / "lamp.csv").write_text("\n".join(["wavelength_nm,power", *rows]), encoding="utf-8")
    done = labcdp("spectra", "--sensitivity", sensitivity, "--source", "lamp.csv", "--json")
    assert json.loads(done.stdout)["source"] == "lamp.csv"


def test_without_a_camera_the_lights_are_listed(labcdp):
    assert "LED-RGB1" in labcdp("spectra").stderr
    assert {"A", "D65"} <= set(json.loads(labcdp("spectra", "--json").stdout)["sources"])


def test_mistakes_are_one_line(fails, sensitivity):
    assert "none.csv cannot be read" in fails("spectra", "--sensitivity", "none.csv")
    line = fails("spectra", "--sensitivity", sensitivity, "--source", "candle")
    assert line.startswith("labcdp: --source: spectrum is 'candle', which is not known")
    assert line.endswith(", or a CSV file")
