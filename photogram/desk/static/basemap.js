// Tiles of somebody else under a map, where the command names them.

import { get } from "./api.js";
import { PROJECTION } from "./maps.js";

const { ol } = window;

const applied = p => ([x, y]) => {
  const u = (x - p.from_centre[0]) / p.from_half, v = (y - p.from_centre[1]) / p.from_half;
  const powers = [1, v, v * v, v ** 3, u, u * v, u * v * v, u * u, u * u * v, u ** 3];
  return p.coefficients.map((row, k) => p.to_centre[k] + p.to_half * row.reduce((sum, c, n) => sum + c * powers[n], 0));
};

// Put the tiles under the map, and say whose they are.
export async function addBasemap(map) {
  const basemap = await get("basemap");
  if (!basemap.url) return;
  ol.proj.addCoordinateTransforms(PROJECTION, "EPSG:3857", applied(basemap.mercator_from_map), applied(basemap.map_from_mercator));
  const source = new ol.source.XYZ({ url: basemap.url, projection: "EPSG:3857", attributions: basemap.host });
  map.addLayer(new ol.layer.Tile({ source, zIndex: -1 }));
  map.addControl(new ol.control.Attribution({ collapsible: false }));
}
