// A spill of many objects: the ship's track, classes, finds, patrols and teams, each a row of the case, and their places on the map.
import { layer_of, shape } from "./drawn.js";
import { lacks, opened, text } from "./editor.js";
import { dropped, saved } from "./files.js";
import * as form from "./form.js";
import { all, ask, button, focus_unless_typing, get, guarded } from "./kit.js";
import * as sea from "./map.js";
import { chosen, fill_inputs, inputs_of, list_of, variants_of } from "./rows.js";
import * as words from "./spills.js";

const own = {
  told: /** @type {Spill | null} */ (null),
  files: /** @type {string[]} */ ([]),
  objects: /** @type {[string, string][]} */ ([]),
  track: "", // how the ship's track is given, as it was built last
  fresh: false, // whether the map has yet to go to a ship's track that was just opened
};
const drawn = layer_of(26);

/** @type {RowTools} */
const tools = {
  set: form.change,
  pick: (field, told, several) => form.pick_for(field, told, several),
  files: () => own.files,
};
/** @param {SpillTable} table @returns {string[]} */
const names_of = (table) => (own.told?.rows[table] ?? []).map(({ values }) => String(values.name ?? ""));
/** @param {Value | undefined} value */
const range = (value) => (Array.isArray(value) ? value.join(" to ") : value === undefined ? "" : String(value));
const find_fields = () => words.find_fields(names_of("spill.class"), names_of("patrol"));
/** @param {Variant[]} variants @param {Row} row */
const which = (variants, row) => chosen(variants, row.values).id;

/** The lists, by the tables of the case. */
const LISTS = {
  "spill.class": list_of(get("class-rows"), {
    table: "spill.class",
    stem: "class",
    empty: "Nothing was lost yet: add what went overboard.",
    fields: () => [...words.CLASS, ...words.fields_of(words.drifting(own.objects)), ...words.fields_of(words.SINKING)],
    inputs: (prefix, row) => [...inputs_of(prefix, words.CLASS, tools),
      ...variants_of(prefix, "It is", words.drifting(own.objects), row.values, tools),
      ...variants_of(prefix, "Does it sink?", words.SINKING, row.values, tools)],
    sign: (row) => [which(words.drifting([]), row), which(words.SINKING, row), own.objects.length],
    heading: ({ values }) => [values.number === undefined ? "how many?" : `${range(values.number)} lost`],
    look: null,
  }, tools),
  "spill.loss": list_of(get("loss-rows"), {
    table: "spill.loss",
    stem: "loss",
    empty: "No time of loss yet: it needs at least one.",
    fields: () => words.LOSS,
    inputs: (prefix) => inputs_of(prefix, words.LOSS, tools),
    sign: () => "",
    heading: ({ values }, k) => [own.told?.shapes.losses[k]?.period ?? range(values.begin)],
    look: (k) => look_at(own.told?.shapes.losses[k]?.points),
  }, tools),
  find: list_of(get("find-rows"), {
    table: "find",
    stem: "find",
    empty: "Nothing was found yet.",
    fields: () => [...find_fields(), ...words.fields_of(words.FOUND_AT), ...words.fields_of(words.FOUND_WHEN)],
    inputs: (prefix, row) => {
      const [name, ...rest] = inputs_of(prefix, find_fields(), tools);
      return [name, ...variants_of(prefix, "It was", words.FOUND_AT, row.values, tools),
        ...variants_of(prefix, "When?", words.FOUND_WHEN.filter((one) => one.id !== "patrol" || "by" in row.values), row.values, tools), ...rest];
    },
    sign: (row) => [which(words.FOUND_AT, row), which(words.FOUND_WHEN, row), names_of("spill.class"), names_of("patrol")],
    heading: ({ values }, k) => [String(values.class ?? ""), String(values.time ?? values.by_time ?? values.by ?? ""), off_shore(k)],
    look: (k) => look_at(around(own.told?.shapes.finds[k]?.at)),
  }, tools),
  patrol: list_of(get("patrol-rows"), {
    table: "patrol",
    stem: "patrol",
    empty: "No patrol yet.",
    fields: () => [...words.PATROL, ...words.fields_of(words.WALKED)],
    inputs: (prefix, row) => [...inputs_of(prefix, words.PATROL, tools), ...variants_of(prefix, "It searched", words.WALKED, row.values, tools)],
    sign: (row) => which(words.WALKED, row),
    heading: ({ values }) => [String(values.time ?? "")],
    look: (k) => look_at(own.told?.shapes.patrols[k]?.points),
  }, tools),
  patrol_unit: list_of(get("team-rows"), {
    table: "patrol_unit",
    stem: "team",
    empty: "No team yet: a plan needs at least one.",
    fields: () => [...words.TEAM, ...words.fields_of(words.REACH)],
    inputs: (prefix, row) => [...inputs_of(prefix, words.TEAM, tools), ...variants_of(prefix, "It goes", words.REACH, row.values, tools)],
    sign: (row) => which(words.REACH, row),
    heading: ({ values }) => [`${values.length ?? "?"} a day`, `from ${values.first ?? "?"}`],
    look: (k) => look_at(around(own.told?.shapes.teams[k]?.at)),
  }, tools),
};
const TABLES = /** @type {SpillTable[]} */ (Object.keys(LISTS));

