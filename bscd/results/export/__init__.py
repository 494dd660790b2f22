"""Results for other programs: spreadsheets (CSV), ParaView (VTU and PVD), MATLAB (MultiDIC's layout)."""

from bscd.results.export.csv import export_csv
from bscd.results.export.folder import ExportProgress
from bscd.results.export.matlab import export_matlab
from bscd.results.export.vtk import export_vtk

__all__ = ["ExportProgress", "export_csv", "export_matlab", "export_vtk"]
