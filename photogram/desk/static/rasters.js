// Rasters of the results on a map: cloud optimised GeoTIFFs, read in the parts that it shows and coloured here, on plain
// canvases, which machines without a graphics card draw as well.

import { PROJECTION } from "./maps.js";
import { element, fill, problem } from "./page.js";
import { number, t } from "./words.js";

const { ol, GeoTIFF } = window;
const MASK = 4; // of NewSubfileType
const SHADES = 1024;
let pool = null;

const workers = () => (pool ??= new GeoTIFF.Pool(Math.min(navigator.hardwareConcurrency || 2, 4)));

// A layer of one file, or of several with the same cells; ``colour`` turns the bands that are read into pixels. Layers of
// another class than their neighbours have a canvas of their own. Its extent is known once the file has been opened.
function cogLayer(addresses, colour, { interpolate = false, className = "ol-layer" } = {}) {
  const layer = new ol.layer.Tile({ className });
  const extent = begin(layer, addresses, colour, interpolate);
  extent.catch(problem);
  return { layer, extent };
}

async function begin(layer, addresses, colour, interpolate) {
  const files = await Promise.all(addresses.map(levels)), finest = files[0].at(-1);
  const [west, south, east, north] = finest.getBoundingBox(), extent = [west, south, east, north];
  const tileGrid = new ol.tilegrid.TileGrid({
    extent, origin: [west, north],
    resolutions: files[0].map(level => (east - west) / level.getWidth()),
    tileSizes: files[0].map(level => [level.getTileWidth(), level.getTileHeight()]),
  });
  const loader = async (z, x, y, { signal }) => {
    const [wide, high] = tileGrid.getTileSize(z), level = files[0][z];
    const window = [x * wide, y * high, Math.min((x + 1) * wide, level.getWidth()), Math.min((y + 1) * high, level.getHeight())];
    const bands = (await Promise.all(files.map(file => file[z].readRasters({ window, pool: workers(), signal })))).flatMap(read => [...read]);
    const picture = new ImageData(window[2] - window[0], window[3] - window[1]);
    colour(bands, picture.data);
    const tile = Object.assign(document.createElement("canvas"), { width: wide, height: high });
    tile.getContext("2d").putImageData(picture, 0, 0);
    return tile;
  };
  layer.setSource(new ol.source.ImageTile({ loader, tileGrid, projection: PROJECTION, interpolate, transition: 0, wrapX: false }));
  return extent;
}

// The picture and its overviews, the coarsest first, without masks.
async function levels(address) {
  const file = await GeoTIFF.fromUrl(address);
  const images = await Promise.all(Array.from({ length: await file.getImageCount() }, (_, number) => file.getImage(number)));
  return images.filter(image => !((image.fileDirectory.getValue("NewSubfileType") || 0) & MASK)).sort((a, b) => a.getWidth() - b.getWidth());
}

function asPicture([red, green, blue, alpha], pixels) {
  for (let n = 0, at = 0; n < red.length; n++, at += 4) {
    pixels[at] = red[n];
    pixels[at + 1] = green[n];
    pixels[at + 2] = blue[n];
    pixels[at + 3] = alpha[n];
  }
}

const channels = colour => [1, 3, 5].map(at => parseInt(colour.slice(at, at + 2), 16));

// The colours between those of a ramp, as many as the eye tells apart.
function shaded(colours) {
  const known = colours.map(channels), shades = new Uint8ClampedArray(3 * SHADES);
  for (let n = 0; n < SHADES; n++) {
    const place = n * (known.length - 1) / (SHADES - 1), below = Math.min(Math.floor(place), known.length - 2), share = place - below;
    for (let c = 0; c < 3; c++) shades[3 * n + c] = known[below][c] + share * (known[below + 1][c] - known[below][c]);
  }
  return shades;
}

// Put the colour of a value between two bounds into a pixel.
function put(pixels, at, shades, value, low, high) {
  const shade = 3 * Math.round(Math.min(Math.max((value - low) / (high - low), 0), 1) * (SHADES - 1));
  pixels[at] = shades[shade];
  pixels[at + 1] = shades[shade + 1];
  pixels[at + 2] = shades[shade + 2];
  pixels[at + 3] = 255;
}

function putFlat(pixels, at, colour) {
  const [red, green, blue] = channels(colour);
  pixels.set([red, green, blue, 255], at);
}

// Colours of heights (viridis, by 8 of its colours) and of standard deviations (light to dark red).
const RAMPS = {
  heights: ["#440154", "#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725"],
  sigma: ["#fff5eb", "#fee0c2", "#fdbd82", "#f98b4a", "#e25a1c", "#b53b02", "#7f2704"],
};

export const ramp = kind => RAMPS[kind];

// Of differences: lower, in between and higher, as in comparison.png; grey is within the level of detection.
const LOWER = ["#053061", "#2166ac", "#4393c3", "#92c5de"], HIGHER = ["#f4a582", "#d6604d", "#b2182b", "#67001f"];
const AROUND_ZERO = [...LOWER, "#f7f7f7", ...HIGHER], WITHIN = "#9aa3a8", UNTOLD = "#d8c48f";
const NOTHING = -9000, NO_LEVEL = 255;

// A difference and what has changed, two rasters with the same cells: cells within the level of detection are grey, and
// those that were filled, which have none, of a colour of their own.
export function differenceLayer(address, half) {
  const shades = shaded(AROUND_ZERO);
  return cogLayer(["difference.tif", "change.tif"].map(address), ([difference, change], pixels) => {
    for (let n = 0; n < difference.length; n++) {
      if (!(difference[n] >= NOTHING)) continue;
      if (change[n] === 0) putFlat(pixels, 4 * n, WITHIN);
      else if (change[n] === NO_LEVEL) putFlat(pixels, 4 * n, UNTOLD);
      else put(pixels, 4 * n, shades, difference[n], -half, half);
    }
  });
}

export function differenceLegend(parent, { half_range: half, unit, has_untold: hasUntold }) {
  const bar = element("span", { class: "bar" });
  bar.style.background = `linear-gradient(to right, ${AROUND_ZERO.join(", ")})`;
  const swatch = (colour, words) => {
    const square = element("i");
    square.style.background = colour;
    return element("span", { class: "swatch" }, square, words);
  };
  parent.hidden = false;
  fill(parent, element("span", {}, t("cut {figure}", { figure: `−${number(half)}` })), bar, element("span", {}, t("{figure} fill", { figure: `+${number(half)} ${unit}` })),
    swatch(WITHIN, t("within the level of detection")), hasUntold ? swatch(UNTOLD, t("filled, without one")) : null);
}

// A raster of the results, and where it lies.
export function rasterLayer(layer, address, className = "ol-layer") {
  if (layer.kind === "picture") return cogLayer([address], asPicture, { interpolate: true, className });
  const [low, high] = layer.range, shades = shaded(RAMPS[layer.kind]);
  return cogLayer([address], ([values], pixels) => {
    for (let n = 0; n < values.length; n++) if (values[n] >= NOTHING) put(pixels, 4 * n, shades, values[n], low, high);
  }, { className });
}
