"""Scale of DN in files of 16 bits that do not say how many bits the sensor's converter had."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.finding import Finding, info, warning

#: Bits of converters whose DN are kept in 16 bits.
_DEPTHS = (10, 12, 14)


@dataclass(frozen=True)
class Scale:
    """Bits of the DN scale, the DN from which a pixel is saturated, and how they were found."""

    bits: int
    saturation_dn: float
    findings: tuple[Finding, ...] = ()


def guessed_scale(largest: int, in_use: int, bits: int) -> Scale:
    """Scale of DN in a wider type: that of a converter at whose highest DN the values end, else the type's own.

    Parameters
    ----------
    largest : int
        Largest DN of all pictures that belong together.
    in_use : int
        Bits that are set in any of them.
    bits : int
        Bits of the type.
    """
    for depth in _DEPTHS:
        if largest == 2**depth - 1 < 2**bits - 1:
            return Scale(depth, float(largest), (info("bit-depth-guessed", bits=depth, saturation_dn=largest),))
    for depth in _DEPTHS:
        step = 2 ** (bits - depth)
        top = 2**bits - step
        if largest == top and not in_use & (step - 1):
            found = info("bit-depth-guessed-upper", bits=depth, stored_bits=bits, saturation_dn=top)
            return Scale(bits, float(top), (found,))
    findings: tuple[Finding, ...] = ()
    if largest < 2 ** (bits - 1):
        findings = (warning("bit-depth-unknown", largest_dn=largest, top_dn=2**bits - 1),)
    return Scale(bits, 2.0**bits - 1, findings)
