"""Pictures of a chart of 6 x 6 patches by a camera with photon noise, in plain NumPy."""

import cv2
import numpy as np

SIDE, LEFT, TOP, BLACK_DN = 70, 50, 40, 64
K_DN_PER_E, READ_E, FULL_E, WHITE_E = 0.25, 3.0, 12_000.0, 20_000.0
CORNERS = [(LEFT, TOP), (LEFT + 6 * SIDE, TOP), (LEFT + 6 * SIDE, TOP + 6 * SIDE), (LEFT, TOP + 6 * SIDE)]


def stated_density(patch):
    return 0.05 + 0.1 * patch


def make_picture(path, glare_e=0.0, seed=3, marks=False, black_e=None):
    """Photons, dark noise, full well and 12 bits of the grid of 6 x 6."""
    rng = np.random.default_rng(seed)
    electrons = np.full((6 * SIDE + 80, 6 * SIDE + 100), 0.3 * WHITE_E if marks else 0.02 * WHITE_E)
    for patch in range(36):
        row, column = divmod(patch, 6)
        y, x = TOP + row * SIDE, LEFT + column * SIDE
        electrons[y : y + SIDE, x : x + SIDE] = WHITE_E * 10 ** -stated_density(patch)
        if black_e is not None and patch == 35:
            electrons[y : y + SIDE, x : x + SIDE] = black_e
    if marks:
        for number, (x, y) in enumerate([(5, 5), (LEFT + 6 * SIDE + 5, 5), (5, TOP + 6 * SIDE - 20)]):
            mark = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), number, 36)
            electrons[y : y + 36, x : x + 36] = np.where(mark > 0, 0.3, 0.01) * WHITE_E
    made = rng.poisson(electrons + glare_e) + rng.normal(0, READ_E, electrons.shape)
    dn = np.clip(np.round(np.minimum(made, FULL_E) * K_DN_PER_E) + BLACK_DN, 0, 4095).astype(np.uint16)
    cv2.imwrite(str(path), dn)
    return dn
