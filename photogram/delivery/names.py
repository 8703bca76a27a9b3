"""The products that are handed over and their files, for the command, which imports nothing that computes."""

from enum import StrEnum

from photogram.result_files import TILES_FOLDER


class Product(StrEnum):
    """What is handed over."""

    DXF = "dxf"
    QGIS = "qgis"
    LANDXML = "landxml"
    GLB = "glb"
    SHAPEFILE = "shapefile"
    KMZ = "kmz"
    COPC = "copc"
    TILES = "3dtiles"


USUAL = tuple(product for product in Product if product is not Product.TILES)
"""Those that are made where nobody names any: tiles take minutes, and as much disk as the orthophoto."""

FILES = {
    Product.DXF: ("survey.dxf",),
    Product.QGIS: ("survey.qgz", "ground_points.gpkg"),
    Product.LANDXML: ("survey.xml",),
    Product.GLB: ("model.glb",),
    Product.SHAPEFILE: ("survey_shp.zip",),
    Product.KMZ: ("survey.kmz",),
    Product.COPC: ("dense.copc.laz",),
    Product.TILES: (f"{TILES_FOLDER}/tileset.json",),
}
"""The files of each product, the one that is opened first."""
