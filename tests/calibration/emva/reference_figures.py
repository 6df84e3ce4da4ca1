"""Figures of the reference implementation, github.com/EMVA1288/emva1288 at 2ed0b40, for the public data sets."""

NAMES = (
    "responsivity", "k_dn_per_e", "quantum_efficiency", "saturation_photons", "full_well_e", "dark_noise_e",
    "sensitivity_threshold_photons", "dynamic_range", "linearity_error_min_rel", "linearity_error_max_rel", "dsnu_e",
    "prnu_rel",
)  # fmt: skip


#: Name of the set, values by `NAMES`, largest relative deviation, and what is found.
SETS = [
    (
        "001_CCD_12Bit",
        (0.1267269, 0.2800626, 0.4524949, 30957, 14007.88, 10.92440, 25.35480, 1220.952, -0.006157976, 0.004804483,
         0.5531880, 0.004327052),
        0.0005,
        ["converter-saturates"],
    ),
    (
        "002_CMOS_08Bit",
        (0.01130041, 0.02055535, 0.5497553, 19384.01, 10656.46, 19.25589, 44.26172, 437.9407, -0.008961779,
         0.008542592, 6.438088, 0.01417983),
        0.0008,
        ["photon-transfer-not-straight", "dark-noise-rounded", "exposures-not-in-ns", "converter-saturates",
         "read-noise-upper-limit"],
    ),
    (
        "003_Simulation_12Bit",
        (0.04929032, 0.09785879, 0.5036882, 81323.3, 40961.58, 30.64733, 62.11973, 1309.138, -0.009656980,
         0.003817411, 21.73921, 0.009668946),
        0.00001,
        ["converter-saturates"],
    ),
]  # fmt: skip
