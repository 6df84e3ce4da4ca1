"""Which causes labcdp's findings name: what makes a finding right in one world and false in another."""

from __future__ import annotations

from collections.abc import Iterable

#: Causes that the beginnings of findings' codes name, the longest that fits; of several the finding says "one of".
NAMED_BY: dict[str, tuple[str, ...]] = {
    "colours-do-not-fit": ("colours",),
    "dark-changed": ("dark signal",),
    "dark-contradicts": ("dark signal",),
    "dark-current-differs": ("dark signal", "temperature"),
    "dark-differs": ("dark signal",),
    "dark-falls": ("dark signal",),
    "drift": ("drift",),
    "exposure-deviates": ("exposure", "flicker", "response"),
    "exposures-disagree": ("exposure", "flicker", "exposure offset"),
    "exposures-offset": ("exposure offset", "flicker"),
    "exposures-scatter": ("scatter of exposures",),
    "first-frames-differ": ("image lag",),
    "flat-not-radial": ("place",),
    "flat-step": ("place",),
    "flicker": ("flicker",),
    "full-below-saturation": ("response",),
    "intercept": ("glare", "dark signal"),
    "intercept-not-excluded": ("glare not excluded",),
    "meter-recalibrated": ("step",),
    "patch-coloured": ("colours",),
    "patch-contradicts": ("patch",),
    "patch-contradicts-meter": (
        "flicker",
        "focus",
        "glare",
        "shape of patches",
        "image lag",
        "patch",
        "readings",
        "scatter of patches",
    ),
    "patch-rim": ("focus", "glare", "shape of patches"),
    "patch-shape": ("shape of patches",),
    "patches-scatter": ("scatter of patches",),
    "planes-intercepts-differ": ("colours",),
    "reading-contradicts": ("patch",),
    "region-edge": ("shape of patches",),
    "readings-scatter": ("readings",),
    "readings-step": ("step",),
    "responsivity-changed": ("responsivity", "flicker", "drift"),
    "surroundings": ("focus", "glare", "shape of patches"),
    "temperature-": ("temperature",),
    "vignetting-": ("place",),
}
#: What some of them say is how large something is, and not why: right where a world has it, and false nowhere.
SIZES = ("glare not excluded", "scatter of exposures", "scatter of patches")
#: Findings of these severities claim something; others report that nothing was found, or what was done.
_CLAIMS = ("warning", "error")


def causes_of(code: str) -> tuple[str, ...]:
    """Causes that a code names, or several codes joined by ``|``; empty if it names none."""
    if "|" in code:
        return tuple(dict.fromkeys(cause for one in code.split("|") for cause in causes_of(one)))
    longest = max((begin for begin in NAMED_BY if code.startswith(begin)), key=len, default="")
    return NAMED_BY.get(longest, ())


def right(findings: Iterable[tuple[str, str]], causes: tuple[str, ...]) -> bool:
    """Whether one of the findings, severities and codes, names one of the causes."""
    return any(set(causes_of(code)) & set(causes) for severity, code in findings if severity in _CLAIMS)


def false(findings: Iterable[tuple[str, str]], causes: tuple[str, ...]) -> tuple[str, ...]:
    """Codes of the findings that name only causes which a world does not have."""
    named = ((code, causes_of(code)) for severity, code in findings if severity in _CLAIMS)
    return tuple(sorted({code for code, of in named if of and not {*causes, *SIZES} & set(of)}))
