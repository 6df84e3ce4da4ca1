"""The certificate page: all that identifies a measurement, escaped, on one or two printed pages."""

import re
import shutil
import subprocess
from dataclasses import replace

import pytest

from labcdp.calibration.verify.verify import verify
from labcdp.evaluate.bench.certificate import calibration_certificate, verification_certificate
from labcdp.session import ConditionsConfiguration, MeterCertificate

CHROMIUM = shutil.which("chromium")
CERTIFICATE = {"number": "K <42>", "laboratory": "PTB", "date": "2026-01-31", "expanded_uncertainty_rel": 0.008}


@pytest.fixture(scope="module")
def pages(evaluation, recorded):
    """Certificates of a calibration, and of its verification, with a meter's certificate and some conditions."""
    observed, calibration, plane = evaluation.observed, evaluation.calibration, evaluation.observed.monochrome
    certificate = MeterCertificate.model_validate(CERTIFICATE)
    meter = observed.configuration.meter.model_copy(update={"certificate": certificate, "f1_prime": 0.03})
    conditions = ConditionsConfiguration.model_validate({"camera_distance_m": 0.8, "angle_deg": 0.0})
    configuration = observed.configuration.model_copy(update={"meter": meter, "conditions": conditions})
    observed = replace(observed, configuration=configuration)
    seen = {"": [o for group in plane.patches.values() for o in group]}
    found = verify(calibration, seen, {"": plane.darks}, observed.readings, observed.meter_scale, 0.5)
    return (
        calibration_certificate(recorded, observed, calibration).decode(),
        verification_certificate(recorded, observed, calibration, found).decode(),
    )


def test_devices_conditions_results_traceability_and_verdict(pages, evaluation):
    for page in pages:
        for words in (
            *("Simulated data, not a measurement.", evaluation.observed.input_sha256, "Kowa LM6NCL (simulated)"),
            *("Certificate K &lt;42&gt; of PTB, 2026-01-31", "k\u00a0=\u00a02", "SIM-73323007", "0° to the normal"),
            *("<dt>Camera distance</dt><dd>0.8 m</dd>", "<dd>focus, meter distance, measuring field, room</dd>"),
        ):
            assert words in page
        # One picture, no script, and nothing of a user's text as markup.
        assert page.count("<img") == page.count("data:image/png;base64,") == 1
        assert not re.search("<script|<em>", page)
    verification = pages[1]
    for words in (
        *("<strong>Conform</strong>", "Tolerance T\u00a0=\u00a0± 50\u00a0%, as stated."),
        "One meter cannot say whether camera, lens or meter has changed.",
        # Its meter has a certificate, that of the calibration had none.
        "and the scales of both meters",
    ):
        assert words in verification


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_it_prints_on_one_or_two_pages_of_a4(pages, tmp_path):
    for page in pages:
        html, pdf = tmp_path / "a.html", tmp_path / "a.pdf"
        html.write_text(page, encoding="utf-8")
        options = ("--headless", "--no-sandbox", "--disable-background-networking", f"--print-to-pdf={pdf}")
        command = [CHROMIUM, *options, f"--user-data-dir={tmp_path / 'profile'}", html.as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=300)
        content = pdf.read_bytes()
        assert len(re.findall(rb"/Type\s*/Page\b", content)) in (1, 2)
        # 210 x 297 mm in points.
        size = re.search(rb"/MediaBox\s*\[0 0 ([\d.]+) ([\d.]+)\]", content).groups()
        assert [float(side) for side in size] == pytest.approx([595.3, 841.9], abs=1)
