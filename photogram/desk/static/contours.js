// Contour lines as a layer of the map: those of the survey, or of an interval that is asked for.

import { get } from "./api.js";
import { $, element, guarded } from "./page.js";
import { number, t } from "./words.js";

const { ol } = window;
const INK = "#5b3413", HALO = "rgba(255, 255, 255, .75)";

// The layer, empty until it is first shown.
export function contourLayer() {
  const source = new ol.source.Vector();
  const layer = new ol.layer.VectorImage({ source, style, visible: false, imageRatio: 1.2 });
  let interval = null, drawn = false;
  const draw = guarded(async () => {
    $("hint").textContent = t("Drawing contour lines …");
    try {
      const contours = await get("contours", interval ? { interval_m: interval } : {});
      source.clear();
      source.addFeatures(contours.lines.map(line => new ol.Feature({ geometry: new ol.geom.LineString(line.places_map_m), index: line.is_index, height: line.height_m })));
      drawn = true;
      $("hint").textContent = t("Contour lines every {interval} m, {source}.", { interval: number(contours.interval_m), source: contours.of });
    } catch (error) {
      $("hint").textContent = "";
      throw error;
    }
  });
  const box = element("label", {}, element("input", { type: "checkbox", onchange: async event => {
    layer.setVisible(event.target.checked);
    field.hidden = !event.target.checked;
    if (event.target.checked && !drawn) await draw();
    else $("hint").textContent = "";
  } }), t("Contour lines"));
  const field = element("label", { hidden: true, class: "small" }, t("every, m"), " ", element("input", { type: "number", min: "0.01", step: "any", placeholder: t("as delivered"), onchange: event => { interval = event.target.value || null; draw(); } }));
  return { layer, controls: [box, field] };
}

function style(feature, resolution) {
  const index = feature.get("index"), width = index ? 1.8 : .9;
  const lines = [new ol.style.Style({ stroke: new ol.style.Stroke({ color: HALO, width: width + 1.6 }) }), new ol.style.Style({ stroke: new ol.style.Stroke({ color: INK, width }) })];
  if (index && feature.getGeometry().getLength() > 150 * resolution) {
    lines.push(new ol.style.Style({ text: new ol.style.Text({ text: number(Math.round(feature.get("height") * 100) / 100), placement: "line", font: "12px sans-serif", fill: new ol.style.Fill({ color: INK }), stroke: new ol.style.Stroke({ color: HALO, width: 3 }) }) }));
  }
  return lines;
}
