// The survey on its map before any work: photographs, points, what is odd, what is assumed.

import { get, post } from "./api.js";
import { addBasemap } from "./basemap.js";
import * as coverage from "./coverage.js";
import { features, newMap, photographStyle, pointStyle, shownFully, vectorLayer } from "./maps.js";
import { $, element, fill, figure, guarded, plural } from "./page.js";

const { ol } = window;
const COLOURS = ["#0b5573", "#b5541c", "#5b7f1f", "#7a4a9e", "#a0326a", "#32808f"];
let map = null, shown = null;

export async function show() {
  $("facts").textContent = "Reading the tags of the photographs …";
  const overview = await get("overview");
  if (JSON.stringify(overview) !== shown) {
    shown = JSON.stringify(overview);
    draw(overview);
    await addBasemap(map);
  }
  await coverage.show();
  fill($("facts"), ...facts(overview));
  $("roles").hidden = !overview.points.length;
  fill($("roles").querySelector("ul"), ...overview.points.map(role));
  fill($("assumptions"), ...overview.assumptions.map(assumption));
  const odd = overview.findings;
  fill($("findings"), ...(odd.length ? odd.map(finding) : [element("li", { class: "note" }, "Nothing.")]));
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
  const select = element("select", { "aria-label": `Role of ${point.name}`, "data-point": point.name },
    ...["control", "check"].map(name => element("option", { value: name, ...(name === point.role ? { selected: "" } : {}) }, name)));
  select.onchange = guarded(async () => {
    await post("role", { name: point.name, role: select.value });
    await show();
    $("roles").querySelector(`select[data-point="${CSS.escape(point.name)}"]`)?.focus();
  });
  return element("li", {}, element("span", {}, point.name), select, element("span", { class: "muted" }, plural(point.marks, "mark")));
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
  const rows = [
    ["Map grid", overview.crs],
    ["Photographs", `${overview.photographs.length}, ${placed === overview.photographs.length ? "all" : placed} with a position${flights > 1 ? `, in ${flights} flights` : ""}`],
    [overview.cameras.length > 1 ? "Cameras" : "Camera", overview.cameras.join(", ")],
    ["Points", overview.points.length ? `${roles("control").length} control, ${roles("check").length} check; ${marked} marked in two photographs or more` : "none: GNSS alone places the survey"],
  ];
  return [element("dl", {}, ...rows.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)])),
    overview.points.length && marked < overview.points.length ? element("p", {}, element("a", { href: "#points" }, `Mark ${plural(overview.points.length - marked, "point")}`)) : null];
}

function assumption(item) {
  const inputs = item.value_m.map((value, k) => element("input", {
    type: "number", min: "0.0001", step: "any", value: String(value), "aria-label": `${item.title}, ${["easting", "northing", "height"][k]}, m`,
  }));
  const state = guarded(async () => {
    await post("accuracy", { name: item.name, sigma_m: inputs.map(input => Number(input.value)) });
    await show();
  });
  return element("details", { class: "chip" },
    element("summary", {}, `${item.title}: assumed ${item.value_m.map(v => figure(v, null, "m")).join(", ")}`),
    element("p", { class: "muted" }, `If nobody states it: ${item.cost}.`),
    element("div", { class: "path" }, ...inputs, element("button", { type: "button", onclick: state }, "State this")));
}

function finding(item) {
  return element("li", { class: item.severity }, element("b", {}, { error: "Error", warning: "Warning", note: "Note" }[item.severity]), ` ${item.where}: ${item.text}`,
    item.remedy ? element("span", { class: "remedy" }, ` ${item.remedy}`) : null);
}
