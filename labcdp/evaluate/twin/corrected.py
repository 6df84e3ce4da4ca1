"""The twin of a camera with corrected frames: fixed pattern left by dark library and flat field."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from ...calibration import Calibration
from ...calibration.dark.library import DarkLibrary
from ...calibration.emva.result import Quantity
from ...core.finding import Finding, info
from ...core.vignetting import FlatField
from .parameters import TwinParameters

#: Noise components removed by a dark library in addition to the DSNU of the pixels.
_OTHER_DARK_PATTERN = ("row_dsnu_dn", "column_dsnu_dn", "dsnu_dn_s")
#: Variance of the dark signal above which the steps of the converter are dithered.
_COARSE_DN2 = 2.0
#: Number of classes of pixels by dark signal, and the golden ratio.
_DARK_KINDS, _GOLDEN = 21, (1 + sqrt(5)) / 2


@dataclass(frozen=True, eq=False)
class CorrectedTwin:
    """A twin with the corrections that the calibration applies to its frames.

    Parameters
    ----------
    uncorrected : TwinParameters
        The camera.
    library : DarkLibrary or None
        Subtracted at the exposures where it removes more than it adds. Its own noise, the same in every frame, remains.
    flat_field : FlatField or None
        Removes the PRNU except for the noise of its own pixels.
    """

    uncorrected: TwinParameters
    library: DarkLibrary | None = None
    flat_field: FlatField | None = None

    @classmethod
    def of(cls, twin: TwinParameters, calibration: Calibration) -> CorrectedTwin:
        """Take the corrections from a calibration."""
        flat_field = calibration.vignetting if isinstance(calibration.vignetting, FlatField) else None
        return cls(twin, calibration.dark_library, flat_field)

    def takes_pattern_off(self, exposure_s: float) -> bool:
        """Whether the dark pattern is subtracted at an exposure."""
        return self.library is not None and self.library.worth_applying(exposure_s, self.uncorrected.temperature_c)

    def at(self, exposure_s: float) -> TwinParameters:
        """Return the twin with the residual fixed pattern of corrected frames of an exposure."""
        twin = self.uncorrected
        changes: dict[str, Quantity] = {}
        if self.library is not None and self.takes_pattern_off(exposure_s):
            left_dn = self.library.noise_dn(exposure_s, twin.temperature_c)
            changes = {name: replace(getattr(twin.noise, name), value=0.0) for name in _OTHER_DARK_PATTERN}
            changes["dsnu_dn"] = replace(twin.noise.dsnu_dn, value=left_dn, note="noise of the dark library")
            pattern_dn = self.library.nonuniformity_dn(exposure_s, twin.temperature_c)
            twin = replace(twin, pattern_taken_off_dn=pattern_dn)
        if self.flat_field is not None:
            left_rel = self.flat_field.random_rel
            changes["prnu_rel"] = replace(twin.noise.prnu_rel, value=left_rel, note="noise of the flat field")
        exact = {name: replace(one, standard_uncertainty=0.0) for name, one in changes.items()}
        return twin.with_noise(replace(twin.noise, **exact)) if exact else twin

    def findings(self, exposures_s: Iterable[float]) -> list[Finding]:
        """Return the quantities compared instead of DSNU and PRNU."""
        corrected_s = [t for t in sorted(set(exposures_s)) if self.takes_pattern_off(t)]
        found = [info("twin-dark-library", exposures_s=corrected_s)] if corrected_s else []
        return [*found, info("twin-flat-field")] if self.flat_field is not None else found


def dark_kinds(twin: TwinParameters) -> list[tuple[float, float]] | None:
    """Equally frequent classes of pixels by dark signal: that of the frames, and that subtracted from them.

    Needed only where a pattern is subtracted and the noise does not dither the converter: the values of a pixel then
    lie on a grid of 1 DN whose offset differs from pixel to pixel. None where noise of more than about a DN makes the
    offset irrelevant.

    Parameters
    ----------
    twin : TwinParameters
        The twin at an exposure, by `CorrectedTwin.at`.
    """
    from scipy.special import ndtri

    noise = twin.noise
    if twin.pattern_taken_off_dn == 0 or noise.read_noise_dn.value**2 + noise.dsnu_dn.value**2 >= _COARSE_DN2:
        return None
    # A uniform lattice of two independent normal variables.
    number = np.arange(_DARK_KINDS) + 0.5
    both = ndtri(np.stack([number / _DARK_KINDS, (number * _GOLDEN) % 1]))
    pattern, left = both / both.std(axis=1, keepdims=True) * [[twin.pattern_taken_off_dn], [noise.dsnu_dn.value]]
    return list(zip(pattern.tolist(), (pattern + left).tolist(), strict=True))
