// What the page asks of its server. Addresses are relative: they begin with the token of this session.

import { t } from "./words.js";

// What the server says of what it does not do, and in which language.
export class Refused extends Error {
  constructor(message, lang = null) {
    super(message);
    this.lang = lang;
  }
}

async function answered(response) {
  const content = await response.json().catch(() => ({}));
  if (!response.ok) throw new Refused(content.error ?? t("the server answered {status}", { status: response.status }), content.lang ?? (content.error ? "en" : null));
  return content;
}

async function tried(request) {
  try {
    return await request();
  } catch (error) {
    if (error instanceof TypeError) throw new Refused(t("photogram desk does not answer: start it again in the terminal"));
    throw error;
  }
}

export function get(name, query = {}) {
  const search = new URLSearchParams(query).toString();
  return tried(async () => answered(await fetch(`api/${name}${search ? `?${search}` : ""}`)));
}

export function post(name, body = {}) {
  const headers = { "Content-Type": "application/json" };
  return tried(async () => answered(await fetch(`api/${name}`, { method: "POST", headers, body: JSON.stringify(body) })));
}

export function resultAddress(file) {
  return new URL(`results/${file.split("/").map(encodeURIComponent).join("/")}`, document.baseURI).href;
}

export function comparedAddress(comparison, file) {
  return new URL(`compared/${encodeURIComponent(comparison)}/${file}`, document.baseURI).href;
}
