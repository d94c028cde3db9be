// The step "Search": what was searched, what was seen, and the units and times of the plan, each a row of the case.
import { layer_of, search_shapes, shape } from "./drawn.js";
import { opened, tab, text } from "./editor.js";
import * as form from "./form.js";
import { all, ask, button, get, guarded, make, Rejected } from "./kit.js";
import * as sea from "./map.js";
import { fill_inputs, inputs_of } from "./rows.js";
import * as words from "./searches.js";

const LARGEST = 2 ** 20; // [bytes] of a track
const own = {
  told: /** @type {Searches | null} */ (null),
  files: /** @type {string[]} */ ([]),
  built: /** @type {Record<string, string>} */ ({}), // what each list was built for
  open: /** @type {string | null} */ (null), // the row that was just added
  fresh: false, // whether the map has yet to go to the searches of a case that was just opened
};
const drawn = layer_of(25);
sea.switch_with("searches", drawn.layer);

/** @type {RowTools} */
const tools = {
  set: form.change,
  pick: (field, told, several) => form.pick_for(field, told, several),
  files: () => own.files,
};

/** The lists: the fields of a row, what it is, and how its heading reads. */
const LISTS = /** @type {Record<Listed3, ListSpec>} */ ({
  sortie: { fields: words.fields_of_sortie, kind: words.kind_of_sortie, labels: words.PATTERNS, empty: "Nothing was searched yet." },
  contact: { fields: words.fields_of_contact, kind: words.kind_of_contact, labels: words.CONTACTS, empty: "No sighting, find or bearing yet." },
  unit: { fields: () => words.UNIT, kind: () => "", labels: {}, empty: "No unit yet: a plan needs at least one." },
});
const TABLES = /** @type {Listed3[]} */ (Object.keys(LISTS));

/** @param {Row} row */
const by_tables = ({ values }) => Object.keys(values).some((key) => key.startsWith("sweep_width."));

// --- from the text to the rows -------------------------------------------------------------------------------------------
/** Read the searches of the text, and show them. */
async function refresh() {
  /** @type {Searches} */
  const told = await ask("/api/search", { text: text.value, name: opened.name });
  own.told = told;
  fill_choices(told);
  for (const table of TABLES) list(table, told);
  fill_inputs(get("plan-fields"), "plan", words.PLAN, told.plan);
  draw(told);
  const points = [...Object.keys(told.shapes.sortie).flatMap((k) => points_of("sortie", Number(k))),
    ...Object.keys(told.shapes.contact).flatMap((k) => points_of("contact", Number(k)))];
  if (own.fresh && points.length && !sea.shown.areas) sea.look_at([sea.middle(), ...points]);
  own.fresh = false;
}
form.follow(refresh);

/** @param {Searches} told */
function fill_choices({ search_objects }) {
  const place = get("search-object");
  if (place.children.length > 1) return;
  place.append(make("option", { value: "" }, "not stated"), ...search_objects.map((one) => make("option", { value: one }, one)));
}

/**
 * Show the rows of a table; elements stay while the tables keep their fields.
 * @param {Listed3} table
 * @param {Searches} told
 */
function list(table, told) {
  const spec = LISTS[table];
  const rows = told.rows[table];
  const place = get(`${table}-rows`);
  const sign = JSON.stringify([rows.map((row) => [spec.kind(row.values), by_tables(row), row.in_text]), own.files]);
  if (own.built[table] !== sign) {
    own.built[table] = sign;
    const focus = document.activeElement instanceof HTMLElement ? document.activeElement.dataset.own : undefined;
    const open = new Set(all("details[open]", place).map((one) => one.dataset.row));
    if (own.open) open.add(own.open);
    own.open = null;
    place.replaceChildren(...rows.map((row, k) => new_row(table, row, k, open.has(`${table}.${k}`))));
    if (!rows.length) place.append(make("li", { class: "soft" }, spec.empty));
    if (focus) all(`[data-own="${CSS.escape(focus)}"]`)[0]?.focus();
  }
  rows.forEach((row, k) => {
    const prefix = `${table}.${k}`;
    const item = place.children[k];
    fill_inputs(item, prefix, [...spec.fields(row.values), ...words.WIDTH, ...words.CONDITIONS], row);
    const heading = item.querySelector("summary");
    heading?.replaceChildren(...heading_of(table, row, k, told));
  });
}

/**
 * @param {Listed3} table
 * @param {Row} row
 * @param {number} k
 * @param {Searches} told
 */
