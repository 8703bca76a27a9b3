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
