"""Pictures of targets with known corners, from anywhere, with blur, noise and uneven light."""

import numpy as np

SHAPE = (300, 400)


def seen_from(rng, rows, columns, side_px, *, turn_deg=0.0, perspective=0.0, shape=SHAPE, shift=(0.0, 0.0)):
    """Homography from target coordinates, in which a square has the side 1, to pixels."""
    height, width = shape
    turn = np.radians(turn_deg)
    c, s = side_px * np.cos(turn), side_px * np.sin(turn)
    tilt = np.eye(3)
    tilt[2, :2] = perspective * rng.uniform(0.5, 1, 2) * rng.choice([-1, 1], 2) / max(rows, columns)
    middle = np.eye(3)
    middle[:2, 2] = -columns / 2, -rows / 2
    place = np.array([[c, -s, width / 2 + shift[0]], [s, c, height / 2 + shift[1]], [0, 0, 1]])
    return place @ tilt @ middle


def on_target(matrix, x, y):
    inverse = np.linalg.inv(matrix)
    u, v, w = (inverse[i, 0] * x + inverse[i, 1] * y + inverse[i, 2] for i in range(3))
    return u / w, v / w


def picture(matrix, value_at, rng, *, shape=SHAPE, blur_px=0.8, noise=1.0, uneven=0.0, finer=3):
    """Render value_at(u, v), averaged over each pixel."""
    import cv2

    height, width = shape
    y, x = (np.mgrid[: height * finer, : width * finer] + 0.5) / finer
    values = value_at(*on_target(matrix, x, y)).reshape(height, finer, width, finer).mean(axis=(1, 3))
    light = 1 - uneven * (np.linspace(0, 0.6, width) + np.linspace(0, 0.4, height)[:, None])
    return cv2.GaussianBlur(values * light, (0, 0), blur_px) + rng.normal(0, noise, shape)


def board(rows, columns, around=120.0, light=200.0, dark=50.0):
    def value_at(u, v):
        inside = (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
        # The upper left square is light.
        squares = np.where((np.floor(u) + np.floor(v)) % 2 == 0, light, dark)
        return np.where(inside, squares, around)

    return value_at


def steps(levels, around, gap=0.25):
    """Patches of the side 1 at distances of 1 + gap."""
    levels = np.asarray(levels, dtype=float)
    pitch = 1 + gap

    def value_at(u, v):
        row, column = np.floor(v / pitch).astype(int), np.floor(u / pitch).astype(int)
        inside = (row >= 0) & (row < levels.shape[0]) & (column >= 0) & (column < levels.shape[1])
        inside &= (u - column * pitch < 1) & (v - row * pitch < 1)
        patches = levels[np.clip(row, 0, levels.shape[0] - 1), np.clip(column, 0, levels.shape[1] - 1)]
        return np.where(inside, patches, around)

    return value_at
