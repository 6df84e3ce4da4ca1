"""Limits of usable signals."""

#: Share of clipped values (saturated, or at DN 0) whose effect on a mean is negligible compared with the noise.
MAX_CLIPPED_SHARE = 0.001
#: Standard uncertainties above which a patch is brighter than the dark signal.
MIN_NET_SIGNAL = 3.0
