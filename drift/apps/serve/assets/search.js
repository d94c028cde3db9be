// The step "Search": what was searched, what was seen, and the units and times of the plan, each a row of the case.
import { layer_of, search_shapes, shape } from "./drawn.js";
import { lacks, opened, tab, text } from "./editor.js";
import { dropped, saved } from "./files.js";
import * as form from "./form.js";
import { all, ask, focus_unless_typing, get, guarded, make } from "./kit.js";
import * as sea from "./map.js";
import { fill_inputs, inputs_of, list_of } from "./rows.js";
import * as words from "./searches.js";

const own = {
  told: /** @type {Searches | null} */ (null),
  files: /** @type {string[]} */ ([]),
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

/** A unit of another kind has another speed. @type {RowTools} */
const unit_tools = {
  ...tools,
  set: (changes) => tools.set(changes.flatMap((change) => {
    const [, prefix, k] = change.field.match(/^(unit\.(\d+))\.kind$/) ?? [];
    const values = own.told?.rows.unit[Number(k)]?.values;
    return [change, ...(prefix && values ? words.of_kind(prefix, change.value, values) : [])];
  })),
};

/** @param {Row} row */
const by_tables = ({ values }) => Object.keys(values).some((key) => key.startsWith("sweep_width."));

/** @param {string} prefix @param {Row} row @param {FieldSpec[]} fields */
const with_width = (prefix, row, fields, own_tools = tools) => [...inputs_of(prefix, fields, own_tools), ...width_of(prefix, row)];
/** @param {Row} row @param {string} kind */
const sign_of = (row, kind) => [kind, by_tables(row)];

/** The lists, by the tables of the case. */
const LISTS = {
  sortie: list_of(get("sortie-rows"), {
    table: "sortie",
    stem: "sortie",
    empty: "Nothing was searched yet.",
    fields: (values) => [...words.fields_of_sortie(values), ...words.WIDTH, ...words.CONDITIONS],
    inputs: (prefix, row) => with_width(prefix, row, words.fields_of_sortie(row.values)),
    sign: (row) => sign_of(row, words.kind_of_sortie(row.values)),
    heading: ({ values }, k) => [words.PATTERNS[words.kind_of_sortie(values)].label, ...figures_of(own.told?.shapes.sortie[k])],
    look: (k) => go_to("sortie", k),
  }, tools),
  contact: list_of(get("contact-rows"), {
    table: "contact",
    stem: "contact",
    empty: "No sighting, find or bearing yet.",
    fields: words.fields_of_contact,
    inputs: (prefix, row) => inputs_of(prefix, words.fields_of_contact(row.values), tools),
    sign: (row) => sign_of(row, words.kind_of_contact(row.values)),
    heading: ({ values }) => [words.CONTACTS[words.kind_of_contact(values)].label],
    look: (k) => go_to("contact", k),
  }, tools),
  unit: list_of(get("unit-rows"), {
    table: "unit",
    stem: "unit",
    empty: "No unit yet: a plan needs at least one.",
    fields: () => [...words.UNIT, ...words.WIDTH, ...words.CONDITIONS],
    inputs: (prefix, row) => with_width(prefix, row, words.UNIT, unit_tools),
    sign: (row) => sign_of(row, ""),
    heading: ({ values }) => [`${values.search_speed ?? "?"}, ${values.endurance ?? "?"} on scene`],
    look: (k) => go_to("unit", k),
  }, tools),
};
const TABLES = /** @type {Listed3[]} */ (Object.keys(LISTS));

// --- from the text to the rows -------------------------------------------------------------------------------------------
/** Read the searches of the text, and show them. */
async function refresh() {
  if (form.is_spill()) { // it has rows of its own
    own.told = null;
    drawn.source.clear(true);
    return;
  }
  /** @type {Searches} */
  const told = await ask("/api/search", { text: text.value, name: opened.name });
  own.told = told;
  fill_choices(told);
  for (const table of TABLES) LISTS[table].show(told.rows[table]);
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

/** @param {Searched | undefined} shapes */
function figures_of(shapes) {
  if (!shapes) return [];
  return [shapes.period, shapes.track_nmi ? `${shapes.track_nmi} nmi in ${shapes.legs_number} legs` : "",
    shapes.pod === null ? "" : `POD ${Math.round(100 * shapes.pod)} %`];
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
  for (const [k, base] of Object.entries(shapes.unit)) {
    drawn.source.addFeature(shape("point", [base], { look: "way", label: `${name("unit", k)}: base` }));
  }
}

/** @param {Listed3} table @param {number} k @returns {Point[]} */
function points_of(table, k) {
  const shapes = own.told?.shapes;
  if (table === "unit") return shapes?.unit[k] ? sea.circle(shapes.unit[k], 8000) : [];
  if (table === "contact") return (shapes?.contact[k] ?? []).flatMap((one) => one.points);
  const one = shapes?.sortie[k];
  return [...(one?.outline ?? []), ...(one?.legs.flatMap((leg) => leg.points) ?? [])];
}

/** @param {Listed3} table @param {number} k */
function go_to(table, k) {
  const points = points_of(table, k);
  if (points.length) sea.look_at(points);
  get("map").scrollIntoView({ block: "nearest" });
}

// --- new rows ------------------------------------------------------------------------------------------------------------
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
  LISTS[table].open(k);
  await tools.set([{ field: `${table}.${k}`, value: row }]);
  focus_unless_typing(all(`[data-own="${table}.${k}.name"]`)[0]);
}

for (const [id, kinds] of /** @type {[string, Record<string, PatternSpec>][]} */ ([["new-sortie", words.PATTERNS], ["new-contact", words.CONTACTS]])) {
  const kept = Object.entries(kinds).filter(([kind]) => kind !== "text");
  get(id).append(...kept.map(([kind, { label }]) => make("option", { value: kind }, label)));
}
get("add-sortie").addEventListener("click", () => {
  const kind = get("new-sortie").value;
  const track = own.files[0] ?? "track.gpx";
  add("sortie", words.new_sortie(kind, { name: free_name("sortie", "search"), track }));
});
get("add-contact").addEventListener("click", () => {
  const kind = get("new-contact").value;
  const stem = kind === "debris" ? "debris" : kind === "position" ? "sighting" : kind;
  add("contact", words.new_contact(kind, { name: free_name("contact", stem) }));
});
get("add-unit").addEventListener("click", () => add("unit", words.new_unit({ name: free_name("unit", "unit") })));
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
  await saved("/api/search/gpx", file, get("track-said"), "the track becomes a sortie of it");
  await list_tracks();
  const name = free_name("sortie", file.name.replace(/\.gpx$/i, ""));
  await add("sortie", words.new_sortie("track", { name, track: file.name }));
});
get("new-track").addEventListener("change", () => {
  const file = get("new-track").files?.[0];
  if (file) save_track(file);
  get("new-track").value = "";
});
dropped({
  /** @param {File} file */
  takes: (file) => !form.is_spill() && /\.gpx$/i.test(file.name),
  /** @param {File} file */
  work: (file) => {
    if (opened.name !== null) tab("search"); // where its sortie appears
    save_track(file);
  },
});

/** Return whether there is a unit to plan for; if not, show where to add it. */
export function can_plan() {
  return own.told?.rows.unit.length !== 0 || lacks("A plan needs at least one unit: add it under 7, then press again.", get("add-unit"));
}

/** Begin with a case that was just opened. */
export const begin = guarded(async () => {
  Object.assign(own, { told: null, fresh: true });
  for (const table of TABLES) LISTS[table].again();
  drawn.source.clear(true);
  get("track-said").textContent = "";
  await list_tracks();
  if (own.told) LISTS.sortie.show(own.told.rows.sortie);
});
