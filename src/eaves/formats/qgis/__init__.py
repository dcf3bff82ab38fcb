"""The files that open a result as a map in QGIS: styles, names of columns, a project."""
