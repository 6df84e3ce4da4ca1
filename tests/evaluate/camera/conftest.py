"""The data set of known cameras, as in the tests of its characterisation."""

from ...calibration.emva.conftest import data_set

__all__ = ["data_set"]
