// Maps in the plane of the survey's own grid, in metres: nothing is fetched from elsewhere, but tiles that the command names.

import { element, fill } from "./page.js";

const { ol } = window;

export const PROJECTION = new ol.proj.Projection({ code: "survey", units: "m", axisOrientation: "enu" });

const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export function newMap(target, layers) {
  const map = new ol.Map({
    target,
    layers,
    view: new ol.View({ projection: PROJECTION, center: [0, 0], resolution: 1, maxResolution: 1e4, minResolution: 1e-3, constrainResolution: false }),
    controls: ol.control.defaults.defaults({ attribution: false, rotate: false }).extend([new ol.control.ScaleLine({ units: "metric" })]),
  });
  return map;
}

export function shownFully(map, extent) {
  map.updateSize();
  const options = { padding: [40, 40, 40, 40], minResolution: 0.002 };
  if (map.getSize()?.every(side => side > 100)) map.getView().fit(extent, { ...options, size: map.getSize() });
  else map.once("change:size", () => shownFully(map, extent));
}

const circle = (radius, fill, stroke) => new ol.style.Circle({ radius, fill: new ol.style.Fill({ color: fill }), stroke: new ol.style.Stroke({ color: stroke, width: 1.5 }) });

function labelled(text) {
  return new ol.style.Text({
    text, font: "13px sans-serif", offsetY: -14,
    fill: new ol.style.Fill({ color: css("--ink") }), stroke: new ol.style.Stroke({ color: css("--paper"), width: 3 }),
  });
}

export function pointStyle(feature) {
  const control = feature.get("role") === "control";
  return new ol.style.Style({
    image: new ol.style.RegularShape({
      points: control ? 3 : 4, radius: 8, angle: control ? 0 : Math.PI / 4,
      fill: new ol.style.Fill({ color: control ? css("--attention") : css("--good") }),
      stroke: new ol.style.Stroke({ color: css("--paper"), width: 1.5 }),
    }),
    text: labelled(feature.get("name")),
  });
}

export function photographStyle(colour) {
  return new ol.style.Style({ image: circle(4, colour, css("--paper")) });
}

export function features(items, more = () => ({})) {
  return items.filter(item => item.position_map_m).map(item => new ol.Feature({
    geometry: new ol.geom.Point(item.position_map_m.slice(0, 2)), name: item.name, item, ...more(item),
  }));
}

export function vectorLayer(list, style) {
  return new ol.layer.Vector({ source: new ol.source.Vector({ features: list }), style });
}

// Colours of heights (viridis, by 8 of its colours) and of standard deviations (light to dark red).
const RAMPS = {
  heights: ["#440154", "#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725"],
  sigma: ["#fff5eb", "#fee0c2", "#fdbd82", "#f98b4a", "#e25a1c", "#b53b02", "#7f2704"],
};

export const ramp = kind => RAMPS[kind];

// Of differences: lower, in between and higher, as in comparison.png; grey is within the level of detection.
const LOWER = ["#053061", "#2166ac", "#4393c3", "#92c5de"], HIGHER = ["#f4a582", "#d6604d", "#b2182b", "#67001f"];
const AROUND_ZERO = [...LOWER, "#f7f7f7", ...HIGHER], WITHIN = "#9aa3a8", UNTOLD = "#d8c48f";
const NOTHING = -9000, NO_LEVEL = 255, NO_VALUE = -1e6;

// A difference and what has changed, two rasters with the same cells: cells within the level of detection are grey, and
// those that were filled, which have none, of a colour of their own. What stands for no data is told apart here.
export function differenceLayer(address, half) {
  const source = new ol.source.GeoTIFF({
    sources: ["difference.tif", "change.tif"].map(name => ({ url: address(name), bands: [1], nodata: NO_VALUE })),
    projection: PROJECTION, normalize: false, convertToRGB: false, interpolate: false, wrapX: false, transition: 0,
  });
  const stops = AROUND_ZERO.flatMap((colour, n) => [half * (2 * n / (AROUND_ZERO.length - 1) - 1), colour]);
  const color = ["case", ["any", ["==", ["band", 3], 0], ["<", ["band", 1], NOTHING]], ["color", 0, 0, 0, 0],
    ["==", ["band", 2], 0], WITHIN, ["==", ["band", 2], NO_LEVEL], UNTOLD, ["interpolate", ["linear"], ["band", 1], ...stops]];
  return new ol.layer.WebGLTile({ source, style: { color } });
}

export function differenceLegend(parent, { half_range: half, unit, has_untold: hasUntold }) {
  const bar = element("span", { class: "bar" });
  bar.style.background = `linear-gradient(to right, ${AROUND_ZERO.join(", ")})`;
  const swatch = (colour, words) => {
    const square = element("i");
    square.style.background = colour;
    return element("span", { class: "swatch" }, square, words);
  };
  parent.hidden = false;
  fill(parent, element("span", {}, `cut −${half}`), bar, element("span", {}, `+${half} ${unit} fill`),
    swatch(WITHIN, "within the level of detection"), hasUntold ? swatch(UNTOLD, "filled, without one") : null);
}

// A raster; layers of another class than their neighbours have a canvas of their own.
export function rasterLayer(layer, address, className = "ol-layer") {
  const picture = layer.kind === "picture";
  const source = new ol.source.GeoTIFF({
    sources: [{ url: address, ...(picture ? { bands: [1, 2, 3, 4] } : {}) }],
    projection: PROJECTION, normalize: picture, convertToRGB: false, interpolate: picture, wrapX: false, transition: 0,
  });
  let style = { color: ["array", ["band", 1], ["band", 2], ["band", 3], ["band", 4]] };
  if (!picture) {
    const [low, high] = layer.range, colours = RAMPS[layer.kind];
    const stops = colours.flatMap((colour, n) => [low + (high - low) * n / (colours.length - 1), colour]);
    style = { color: ["case", ["==", ["band", 2], 0], ["color", 0, 0, 0, 0], ["interpolate", ["linear"], ["band", 1], ...stops]] };
  }
  return { layer: new ol.layer.WebGLTile({ source, style, className }), source };
}
