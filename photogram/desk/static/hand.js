// Hand over: the report in a sentence, what it still lacks, and the files.

import { get, post, resultAddress } from "./api.js";
import { renew } from "./main.js";
import { $, element, fill, guarded, size } from "./page.js";

const LINES = [["name", "Title"], ["client", "Client"], ["author", "Who signs"], ["place", "Place"], ["surveyor", "Who surveyed the points"], ["instrument", "Instrument"], ["targets", "Targets"]];
const LANGUAGES = [["en", "English"], ["de", "Deutsch"], ["es", "Español"], ["pt", "Português"], ["fr", "Français"]];
const PRODUCTS = {
  dxf: "CAD drawing", qgis: "QGIS project", landxml: "LandXML", glb: "Textured model", shapefile: "Shapefiles", kmz: "Google Earth", copc: "Cloud for the web", "3dtiles": "3D Tiles",
};
let delivering = false;

export async function show(state) {
  const results = await get("results");
  $("no-results").hidden = Boolean(results.headline);
  $("handing").hidden = !results.headline;
  if (!results.headline) return;
  const { headline } = results;
  $("headline").className = `headline ${headline.grade}`;
  fill($("headline"), headline.sentence, headline.also ? ` ${headline.also}` : null);
  fill($("to-do"), ...headline.to_do.map(text => element("li", {}, text)));
  if (results.report) $("report").href = resultAddress(results.report);
  const said = Object.fromEntries(LINES.map(([key]) => [key, results.texts[key] ?? ""]));
  fill($("texts"), ...LINES.map(([key, title]) => element("label", {}, title, element("input", { name: key, value: said[key], maxlength: 200 }))),
    element("label", {}, "Language", element("select", { name: "language" }, ...LANGUAGES.map(([code, name]) => element("option", { value: code, selected: code === results.texts.language, lang: code }, name)))),
    element("button", { type: "submit" }, "Keep, and renew the report"));
  $("missing").textContent = results.missing.length ? `A report that is signed still lacks ${results.missing.join("; ")}.` : "";
  if (!$("products").querySelector("input")) {
    $("products").append(...state.products.map(({ name, file, usual }) => element("label", {}, element("input", { type: "checkbox", value: name, checked: usual }), PRODUCTS[name] ?? name, element("small", {}, ` ${file}`))));
  }
  $("package").hidden = !results.package;
  if (results.package) $("package").href = resultAddress(results.package);
  fill($("files").tBodies[0], ...results.products.map(file => element("tr", {},
    element("th", { scope: "row" }, element("a", { href: resultAddress(file.file), download: true }, file.file.split("/").at(-1))),
    element("td", {}, file.contents), element("td", { class: "figure" }, size(file.bytes)))));
}

export function told(run) {
  const busy = run.kind === "deliver" && (run.state === "running" || run.state === "paused");
  $("deliver").disabled = run.state === "running" || run.state === "paused";
  $("deliver-words").textContent = busy ? "writing …" : run.kind === "deliver" ? { done: "written", failed: run.text, stopped: "stopped" }[run.state] ?? "" : "";
  if (delivering && !busy) {
    delivering = false;
    renew();
  }
}

$("deliver").addEventListener("click", guarded(async () => {
  delivering = true;
  await post("deliver", { products: [...$("products").querySelectorAll("input:checked")].map(box => box.value) });
  await renew();
}));
$("texts").addEventListener("submit", guarded(async event => {
  event.preventDefault();
  await post("texts", { texts: Object.fromEntries(new FormData($("texts"))) });
  await post("start");
  await renew();
}));
