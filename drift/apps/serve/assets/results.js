// A result on the map: its scenarios, the value under the pointer, and what has changed since the run before.
import { layer_of, shape } from "./drawn.js";
import { changes } from "./changes.js";
import { export_part } from "./export.js";
import { looks_of, show_areas } from "./form.js";
import { ask, file_of, get, guarded, make } from "./kit.js";
import * as sea from "./map.js";

const LEVEL = 0.95; // of the outline of the run before
const own = {
  run: /** @type {Run | null} */ (null),
  before: /** @type {Run | null} */ (null), // the run before of the same case
  areas: /** @type {Areas | null} */ (null), // of all scenarios together
  told: /** @type {ResultOf | null} */ (null),
  earlier: /** @type {Compared | null} */ (null), // the run before
  scenario: /** @type {string | null} */ (null),
  timer: 0,
  asked: 0,
};
const earlier = layer_of(9);
sea.switch_with("areas", earlier.layer);

/** @param {Run} run the case of a run, by the name of its folder */
const case_of = (run) => run.name.replace(/-(forecast|plan)(-\d+)?$/, "");

/** @param {Run} run @returns {Promise<Areas>} */
async function contours(run) {
  const answer = await fetch(file_of(run.name, run.key, "contours.geojson"), { cache: "no-store" });
  if (!answer.ok) throw new Error(`${run.name} has no areas`);
  return answer.json();
}

/** The scenario that is chosen of the result on the map; null: all together, or no result. */
export const chosen_scenario = () => own.scenario;

/**
 * Show a result of the list on the map.
 * @param {Run} run
 * @param {Run[]} runs all results, the newest first
 * @param {{keep?: boolean, scenario?: string | null}} [more] keep: the view, the time and the layers stay
 */
export const show_result = guarded(async (/** @type {Run} */ run, /** @type {Run[]} */ runs, { keep = false, scenario = null } = {}) => {
  const areas = await contours(run);
  const older = runs.slice(runs.findIndex((one) => one.name === run.name) + 1);
  const before = older.find((one) => case_of(one) === case_of(run) && one.files.some((file) => file.name === "contours.geojson")) ?? null;
  Object.assign(own, { run, areas, before, told: null, earlier: null, scenario: null });
  show_areas(run.name, areas, { start: run.start || undefined }, keep);
  get("result").hidden = false;
  get("export").replaceChildren(export_part(run) ?? "");
  get("since-line").hidden = !before;
  get("since").checked = keep && get("since").checked && Boolean(before);
  get("since-name").textContent = before?.name ?? "";
  if (!keep) get("map").scrollIntoView({ block: "nearest" });
  const told = await result_of(run, null);
  if (own.run !== run) return null;
  own.told = told;
  sea.add({ likely: told.likely, particles: told.particles, looks: looks_of(told.statuses) });
  if (!keep && told.opens && sea.shown.index === sea.shown.times.length - 1) sea.go_to_time(epoch(told.opens));
  get("headline").textContent = title_of(run, told);
  get("story-line").hidden = told.scenarios.length < 2;
  get("story").replaceChildren(make("option", { value: "" }, "all, each as likely as it is"),
    ...told.scenarios.map(({ name, probability }) => make("option", { value: name }, `only ${name} (${(100 * (probability.at(-1) ?? 0)).toFixed(0)} %)`)));
  if (scenario !== null && told.scenarios.some((one) => one.name === scenario)) {
    get("story").value = scenario;
    await choose();
  }
  await read_earlier();
  return /** @type {Compared} */ ({ ...told, areas });
});

/**
 * Return what stands below the map. A plan shows its begin, and its report another time.
 * @param {Run} run
 * @param {ResultOf} told
 */
const title_of = (run, told) => `Areas of ${run.name}${run.kind === "plan" ? "" : `: ${told.words}`}`;

/** @param {Run} run @param {string | null} scenario @returns {Promise<ResultOf>} */
function result_of(run, scenario) {
  return ask("/api/result", { run: run.name, scenario });
}