function heading_of(table, { values }, k, told) {
  const spec = LISTS[table];
  const name = String(values.name ?? `${table} ${k + 1}`);
  const parts = [spec.labels[spec.kind(values)]?.label];
  const shapes = told.shapes.sortie[k];
  if (table === "sortie" && shapes) {
    parts.push(shapes.period);
    if (shapes.track_nmi) parts.push(`${shapes.track_nmi} nmi in ${shapes.legs_number} legs`);
    if (shapes.pod !== null) parts.push(`POD ${Math.round(100 * shapes.pod)} %`);
  }
  if (table === "unit") parts.push(`${values.search_speed ?? "?"}, ${values.endurance ?? "?"} on scene`);
  return [make("strong", {}, name), `: ${parts.filter(Boolean).join(", ")}`];
}

/**
 * @param {Listed3} table
 * @param {Row} row
 * @param {number} k
 * @param {boolean} open
 */
function new_row(table, row, k, open) {
  const prefix = `${table}.${k}`;
  const spec = LISTS[table];
  const box = make("details", { "data-row": prefix, open }, make("summary", {}), ...inputs_of(prefix, spec.fields(row.values), tools));
  if (table !== "contact") box.append(...width_of(prefix, row));
  if (row.in_text.length) box.append(make("p", { class: "soft" }, `Also set, in the text: ${row.in_text.join(", ")}.`));
  const name = String(row.values.name ?? `${table} ${k + 1}`);
  box.append(make("p", { class: "line" },
    ...(table === "unit" ? [] : [button("Show on the map", () => go_to(table, k))]),
    button("Remove", () => tools.set([{ field: prefix, value: null }]), { "aria-label": `Remove ${name}` })));
  return make("li", {}, box);
}

/**
 * Return the inputs of the sweep width: given, or by the conditions.
 * @param {string} prefix
 * @param {Row} row
 */
function width_of(prefix, row) {
  const tables = by_tables(row);
  const choice = make("select", { id: `own-${prefix.replace(".", "-")}-how` });
  choice.append(make("option", { value: "" }, "a sweep width that is known"), make("option", { value: "tables" }, "the tables, by visibility and wind"));
  choice.value = tables ? "tables" : "";
  choice.addEventListener("change", () => {
    /** @type {Change[]} */
    const given = [{ field: `${prefix}.altitude`, value: null }, { field: `${prefix}.sweep_width`, value: "0.5 nmi" }];
    /** @type {Change[]} */
    const by = [{ field: `${prefix}.sweep_width`, value: null }, { field: `${prefix}.sweep_width.visibility`, value: "10 nmi" },
      { field: `${prefix}.sweep_width.wind`, value: "12 kn" }];
    tools.set(choice.value ? by : given);
  });
  const hint = tables
    ? "The tables are of the US Coast Guard; say above what is looked for."
    : "It misses as much inside this band as it finds outside: about twice the distance at which half is seen.";
  return [make("p", {}, make("label", { for: choice.id }, "How far it sees: by"), " ", choice),
    ...inputs_of(prefix, tables ? words.CONDITIONS : words.WIDTH, tools), make("p", { class: "soft" }, hint)];
}

// --- on the map ----------------------------------------------------------------------------------------------------------
/** @param {Searches} told */
function draw({ rows, shapes }) {
  drawn.source.clear(true);
  const name = (/** @type {Listed3} */ table, /** @type {string} */ k) => String(rows[table][Number(k)]?.values.name ?? `${table} ${Number(k) + 1}`);
  for (const [k, one] of Object.entries(shapes.sortie)) {
    drawn.source.addFeatures(search_shapes(one, { outline: "searched", legs: "legs", label: name("sortie", k) }));
  }
  for (const [k, many] of Object.entries(shapes.contact)) {
    drawn.source.addFeatures(many.map(({ shape: kind, points }) => {
      const form_of = kind === "region" ? "polygon" : kind === "line" ? "line" : "point";
      return shape(form_of, points, { look: "contact", label: kind === "point" ? name("contact", k) : "" });
    }));
  }
}

/** @param {"sortie" | "contact"} table @param {number} k */
function points_of(table, k) {
  const shapes = own.told?.shapes;
  if (table === "contact") return (shapes?.contact[k] ?? []).flatMap((one) => one.points);
  const one = shapes?.sortie[k];
  return [...(one?.outline ?? []), ...(one?.legs.flatMap((leg) => leg.points) ?? [])];
}

