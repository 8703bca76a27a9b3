// The loupe: the surroundings of the pointer, eight times as large as the photograph's own pixels.

import * as api from "./api.js";

const TIMES = 8, SIDE = 160, TILE = 128;
const canvas = document.querySelector("#loupe");
let wanted = null, tile = null, timer = 0;

export function hide() {
  wanted = null;
  canvas.hidden = true;
}

// Show the surroundings of a pixel beside the pointer.
export function follow(record, pixel, event, filter, turn) {
  wanted = { record, pixel, turn };
  canvas.hidden = false;
  canvas.style.filter = filter;
  const far = 24, x = event.clientX + far + SIDE > innerWidth ? event.clientX - far - SIDE : event.clientX + far;
  const y = event.clientY + far + SIDE > innerHeight ? event.clientY - far - SIDE : event.clientY + far;
  canvas.style.left = `${Math.max(x, 0)}px`;
  canvas.style.top = `${Math.max(y, 0)}px`;
  draw();
  if (!covers()) {
    clearTimeout(timer);
    timer = setTimeout(read, 60);
  }
}

function covers() {
  if (!tile || !wanted || tile.photograph !== wanted.record.name) return false;
  const [u, v] = wanted.pixel, half = SIDE / TIMES / 2, { width_px, height_px } = wanted.record;
  return Math.max(u - half, 0) >= tile.left && Math.max(v - half, 0) >= tile.upper
    && Math.min(u + half, width_px - 1) <= tile.left + tile.width && Math.min(v + half, height_px - 1) <= tile.upper + tile.height;
}

async function read() {
  if (!wanted) return;
  const { record, pixel } = wanted, left = Math.round(pixel[0]) - TILE / 2, upper = Math.round(pixel[1]) - TILE / 2;
  try {
    const read = await api.patch(record.name, left, upper, TILE, TILE, 1);
    tile?.bitmap.close();
    tile = { ...read, photograph: record.name };
    draw();
  } catch {
    hide(); // outside of the photograph
  }
}

function draw() {
  const side = Math.round(SIDE * devicePixelRatio);
  if (canvas.width !== side) canvas.width = canvas.height = side;
  const context = canvas.getContext("2d"), k = side / SIDE * TIMES;
  context.fillStyle = "#333";
  context.fillRect(0, 0, side, side);
  if (!wanted) return;
  const [u, v] = wanted.pixel;
  if (tile?.photograph === wanted.record.name) {
    context.imageSmoothingEnabled = false;
    context.save();
    context.translate(side / 2, side / 2);
    context.rotate(wanted.turn);
    context.drawImage(tile.bitmap, (tile.left - 0.5 - u) * k, (tile.upper - 0.5 - v) * k, tile.width * k, tile.height * k);
    context.restore();
  }
  context.beginPath();
  context.moveTo(side / 2, 0); context.lineTo(side / 2, side); context.moveTo(0, side / 2); context.lineTo(side, side / 2);
  for (const [colour, thick] of [["#000a", 3], ["#fff", 1]]) {
    context.strokeStyle = colour;
    context.lineWidth = thick;
    context.stroke();
  }
}
