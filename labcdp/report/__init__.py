"""Report: results as tables, figures, pages, spreadsheets and files."""

from .calibration_results import write_calibration_report
from .characterise_results import characterisation_values, write_characterisation
from .characterise_tables import characterisation_table
from .folder import place_for_results
from .map_files import write_map
from .map_tables import map_notes, map_values, usable_table
from .netcdf import load_netcdf, save_netcdf
from .results import write_results
from .simulation_results import simulation_values, write_simulation
from .simulation_tables import detection_table, signal_table
from .tables import Table, contrast_table, summary_table
from .thesis_results import figure_table, thesis_table, thesis_values, write_thesis
from .twin_results import write_twin
from .video_archive import write_archive
from .video_files import load_video, write_video

__all__ = [
    "Table",
    "characterisation_table",
    "characterisation_values",
    "contrast_table",
    "detection_table",
    "figure_table",
    "load_netcdf",
    "load_video",
    "map_notes",
    "map_values",
    "place_for_results",
    "save_netcdf",
    "signal_table",
    "simulation_values",
    "summary_table",
    "thesis_table",
    "thesis_values",
    "usable_table",
    "write_archive",
    "write_calibration_report",
    "write_characterisation",
    "write_map",
    "write_results",
    "write_simulation",
    "write_thesis",
    "write_twin",
    "write_video",
]
