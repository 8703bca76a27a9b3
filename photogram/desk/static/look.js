// Look and measure: rasters of the results on a map, and what is drawn on them, each figure with its standard deviation.

import { get, post, resultAddress } from "./api.js";
import { addBasemap } from "./basemap.js";
import * as compare from "./compare.js";
import { contourLayer } from "./contours.js";
import { features, newMap, photographStyle, pointStyle, shownFully, vectorLayer } from "./maps.js";
import { $, element, ENGLISH, fill, figure, guarded } from "./page.js";
import { ramp, rasterLayer } from "./rasters.js";
import { residualLayer } from "./residuals.js";
import { code, fixed, t } from "./words.js";

const { ol } = window;
const SHAPES = { height: "Point", distance: "LineString", profile: "LineString", area: "Polygon", volume: "Polygon" };
const titleOf = kind => ({ height: t("Height"), distance: t("Distance"), profile: t("Profile"), area: t("Area"), volume: t("Volume") })[kind];
const hintOf = kind => ({
  height: t("Click a place."),
  distance: t("Click the places; a double click ends."),
  profile: t("Click along the line; a double click ends."),
  area: t("Click the corners; a double click closes."),
  volume: t("Click the foot of the heap all around; a double click closes."),
})[kind] ?? "";
let map = null, known = null, drawn = null, drawing = null, current = null;

export async function show() {
  const layers = await get("layers");
  $("no-surface").hidden = layers.length > 0;
  $("looking").hidden = !layers.length;
  const now = JSON.stringify([layers, code()]);
  if (!layers.length || now === known) return;
  known = now;
  await begin(layers);
}

async function begin(layers) {
  const seen = map?.getView();
  map?.setTarget(null);
  if (current) use(current);
  const overview = await get("overview");
  drawn = new ol.source.Vector();
  const line = new ol.style.Style({ stroke: new ol.style.Stroke({ color: "#d9480f", width: 2.5 }), fill: new ol.style.Fill({ color: "rgba(217, 72, 15, .15)" }), image: new ol.style.Circle({ radius: 5, fill: new ol.style.Fill({ color: "#d9480f" }) }) });
  const rasters = new Map();
  const contours = contourLayer();
  const over = [
    contours.layer,
    vectorLayer(features(overview.photographs), photographStyle("#0b5573")),
    vectorLayer(features(overview.points, point => ({ role: point.role })), pointStyle),
    new ol.layer.Vector({ source: drawn, style: line }),
  ];
  over[1].setVisible(false);
  map = newMap("result-map", over);
  over.push(residualLayer(map));
  map.addLayer(over.at(-1));
  map.on("pointermove", event => { $("cursor").textContent = `E ${fixed(event.coordinate[0], 2)}  N ${fixed(event.coordinate[1], 2)}`; });
  let base = layers[0];
  const choose = async layer => {
    if (!rasters.has(layer.name)) {
      const made = rasterLayer(layer, resultAddress(layer.file));
      rasters.set(layer.name, made);
      map.getLayers().insertAt(0, made.layer);
      if (rasters.size === 1) shownAgain(seen, await made.extent);
    }
    base = layer;
    compare.clear();
    for (const [name, made] of rasters) made.layer.setVisible(name === layer.name);
    legend(layer);
  };
  const radios = layers.map((layer, n) => element("label", {}, element("input", { type: "radio", name: "layer", value: layer.name, checked: n === 0, onchange: guarded(() => choose(layer)) }), layer.title));
  const boxes = [["photographs", t("Photographs"), over[1]], ["points", t("Points"), over[2]], ["measurements", t("Measurements"), over[3]], ["residuals", t("Residuals"), over.at(-1)]].map(([value, title, layer]) => element("label", {}, element("input", { type: "checkbox", value, checked: layer.getVisible(), onchange: event => layer.setVisible(event.target.checked) }), title));
  fill($("layers"), element("legend", {}, t("Show")), ...radios, ...boxes, ...contours.controls);
  fill($("tools"), element("legend", {}, t("Measure")), ...Object.keys(SHAPES).map(kind => element("button", { type: "button", "data-tool": kind, "aria-pressed": "false", onclick: () => use(kind) }, titleOf(kind))));
  await choose(layers[0]);
  await addBasemap(map);
  await compare.begin({
    map, layers, legend, address: layer => resultAddress(layer.file), rasterCount: () => rasters.size,
    others: visible => { for (const [name, made] of rasters) made.layer.setVisible(visible && name === base.name); if (visible) legend(base); },
  });
  list(await get("measurements"));
  window.desk = { map, rasters, measure: measured };
}

// What was seen before, where there was a map of the same survey; else all.
function shownAgain(seen, extent) {
  if (seen && ol.extent.containsCoordinate(extent, seen.getCenter())) {
    map.getView().setCenter(seen.getCenter());
    map.getView().setResolution(seen.getResolution());
  } else shownFully(map, extent);
}

