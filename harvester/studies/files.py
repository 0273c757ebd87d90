"""The files of a study: NetCDF, CSV, figures."""

from harvester.files.writing import in_folder
from harvester.show import figures
from harvester.studies import drawing
from harvester.studies.dataset import save_csv, save_netcdf, to_dataset
from harvester.studies.folder import held

FIGURES = {
    "power.png": drawing.draw_power,
    "efficiency.png": drawing.draw_efficiency,
    "waveforms.png": drawing.draw_waveforms,
}
FILES = ("load-study.nc", "load-study.csv", *FIGURES)


def save(report, folder):
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
    with held(folder):
        save_netcdf(to_dataset(report), in_folder(folder, "load-study.nc"))
        save_csv(report, in_folder(folder, "load-study.csv"))
        for name, draw in FIGURES.items():
            figures.save(draw, report, in_folder(folder, name))
    return list(FILES)
