// What is asked of the server: addresses are relative to the page, so that its token is in all of them.

import { t } from "./words.js";

async function answered(response) {
  const value = await response.json();
  if (!response.ok) throw Object.assign(new Error(value.error ?? t("the server answered {status}", { status: response.status })), { lang: value.lang ?? null });
  return value;
}

const name = encodeURIComponent;

export const state = async (title) => answered(await fetch(title === null ? "state" : `state?point=${name(title)}`));
export const plan = async () => answered(await fetch("plan"));
export const changed = async (after) => (await answered(await fetch(`events?after=${after}`))).version;
export const ahead = (title, shown, side) => fetch(`ahead/${name(title)}?shown=${shown}&side=${side}`).catch(() => null);

export async function act(action) {
  const response = await fetch("action", {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(action),
  });
  return answered(response);
}

// A patch of a photograph and the window that it shows: left, upper, width, height in pixels of the photograph, from
// the corner of its top-left pixel.
export async function patch(photograph, x, y, width, height, scale, signal) {
  const address = `patch?photograph=${name(photograph)}&x=${x}&y=${y}&width=${width}&height=${height}&scale=${scale}`;
  const response = await fetch(address, { signal });
  if (!response.ok) await answered(response);
  const [left, upper, across, down] = response.headers.get("X-Window").split(" ").map(Number);
  const bitmap = await createImageBitmap(await response.blob(), { colorSpaceConversion: "none" });
  return { bitmap, left, upper, width: across, height: down, scale };
}
