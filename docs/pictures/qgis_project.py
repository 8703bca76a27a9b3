"""Draw a project of QGIS that photogram deliver has made, as QGIS itself shows it, with its legend.

Call: python3 docs/pictures/qgis_project.py OUTPUT survey.qgz, with the Python that has QGIS's own modules (Debian:
python3-qgis); QT_QPA_PLATFORM=offscreen where there is no screen. The picture in the documentation is of Brighton
Beach.
"""

import sys
from pathlib import Path

from qgis.core import (
    QgsApplication,
    QgsLayout,
    QgsLayoutExporter,
    QgsLayoutItemLegend,
    QgsLayoutItemMap,
    QgsLayoutPoint,
    QgsLayoutSize,
    QgsLegendStyle,
    QgsProject,
    QgsUnitTypes,
)
from qgis.PyQt.QtCore import QRectF

PAGE_MM, MAP_MM = (220.0, 150.0), (150.0, 150.0)
DOTS_PER_INCH = 130
TEXT_PT, SYMBOL_MM = 7.0, 2.5


def main(output: Path, path: Path) -> None:
    """Draw the visible layers of a project."""
    application = QgsApplication([], False)
    application.initQgis()
    project = QgsProject.instance()
    if not project.read(str(path)):
        raise SystemExit(f"{path}: QGIS cannot read it")
    shown = [node.layer() for node in project.layerTreeRoot().findLayers() if node.isVisible()]
    layout = QgsLayout(project)
    layout.initializeDefaults()
    layout.pageCollection().page(0).setPageSize(QgsLayoutSize(*PAGE_MM, QgsUnitTypes.LayoutMillimeters))
    picture = QgsLayoutItemMap(layout)
    picture.attemptSetSceneRect(QRectF(0.0, 0.0, *MAP_MM))
    picture.setLayers(shown)
    picture.zoomToExtent(project.viewSettings().defaultViewExtent())
    layout.addLayoutItem(picture)
    legend = QgsLayoutItemLegend(layout)
    legend.setAutoUpdateModel(False)
    groups = legend.model().rootGroup()
    for group in list(groups.children()):
        if not group.itemVisibilityChecked():
            groups.removeChildNode(group)
    legend.setSymbolHeight(SYMBOL_MM)
    for part in (QgsLegendStyle.Group, QgsLegendStyle.Subgroup, QgsLegendStyle.SymbolLabel):
        style = legend.style(part)
        font = style.font()
        font.setPointSizeF(TEXT_PT)
        style.setFont(font)
        legend.setStyle(part, style)
    legend.attemptMove(QgsLayoutPoint(MAP_MM[0] + 2.0, 2.0, QgsUnitTypes.LayoutMillimeters))
    layout.addLayoutItem(legend)
    settings = QgsLayoutExporter.ImageExportSettings()
    settings.dpi = DOTS_PER_INCH
    QgsLayoutExporter(layout).exportToImage(str(output), settings)
    application.exitQgis()


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
