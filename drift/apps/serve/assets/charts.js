// Charts of the user's own, as tiles of images: above the shipped shoreline, under all else. The map's Mercator is that of tiles
// on the web, on a sphere of another size, so a tile needs no more than another scale.
import { ask, get, guarded, make } from "./kit.js";
import { chart as sea, map } from "./map.js";

const FAR = Math.PI * R; // [m] from the middle of the map to its edges
const world = [-FAR, -FAR, FAR, FAR];

/** Show the charts that the server has, with a box for each among the layers. What was switched off stays off. */
export const show_charts = guarded(async () => {
  /** @type {{charts: Chart[]}} */
  const told = await ask("/api/charts");
  get("charts").replaceChildren(...told.charts.map(switched));
});

/**
 * Add a chart to the map, and return its box.
 * @param {Chart} told
 * @param {number} number
 */
function switched({ name, attribution, least, most, bounds }, number) {
  const tileGrid = ol.tilegrid.createXYZ({ extent: world, minZoom: least, maxZoom: most });
  const url = `/api/charts/${number}/{z}/{x}/{y}`;
  const layer = new ol.layer.Tile({
    source: new ol.source.XYZ({ url, tileGrid, projection: map.projection, wrapX: true }),
    zIndex: 2,
    extent: bounds ? [...map.forward([bounds[0], bounds[1]]), ...map.forward([bounds[2], bounds[3]])] : undefined,
  });
  sea.addLayer(layer);
  const off = `chart off: ${name}`;
  const box = make("input", { type: "checkbox", checked: !remembered(off) });
  box.addEventListener("change", () => {
    layer.setVisible(box.checked);
    remember(off, !box.checked);
  });
  layer.setVisible(box.checked);
  const maker = attribution ? make("span", { class: "soft" }, ` (${attribution})`) : null;
  return make("label", {}, box, ` Chart: ${name}`, maker);
}

/** @param {string} what */
function remembered(what) {
  try {
    return localStorage.getItem(what) !== null;
  } catch {
    return false; // no storage here
  }
}

/**
 * Remember something in this browser, or forget it.
 * @param {string} what
 * @param {boolean} on
 */
function remember(what, on) {
  try {
    if (on) localStorage.setItem(what, "1");
    else localStorage.removeItem(what);
  } catch { /* no storage here */ }
}
