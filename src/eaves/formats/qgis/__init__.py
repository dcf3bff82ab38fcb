"""What QGIS needs to open a result as a map: styles, names of columns, a project."""
