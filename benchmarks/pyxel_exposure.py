"""Exposures in Pyxel, one for each line read; `bench_pyxel.py` starts this in an environment that has Pyxel.

The argument is a JSON object with the settings. Each line of input names a variant; the answer is a JSON object with
the seconds of the models alone ("models") and of a whole `pyxel.run_mode` ("run_mode"), and the mean and standard
deviation of the image in DN ("mean_dn", "std_dn").
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import pyxel
from pyxel.detectors import CCD, CCDGeometry, Characteristics, ChargeToVoltSettings, Environment, SensitiveChargeToVolt
from pyxel.exposure import Exposure, Readout
from pyxel.pipelines import DetectionPipeline, ModelFunction, Processor

Settings = dict[str, Any]

# The range of the converter; Pyxel wants volts, labcdp does not.
ADC_RANGE_V = 1.0
ELEMENTARY_CHARGE_NC = 1.602176634e-10
# Pyxel's pattern is q (1 + exp(f q z)), q the quantum efficiency, f its factor and z normal: with q = 1/2 it has the
# mean 1 and the standard deviation f / 4.
PATTERN_QUANTUM_EFFICIENCY = 0.5


def volt_per_dn(settings: Settings) -> float:
    return ADC_RANGE_V / float(2 ** settings["bits"] - 1)


def make_detector(settings: Settings) -> CCD:
    pitch_um = settings["pixel_pitch_m"] * 1e6
    gain_v_per_e = settings["k_dn_per_e"] * volt_per_dn(settings)
    return CCD(
        geometry=CCDGeometry(
            row=settings["height"], col=settings["width"], pixel_vert_size=pitch_um, pixel_horz_size=pitch_um
        ),
        environment=Environment(temperature=settings["reference_temperature_c"] + 273.15),
        characteristics=Characteristics(
            quantum_efficiency=PATTERN_QUANTUM_EFFICIENCY,
            charge_to_volt=SensitiveChargeToVolt(ChargeToVoltSettings(value=gain_v_per_e)),
            full_well_capacity=settings["full_well_e"],
            adc_bit_resolution=settings["bits"],
            adc_voltage_range=(0.0, ADC_RANGE_V),
        ),
    )


def model(name: str, **arguments: Any) -> ModelFunction:
    return ModelFunction(func=f"pyxel.models.{name}", name=name.rpartition(".")[2], arguments=arguments)


def charge_generation(settings: Settings, *, lean: bool) -> list[ModelFunction]:
    rate_e_s = settings["dark_current_e_s"]
    if lean:
        return [
            model("charge_generation.simple_conversion", quantum_efficiency=1.0, binomial_sampling=False),
            model("charge_generation.simple_dark_current", dark_rate=rate_e_s),
        ]
    # Pyxel wants the dark current in nA/cm^2 at 300 K, which is the reference temperature.
    figure_of_merit = rate_e_s * ELEMENTARY_CHARGE_NC / (settings["pixel_pitch_m"] * 100) ** 2
    return [
        model("charge_generation.simple_conversion", quantum_efficiency=settings["quantum_efficiency"]),
        model("charge_generation.dark_current", figure_of_merit=figure_of_merit),
    ]


def make_pipeline(settings: Settings, *, pattern: bool, lean: bool = False) -> DetectionPipeline:
    per_e = 1.0 if lean else 1 / settings["quantum_efficiency"]
    step_v = volt_per_dn(settings)
    fixed_pattern = model(
        "charge_collection.fixed_pattern_noise",
        fixed_pattern_noise_factor=4 * settings["prnu_rel"],
        seed=settings["device_seed"],
    )
    return DetectionPipeline(
        photon_collection=[
            model("photon_collection.illumination", level=settings["electrons_s"] * per_e, option="uniform"),
            model("photon_collection.shot_noise", type="poisson"),
        ],
        charge_generation=charge_generation(settings, lean=lean),
        charge_collection=[
            model("charge_collection.simple_collection"),
            *([fixed_pattern] if pattern else []),
            model("charge_collection.simple_full_well"),
        ],
        charge_measurement=[
            model("charge_measurement.simple_measurement"),
            model(
                "charge_measurement.output_node_noise",
                std_deviation=settings["read_noise_e"] * settings["k_dn_per_e"] * step_v,
            ),
            # Half a DN above the black level, because simple_adc truncates.
            model("charge_measurement.dc_offset", offset=(settings["black_level_dn"] + 0.5) * step_v),
        ],
        readout_electronics=[model("readout_electronics.simple_adc")],
    )


def expose(detector: CCD, pipeline: DetectionPipeline, exposure_s: float) -> dict[str, float]:
    # What pyxel.run_mode does before it runs the models.
    processor = Processor(detector=detector, pipeline=pipeline)
    detector.set_readout(times=[exposure_s], start_time=0.0, non_destructive=False)
    detector.readout_properties.time = exposure_s
    detector.readout_properties.time_step = exposure_s
    detector.empty()
    start = time.perf_counter()
    processor.run_pipeline(debug=False)
    models_s = time.perf_counter() - start
    image = detector.image.array

    mode = Exposure(readout=Readout(times=[exposure_s]))
    start = time.perf_counter()
    pyxel.run_mode(mode=mode, detector=detector, pipeline=pipeline)
    run_mode_s = time.perf_counter() - start
    return {
        "models": models_s,
        "run_mode": run_mode_s,
        "mean_dn": float(image.mean()),
        "std_dn": float(image.std()),
    }


def main() -> None:
    settings = json.loads(sys.argv[1])
    detector = make_detector(settings)
    pipelines = {
        "all models": make_pipeline(settings, pattern=True),
        "no pattern": make_pipeline(settings, pattern=False),
        "leanest": make_pipeline(settings, pattern=False, lean=True),
    }
    for line in sys.stdin:
        print(json.dumps(expose(detector, pipelines[line.strip()], settings["exposure_s"])), flush=True)


if __name__ == "__main__":
    main()
