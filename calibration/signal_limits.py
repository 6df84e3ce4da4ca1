"""When a signal is not used."""

#: Share of clipped values (saturated, or at DN 0) up to which their effect on a mean vanishes beside the noise.
MAX_CLIPPED_SHARE = 0.001
#: A patch counts as brighter than the dark from this many standard uncertainties on.
MIN_NET_SIGNAL = 3.0
#: Variance by rounding to whole DN.
ROUNDING_DN2 = 1 / 12
