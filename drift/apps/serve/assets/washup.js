// The coast of a spill's result: stretches by rank, as a list and on the map, and the planned patrols.
import { layer_of, shade_of, shape } from "./drawn.js";
import { opened, tab, text } from "./editor.js";
import * as form from "./form.js";
import { all, ask, button, file_of, get, guarded, make } from "./kit.js";
import * as sea from "./map.js";

// classes of ranks: up to which, how wide the line is [px], and its shade
const RANKS = [{ most: 3, width: 10, shade: 4 }, { most: 10, width: 7, shade: 3 }, { most: 30, width: 5, shade: 2 }, { most: Infinity, width: 3, shade: 1 }];
const NUMBERED = 10; // stretches whose rank stands on the map
const LISTED = 15; // stretches of the list, until the user asks for more
const LEAST = 0.005; // expected objects of a stretch that is shown
const own = {
  told: /** @type {Washup | null} */ (null),
  key: "",
  chosen: /** @type {number | null} */ (null), // number of a stretch among those told
  all: false, // whether the whole list is shown
  built: "",
};
const bands = layer_of(12);
sea.switch_with("areas", bands.layer);
const patrolled = layer_of(11);
const marks = layer_of(50); // above all: of two names that overlap the upper one stays

/** @param {number} value a number of objects */
const many = (value) => (value === 0 ? "0" : value < 0.05 ? "< 0.1" : value < 10 ? value.toFixed(1) : value.toFixed(0));
/** @param {number} share */
const percent = (share) => (share > 0.995 && share < 1 ? "> 99 %" : share < 0.005 && share > 0 ? "< 1 %" : `${Math.round(100 * share)} %`);

/** Return the number of the output that is shown. */
function time_of() {
  const { told } = own;
  const now = sea.shown.times[sea.shown.index];
  if (!told || now === undefined) return Math.max(0, (told?.times.length ?? 0) - 1);
  const off = told.times.map((one) => Math.abs(epoch(one) - now));
  return off.indexOf(Math.min(...off));
}

/** Return the stretches by rank, at the time and of the class that are shown. */
function ranked() {
  const { told } = own;
  if (!told) return [];
  const values = told.expected[Number(get("stretch-class").value)][time_of()];
  return values.map((value, k) => ({ value, k })).filter(({ value }) => value >= LEAST).sort((a, b) => b.value - a.value);
}

// --- opening -------------------------------------------------------------------------------------------------------------
/**
 * Show the stretches of a result, and its patrols if it has any.
 * @param {string} run
 * @param {string} key of its files
 * @param {string[]} files
 */
export const open_washup = guarded(async (/** @type {string} */ run, /** @type {string} */ key, /** @type {string[]} */ files) => {
  /** @type {Washup} */
  const told = await ask("/api/washup", { run });
  own.key = key;
  show(told);
  get("story-line").hidden = true; // the class is chosen beside the stretches
  const sheets = Object.entries(SHEETS).filter(([name]) => files.includes(name));
  get("washup-files").replaceChildren(...sheets.map(([name, words]) => {
    return make("li", {}, make("a", { href: file_of(run, key, name), target: "_blank", rel: "noopener noreferrer" }, words));
  }));
  tab("washup");
});
const SHEETS = {
  "patrols.txt": "schedule of the patrols",
  "patrols.png": "sheet of the patrols",
  "patrols.csv": "patrols, as a table",
  "patrols_left_out.csv": "stretches too long for a team's day",
  "washup.png": "sheet of the stretches",
  "washup.csv": "stretches, as a table",
  "finds.csv": "finds, as a table",
  "totals.csv": "all objects by time, as a table",
};

/** Show no stretches. */
export function close_washup() {
  Object.assign(own, { told: null, chosen: null, built: "" });
  for (const { source } of [bands, patrolled, marks]) source.clear(true);
  get("ranks").hidden = true;
  const [button_of_tab] = /** @type {HTMLButtonElement[]} */ (all("[data-tab=washup]"));
  button_of_tab.hidden = true;
  if (button_of_tab.getAttribute("aria-pressed") === "true") tab(opened.name === null ? "cases" : "form");
}

