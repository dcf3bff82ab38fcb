"""One tool of the toolbox, made from a form: its parameters, the words of the command, its layers."""

import sqlite3
import tempfile
from contextlib import closing
from html import escape
from pathlib import Path

from qgis.core import (
    QgsFeatureSink,
    QgsProcessing,
    QgsProcessingAlgorithm,
    QgsProcessingException,
    QgsProcessingLayerPostProcessorInterface,
    QgsProcessingOutputFile,
    QgsProcessingOutputRasterLayer,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterEnum,
    QgsProcessingParameterExtent,
    QgsProcessingParameterFeatureSink,
    QgsProcessingParameterField,
    QgsProcessingParameterFile,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterMultipleLayers,
    QgsProcessingParameterNumber,
    QgsProcessingParameterString,
    QgsProcessingParameterVectorLayer,
    QgsVectorLayer,
)
from qgis.PyQt.QtXml import QDomDocument

from .commands import SETTING, CommandError, find_command, run_command

INPUT, OUTPUT = "INPUT", "OUTPUT"
LAYERS = {"FOOTPRINTS": ("footprints", "Footprints"), "ROOF_PLANES": ("roof_planes", "Roof planes")}
"""Layers of footprints.gpkg that come out as layers of QGIS."""
RASTERS = {"DTM": ("dtm.tif", "Terrain"), "DSM": ("dsm.tif", "Surface"), "MASK": ("mask.tif", "Mask")}
FILES = {
    "MODELS": ("buildings.city.jsonl", "Models"),
    "REPORT": ("report.html", "Report"),
    "PROJECT": ("buildings.qgz", "QGIS project"),
    "POINTS": ("classified.laz", "Classified points"),
    "SOLAR": ("solar.gpkg", "Sunlight"),
    "CONTOURS": ("contours.gpkg", "Contours"),
    "CHANGE": ("changes.gpkg", "Changes"),
}


class Styled(QgsProcessingLayerPostProcessorInterface):
    """Gives a finished layer the style that lies beside it in the GeoPackage."""

    kept = []  # noqa: RUF012

    def __init__(self, qml):
        super().__init__()
        self.qml = qml
        Styled.kept.append(self)  # QGIS keeps no reference

    def postProcessLayer(self, layer, context, feedback):
        document = QDomDocument()
        document.setContent(self.qml)
        layer.importNamedStyle(document)
        layer.triggerRepaint()


