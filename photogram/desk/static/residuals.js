// How far ground points are off: arrows and ellipses on the map of the results, and each point with its marks.

import { get } from "./api.js";
import { vectorLayer } from "./maps.js";
import { go } from "./main.js";
import { markingOf } from "./points.js";
import { $, element, ENGLISH, fill, guarded } from "./page.js";
import { fixed, number, t } from "./words.js";

const { ol } = window;
const LONGEST_PX = 60, SIDES = 48;
const WITHIN_95 = 2.4477; // sigmas of two coordinates

// The layer of a map, drawn when it is shown, and the list beside it.
export function residualLayer(map) {
  const source = new ol.source.Vector(), layer = new ol.layer.Vector({ source });
  layer.setVisible(false);
  map.on("click", event => layer.getVisible() && map.forEachFeatureAtPixel(event.pixel, feature => opened(feature.get("point")), { hitTolerance: 8, layerFilter: one => one === layer }));
  layer.on("change:visible", guarded(async () => {
    $("residuals").hidden = !layer.getVisible();
    if (layer.getVisible()) draw(source, map, await get("residuals"));
  }));
  return layer;
}

function draw(source, map, { points, others }) {
  const longest = Math.max(...points.map(({ residual_m: [e, n], sigma_m: [a, b] }) => Math.max(Math.hypot(e, n), WITHIN_95 * Math.max(a ?? 0, b ?? 0))), 1e-6);
  const times = nice(LONGEST_PX * map.getView().getResolution() / longest);
  source.clear();
  source.addFeatures(points.flatMap(point => shapes(point, times)));
  $("residuals-words").textContent = points.length
    ? t("Residuals in plan as arrows, in height as bars, with 95 % confidence ellipses; all enlarged {times} times.", { times: number(times) })
    : t("No ground points were surveyed and marked.");
  fill($("residuals-others"), ...others.map(text => element("li", { class: "warning", ...ENGLISH }, text)));
  fill($("residuals-points"), ...points.map(entry));
}

// The next lower of 1, 2, 5, 10, …
function nice(times) {
  const ten = 10 ** Math.floor(Math.log10(times));
  return Math.max([5, 2, 1].find(step => step * ten <= times) * ten, 1);
}

function shapes(point, times) {
  const [x, y] = point.position_map_m, [e, n, h] = point.residual_m, [a, b, c] = point.sigma_m;
  const colour = point.suspect ? "#c92a2a" : point.role === "control" ? "#8a5300" : "#00694e";
  const stroke = (width, lineDash) => new ol.style.Style({ stroke: new ol.style.Stroke({ color: colour, width, lineDash }) });
  const shape = (geometry, style) => {
    const feature = new ol.Feature({ geometry, point: point.name });
    feature.setStyle(style);
    return feature;
  };
  const tip = [x + times * e, y + times * n], turn = Math.atan2(n, e), head = .18 * Math.hypot(tip[0] - x, tip[1] - y);
  const barb = side => [tip[0] - head * Math.cos(turn + side), tip[1] - head * Math.sin(turn + side)];
  const around = a === null || b === null ? [] : [Array.from({ length: SIDES + 1 }, (_, k) => 2 * Math.PI * k / SIDES).map(angle =>
    [x + times * WITHIN_95 * a * Math.cos(angle), y + times * WITHIN_95 * b * Math.sin(angle)])];
  const bar = c === null ? 3 : Math.abs(h) > 1.96 * c ? 6 : 3;
  return [
    ...around.map(ring => shape(new ol.geom.LineString(ring), stroke(1.5, [5, 4]))),
    shape(new ol.geom.MultiLineString([[[x, y], tip], [barb(.5), tip, barb(-.5)]]), stroke(2.5)),
    shape(new ol.geom.LineString([[x, y], [x, y + times * h]]), new ol.style.Style({ stroke: new ol.style.Stroke({ color: colour, width: bar, lineCap: "butt" }) })),
  ];
}

function opened(name) {
  const item = $("residuals-points").querySelector(`details[data-point="${CSS.escape(name)}"]`);
  item.open = true;
  item.querySelector("summary").focus();
  return true;
}

const cm = (value, sigma) => `${fixed(100 * value, 1)}${sigma === null ? "" : ` ± ${fixed(100 * sigma, 1)}`}`;

function entry(point) {
  const [east, north, height] = [0, 1, 2].map(k => cm(point.residual_m[k], point.sigma_m[k]));
  const words = point.role === "control"
    ? t("control: east {east}, north {north}, height {height} cm", { east, north, height }) : t("check: east {east}, north {north}, height {height} cm", { east, north, height });
  const rows = point.marks.map(mark => element("tr", { class: mark.suspect || mark.left_out ? "bad" : null }, element("th", { scope: "row" }, mark.photograph),
    element("td", {}, mark.residual_px.map(v => fixed(v, 2)).join("; ")), element("td", {}, mark.left_out ? t("left out") : mark.suspect ? t("suspect") : t("used"))));
  return element("li", { class: point.suspect ? "warning" : "note" }, element("details", { "data-point": point.name },
    element("summary", {}, element("b", {}, point.name), ` ${words}`),
    ...point.sentences.map(text => element("p", ENGLISH, text)),
    rows.length ? element("table", {}, element("thead", {}, element("tr", {}, ...[t("Photograph"), t("Residual u, v, px"), t("Use")].map(title => element("th", { scope: "col" }, title)))), element("tbody", {}, ...rows)) : null,
    element("button", { type: "button", onclick: guarded(async () => { markingOf(point.name); await go("points"); }) }, t("Show the marks of {point}", { point: point.name }))));
}