/** Return whether there is a team to plan for; if not, show where to add it. */
export function can_plan() {
  return own.told?.rows.patrol_unit.length !== 0 || lacks("A plan needs at least one team: add it under 7, then press again.", get("add-team"));
}

// --- from the text to the rows -------------------------------------------------------------------------------------------
/** Show the part of the page that the case needs; of a spill read its rows. */
async function refresh() {
  const spill = form.is_spill();
  get("kind").value = spill ? "spill" : "search";
  for (const one of all("[data-for]")) one.hidden = one.dataset.for !== (spill ? "spill" : "search");
  const [tab] = all("[data-tab=search]");
  tab.textContent = spill ? "Finds and patrols" : "Search";
  all("[data-kind=plan]")[0].textContent = spill ? "Plan the patrols" : "Plan the next search";
  if (!spill) {
    own.told = null;
    drawn.source.clear(true);
    form.also_wrong([]);
    return;
  }
  /** @type {Spill} */
  const told = await ask("/api/spill", { text: text.value, name: opened.name });
  own.told = told;
  fill_track(told);
  for (const table of TABLES) LISTS[table].show(told.rows[table]);
  for (const [id, fields] of SINGLE) fill_inputs(get(id), "spill", fields, told.spill);
  const total = range(told.spill.values.objects);
  get("class-total").textContent = told.rows["spill.class"].length > 1 && total ? `${total} in all.` : "";
  form.also_wrong(Object.entries(told.shapes.finds).flatMap(([k, { mistake }]) => {
    return mistake ? [{ message: mistake, field: `find.${k}.at`, line: null }] : [];
  }));
  draw(told);
  const points = told.shapes.track;
  if (own.fresh && points.length > 1 && !sea.shown.areas) sea.look_at(points);
  own.fresh &&= points.length < 2;
}
form.follow(refresh);

/** @type {[string, FieldSpec[]][]} */
const SINGLE = [["clock-fields", words.CLOCK], ["release-fields", words.RELEASE], ["shared-fields", words.SHARED], ["silence-fields", words.SILENCE]];
for (const [id, fields] of SINGLE) get(id).append(...inputs_of("spill", fields, tools));

/** @param {Spill} told */
function fill_track({ spill }) {
  const variants = words.tracks(own.files);
  const sign = JSON.stringify([chosen(variants, spill.values).id, own.files]);
  if (own.track !== sign) {
    own.track = sign;
    get("track-fields").replaceChildren(...variants_of("spill", "The ship's track is", variants, spill.values, tools));
  }
  fill_inputs(get("track-fields"), "spill", chosen(variants, spill.values).fields, spill);
  if ("track" in spill.values) form.show_known("track");
}

/** @param {number} k */
function off_shore(k) {
  const found = own.told?.shapes.finds[k];
  if (!found || found.mistake) return found ? "not on the shore" : "";
  return found.off_shore === null || found.off_shore < 50 ? "" : `${(found.off_shore / 1000).toFixed(1)} km from the shoreline`;
}

// --- on the map ----------------------------------------------------------------------------------------------------------
/** @param {Spill} told */
function draw({ rows, shapes }) {
  drawn.source.clear(true);
  const { track, losses, finds, patrols, teams } = shapes;
  if (track.length > 1) drawn.source.addFeature(shape("line", track, { look: "line", label: "ship's track" }));
  for (const at of track) drawn.source.addFeature(shape("point", [at], { look: "way" }));
  losses.forEach(({ points, period }) => {
    drawn.source.addFeature(shape("line", points, { look: "start", strong: true, label: period }));
  });
  /** @param {SpillTable} table @param {string} k @param {string} stem */
  const name = (table, k, stem) => String(rows[table][Number(k)]?.values.name ?? `${stem} ${Number(k) + 1}`);
  for (const [k, { points }] of Object.entries(patrols)) {
    drawn.source.addFeature(shape("line", points, { look: "legs", strong: true, label: name("patrol", k, "patrol") }));
  }
  for (const [k, { at, reach }] of Object.entries(teams)) {
    drawn.source.addFeature(shape("point", [at], { look: "way", label: name("patrol_unit", k, "team") }));
    if (reach) drawn.source.addFeature(shape("line", sea.circle(at, reach), { look: "way" }));
  }
  for (const [k, { at, mistake }] of Object.entries(finds)) {
    drawn.source.addFeature(shape("point", [at], { look: "find", label: name("find", k, "find") + (mistake ? ": not on the shore" : "") }));
  }
}