/** @param {Washup} told */
function show(told) {
  Object.assign(own, { told, chosen: null, all: false, built: "" });
  all("[data-tab=washup]")[0].hidden = false;
  get("ranks").hidden = false;
  get("stretch-class-line").hidden = told.classes.length < 2;
  get("stretch-class").replaceChildren(make("option", { value: 0 }, "all objects"), ...(told.classes.length < 2 ? [] : told.classes.map((name, k) => {
    return make("option", { value: k + 1 }, name);
  })));
  get("washup-files").replaceChildren();
  get("washup-of").textContent = told.run || "First map, of few simulated spills";
  get("washup-warned").replaceChildren(...told.warnings.map((line) => make("li", {}, line)));
  list_patrols(told);
  draw();
  const worst = ranked().slice(0, NUMBERED).flatMap(({ k }) => told.stretches[k].lines.flat());
  const places = told.patrols.length ? told.patrols.flatMap(({ visits }) => visits.flatMap(({ segment }) => lines_of(segment).flat())) : worst;
  if (places.length) sea.look_at(places);
}

// --- the list and the map ------------------------------------------------------------------------------------------------
/** @param {number} segment @returns {Point[][]} */
const lines_of = (segment) => own.told?.stretches.find((one) => one.segment === segment)?.lines ?? [];

/** Draw the stretches, and write the list, for the time and class that are shown. */
function draw() {
  const { told } = own;
  for (const { source } of [bands, patrolled, marks]) source.clear(true);
  if (!told) return;
  const rows = ranked();
  rows.forEach(({ k }, place) => {
    const { width, shade } = class_of(place + 1);
    const strong = own.chosen === k;
    for (const line of told.stretches[k].lines) bands.source.addFeature(shape("line", line, { look: "stretch", width, shade, strong, stretch: k }));
    if (place < NUMBERED || strong) marks.source.addFeature(shape("point", [told.stretches[k].at], { look: "place", label: String(place + 1), stretch: k }));
  });
  for (const { visits, team, time } of told.patrols) {
    for (const { segment } of visits) {
      lines_of(segment).forEach((line) => patrolled.source.addFeature(shape("line", line, { look: "patrol", width: 20 })));
      const at = told.stretches.find((one) => one.segment === segment)?.at;
      if (at) marks.source.addFeature(shape("point", [at], { look: "planned_point", label: `${team}, ${group(epoch(time)).slice(0, 6)}Z` }));
    }
  }
  // the finds of an open case are on the map already
  for (const { name, at, odd } of told.finds.filter((one) => one.odd || !form.is_spill())) marks.source.addFeature(shape("point", [at], { look: "find", label: odd ? `${name}: odd` : name }));
  legend(rows.length);
  write(rows);
}
sea.follow(draw);

/** @param {number} rank */
const class_of = (rank) => RANKS.find(({ most }) => rank <= most) ?? RANKS[3];

/** @param {number} number of stretches that are shown */
function legend(number) {
  let from = 1;
  const items = RANKS.flatMap(({ most, width, shade }) => {
    const [first, last] = [from, Math.min(most, number)];
    from = most + 1;
    if (first > number) return [];
    const swatch = make("span", { class: "swatch", "aria-hidden": "true" });
    swatch.style.borderTopWidth = `${width}px`;
    swatch.style.borderTopColor = shade_of(shade);
    return [make("li", {}, swatch, first === last ? ` ${first}` : ` ${first} to ${last}`)];
  });
  if (own.told?.patrols.length) items.push(make("li", {}, "framed, with a team's name: planned patrol"));
  get("rank-list").replaceChildren(...items);
}

/** @param {{value: number, k: number}[]} rows */
function write(rows) {
  const { told } = own;
  if (!told) return;
  const t = time_of();
  const [mean, low, high] = told.ashore[t];
  const time = group(epoch(told.times[t]));
  get("washup-words").textContent = `By ${time}: ${many(mean)} of ${many(told.lost)} objects stranded (${many(low)} to ${many(high)} with 80 % probability)${told.finds.length ? ", without those found" : ""}.`;
  const one_class = Number(get("stretch-class").value) > 0;
  const shown = own.all ? rows : rows.slice(0, LISTED);
  const sign = JSON.stringify([told.run, t, get("stretch-class").value, own.all]);
  if (own.built !== sign) {
    own.built = sign;
    const focus = document.activeElement instanceof HTMLElement ? document.activeElement.dataset.stretch : undefined;
    get("stretch-rows").replaceChildren(...shown.map(({ value, k }, place) => {
      const { name, length_km, first } = told.stretches[k];
      const figures = one_class ? `${many(value)} on average`
        : `${many(value)} on average (${told.low[t][k]} to ${told.high[t][k]}); any: ${percent(told.probability[t][k])}`;
      const more = `${length_km.toFixed(1)} km${first ? ` · first arrival, median: ${group(epoch(first))}` : ""}`;
      const go = button(`${place + 1}. ${name}`, () => choose(k, true), { class: "link", "data-stretch": String(k), "aria-pressed": "false" });
      return make("li", {}, go, make("p", {}, figures), make("p", { class: "soft" }, more));
    }));
    if (!rows.length) get("stretch-rows").append(make("li", { class: "soft" }, "No object is stranded at this time."));
    if (focus !== undefined) all(`[data-stretch="${focus}"]`)[0]?.focus();
  }
  for (const one of all("[data-stretch]")) one.setAttribute("aria-pressed", String(Number(one.dataset.stretch) === own.chosen));
  const rest = rows.length - shown.length;
  get("more-stretches").hidden = rest <= 0;
  get("more-stretches").textContent = `Show ${rest} more`;
}

