// What the photographs cover by their tags alone, and how accurate it will be: colours under the map, gaps, sentences.

import { get } from "./api.js";
import { PROJECTION, vectorLayer } from "./maps.js";
import { $, element, fill, guarded } from "./page.js";
import { ramp } from "./rasters.js";
import { number, t } from "./words.js";

const { ol } = window;
// Least number of photographs of each class, its colour, and what it is called; red to blue, which most eyes tell apart.
const counts = () => [[1, [178, 24, 43], "1"], [2, [239, 138, 98], "2"], [3, [254, 224, 118], "3–4"], [5, [146, 197, 222], "5–8"], [9, [33, 102, 172], t("9 or more")]];
const SIGMA_CLASSES = 5;
const OPACITY = .7;
let map = null, drawn = [], counted = null, expected = null;

// A new map begins without coverage.
export function onMap(made) {
  map = made;
  drawn = [];
}

export async function show() {
  clear();
  for (const id of ["coverage", "coverage-legend", "coverage-kind-label", "gaps-kml"]) $(id).hidden = true;
  if (!$("coverage-switch").checked) return;
  $("coverage-words").textContent = t("Counting …");
  try {
    [counted, expected] = await Promise.all([get("coverage"), get("expected")]);
    draw();
  } finally {
    $("coverage-words").textContent = "";
  }
}

function clear() {
  for (const layer of drawn) map.removeLayer(layer);
  drawn = [];
}

const said = sentences => sentences.map(one => element("li", { class: one.severity, lang: one.lang }, one.text));

function draw() {
  if (!$("coverage-switch").checked) return;
  clear();
  fill($("coverage-sentences"), ...said(counted.sentences));
  fill($("expected-sentences"), ...said(expected.sentences));
  $("coverage").hidden = false;
  $("coverage-kind-label").hidden = !expected.grid;
  $("gaps-kml").hidden = !counted.has_kml;
  const kind = expected.grid ? $("coverage-kind").value : "counts";
  const grid = kind === "counts" ? counted.grid : expected.grid;
  if (!grid) return;
  const values = grid[kind], classes = kind === "counts" ? counts() : sigmaClasses(values);
  legend(classes, kind === "counts" ? t("photographs") : "cm");
  const edge = new ol.style.Style({ stroke: new ol.style.Stroke({ color: "#b2182b", width: 3, lineDash: [8, 5] }) });
  const gaps = counted.gaps.map(gap => new ol.Feature(new ol.geom.Polygon(gap.rings_map_m)));
  drawn = [picture(grid, values, classes), vectorLayer(gaps, edge)];
  map.getLayers().insertAt(0, drawn[0]);
  map.addLayer(drawn[1]);
  if (expected.next_point) {
    drawn.push(further(expected.next_point));
    map.addLayer(drawn[2]);
  }
}

function legend(classes, unit) {
  fill($("coverage-legend"), ...classes.map(([, colour, words]) => {
    const swatch = element("i");
    swatch.style.background = `rgba(${colour.join(" ")} / ${OPACITY})`;
    return element("li", {}, swatch, words);
  }), element("li", {}, unit));
  $("coverage-legend").hidden = false;
}

// Classes in equal steps of the logarithm, from the best place to one that nine of ten are better than.
function sigmaClasses(values) {
  const known = values.filter(value => value !== null).sort((a, b) => a - b);
  const low = known[0], high = Math.max(known[Math.floor(.9 * (known.length - 1))], 1.02 * low);
  const colours = ramp("sigma"), least = n => low * (high / low) ** (n / (SIGMA_CLASSES - 1));
  return Array.from({ length: SIGMA_CLASSES }, (_, n) => {
    const colour = colours[Math.round(n * (colours.length - 1) / (SIGMA_CLASSES - 1))];
    const bound = number(Number((100 * least(n || 1)).toPrecision(2)));
    return [n ? least(n) : 0, [1, 3, 5].map(at => parseInt(colour.slice(at, at + 2), 16)), n ? t("from {bound}", { bound }) : t("to {bound}", { bound })];
  });
}

function further({ position_map_m: [east, north] }) {
  const style = new ol.style.Style({
    image: new ol.style.RegularShape({ points: 5, radius: 11, radius2: 5, fill: new ol.style.Fill({ color: "#ffd500" }), stroke: new ol.style.Stroke({ color: "#333", width: 1.5 }) }),
    text: new ol.style.Text({ text: t("one more control point"), offsetY: 20, font: "12px sans-serif", fill: new ol.style.Fill({ color: "#111" }), stroke: new ol.style.Stroke({ color: "#fff", width: 3 }) }),
  });
  return vectorLayer([new ol.Feature({ geometry: new ol.geom.Point([east, north]), item: {} })], style);
}

function picture(grid, values, classes) {
  const canvas = element("canvas", { width: grid.columns, height: grid.rows });
  const context = canvas.getContext("2d"), image = context.createImageData(grid.columns, grid.rows);
  values.forEach((value, cell) => {
    const colour = value === null ? null : classes.findLast(([least]) => value >= least)?.[1];
    if (colour) image.data.set([...colour, 255], 4 * cell);
  });
  context.putImageData(image, 0, 0);
  const extent = [grid.west_map_m, grid.north_map_m - grid.rows * grid.cell_m, grid.west_map_m + grid.columns * grid.cell_m, grid.north_map_m];
  const source = new ol.source.ImageStatic({ url: canvas.toDataURL(), imageExtent: extent, projection: PROJECTION, interpolate: false });
  return new ol.layer.Image({ source, opacity: OPACITY });
}

$("coverage-switch").addEventListener("change", guarded(show));
$("coverage-kind").addEventListener("change", guarded(draw));
