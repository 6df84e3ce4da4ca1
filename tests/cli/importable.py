"""Pictures, readings and a plan from which `labcdp import` makes a session: a simulation in plain NumPy."""

import numpy as np
import tifffile

LUMINANCES_CD_M2 = {"P01": 5.0, "P02": 20.0, "P03": 80.0, "P04": 160.0}
_RESPONSIVITY, _K_DN_PER_E, _READ_NOISE_E, _BLACK_DN = 400.0, 0.4, 5.0, 64.0
_PLAN = """name = "t"
operator = "a"
notes = ""
[camera]
pixel_pitch_m = 3.45e-6
[lens]
model = "x"
serial = "1"
focal_length_m = 6e-3
f_number = 2.6
vignetting_rel = 0
[meter]
model = "another"
entry = "csv"
file = "readings.csv"
serial = "7"
scale_half_width_rel = 0.02
repeatability_rel = 0.002
digits = 1
[source]
spectrum = "D65"
[plan]
gain_db = 0.0
pixel_format = "Mono12"
frames_per_exposure = 3
dark_frames_per_exposure = 2
readings_per_patch = 2
[target]
name = "t"
"""


def frame(rng, exposure_s, light):
    """DN of four patches side by side."""
    dn_per_s = np.repeat([*LUMINANCES_CD_M2.values()], 50) * _RESPONSIVITY * light
    electrons = rng.poisson(np.broadcast_to(dn_per_s * exposure_s / _K_DN_PER_E, (120, 200)))
    read = rng.normal(0, _READ_NOISE_E, (120, 200))
    return np.clip(np.rint((electrons + read) * _K_DN_PER_E + _BLACK_DN), 0, 4095).astype(np.uint16)


def write_importable(folder, seed=5):
    """Write the files, and return the arguments of labcdp import without the session's folder."""
    rng, exposures = np.random.default_rng(seed), []
    for ms in (2, 8, 30):
        for kind, count in (("light", 3), ("dark", 2)):
            (folder / kind).mkdir(parents=True, exist_ok=True)
            for n in range(count):
                name = f"{kind}/{kind[0]}_{ms}ms_{n}.tif"
                tifffile.imwrite(folder / name, frame(rng, ms / 1000, kind == "light"))
                exposures.append(f"--exposure={name}={ms}ms")
    patches = [
        f'[[target.patch]]\nname = "{name}"\nroi = [{at * 50 + 5}, 10, 40, 100]\n'
        for at, name in enumerate(LUMINANCES_CD_M2)
    ]
    (folder / "plan.toml").write_text(_PLAN + "".join(patches))
    rows = [f"{name},{value + step:.1f}" for name, value in LUMINANCES_CD_M2.items() for step in (0.0, 0.1)]
    (folder / "readings.csv").write_text("patch,luminance_cd_m2\n" + "\n".join(rows) + "\n")
    return ["--light", "light", "--dark", "dark", "--readings", "readings.csv", *exposures]
