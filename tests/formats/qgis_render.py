"""Run by QGIS's own Python: opens a project, draws its map; what it found as JSON on standard output."""

import json
import os
import sys

from qgis._3d import Qgs3D
from qgis.core import (
    QgsApplication,
    QgsExpressionContext,
    QgsExpressionContextUtils,
    QgsLayerTreeModel,
    QgsMapRendererSequentialJob,
    QgsMapSettings,
    QgsProject,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtGui import QColor

application = QgsApplication([], True)
application.initQgis()
Qgs3D.initialize()
path, theme, picture = sys.argv[1:4]
project = QgsProject.instance()
read = project.read(path)
root = project.layerTreeRoot()
project.mapThemeCollection().applyTheme(theme, root, QgsLayerTreeModel(root))
settings = QgsMapSettings()
settings.setLayers(root.checkedLayers())
settings.setDestinationCrs(project.crs())
settings.setOutputSize(QSize(500, 400))
settings.setBackgroundColor(QColor("white"))
extent = project.mapLayer("eaves_footprints_layer").extent()
extent.scale(1.3)
settings.setExtent(extent)
scopes = [QgsExpressionContextUtils.globalScope(), QgsExpressionContextUtils.mapSettingsScope(settings)]
context = QgsExpressionContext()
context.appendScopes(scopes)
settings.setExpressionContext(context)
job = QgsMapRendererSequentialJob(settings)
job.start()
job.waitForFinished()
image = job.renderedImage()
image.save(picture)
colours = {image.pixelColor(x, y).name() for x in range(0, 500, 2) for y in range(0, 400, 2)}
layers = {}
for layer in project.mapLayers().values():
    vector = isinstance(layer, QgsVectorLayer)
    layers[layer.name()] = {
        "valid": layer.isValid(),
        "crs": layer.crs().authid(),
        "3d": bool(vector and layer.renderer3D()),
        "styles": layer.styleManager().styles(),
        "names": {field.name(): field.displayName() for field in layer.fields()} if vector else {},
    }
alone = QgsVectorLayer(path.replace("buildings.qgz", "footprints.gpkg|layername=footprints"), "a", "ogr")
words, opened = alone.loadDefaultStyle()
found = {
    "read": read,
    "layers": layers,
    "themes": project.mapThemeCollection().mapThemes(),
    "colours": sorted(colours),
    "errors": [error.message for error in job.errors()],
    "default style": [opened, type(alone.renderer()).__name__, alone.renderer().classAttribute()],
    "styles in the file": sorted(alone.listStylesInDatabase()[2]),
}
print("found: " + json.dumps(found))
sys.stdout.flush()
os._exit(0)  # QGIS 3.22 crashes on the way out
