"""The files of a study: NetCDF, CSV, figures."""

from pathlib import Path

from harvester.files.tables import write_csv, write_netcdf
from harvester.files.writing import in_folder
from harvester.running.folder import StudyFolder, held
from harvester.show import figures
from harvester.studies.loads import drawing
from harvester.studies.loads.dataset import table_of, to_dataset
from harvester.studies.loads.outcome import Report

FIGURES = {
    "power.png": drawing.draw_power,
    "efficiency.png": drawing.draw_efficiency,
    "waveforms.png": drawing.draw_waveforms,
}
FILES = ("load-study.nc", "load-study.csv", *FIGURES)


def save(report: Report, folder: str | Path | StudyFolder) -> list[str]:
    """Write a study's files, each whole or not at all; returns their names.

    Parameters
    ----------
    report : harvester.studies.loads.outcome.Report
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
        write_netcdf(in_folder(place, "load-study.nc"), to_dataset(report))
        write_csv(in_folder(place, "load-study.csv"), *table_of(report))
        for name, draw in FIGURES.items():
            figures.save(draw, report, in_folder(place, name))
    return list(FILES)
