"""The certificate page: all that identifies a measurement, escaped, on one or two printed pages."""

import re
import shutil
import subprocess
from dataclasses import replace

import pytest

from labcdp.calibration.verify.verify import verify
from labcdp.evaluate.bench.certificate import calibration_certificate, verification_certificate
from labcdp.session import ConditionsConfiguration, MeterCertificate, Session

CHROMIUM = shutil.which("chromium")
CERTIFICATE = {"number": "K <42>", "laboratory": "PTB", "date": "2026-01-31", "expanded_uncertainty_rel": 0.008}


@pytest.fixture(scope="module")
def pages(evaluation, recorded):
    """Certificates of a calibration, and of its verification, with a meter's certificate and some conditions."""
    observed, calibration = evaluation.observed, evaluation.calibration
    meter = observed.configuration.meter.model_copy(
        update={"certificate": MeterCertificate.model_validate(CERTIFICATE), "f1_prime": 0.03}
    )
    conditions = ConditionsConfiguration.model_validate({"camera_distance_m": 0.8, "angle_deg": 0.0})
    configuration = observed.configuration.model_copy(update={"meter": meter, "conditions": conditions})
    observed = replace(observed, configuration=configuration)
    plane = observed.monochrome
    found = verify(
        calibration,
        {"": [o for group in plane.patches.values() for o in group]},
        {"": plane.darks},
        observed.readings,
        observed.meter_scale,
        0.5,
    )
    with Session.open(recorded) as session:
        return (
            calibration_certificate(session, observed, calibration).decode(),
            verification_certificate(session, observed, calibration, found).decode(),
        )


def test_devices_conditions_results_and_traceability(pages, evaluation):
    sha256 = evaluation.observed.input_sha256
    for page in pages:
        assert "Simulated data, not a measurement." in page
        assert sha256 in page
        for words in ("Kowa LM6NCL (12345)", "Certificate K &lt;42&gt; of PTB, 2026-01-31", "k\u00a0=\u00a02", "SIM-1"):
            assert words in page
        assert re.search(r"<dt>Camera distance</dt><dd>0\.8 m</dd>", page)
        assert "<dd>focus, meter distance, measuring field, room</dd>" in page
        assert "0° to the normal" in page
        # One picture, no script, and nothing of a user's text as markup.
        assert page.count("<img") == page.count("data:image/png;base64,") == 1
        assert "<script" not in page
        assert "<em>" not in page


def test_a_verification_states_verdict_and_decision_rule(pages):
    calibration, verification = pages
    assert "Decision rule" not in calibration
    assert "<strong>Conform</strong>" in verification
    assert "Tolerance T\u00a0=\u00a0± 50\u00a0%, as stated." in verification
    assert "One meter cannot say whether camera, lens or meter has changed." in verification
    # Its meter has a certificate, that of the calibration had none.
    assert "and the scales of both meters" in verification


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_it_prints_on_one_or_two_pages_of_a4(pages, tmp_path):
    for number, page in enumerate(pages):
        html, pdf = tmp_path / f"{number}.html", tmp_path / f"{number}.pdf"
        html.write_text(page, encoding="utf-8")
        subprocess.run(
            [
                *(CHROMIUM, "--headless", "--no-sandbox", "--disable-background-networking"),
                *(f"--user-data-dir={tmp_path / 'profile'}", f"--print-to-pdf={pdf}", html.as_uri()),
            ],
            check=True,
            capture_output=True,
            timeout=120,
        )
        content = pdf.read_bytes()
        assert len(re.findall(rb"/Type\s*/Page\b", content)) in (1, 2)
        # 210 x 297 mm in points.
        width, height = (float(v) for v in re.search(rb"/MediaBox\s*\[0 0 ([\d.]+) ([\d.]+)\]", content).groups())
        assert (width, height) == (pytest.approx(595.3, abs=1), pytest.approx(841.9, abs=1))