/**
 * Choose a stretch, in the list or on the map.
 * @param {number} k
 * @param {boolean} go whether the map goes there
 */
function choose(k, go) {
  const { told } = own;
  if (!told) return;
  own.chosen = k;
  if (!ranked().slice(0, own.all ? undefined : LISTED).some((one) => one.k === k)) Object.assign(own, { all: true, built: "" });
  draw();
  if (go) {
    const [lon, lat] = told.stretches[k].at;
    sea.look_at([...told.stretches[k].lines.flat(), ...sea.circle([lon, lat], 12000)]);
    get("map").scrollIntoView({ block: "nearest" });
  } else {
    tab("washup");
    all(`[data-stretch="${k}"]`)[0]?.scrollIntoView({ block: "nearest" });
  }
}

sea.chart.on("singleclick", (event) => {
  if (sea.picking() || !own.told) return;
  const found = sea.chart.forEachFeatureAtPixel(event.pixel, (feature) => feature, {
    hitTolerance: 6,
    layerFilter: (layer) => layer === bands.layer || layer === marks.layer,
  });
  const k = found?.get("stretch");
  if (typeof k === "number") choose(k, false);
});
get("stretch-class").addEventListener("change", () => {
  draw();
  if (!own.told?.run) return;
  get("story").value = own.told.classes[Number(get("stretch-class").value) - 1] ?? ""; // the areas of the same class
  get("story").dispatchEvent(new Event("change"));
});
get("more-stretches").addEventListener("click", () => {
  own.all = true;
  draw();
});

// --- patrols -------------------------------------------------------------------------------------------------------------
/** @param {Washup} told */
function list_patrols({ run, patrols, plan }) {
  get("patrols-box").hidden = plan === null;
  if (!plan) return;
  get("patrols-total").textContent = `${many(plan.found)} ± ${many(plan.found_se)} objects found on average; no plan of these teams finds more than ${many(plan.bound)}.`;
  get("patrols-said").textContent = "";
  get("patrol-list").replaceChildren(...patrols.map((patrol) => {
    const visits = patrol.visits.map(({ segment, name, lying, found }) => {
      const k = own.told?.stretches.findIndex((one) => one.segment === segment) ?? -1;
      const go = k < 0 ? name : button(own.told?.stretches[k].name ?? name, () => choose(k, true), { class: "link" });
      return make("li", {}, go, make("p", { class: "soft" }, `${many(found)} found of ${many(lying)} lying there`));
    });
    const keep = button("Keep as carried out", () => keep_patrol(run, patrol.name), { "aria-label": `Keep ${patrol.name} as carried out` });
    return make("li", {}, make("p", { class: "name" }, `${group(epoch(patrol.time))} ${patrol.team}`),
      make("p", {}, `${patrol.length_km.toFixed(1)} km of shore, ${many(patrol.found)} found`), make("ol", {}, ...visits), make("p", { class: "line", "data-changes": "" }, keep));
  }));
}

/** @param {string} run @param {string} patrol */
async function keep_patrol(run, patrol) {
  const its_case = `${run.replace(/-plan(-\d+)?$/, "")}.toml`;
  if (opened.name !== its_case) {
    get("patrols-said").textContent = `This is a plan of ${its_case}: open that case to keep a patrol in it.`;
    return;
  }
  await form.work_on_text(null, async () => {
    /** @type {{text: string, name: string}} */
    const told = await ask("/api/washup/keep", { run, patrol, text: text.value });
    get("patrols-said").textContent = `Kept as the patrol "${told.name}": correct it under Finds and patrols to what was done, and add each object found.`;
    return told.text;
  });
}

form.follow_sketch(({ washup }) => {
  if (!washup) {
    close_washup();
    return;
  }
  show(washup);
});
