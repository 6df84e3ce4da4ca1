"""The twin of a camera whose frames are corrected: what dark library and flat field leave of the fixed pattern."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from ..calibration import Calibration
from ..calibration.dark_library import DarkLibrary
from ..calibration.emva.result import Quantity
from ..vignetting import FlatField
from .twin_parameters import TwinParameters

#: What takes the place of DSNU and PRNU in a comparison of corrected frames.
LEFT_BY_LIBRARY, LEFT_BY_FLAT_FIELD = "DSNU left by the dark library", "PRNU left by the flat field"
#: Parts of the noise that a dark library takes off beside the DSNU of the pixels.
_OTHER_DARK_PATTERN = ("row_dsnu_dn", "column_dsnu_dn", "dsnu_dn_s")
#: Variance of darkness from which on the steps of the converter are no longer seen.
_COARSE_DN2 = 2.0
#: Kinds of pixels by their darkness, and the golden ratio.
_DARK_KINDS, _GOLDEN = 21, (1 + sqrt(5)) / 2


@dataclass(frozen=True, eq=False)
class CorrectedTwin:
    """A twin, and what the calibration takes off its frames.

    Parameters
    ----------
    uncorrected : TwinParameters
        The camera.
    library : DarkLibrary or None
        Taken off at the exposures where it leaves less than it removes; its own noise, which stays the same from
        frame to frame, is what it leaves.
    flat_field : FlatField or None
        Leaves the noise of its pixels of the PRNU.
    """

    uncorrected: TwinParameters
    library: DarkLibrary | None = None
    flat_field: FlatField | None = None

    @classmethod
    def of(cls, twin: TwinParameters, calibration: Calibration) -> CorrectedTwin:
        """Take from a calibration what it corrects."""
        flat_field = calibration.vignetting if isinstance(calibration.vignetting, FlatField) else None
        return cls(twin, calibration.dark_library, flat_field)

    def takes_pattern_off(self, exposure_s: float) -> bool:
        """Whether the pattern of the darkness is taken off at an exposure."""
        return self.library is not None and self.library.worth_applying(exposure_s, self.uncorrected.temperature_c)

    def at(self, exposure_s: float) -> TwinParameters:
        """Return the twin with the fixed pattern that corrected frames of an exposure have."""
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

    def left(self, exposures_s: Iterable[float]) -> dict[str, Quantity]:
        """Return what is compared in place of DSNU and PRNU, by name; of the longest of the exposures that apply."""
        found, k = {}, self.uncorrected.noise.k_dn_per_e.value
        corrected_s = [t for t in exposures_s if self.takes_pattern_off(t)]
        if corrected_s:
            left = self.at(max(corrected_s)).noise.dsnu_dn
            note = f"noise of the dark library at {1e3 * max(corrected_s):.4g} ms, compared in place of the DSNU"
            found[LEFT_BY_LIBRARY] = replace(left, value=left.value / k, unit="e-", note=note)
        if self.flat_field is not None:
            left = self.at(0.0).noise.prnu_rel
            found[LEFT_BY_FLAT_FIELD] = replace(left, note="noise of the flat field, compared in place of the PRNU")
        return found

    def notes(self, exposures_s: Iterable[float]) -> list[str]:
        """Tell what is compared in place of DSNU and PRNU."""
        notes, exposures_s = [], sorted(set(exposures_s))
        corrected_s = [t for t in exposures_s if self.takes_pattern_off(t)]
        if corrected_s:
            some = ", ".join(f"{1e3 * t:.4g}" for t in corrected_s)
            where = "" if corrected_s == exposures_s else f" at {some} ms"
            notes.append(
                f"the calibration takes off the pattern of the darkness{where}: there the noise of the dark library is "
                "compared in place of the DSNU"
            )
        if self.flat_field is not None:
            notes.append("the calibration has a flat field: the noise of its pixels is compared in place of the PRNU")
        return notes


def dark_kinds(twin: TwinParameters) -> list[tuple[float, float]] | None:
    """Kinds of pixels by their darkness: what frames have of it, and what is taken off them; equally frequent.

    Only for a pattern that is taken off and a noise that does not dither the converter: a pixel's values then lie one
    DN apart, but each pixel's elsewhere. None where the values of all pixels may be taken as one DN apart: with noise
    of more than about a DN it does not matter.

    Parameters
    ----------
    twin : TwinParameters
        The twin at an exposure, by `CorrectedTwin.at`.
    """
    from scipy.special import ndtri

    noise = twin.noise
    if twin.pattern_taken_off_dn == 0 or noise.read_noise_dn.value**2 + noise.dsnu_dn.value**2 >= _COARSE_DN2:
        return None
    # An evenly spread lattice of two independent normal variables.
    number = np.arange(_DARK_KINDS) + 0.5
    both = ndtri(np.stack([number / _DARK_KINDS, (number * _GOLDEN) % 1]))
    pattern, left = both / both.std(axis=1, keepdims=True) * [[twin.pattern_taken_off_dn], [noise.dsnu_dn.value]]
    return list(zip(pattern.tolist(), (pattern + left).tolist(), strict=True))
