// What the photographs cover by their tags alone: counts as colours under the map, gaps outlined, and sentences.

import { get } from "./api.js";
import { PROJECTION, vectorLayer } from "./maps.js";
import { $, element, fill, guarded } from "./page.js";

const { ol } = window;
// Least number of photographs of each class, its colour, and what it is called; red to blue, which most eyes tell apart.
const CLASSES = [[1, [178, 24, 43], "1"], [2, [239, 138, 98], "2"], [3, [254, 224, 118], "3–4"], [5, [146, 197, 222], "5–8"], [9, [33, 102, 172], "9 or more"]];
const OPACITY = .7;
let map = null, drawn = [];

// A new map begins without coverage.
export function onMap(made) {
  map = made;
  drawn = [];
}

export async function show() {
  const wanted = $("coverage-switch").checked;
  for (const layer of drawn) map.removeLayer(layer);
  drawn = [];
  for (const id of ["coverage", "coverage-legend", "gaps-kml"]) $(id).hidden = true;
  if (!wanted) return;
  $("coverage-words").textContent = "Counting …";
  try {
    draw(await get("coverage"));
  } finally {
    $("coverage-words").textContent = "";
  }
}

function draw(coverage) {
  if (!$("coverage-switch").checked) return;
  fill($("coverage-sentences"), ...coverage.sentences.map(one => element("li", { class: one.severity }, one.text)));
  $("coverage").hidden = false;
  $("gaps-kml").hidden = !coverage.has_kml;
  if (!coverage.grid) return;
  fill($("coverage-legend"), ...CLASSES.map(([, colour, words]) => {
    const swatch = element("i");
    swatch.style.background = `rgba(${colour.join(" ")} / ${OPACITY})`;
    return element("li", {}, swatch, words);
  }), element("li", {}, "photographs"));
  $("coverage-legend").hidden = false;
  const edge = new ol.style.Style({ stroke: new ol.style.Stroke({ color: "#b2182b", width: 3, lineDash: [8, 5] }) });
  const gaps = coverage.gaps.map(gap => new ol.Feature(new ol.geom.Polygon(gap.rings_map_m)));
  drawn = [picture(coverage.grid), vectorLayer(gaps, edge)];
  map.getLayers().insertAt(0, drawn[0]);
  map.addLayer(drawn[1]);
}

function picture(grid) {
  const canvas = element("canvas", { width: grid.columns, height: grid.rows });
  const context = canvas.getContext("2d"), image = context.createImageData(grid.columns, grid.rows);
  grid.counts.forEach((count, cell) => {
    const colour = CLASSES.findLast(([least]) => count >= least)?.[1];
    if (colour) image.data.set([...colour, 255], 4 * cell);
  });
  context.putImageData(image, 0, 0);
  const extent = [grid.west_map_m, grid.north_map_m - grid.rows * grid.cell_m, grid.west_map_m + grid.columns * grid.cell_m, grid.north_map_m];
  const source = new ol.source.ImageStatic({ url: canvas.toDataURL(), imageExtent: extent, projection: PROJECTION, interpolate: false });
  return new ol.layer.Image({ source, opacity: OPACITY });
}

$("coverage-switch").addEventListener("change", guarded(show));
