// Hand over: the report in a sentence, what it still lacks, and the files.

import { get, post, resultAddress } from "./api.js";
import { renew } from "./main.js";
import { $, element, fill, guarded, keepingFields, size } from "./page.js";
import { code, languages, t } from "./words.js";

const lines = () => [
  ["name", t("Title")], ["client", t("Client")], ["author", t("Who signs")], ["place", t("Place")],
  ["surveyor", t("Who surveyed the points")], ["instrument", t("Instrument")], ["targets", t("Targets")],
];
const titleOf = product => ({
  dxf: t("CAD drawing"), qgis: t("QGIS project"), landxml: "LandXML", glb: t("Textured model"), shapefile: "Shapefiles", kmz: "Google Earth", copc: t("Cloud for the web"), "3dtiles": "3D Tiles",
})[product] ?? product;
let delivering = false, spoken = null;

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
  const said = Object.fromEntries(lines().map(([key]) => [key, results.texts[key] ?? ""]));
  fill($("texts"), ...lines().map(([key, title]) => element("label", {}, title, element("input", { name: key, value: said[key], maxlength: 200 }))),
    element("label", {}, t("Language of the report"), element("select", { name: "language" }, ...languages().map(({ code: value, name }) => element("option", { value, selected: value === results.texts.language, lang: value }, name)))),
    results.has_measurements || results.with_measurements ? element("label", { class: "tick" }, element("input", { type: "checkbox", name: "measurements", value: "yes", checked: results.with_measurements }), t("With what was measured and named")) : "",
    element("button", { type: "submit" }, t("Keep, and renew the report")));
  $("missing").textContent = results.missing.length ? t("A report that is signed still lacks: {missing}.", { missing: results.missing.join("; ") }) : "";
  if (spoken !== code()) {
    const legend = $("products").querySelector("legend");
    await keepingFields($("products"), () => fill($("products"), legend, ...state.products.map(({ name, file, usual }) =>
      element("label", {}, element("input", { type: "checkbox", value: name, checked: usual }), titleOf(name), " ", element("small", {}, file)))));
    spoken = code();
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
  const ended = run.kind === "deliver" ? { done: t("written"), failed: run.text, stopped: t("stopped") }[run.state] ?? "" : "";
  fill($("deliver-words"), element("span", { lang: !busy && run.state === "failed" ? run.lang : null }, busy ? t("writing …") : ended));
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
  const measured = $("texts").elements.measurements;
  await post("texts", { texts: { ...Object.fromEntries(new FormData($("texts"))), ...(measured ? { measurements: measured.checked ? "yes" : "" } : {}) } });
  await post("start");
  await renew();
}));
