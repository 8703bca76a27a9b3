// Maps in the plane of the survey's own grid, in metres: nothing is fetched from elsewhere, but tiles that the command names.

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

export function rasterLayer(layer, address) {
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
  return { layer: new ol.layer.WebGLTile({ source, style }), source };
}
