"""Characterisation of a camera after EMVA 1288."""

from .data_set import characterise_data_set
from .index import INDEX_NAME, DataSetIndex, IndexBlock, index_path, load_index, parse_index
from .result import Characterisation, Quantity, SpatialImages
from .series import Level, SeriesPoint

__all__ = [
    "INDEX_NAME",
    "Characterisation",
    "DataSetIndex",
    "IndexBlock",
    "Level",
    "Quantity",
    "SeriesPoint",
    "SpatialImages",
    "characterise_data_set",
    "index_path",
    "load_index",
    "parse_index",
]
