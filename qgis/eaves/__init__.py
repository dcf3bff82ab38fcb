"""eaves as a provider of QGIS Processing."""


def classFactory(iface):
    """The plug-in, as QGIS asks for it."""
    from .plugin import Plugin

    return Plugin()
