"""The inputs of the commands whose numbers are recorded: pictures, a video, regions, a data set, chains, benches."""

import re
from pathlib import Path

import cv2
import numpy as np
import roifile


def make_inputs(folder: Path, data: Path) -> None:
    """Write what the commands work on into a new folder; `data` is the folder of labcdp's own data."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(19)
    for i, exposure in enumerate((1.0, 0.5, 2.0), start=1):
        save(folder / f"night-{i}.png", 8 * exposure * scene(0, rng), np.uint16)
    stripes = 40 + 60.0 * (np.arange(64) % 2) + rng.normal(0, 4, (48, 64))
    save(folder / "stripes.png", stripes, np.uint8)
    rectangles = {"sign": (22, 42, 48, 68), "ground": (22, 82, 48, 108), "sky": (100, 10, 140, 40)}
    roifile.roiwrite(folder / "regions.zip", [rectangle(*item) for item in list(rectangles.items())[:2]])
    patches = {"bright": (70, 30, 110, 70), "dark": (270, 30, 310, 70)}
    roifile.roiwrite(folder / "patches.zip", [rectangle(*item) for item in patches.items()])
    make_video(folder, rng)
    make_emva(folder / "emva", rng)
    chain = (data / "chains" / "manta-g505.toml").read_text()
    bracket = chain.replace("exposure_s = 0.005", "exposure_s = [0.001, 0.004, 0.016]")
    (folder / "bracket.toml").write_text(bracket + '\n[hdr]\nmethod = "normal"\nbits = 20\n')
    bench = re.sub(r"\[\[contrast\]\][^\[]*", "", (data / "example-session" / "session.toml").read_text())
    kept = "P01|P04|P07|P12|upper right|lower right"
    bench = re.sub(rf'\[\[target\.patch\]\]\nname = "(?!{kept})[^[]*\[[^\[]*', "", bench)
    for name, exposures in (("bench", "0.001, 0.008, 0.032"), ("again", "0.002, 0.032")):
        text = re.sub(r"exposures_s = .*", f"exposures_s = [{exposures}]", bench)
        (folder / f"{name}.toml").write_text(text)


def save(path: Path, values: np.ndarray, kind: type) -> None:
    """Write a picture of 12 bits in 16, or of 8."""
    if not cv2.imwrite(str(path), np.clip(np.rint(values), 0, 4095 if kind is np.uint16 else 255).astype(kind)):
        raise OSError(f"{path} cannot be written")


def rectangle(name: str, corners: tuple[int, int, int, int]) -> roifile.ImagejRoi:
    """Return a region from its left, top, right and bottom edges, the latter two exclusive."""
    left, top, right, bottom = corners
    return roifile.ImagejRoi(
        roitype=roifile.ROI_TYPE.RECT, name=name, left=left, top=top, right=right, bottom=bottom, version=227
    )


def scene(shift: int, rng: np.random.Generator) -> np.ndarray:
    """Return a structured ground with a bright and a dark square; the bright one moves. Up to about 230."""
    ground = np.random.default_rng(5).normal(90, 60, (120, 160))
    values = cv2.GaussianBlur(ground, (0, 0), 2) + rng.normal(0, 2, ground.shape)
    values[40:70, 20 + shift : 50 + shift] = 200 + rng.normal(0, 14, (30, 30))
    values[80:110, 20:50] = 60 + rng.normal(0, 10, (30, 30))
    return values


def make_video(folder: Path, rng: np.random.Generator) -> None:
    """Write the same twelve frames as a video and as numbered images."""
    (folder / "drive").mkdir()
    flags = [cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
    video = cv2.VideoWriter(
        str(folder / "drive.avi"), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), 25, (160, 120), flags
    )
    for number in range(12):
        frame = np.clip(np.rint(scene(2 * number, rng)), 0, 255)
        save(folder / "drive" / f"{number:03}.png", frame, np.uint8)
        video.write(frame.astype(np.uint8))
    video.release()


def make_emva(folder: Path, rng: np.random.Generator) -> None:
    """Write an EMVA 1288 data set of 12 bits: quantum efficiency 0.5, 0.25 DN/e-, 8 e- of read noise, 2000 e-/s."""
    shape = (48, 64)
    gain, offset = 1 + 0.01 * rng.standard_normal(shape), 3 * rng.standard_normal(shape)
    exposures_ns, photons = np.linspace(1e6, 20e6, 12), np.linspace(900, 40_000, 12)
    blocks = [(e, p, 2) for e, p in zip(exposures_ns, photons, strict=True)] + [(exposures_ns[4], photons[4], 10)]
    lines = ["v 3.1", f"n 12 {shape[1]} {shape[0]}"]
    folder.mkdir()
    for number, (exposure_ns, light, count) in enumerate(blocks):
        for letter, value in (("b", light), ("d", 0.0)):
            lines.append(f"{letter} {exposure_ns:.6g}" + (f" {value:.10g}" if letter == "b" else ""))
            for index in range(count):
                electrons = rng.poisson(0.5 * value * gain + 2000e-9 * exposure_ns)
                dn = 0.25 * (electrons + offset + 8 * rng.standard_normal(shape)) + 20
                name = f"{letter}_{number:02}_{index:02}.png"
                save(folder / name, dn, np.uint16)
                lines.append(f"i {name}")
    (folder / "EMVA1288_Data.txt").write_text("\n".join(lines) + "\n")