/** @param {Listed3} table @param {number} k */
function go_to(table, k) {
  if (table === "unit") return;
  const points = points_of(table, k);
  if (points.length) sea.look_at(points);
  get("map").scrollIntoView({ block: "nearest" });
}

// --- new rows ------------------------------------------------------------------------------------------------------------
/** Return the middle of the map as a position of a case. */
const middle = () => form.spelled(sea.middle());

/** Return a time for a new row: the end of the last sortie, or an hour after the start. */
function next_start() {
  const starts = (own.told?.rows.sortie ?? []).map(({ values }) => String(values.start ?? "").match(/^\+([\d.]+) h$/)?.[1]);
  return `+${Math.max(0, ...starts.map((hours) => Number(hours ?? 0))) + 1} h`;
}

/** @param {Listed3} table @param {string} stem */
function free_name(table, stem) {
  const taken = new Set((own.told?.rows[table] ?? []).map((row) => row.values.name));
  let name = stem;
  for (let k = 2; taken.has(name); k++) name = `${stem} ${k}`;
  return name;
}

/** @param {Listed3} table @param {Table} row */
async function add(table, row) {
  const k = own.told?.rows[table].length ?? 0;
  own.open = `${table}.${k}`;
  await tools.set([{ field: `${table}.${k}`, value: row }]);
  all(`[data-own="${table}.${k}.name"]`)[0]?.focus();
}

for (const [id, kinds] of /** @type {[string, Record<string, PatternSpec>][]} */ ([["new-sortie", words.PATTERNS], ["new-contact", words.CONTACTS]])) {
  const kept = Object.entries(kinds).filter(([kind]) => kind !== "text");
  get(id).append(...kept.map(([kind, { label }]) => make("option", { value: kind }, label)));
}
get("add-sortie").addEventListener("click", () => {
  const kind = get("new-sortie").value;
  const track = own.files[0] ?? "track.gpx";
  add("sortie", words.new_sortie(kind, { name: free_name("sortie", "search"), at: middle(), start: next_start(), track }));
});
get("add-contact").addEventListener("click", () => {
  const kind = get("new-contact").value;
  const stem = kind === "debris" ? "debris" : kind === "position" ? "sighting" : kind;
  add("contact", words.new_contact(kind, { name: free_name("contact", stem), at: middle(), start: next_start() }));
});
get("add-unit").addEventListener("click", () => add("unit", words.new_unit({ name: free_name("unit", "unit"), at: middle() })));
get("plan-fields").append(...inputs_of("plan", words.PLAN, tools));

// --- tracks --------------------------------------------------------------------------------------------------------------
async function list_tracks() {
  /** @type {{files: string[]}} */
  const { files } = await ask("/api/search/tracks", {});
  own.files = files;
}

/**
 * Save a GPX file in the folder, and add it as a sortie.
 * @param {File} file
 */
const save_track = guarded(async (/** @type {File} */ file) => {
  if (file.size > LARGEST) throw new Error(`${file.name} is larger than 1 MB; cut it down to the search`);
  if (opened.name === null) throw new Error("open a case first; the track becomes a sortie of it");
  try {
    await ask("/api/search/gpx", { name: file.name, text: await file.text() });
  } catch (error) {
    if (!(error instanceof Rejected) || error.status !== 409) throw error;
    get("track-said").textContent = `${error.message}: the file of the folder is used.`;
  }
  await list_tracks();
  const name = free_name("sortie", file.name.replace(/\.gpx$/i, ""));
  await add("sortie", words.new_sortie("track", { name, at: "", start: next_start(), track: file.name }));
});
get("new-track").addEventListener("change", () => {
  const file = get("new-track").files?.[0];
  if (file) save_track(file);
  get("new-track").value = "";
});
document.addEventListener("dragover", (event) => {
  if (event.dataTransfer?.types.includes("Files")) event.preventDefault();
});
document.addEventListener("drop", (event) => {
  const file = event.dataTransfer?.files[0];
  if (!file) return;
  event.preventDefault();
  if (!/\.gpx$/i.test(file.name)) get("trouble").textContent = `${file.name} is no track: only GPX files (.gpx) can be dropped here.`;
  else {
    if (opened.name !== null) tab("search"); // where its sortie appears
    save_track(file);
  }
});

/** Begin with a case that was just opened. */
export const begin = guarded(async () => {
  Object.assign(own, { told: null, built: {}, open: null, fresh: true });
  drawn.source.clear(true);
  get("track-said").textContent = "";
  await list_tracks();
  if (own.told) list("sortie", own.told);
});
