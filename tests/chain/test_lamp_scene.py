"""A pulsed lamp as a scene: the light of a frame, its CDP over the phase, and maps of its flicker."""

import numpy as np
import pytest

import labcdp
from labcdp.chain import LampScene, PulsedLamp
from labcdp.core.errors import InputError

LAMP = {"type": "lamp", "width": 48, "height": 36, "luminance_cd_m2": 200.0, "background_cd_m2": 50.0, "side_px": 20,
        "frequency_hz": 90, "duty": 0.2, "off_level": 0.02}  # fmt: skip
DOCUMENT = {
    "name": "lamp",
    "spectrum": "monochromatic 555 nm",
    "scene": LAMP,
    "optics": {"f_number": 2.0, "transmittance": 0.9},
    "exposure": {"exposure_s": 0.004},
    "sensor": {"pixel_pitch_m": 3.45e-6, "quantum_efficiency": 0.5, "full_well_e": 200_000, "k_dn_per_e": 0.02,
               "read_noise_e": 5.0, "dark_current_e_s": 5.0, "bits": 12, "black_level_dn": 16},
}  # fmt: skip


@pytest.fixture(scope="module")
def chain():
    return labcdp.Chain.from_document(DOCUMENT, "lamp")


def test_frames_have_the_light_of_the_exposure(chain):
    lamp = PulsedLamp(90, 0.2, 0.02)
    for phase in (0.0, 0.3, 0.9):
        seen = chain.with_(scene__phase=phase).run(1)
        share = lamp.collected(0.004, phase) / 0.004 / lamp.mean_level
        measured = seen["sensor"].luminance_cd_m2[10:26, 16:32].mean()
        # Noise of 256 pixels, below 1 %, and rounding of the dark ones.
        assert measured == pytest.approx(200 * share, rel=0.01, abs=0.3)
        # What is to be seen is the mean over time.
        assert seen["scene"].values.max() == 200


def test_a_phase_at_random_follows_from_the_seed(chain):
    means = [float(chain.run(seed)["sensor"].luminance_cd_m2[10:26, 16:32].mean()) for seed in range(40)]
    assert chain.run(3)["sensor"].values.tolist() == chain.run(3)["sensor"].values.tolist()
    predicted = PulsedLamp(90, 0.2, 0.02).flicker(0.004)
    assert 200 * predicted.minimum / predicted.mean - 1 < min(means)
    assert max(means) < 200 * predicted.maximum / predicted.mean * 1.02
    # Mean of 40 phases, of a standard deviation of about the mean.
    assert np.mean(means) == pytest.approx(200, abs=3.5 * np.std(means) / np.sqrt(40))


def test_cdp_over_the_phase_is_the_same_simulated_and_predicted(chain):
    over = {"scene__phase": [0.05, 0.3, 0.8]}
    exact = chain.sweep(exact=True, contrast=3.0, **over)["cdp"].values
    simulated = chain.sweep(contrast=3.0, **over)
    # Of 400 pixels of the lamp against 1328 around it.
    assert np.abs(simulated["cdp"].values - exact).max() < 4 * simulated["standard_error"].values.max() + 0.01
    # Of a phase at random, the mean over all: contrasts pass the ends of the interval within 1e-3 of a period.
    phases = ((np.arange(2000) + 0.5) / 2000).tolist()
    for contrast in (1.0, 3.0):
        mean = chain.sweep(exact=True, contrast=contrast, scene__phase=phases)["cdp"].values.mean()
        random = float(chain.sweep(exact=True, contrast=contrast, scene__duty=[0.2])["cdp"][0])
        assert random == pytest.approx(mean, abs=1e-3)


def test_maps_of_flicker_are_those_of_the_closed_form(chain):
    over = {"exposure__exposure_s": [0.001, 0.004, 1 / 90], "scene__duty": [0.1, 0.5]}
    swept = chain.flicker(**over)
    assert swept["mmp"].dims == ("exposure.exposure_s", "scene.duty")
    for exposure_s in over["exposure__exposure_s"]:
        for duty in over["scene__duty"]:
            cell = swept.sel({"exposure.exposure_s": exposure_s, "scene.duty": duty})
            noise = float(cell["noise_rel"])
            expected = PulsedLamp(90, duty, 0.02).flicker(exposure_s, noise_rel=noise)
            for name in ("fmi", "mmp", "fdi"):
                assert float(cell[name]) == pytest.approx(getattr(expected, name), abs=1e-12)
            # Photons of 400 pixels at the mean light: electrons by the DN of the steady lamp.
            steady = chain.with_(exposure__exposure_s=exposure_s, scene__duty=1.0).run(0)["sensor"].values[8:28, 14:34]
            electrons = (steady.mean() - 16) / 0.02
            assert noise == pytest.approx(np.sqrt(electrons + 25) / electrons / 20, rel=0.2)
    rolling = chain.flicker(row_time_s=2e-4)
    rows = PulsedLamp(90, 0.2, 0.02).flicker(0.004, n_rows=20, row_time_s=2e-4)
    assert float(rolling["fmi"]) == pytest.approx(rows.fmi)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scene__side_px": 40}, "side_px is 40, but the scene is 48 x 36 pixels: give a smaller lamp"),
        ({"scene__duty": 0.0}, "duty"),
        ({"scene__phase": True}, "phase is True"),
    ],
)
def test_what_cannot_be_is_refused(chain, change, message):
    with pytest.raises(InputError, match=message):
        chain.with_(**change)


def test_a_flicker_of_what_is_no_lamp_is_refused(chain):
    with pytest.raises(InputError, match="the scene has no pulsed lamp"):
        labcdp.Chain.load("manta-g505").flicker()
    several = labcdp.Chain.from_document(
        DOCUMENT | {"exposure": {"exposure_s": [0.004, 0.001]}, "hdr": {"method": "linear"}}, "lamp"
    )
    with pytest.raises(InputError, match="a rolling shutter of several captures cannot be predicted"):
        several.flicker(row_time_s=1e-5)
    assert isinstance(chain.scene, LampScene)
