// The survey on its map before any work: photographs, points, what is odd, what is assumed.

import { get, post } from "./api.js";
import { addBasemap } from "./basemap.js";
import * as coverage from "./coverage.js";
import { features, newMap, photographStyle, pointStyle, shownFully, vectorLayer } from "./maps.js";
import { $, element, ENGLISH, fill, figure, guarded } from "./page.js";
import { nt, t } from "./words.js";

const { ol } = window;
const COLOURS = ["#0b5573", "#b5541c", "#5b7f1f", "#7a4a9e", "#a0326a", "#32808f"];
let map = null, shown = null;

export async function show() {
  $("facts").textContent = t("Reading the tags of the photographs …");
  const overview = await get("overview");
  const places = JSON.stringify([overview.photographs, overview.points]);
  if (places !== shown) {
    shown = places;
    draw(overview);
    await addBasemap(map);
  }
  await coverage.show();
  fill($("facts"), ...facts(overview));
  $("roles").hidden = !overview.points.length;
  fill($("roles").querySelector("ul"), ...overview.points.map(role));
  fill($("assumptions"), ...overview.assumptions.map(assumption));
  const odd = overview.findings;
  fill($("findings"), ...(odd.length ? odd.map(finding) : [element("li", { class: "note" }, t("Nothing."))]));
}

function draw(overview) {
  map?.setTarget(null);
  const flights = [...new Set(overview.photographs.map(p => p.flight))];
  const colour = flight => COLOURS[flights.indexOf(flight) % COLOURS.length];
  const photographs = features(overview.photographs), points = features(overview.points, point => ({ role: point.role }));
  const lines = flights.map(flight => overview.photographs.filter(p => p.flight === flight && p.position_map_m).map(p => p.position_map_m.slice(0, 2)))
    .filter(places => places.length > 1).map(places => new ol.Feature(new ol.geom.LineString(places)));
  const track = new ol.style.Style({ stroke: new ol.style.Stroke({ color: "#8a979f", width: 1 }) });
  map = newMap("overview-map", [
    vectorLayer(lines, track),
    vectorLayer(photographs, feature => photographStyle(colour(feature.get("item").flight))),
    vectorLayer(points, pointStyle),
  ]);
  map.on("click", event => map.forEachFeatureAtPixel(event.pixel, feature => chosen(feature.get("item")), { hitTolerance: 6 }));
  coverage.onMap(map);
  const extent = ol.extent.createEmpty();
  for (const feature of [...photographs, ...points]) ol.extent.extend(extent, feature.getGeometry().getExtent());
  if (photographs.length || points.length) shownFully(map, ol.extent.getArea(extent) > 0 ? extent : ol.extent.buffer(extent, 50));
}

function role(point) {
  const select = element("select", { "aria-label": t("Role of {point}", { point: point.name }), "data-point": point.name },
    ...[["control", t("control")], ["check", t("check")]].map(([name, words]) => element("option", { value: name, selected: name === point.role }, words)));
  select.onchange = guarded(async () => {
    await post("role", { name: point.name, role: select.value });
    await show();
    $("roles").querySelector(`select[data-point="${CSS.escape(point.name)}"]`)?.focus();
  });
  return element("li", {}, element("span", {}, point.name), select, element("span", { class: "muted" }, nt("{n} mark", "{n} marks", point.marks)));
}

// A click on a point of the map leads to its role.
function chosen(item) {
  if (!("role" in item)) return false;
  $("roles").open = true;
  $("roles").querySelector(`select[data-point="${CSS.escape(item.name)}"]`).focus();
  return true;
}

function facts(overview) {
  const placed = overview.photographs.filter(p => p.position_map_m).length;
  const flights = new Set(overview.photographs.map(p => p.flight)).size;
  const roles = role => overview.points.filter(point => point.role === role);
  const marked = overview.points.filter(point => point.marks > 1).length;
  const n = overview.photographs.length, unmarked = overview.points.length - marked;
  const positions = placed === n
    ? flights > 1 ? t("{n}, all with a position, in {flights} flights", { n, flights }) : t("{n}, all with a position", { n })
    : flights > 1 ? t("{n}, {placed} with a position, in {flights} flights", { n, placed, flights }) : t("{n}, {placed} with a position", { n, placed });
  const rows = [
    [t("Map grid"), overview.crs],
    [t("Photographs"), positions],
    [nt("Camera", "Cameras", overview.cameras.length), overview.cameras.join(", ")],
    [t("Points"), overview.points.length
      ? t("{control} control, {check} check; {marked} marked in two photographs or more", { control: roles("control").length, check: roles("check").length, marked })
      : t("none: GNSS alone places the survey")],
  ];
  return [element("dl", {}, ...rows.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)])),
    unmarked ? element("p", {}, element("a", { href: "#points" }, nt("Mark {n} point", "Mark {n} points", unmarked))) : null];
}

function assumption(item) {
  const axes = [t("easting"), t("northing"), t("height")];
  const inputs = item.value_m.map((value, k) => element("input", {
    type: "number", min: "0.0001", step: "any", value: String(value), "aria-label": `${item.title}, ${axes[k]}, m`,
  }));
  const state = guarded(async () => {
    await post("accuracy", { name: item.name, sigma_m: inputs.map(input => Number(input.value)) });
    await show();
  });
  return element("details", { class: "chip" },
    element("summary", {}, t("{what}: assumed {figures}", { what: item.title, figures: item.value_m.map(v => figure(v, null, "m")).join("; ") })),
    element("p", { class: "muted" }, item.cost),
    element("div", { class: "path" }, ...inputs, element("button", { type: "button", onclick: state }, t("State this"))));
}

function finding(item) {
  return element("li", { class: item.severity }, element("b", {}, { error: t("Error"), warning: t("Warning"), note: t("Note") }[item.severity]), " ",
    element("span", ENGLISH, `${item.where}: ${item.text}`, item.remedy ? element("span", { class: "remedy" }, ` ${item.remedy}`) : null));
}
