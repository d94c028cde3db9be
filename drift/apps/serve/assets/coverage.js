// The domain of the run, and what the chosen files of winds and currents cover, as boxes on the map.
import { layer_of, shape } from "./drawn.js";
import { switch_with } from "./map.js";
import * as sources from "./sources.js";

const PART = 45; // [deg] between points of a parallel: a box may go round the Earth
const POLE = 89; // [deg] beyond, the map ends
const of_domain = layer_of(5);
const of_files = layer_of(4);
switch_with("domain", of_domain.layer);
switch_with("covered", of_files.layer);

/**
 * Draw a box, with a name at its upper left corner.
 * @param {VectorSource} source
 * @param {Box} box
 * @param {string} look
 * @param {string} label
 */
function draw(source, [west, south, east, north], look, label) {
  const [low, high] = [Math.max(south, -POLE), Math.min(north, POLE)];
  const count = Math.max(1, Math.ceil((east - west) / PART));
  const lons = Array.from({ length: count + 1 }, (_, k) => west + (k / count) * (east - west));
  /** @type {Point[]} */
  const ring = [...lons.map((lon) => /** @type {Point} */ ([lon, high])), ...lons.reverse().map((lon) => /** @type {Point} */ ([lon, low])), [west, high]];
  source.addFeature(shape("line", ring, { look, box: label }));
  source.addFeature(shape("point", [[west, high]], { look, label }));
}

/** @param {Box | null} box of the case; null: not known */
export function show_domain(box) {
  of_domain.source.clear(true);
  if (box) draw(of_domain.source, box, "domain", "domain of the run");
}

/** Draw what the chosen files cover, as far as it is known. */
export function show_covered() {
  of_files.source.clear(true);
  for (const what of sources.SOURCES) {
    for (const { file, box } of sources.covered(what)) draw(of_files.source, box, `covers_${what}`, `${what}: ${file}`);
  }
}
sources.follow_covers(show_covered);