/** Show no result: a first map, or nothing, takes its place. */
export function clear_result() {
  Object.assign(own, { run: null, before: null, areas: null, told: null, earlier: null, scenario: null });
  get("result").hidden = true;
  earlier.source.clear(true);
}

const choose = guarded(async () => {
  const { run, areas, told } = own;
  if (!run || !areas) return;
  const scenario = get("story").value || null;
  own.scenario = scenario;
  const shown = scenario === null ? { areas, times: undefined } : await result_of(run, scenario);
  if (own.run !== run || own.scenario !== scenario) return;
  const all = scenario === null && told ? { likely: told.likely, particles: told.particles, looks: looks_of(told.statuses) } : {};
  show_areas(scenario === null ? run.name : `${run.name}, if it is ${scenario}`, shown.areas, { times: shown.times, ...all }, true);
  if (scenario === null && told) get("headline").textContent = title_of(run, told);
});
get("story").addEventListener("change", choose);

// --- changed since -------------------------------------------------------------------------------------------------------
const read_earlier = guarded(async () => {
  const { before } = own;
  if (get("since").checked && before && !own.earlier) {
    const [areas, told] = await Promise.all([contours(before), result_of(before, null)]);
    if (own.before === before) own.earlier = { ...told, areas };
  }
  draw_earlier();
});
get("since").addEventListener("change", read_earlier);

/** Draw the outline of the run before at the output nearest to the time shown, and say what has changed. */
function draw_earlier() {
  earlier.source.clear(true);
  const now = sea.shown.times[sea.shown.index];
  const shown = get("since").checked && own.earlier && now !== undefined;
  get("since-words").hidden = !shown;
  if (!shown || !own.earlier) {
    get("since-time").textContent = "";
    return;
  }
  if (own.told && own.areas) get("since-words").textContent = `Since then: ${changes(own.earlier, { ...own.told, areas: own.areas }, now)}`;
  const held = own.earlier.areas.features.filter((one) => Math.abs((one.properties.level ?? 0) - LEVEL) < 1e-9);
  const times = held.map((one) => epoch(one.properties.time));
  const nearest = times.reduce((best, time) => (Math.abs(time - now) < Math.abs(best - now) ? time : best), times[0]);
  get("since-time").textContent = nearest === undefined ? ": it has no 95 % area" : ` at ${group(nearest)}`;
  const rings = held.filter((_, k) => times[k] === nearest).flatMap((one) => one.geometry.coordinates.map(([outer]) => outer));
  const longest = Math.max(...rings.map((ring) => ring.length));
  earlier.source.addFeatures(rings.map((ring) => {
    return shape("line", ring, { look: "line", label: ring.length === longest ? "95 % before" : "" });
  }));
}
sea.follow(draw_earlier);

// --- the value under the pointer -----------------------------------------------------------------------------------------
/** @param {Point} at */
function tell_value(at) {
  clearTimeout(own.timer);
  const held = sea.level_at(at);
  const words = held === null ? "" : `, in the ${Math.round(100 * held)} % area`;
  get("readout").textContent = `${position(at)}${sea.shown.areas ? words || ", outside the areas" : ""}`;
  const { run, scenario } = own;
  if (!run) return;
  const mine = ++own.asked;
  own.timer = setTimeout(async () => {
    const index = own.run?.kind ? time_index() : -1;
    if (index < 0) return;
    try {
      /** @type {{per_nmi2: number, within: number | null}} */
      const told = await ask("/api/result/value", { run: run.name, scenario, time: index, at });
      if (mine === own.asked && own.run === run) get("readout").textContent += ` · ${density(told.per_nmi2)} per nmi²`;
    } catch { /* it has no such output */ }
  }, 200);
}

/** @param {number} value */
const density = (value) => (value > 0 && value < 1e-5 ? "< 0.001 %" : `${Number((100 * value).toPrecision(2))} %`);

/** The number of the output that is shown: areas and outputs have the same times. */
const time_index = () => sea.shown.index;

sea.chart.on("pointermove", (event) => {
  if (!event.dragging) tell_value(sea.inverse(event.coordinate));
});
sea.chart.on("moveend", () => {
  if (document.activeElement === get("map")) tell_value(sea.middle());
});
