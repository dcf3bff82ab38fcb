"""The provider: one tool for every form."""

import json
from pathlib import Path

from qgis.core import QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon

from .algorithm import Algorithm
from .commands import SETTING

FOLDER = Path(__file__).parent


class Provider(QgsProcessingProvider):
    """eaves in the toolbox."""

    def id(self):
        return "eaves"

    def name(self):
        return "eaves"

    def longName(self):
        return "eaves: buildings from LiDAR"

    def icon(self):
        return QIcon(str(FOLDER / "icon.svg"))

    def load(self):
        """Adds the setting that names the command, where QGIS has settings of Processing."""
        try:
            from processing.core.ProcessingConfig import ProcessingConfig, Setting
        except ImportError:
            pass
        else:
            ProcessingConfig.settingIcons["eaves"] = self.icon()
            setting = Setting("eaves", SETTING, "The eaves command", "", valuetype=Setting.FILE)
            ProcessingConfig.addSetting(setting)
            ProcessingConfig.readSettings()
        self.refreshAlgorithms()
        return True

    def loadAlgorithms(self):
        forms = json.loads((FOLDER / "forms.json").read_text("utf-8"))
        for form in forms["tools"]:
            self.addAlgorithm(Algorithm(form))
