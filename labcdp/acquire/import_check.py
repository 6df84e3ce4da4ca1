"""Pictures to import: read, and checked against each other and against the configuration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..core.clock import exposure_text
from ..core.dn import pixel_format
from ..core.errors import InputError
from ..core.frame import CameraIdentity, Frame, pixels_sha256
from ..core.result import Finding, info, warning
from ..files import DUMP_SUFFIXES, IMAGE_SUFFIXES, FileFrame, PictureOptions, read_image, read_raw
from ..session import Role, SessionConfiguration

#: Relative difference of f-numbers and focal lengths explained by rounding; third stops differ by 12 %.
_LENS_TOLERANCE_REL = 0.05


#: Largest difference of black levels as a share of saturation: many cameras measure it for each picture.
_BLACK_TOLERANCE = 0.01


@dataclass(frozen=True)
class ImportFile:
    """One picture to import.

    Parameters
    ----------
    path : Path
        The file.
    role : {'light', 'dark'}
        Whether it shows the target or was taken with the lens covered.
    patch : str or None
        The patch it shows, where patches were shown one by one.
    exposure_s : float or None
        Exposure time, if not in the file.
    temperature_c : float or None
        Temperature of the camera, which no file states that labcdp reads; None if it is not known.
    size : (int, int) or None
        Width and height of a raw dump in pixels, whose format is ``plan.pixel_format``.
    """

    path: Path
    role: Role
    patch: str | None = None
    exposure_s: float | None = None
    temperature_c: float | None = None
    size: tuple[int, int] | None = None


def check_files(
    configuration: SessionConfiguration,
    files: Sequence[ImportFile],
    report: Callable[[str, int, int], None],
) -> tuple[dict[str, ImportFile], Frame, list[Finding]]:
    """Read all files once; returns them by key, the first frame, which represents all settings, and findings.

    The pixels are read again for writing, to limit memory.
    """
    _require_presentation(configuration, files)
    first: FileFrame | None = None
    seen: dict[str, ImportFile] = {}
    findings: list[Finding] = []
    counts: dict[tuple[Role, str | None, float], int] = {}
    levels: dict[float, dict[Role, list[float]]] = {}
    for done, file in enumerate(files, start=1):
        read = read_import_file(file, configuration)
        if first is None:
            first = read
            _require_bench(configuration, first)
        _require_alike(first, read)
        key = pixels_sha256(read.frame)
        if key in seen:
            same = seen[key]
            if (same.role, same.patch) != (file.role, file.patch):
                raise InputError(
                    f"{file.path} is the same picture as {same.path}, which is given as {_as_what(same)}: check which "
                    "one is wrong"
                )
            findings.append(info("picture-repeated", str(file.path), same_as=str(same.path)))
            continue
        seen[key] = file
        setting = (file.role, file.patch, read.frame.exposure_s)
        counts[setting] = counts.get(setting, 0) + 1
        levels.setdefault(read.frame.exposure_s, {}).setdefault(file.role, []).append(float(read.frame.dn.mean()))
        report("checking", done, len(files))
    if first is None:
        raise InputError("there is no picture to import: give pictures of light and dark frames")
    _require_light_brighter(levels)
    return seen, first.frame, [*first.findings, *findings, *_too_few(counts)]


def _require_light_brighter(levels: Mapping[float, Mapping[Role, Sequence[float]]]) -> None:
    """Refuse light and dark pictures that were confused."""
    both = {t: of for t, of in levels.items() if len(of) > 1}
    if both and all(max(of["light"]) < min(of["dark"]) for of in both.values()):
        exposure_s, of = max(both.items())
        raise InputError(
            f"the light pictures are darker than the dark ones (mean {max(of['light']):.4g} against "
            f"{min(of['dark']):.4g} DN at {exposure_text(exposure_s)}): swap --light and --dark"
        )


def _as_what(file: ImportFile) -> str:
    return file.role if file.patch is None else f"{file.role} of patch {file.patch!r}"


def _too_few(counts: Mapping[tuple[Role, str | None, float], int]) -> list[Finding]:
    findings = [
        warning("one-picture", "" if patch is None else f"patch {patch}", role=role, exposure_s=exposure_s)
        for (role, patch, exposure_s), n in counts.items()
        if n == 1
    ]
    if not any(role == "dark" for role, _, _ in counts):
        findings.append(warning("no-dark-pictures"))
    return findings


def _require_presentation(configuration: SessionConfiguration, files: Sequence[ImportFile]) -> None:
    one_by_one = configuration.target.presentation == "one by one"
    names = [patch.name for patch in configuration.target.patches]
    for file in files:
        if file.role != "light":
            continue
        if one_by_one and file.patch is None:
            raise InputError(
                f"{file.path} shows which patch? The target's patches are shown one by one: give PATCH=FILE"
            )
        if not one_by_one and file.patch is not None:
            raise InputError(
                f"{file.path} is given for patch {file.patch!r}, but the target's patches are shown together: give "
                'the file alone, or set target.presentation = "one by one"'
            )
        if file.patch is not None and file.patch not in names:
            raise InputError(f"there is no patch {file.patch!r} for {file.path}: choose from {', '.join(names)}")


def read_import_file(file: ImportFile, configuration: SessionConfiguration) -> FileFrame:
    """Read a picture, with missing settings from the configuration; raises InputError as `labcdp.files`."""
    camera = configuration.camera
    defaults = PictureOptions(
        exposure_s=file.exposure_s,
        gain_db=configuration.plan.gain_db,
        camera=CameraIdentity(camera.vendor or "unknown", camera.model or "unknown", camera.serial or "unknown"),
        encoding=camera.curve,
        size=file.size,
    )
    suffix = file.path.suffix.lower()
    if suffix in IMAGE_SUFFIXES or (file.size is not None and suffix in DUMP_SUFFIXES):
        read = read_image(file.path, pixel_format(configuration.plan.pixel_format), defaults)
    elif camera.curve is not None:
        raise InputError(f"{file.path} is a camera RAW, which states its curve itself: leave the encoding out")
    else:
        read = read_raw(file.path, defaults)
    return replace(read, frame=replace(camera.stated(read.frame), temperature_c=file.temperature_c))


def _require_bench(configuration: SessionConfiguration, read: FileFrame) -> None:
    """Refuse a picture that is not of the configured camera, lens and target."""
    for name in ("vendor", "model", "serial"):
        wanted, stated = getattr(configuration.camera, name), getattr(read.frame.camera, name)
        if wanted is not None and wanted.casefold() != stated.casefold():
            raise InputError(
                f"{read.path} is by a camera with {name} {stated!r}, the configuration says {wanted!r}: correct "
                f"camera.{name}, or give pictures of that camera"
            )
    lens = configuration.lens
    for name, found_value, wanted_value in (
        ("f_number", read.f_number, lens.f_number),
        ("focal_length_m", read.focal_length_m, lens.focal_length_m),
    ):
        if found_value is not None and abs(found_value / wanted_value - 1) > _LENS_TOLERANCE_REL:
            raise InputError(
                f"{read.path} was taken with {name} {found_value:g}, the configuration says {wanted_value:g}: correct "
                f"lens.{name}, or give pictures with this setting"
            )
    for patch in configuration.target.patches:
        patch.region().mask(read.frame.shape)


def _require_alike(first: FileFrame, read: FileFrame) -> None:
    """Refuse a picture that differs from the first in anything but exposure and light."""
    a, b = first.frame, read.frame
    for name, expected, actual in (
        ("camera", str(a.camera), str(b.camera)),
        ("image size", f"{a.shape[1]} x {a.shape[0]}", f"{b.shape[1]} x {b.shape[0]}"),
        ("pixel format", a.pixel_format, b.pixel_format),
        ("bit depth", a.bit_depth, b.bit_depth),
        ("gain", f"{a.gain_db:.4g} dB", f"{b.gain_db:.4g} dB"),
        ("saturation", f"{a.saturation_dn:g} DN", f"{b.saturation_dn:g} DN"),
        ("f-number", first.f_number, read.f_number),
        ("focal length", first.focal_length_m, read.focal_length_m),
    ):
        if expected != actual:
            raise InputError(
                f"{name} of {read.path} is {actual}, that of {first.path} is {expected}: give pictures of one camera "
                "with one setting, and other exposures only"
            )
    mine, theirs = (settings.black_level_dn or 0.0 for settings in (a, b))
    if abs(mine - theirs) > _BLACK_TOLERANCE * a.saturation_dn:
        raise InputError(
            f"black level of {read.path} is {theirs:g} DN, that of {first.path} is {mine:g} DN: give pictures with one "
            "setting"
        )
