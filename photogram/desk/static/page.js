// Small helpers of the page.

import { fixed, t } from "./words.js";

export const $ = id => document.getElementById(id);

export function element(tag, attributes = {}, ...content) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (typeof value === "boolean") made.toggleAttribute(name, value);
    else if (value !== null && value !== undefined) made.setAttribute(name, value);
  }
  made.append(...content.filter(part => part !== null && part !== undefined));
  return made;
}

export function fill(parent, ...content) {
  parent.replaceChildren(...content.filter(part => part !== null && part !== undefined));
}

// Show why something could not be done, where everybody sees it; nothing takes it away again.
export function problem(error) {
  $("problem").textContent = error ? error.message ?? String(error) : "";
  $("problem").hidden = !error;
  if (error?.lang) $("problem").lang = error.lang;
  else $("problem").removeAttribute("lang");
}

// A function that does something and shows why it could not be done.
export function guarded(work) {
  return async (...given) => {
    try {
      problem(null);
      return await work(...given);
    } catch (error) {
      problem(error);
      return undefined;
    }
  };
}

export function duration(seconds) {
  if (seconds < 1) return t("under 1 s");
  if (seconds < 90) return `${fixed(seconds, 0)} s`;
  if (seconds < 5400) return `${fixed(seconds / 60, 0)} min`;
  return `${fixed(seconds / 3600, 1)} h`;
}

export function size(bytes) {
  if (bytes < 1e5) return `${fixed(bytes / 1e3, 1)} kB`;
  if (bytes < 1e9) return `${fixed(bytes / 1e6, 1)} MB`;
  return `${fixed(bytes / 1e9, 2)} GB`;
}

// A figure with as many digits as its standard deviation gives: two of that.
export function figure(value, sigma, unit) {
  if (value === null) return t("not known");
  if (sigma === null || sigma === undefined) return `${fixed(value, unit === "m" ? 3 : 2)} ${unit}`;
  const digits = Math.min(Math.max(1 - Math.floor(Math.log10(Math.max(sigma, 1e-9))), 0), 4);
  return `${fixed(value, digits)} ± ${fixed(sigma, digits)} ${unit}`;
}

// What the engine says is English, whatever the page speaks: screen readers are told.
export const ENGLISH = { lang: "en" };

// Do what draws a part of the page anew, and keep what somebody has typed and chosen in it.
export async function keepingFields(parent, draws) {
  const fields = () => [...parent.querySelectorAll("input:not([type=file]), select")].map((field, number) => [[field.closest("[id]").id, field.name, isTicked(field) ? field.value : number].join("/"), field]);
  const before = new Map(fields().map(([key, field]) => [key, { value: field.value, checked: field.checked }]));
  await draws();
  for (const [key, field] of fields()) {
    const was = before.get(key);
    if (!was || (isTicked(field) ? field.checked === was.checked : field.value === was.value)) continue;
    if (isTicked(field)) field.checked = was.checked;
    else field.value = was.value;
    field.dispatchEvent(new Event("change")); // for what the field itself does; a form hears nothing of it
  }
}

const isTicked = field => field.type === "radio" || field.type === "checkbox";
