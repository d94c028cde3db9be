// A result in the formats of other programs: the server makes the file, which the page offers with its size.
import { bytes, button, get, guarded, make } from "./kit.js";

/** @type {[format: string, words: string, kinds: string][]} */
const FORMATS = [
  ["mail", "One file to mail (zip)", "forecast plan patrols"],
  ["kml", "Google Earth (KML)", "forecast plan patrols origin"],
  ["kmz", "Google Earth, packed (KMZ)", "forecast plan patrols"],
  ["gpx", "Chart plotters (GPX)", "forecast plan patrols origin"],
  ["geojson", "GIS (GeoJSON)", "forecast plan patrols origin"],
  ["geotiff", "GIS raster (GeoTIFF)", "forecast plan patrols"],
  ["rtz", "Routes for ECDIS (RTZ)", "plan"],
  ["sitrep", "SITREP and NAVTEX (text)", "forecast plan patrols"],
  ["gif", "Animation (GIF)", "forecast plan patrols"],
];

/**
 * Return a menu of formats for a result; null: there are none for its kind.
 * @param {Run} run
 */
export function export_part(run) {
  const own = FORMATS.filter(([, , kinds]) => kinds.split(" ").includes(run.kind));
  if (!own.length) return null;
  const options = own.map(([format, words]) => make("option", { value: format }, words));
  const choice = make("select", { "aria-label": `Format of the export of ${run.name}` }, ...options);
  const said = make("span", { class: "soft", role: "status" });
  const work = guarded(async () => {
    const format = choice.value;
    said.textContent = " Making the file ...";
    try {
      const { name, content } = await exported(run.name, format);
      const link = make("a", { href: URL.createObjectURL(content), download: name }, `Save ${name}`);
      said.replaceChildren(" ", link, ` (${bytes(content.size)})`);
    } catch (error) {
      said.textContent = "";
      throw error;
    }
  });
  const made = button("Make the file", work, { "aria-label": `Make the file of ${run.name}` });
  return make("span", { class: "line exporting", "data-changes": "" }, choice, made, said);
}

/**
 * Return the file of a format.
 * @param {string} run
 * @param {string} format
 */
async function exported(run, format) {
  const headers = { "Content-Type": "application/json" };
  const answer = await fetch("/api/export", { method: "POST", headers, body: JSON.stringify({ run, format }), credentials: "same-origin", cache: "no-store" });
  if (answer.headers.get("Content-Disposition") === null) {
    const told = await answer.json().catch(() => ({ error: `the server answered ${answer.status}` }));
    throw new Error(told.error ?? told.mistakes.join("\n"));
  }
  get("trouble").textContent = "";
  const name = answer.headers.get("Content-Disposition")?.match(/filename\*=UTF-8''(.+)$/)?.[1] ?? "export";
  return { name: decodeURIComponent(name), content: await answer.blob() };
}
