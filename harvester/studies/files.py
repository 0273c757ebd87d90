"""The files of a study: NetCDF, CSV, figures."""

from pathlib import Path

from harvester.files.tables import write_csv, write_netcdf
from harvester.files.writing import in_folder
from harvester.running.folder import StudyFolder, held
from harvester.show import figures
from harvester.studies import drawing
from harvester.studies.dataset import table_of, to_dataset
from harvester.studies.outcome import Report
from harvester.studies.public import LOAD_STUDY_FILES

DRAWINGS = (drawing.draw_power, drawing.draw_efficiency, drawing.draw_waveforms)


def save(report: Report, folder: str | Path | StudyFolder) -> list[str]:
    """Write a study's files, each whole or not at all; returns their names.

    Parameters
    ----------
    report : harvester.studies.outcome.Report
    folder : str or Path or StudyFolder

    Raises
    ------
    HarvesterError
        xarray is missing.
    OutputError
        `FolderInUse` where another run is at work there.
    """
    with held(folder) as own:
        place = Path(own)
        grid, table, *pictures = (in_folder(place, name) for name in LOAD_STUDY_FILES)
        write_netcdf(grid, to_dataset(report))
        write_csv(table, *table_of(report))
        for draw, picture in zip(DRAWINGS, pictures, strict=True):
            figures.save(draw, report, picture)
    return list(LOAD_STUDY_FILES)