function use(kind) {
  map.removeInteraction(drawing);
  drawing = null;
  current = current === kind ? null : kind;
  for (const button of $("tools").querySelectorAll("button")) button.setAttribute("aria-pressed", String(button.dataset.tool === current));
  $("hint").textContent = hintOf(current);
  if (!current) return;
  drawing = new ol.interaction.Draw({ type: SHAPES[current] });
  const tool = current;
  drawing.on("drawend", event => {
    const shape = event.feature.getGeometry().getCoordinates();
    measured(tool, tool === "height" ? [shape] : SHAPES[tool] === "Polygon" ? shape[0].slice(0, -1) : shape);
  });
  map.addInteraction(drawing);
}

const measured = guarded(async (kind, corners) => {
  $("hint").textContent = t("Measuring …");
  try {
    list(await post("measure", { kind, title: titleOf(kind), corners_map_m: corners.map(corner => corner.slice(0, 2)) }));
  } finally {
    $("hint").textContent = hintOf(current);
  }
});

// All measurements, the last one first, and their shapes on the map.
function list(kept) {
  drawn.clear();
  drawn.addFeatures(kept.map((item, number) => {
    const type = SHAPES[item.kind], corners = item.corners_map_m;
    const geometry = type === "Point" ? new ol.geom.Point(corners[0]) : type === "Polygon" ? new ol.geom.Polygon([[...corners, corners[0]]]) : new ol.geom.LineString(corners);
    return new ol.Feature({ geometry, number });
  }));
  fill($("measurements"), ...kept.map(entry).toReversed());
  $("measurements-title").hidden = !kept.length;
  compare.outlines(kept);
}

function entry(item, number) {
  const name = element("input", { type: "text", value: item.name, maxlength: 100, "aria-label": t("Name of the measurement"), onchange: guarded(async event => list(await post("rename", { number, name: event.target.value }))) });
  const result = item.measurement;
  return element("li", {}, name,
    result ? element("dl", {}, ...result.figures.flatMap(f => [element("dt", {}, f.name), element("dd", {}, figure(f.value, f.sigma, f.unit))])) : element("p", { class: "bad", ...ENGLISH }, item.problem),
    result?.profile.length ? profile(result.profile) : null,
    result?.note ? element("p", { class: "muted" }, result.note) : null,
    element("button", { type: "button", onclick: guarded(async () => list(await post("forget", { number }))) }, t("Remove")));
}

// The heights along a line, with a band of one standard deviation.
function profile(samples) {
  const [width, height, left, bottom] = [300, 130, 46, 18];
  const known = samples.filter(s => s.height_m !== null), long = samples.at(-1).along_m;
  const low = Math.min(...known.map(s => s.height_m - s.sigma_m)), high = Math.max(...known.map(s => s.height_m + s.sigma_m));
  const x = s => left + (width - left - 4) * s.along_m / (long || 1), y = h => 6 + (height - bottom - 10) * (high - h) / (high - low || 1);
  const runs = [];
  for (const s of samples) {
    if (s.height_m === null) runs.push([]);
    else if (runs.length) runs.at(-1).push(s);
    else runs.push([s]);
  }
  const path = points => points.map(([a, b], n) => `${n ? "L" : "M"}${a.toFixed(1)} ${b.toFixed(1)}`).join("");
  const svg = (tag, attributes, text = null) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    if (text !== null) made.textContent = text;
    return made;
  };
  const picture = svg("svg", { viewBox: `0 0 ${width} ${height}`, class: "profile", role: "img", "aria-label": t("Profile of {length} m", { length: fixed(long, 1) }) });
  for (const part of runs.filter(run => run.length)) {
    const band = [...part.map(s => [x(s), y(s.height_m + s.sigma_m)]), ...part.toReversed().map(s => [x(s), y(s.height_m - s.sigma_m)])];
    picture.append(svg("path", { d: `${path(band)}Z`, class: "band" }), svg("path", { d: path(part.map(s => [x(s), y(s.height_m)])), class: "line" }));
  }
  picture.append(svg("text", { x: left - 4, y: 12, "text-anchor": "end" }, fixed(high, 2)), svg("text", { x: left - 4, y: height - bottom, "text-anchor": "end" }, fixed(low, 2)),
    svg("text", { x: left, y: height - 4 }, "0"), svg("text", { x: width - 4, y: height - 4, "text-anchor": "end" }, `${fixed(long, 1)} m`));
  return picture;
}

function legend(layer) {
  $("legend").hidden = layer.kind === "picture";
  if (layer.kind === "picture") return;
  const bar = element("span", { class: "bar" });
  bar.style.background = `linear-gradient(to right, ${ramp(layer.kind).join(", ")})`;
  fill($("legend"), element("span", {}, fixed(layer.range[0], 2)), bar, element("span", {}, `${fixed(layer.range[1], 2)} m`));
}

$("three-d").addEventListener("click", guarded(async () => {
  const flat = $("three-d").getAttribute("aria-pressed") === "true";
  if (!flat && !$("view").src) {
    $("hint").textContent = t("Making the 3-D view …");
    const { file } = await post("view");
    $("view").src = resultAddress(file);
    $("hint").textContent = "";
  }
  $("three-d").setAttribute("aria-pressed", String(!flat));
  $("view").hidden = flat;
  $("result-map-frame").hidden = !flat;
}));