/** @param {Point | undefined} at @returns {Point[]} */
const around = (at) => (at ? sea.circle(at, 8000) : []);

/** @param {Point[] | undefined} points */
function look_at(points) {
  if (points?.length) sea.look_at(points);
  get("map").scrollIntoView({ block: "nearest" });
}

// --- new rows ------------------------------------------------------------------------------------------------------------
/**
 * Add a row, open it, and put the cursor into a field of it.
 * @param {SpillTable} table
 * @param {Table} row
 * @param {string} key of the field
 */
async function add(table, row, key) {
  const k = own.told?.rows[table].length ?? 0;
  LISTS[table].open(k);
  await tools.set([{ field: `${table}.${k}`, value: row }]);
  focus_unless_typing(all(`[data-own="${table}.${k}.${key}"]`)[0]);
}

/** @param {SpillTable} table @param {string} stem */
function free_name(table, stem) {
  const taken = new Set(names_of(table));
  let name = stem;
  for (let k = 2; taken.has(name); k++) name = `${stem} ${k}`;
  return name;
}

/** @type {[string, () => unknown][]} */
const ADDS = [
  ["add-class", () => add("spill.class", { name: free_name("spill.class", "container"), object: { immersion: [0.6, 0.9] } }, "number")],
  ["add-loss", () => add("spill.loss", { begin: "", length: "1 h" }, "begin")],
  ["add-patrol", () => add("patrol", { name: free_name("patrol", "patrol"), time: "", detection: 0.7, between: [""] }, "time")],
  ["add-team", () => add("patrol_unit", { name: free_name("patrol_unit", "team"), length: "20 km", detection: 0.7, first: "", base: "", reach: "40 km" }, "first")],
];
for (const [id, work] of ADDS) get(id).addEventListener("click", work);

// a find is dropped by a click on the coast; its time is asked for
get("add-find").append(button("Drop a find on the map", () => tools.pick("find", (at) => add("find", { name: free_name("find", "find 1"), at, time: "" }, "time"), false),
  { "data-pick": "find", "aria-pressed": "false" }));

// --- one object or many --------------------------------------------------------------------------------------------------
get("kind").addEventListener("change", async () => {
  const spill = get("kind").value === "spill";
  await form.work_on_text("kind", async () => {
    /** @type {{text: string}} */
    const told = await ask("/api/spill/turn", { text: text.value, spill });
    return told.text;
  });
  get("kind").value = form.is_spill() ? "spill" : "search"; // it may have been rejected
});

// --- the ship's track ----------------------------------------------------------------------------------------------------
async function list_tracks() {
  /** @type {{files: string[]}} */
  const { files } = await ask("/api/spill/tracks", {});
  own.files = files;
}

/** @param {File} file of the ship's positions */
const save_track = guarded(async (/** @type {File} */ file) => {
  await saved("/api/spill/track", file, get("ship-said"), "the file becomes the track of its ship");
  await list_tracks();
  await tools.set([{ field: "spill.track", value: file.name }]);
});
get("ship-file").addEventListener("change", () => {
  const file = get("ship-file").files?.[0];
  if (file) save_track(file);
  get("ship-file").value = "";
});
dropped({ takes: (file) => form.is_spill() && /\.(gpx|csv|nc)$/i.test(file.name), work: save_track });

/** Begin with a case that was just opened. */
export const begin = guarded(async () => {
  Object.assign(own, { told: null, track: "", fresh: true });
  for (const table of TABLES) LISTS[table].again();
  drawn.source.clear(true);
  get("ship-said").textContent = "";
  form.also_wrong([]);
  await list_tracks();
  if (!own.objects.length) {
    /** @type {{objects: DriftObject[]}} */
    const { objects } = await ask("/api/objects");
    own.objects = objects.map((one) => [one.name, `${one.words[0] ?? one.name}: ${one.description}`]);
  }
});