class Algorithm(QgsProcessingAlgorithm):
    """A command of eaves, whole or with the parameters of one method."""

    def __init__(self, form):
        super().__init__()
        self.form = form

    def createInstance(self):
        return Algorithm(self.form)

    def name(self):
        return self.form["name"]

    def displayName(self):
        return self.form["title"]

    def group(self):
        return self.form["group"]

    def groupId(self):
        return self.form["group"].lower().replace(" ", "_")

    def shortDescription(self):
        return self.form["summary"]

    def shortHelpString(self):
        asked = "".join(
            f"<li><b>{field['title']}</b>: {escape(field['help'])}</li>" for field in self.form["fields"]
        )
        return f"{self.form['help']}<ul>{asked}</ul>"

    def initAlgorithm(self, configuration=None):
        """Adds the parameters of the form, and the outputs its command writes."""
        if self.form["points"]:
            self.addParameter(
                QgsProcessingParameterMultipleLayers(INPUT, "Points (LAS, LAZ, COPC)", QgsProcessing.TypeFile)
            )
        for field in self.form["fields"]:
            parameter = make_parameter(field)
            parameter.setHelp(field["help"])
            if field["advanced"]:
                parameter.setFlags(parameter.flags() | QgsProcessingParameterDefinition.FlagAdvanced)
            self.addParameter(parameter)
        outputs = self.form["outputs"]
        for key, (_, title) in LAYERS.items():
            if key in outputs:
                self.addParameter(
                    QgsProcessingParameterFeatureSink(
                        key, title, QgsProcessing.TypeVectorPolygon, optional=True, createByDefault=True
                    )
                )
        if self.form["out"]:
            self.addParameter(QgsProcessingParameterFolderDestination(OUTPUT, "Folder of all results"))
        for key, (_, title) in RASTERS.items():
            if key in outputs:
                self.addOutput(QgsProcessingOutputRasterLayer(key, title))
        for key, (_, title) in FILES.items():
            if key in outputs:
                self.addOutput(QgsProcessingOutputFile(key, title))

    def processAlgorithm(self, parameters, context, feedback):
        """Runs the command and hands its layers on."""
        given = OUTPUT if self.form["out"] else self.form["fields"][0]["name"]
        folder = Path(self.parameterAsString(parameters, given, context))
        if self.form["out"]:
            folder.mkdir(parents=True, exist_ok=True)
        try:
            words = find_command(setting_of_command()) + self.words_of(parameters, context, folder)
            whole = run_command(words, feedback)
        except CommandError as error:
            raise QgsProcessingException(str(error)) from None
        results = {OUTPUT: str(folder)}
        if not whole:
            return results
        for key, (file, _) in {**RASTERS, **FILES}.items():
            if key in self.form["outputs"] and (folder / file).exists():
                results[key] = str(folder / file)
        for key, (layer, _) in LAYERS.items():
            if key in self.form["outputs"] and parameters.get(key) is not None:
                results[key] = self.copied(
                    parameters, key, folder / "footprints.gpkg", layer, context, feedback
                )
        return results

    def words_of(self, parameters, context, folder):
        """The command's words for these values."""
        words = [self.form["command"]]
        if self.form["points"]:
            words += self.parameterAsFileList(parameters, INPUT, context)
        words += ["--out", str(folder)] if self.form["out"] else []
        words += self.form["always"]
        settings = []
        for field in self.form["fields"]:
            name, kind = field["name"], field["kind"]
            if kind == "folder":
                words.append(self.parameterAsString(parameters, name, context))
                continue
            if kind == "points":
                words += self.parameterAsFileList(parameters, name, context)
                continue
            if parameters.get(name) is None:
                continue
            if kind == "flag":
                words += [field["option"]] if self.parameterAsBool(parameters, name, context) else []
                continue
            value = self.text_of(field, parameters, context)
            if value is None or value == field["default"]:
                continue
            if field["option"]:
                words += [field["option"], value]
            else:
                settings.append(f"{field['key']} = {value}")
        if settings:
            config = Path(tempfile.mkdtemp(prefix="eaves")) / "settings.toml"
            table = [f"[{self.form['stage']}]", f'method = "{self.form["method"]}"', *settings, ""]
            config.write_text("\n".join(table), encoding="utf-8")
            words += ["--config", str(config)]
        return words

    def text_of(self, field, parameters, context):
        """The value of one field as the command reads it; None for none."""
        name, kind = field["name"], field["kind"]
        if kind == "polygons":
            layer = self.parameterAsVectorLayer(parameters, name, context)
            return layer and self.parameterAsCompatibleSourceLayerPath(parameters, name, context, ["gpkg"])
        if kind == "crs":
            crs = self.parameterAsCrs(parameters, name, context)
            return crs.authid() if crs.isValid() else None
        if kind == "extent":
            crs = self.parameterAsCrs(parameters, "crs", context)
            box = self.parameterAsExtent(parameters, name, context, crs)
            corners = (box.xMinimum(), box.yMinimum(), box.xMaximum(), box.yMaximum())
            return None if box.isEmpty() else ",".join(f"{corner:.3f}" for corner in corners)
        if kind == "choice":
            return self.parameterAsEnumString(parameters, name, context) or None
        if kind == "integer":
            return str(self.parameterAsInt(parameters, name, context))
        if kind == "number":
            return repr(self.parameterAsDouble(parameters, name, context))
        return self.parameterAsString(parameters, name, context) or None

    def copied(self, parameters, key, path, layer, context, feedback):
        """The id of the sink that a layer of the GeoPackage was copied to, with its style."""
        source = QgsVectorLayer(f"{path}|layername={layer}", layer, "ogr")
        if not source.isValid():
            raise QgsProcessingException(f"{path}: layer {layer} cannot be read")
        sink, place = self.parameterAsSink(
            parameters, key, context, source.fields(), source.wkbType(), source.sourceCrs()
        )
        sink.addFeatures(source.getFeatures(), QgsFeatureSink.FastInsert)
        del sink
        if context.willLoadLayerOnCompletion(place):
            with closing(sqlite3.connect(path)) as database:
                found = database.execute(
                    "SELECT styleQML FROM layer_styles WHERE f_table_name = ? AND useAsDefault", (layer,)
                ).fetchone()
            if found:
                context.layerToLoadOnCompletionDetails(place).setPostProcessor(Styled(found[0]))
        return place


def setting_of_command():
    """The command that the provider's settings name, if any."""
    try:
        from processing.core.ProcessingConfig import ProcessingConfig
    except ImportError:
        return ""
    return ProcessingConfig.getSetting(SETTING) or ""


def make_parameter(field):
    """A parameter of QGIS for a field of the form; all of them are optional."""
    name, title, default, kind = field["name"], field["title"], field["default"], field["kind"]
    if kind == "folder":
        return QgsProcessingParameterFile(name, title, QgsProcessingParameterFile.Folder)
    if kind == "points":
        return QgsProcessingParameterMultipleLayers(name, title, QgsProcessing.TypeFile)
    if kind == "flag":
        return QgsProcessingParameterBoolean(name, title, False, optional=True)
    if kind == "choice":
        return QgsProcessingParameterEnum(
            name, title, field["choices"], False, default, optional=True, usesStaticStrings=True
        )
    if kind in ("integer", "number"):
        numbers = QgsProcessingParameterNumber
        parameter = numbers(
            name, title, numbers.Integer if kind == "integer" else numbers.Double, optional=True
        )
        parameter.setDefaultValue(None if default is None else float(default))
        if field["min"] is not None:
            parameter.setMinimum(field["min"])
        if field["max"] is not None:
            parameter.setMaximum(field["max"])
        return parameter
    if kind == "crs":
        return QgsProcessingParameterCrs(name, title, optional=True)
    if kind == "extent":
        return QgsProcessingParameterExtent(name, title, optional=True)
    if kind == "polygons":
        return QgsProcessingParameterVectorLayer(
            name, title, [QgsProcessing.TypeVectorPolygon], optional=True
        )
    if kind == "field":
        return QgsProcessingParameterField(name, title, None, field["of"], optional=True)
    if kind == "file":
        return QgsProcessingParameterFile(name, title, optional=True)
    return QgsProcessingParameterString(name, title, default, optional=True)
